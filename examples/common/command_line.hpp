// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include <CLI/CLI.hpp>

#include "traceur/core/error.hpp"

namespace example {

/// Whether the program is to go on: not when help or the version was asked for, and printed. Throws traceur::Error of one
/// line.
inline bool parse(CLI::App& app, int argc, char** argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& s) {
    app.exit(s);
    return false;
  } catch (const CLI::ParseError& e) {
    std::string what = e.what();
    for (char& c : what)
      if (c == '\n') c = ' ';
    throw traceur::Error(what + " (--help lists the options)");
  }
  return true;
}

}  // namespace example
