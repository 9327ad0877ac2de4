// SPDX-License-Identifier: MIT
#pragma once

#include <cstdio>
#include <exception>
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

/// A program's main: reads the options, runs unless only help was asked for, and returns the exit status. What is wrong with
/// the arguments or the input is one line that begins with the program's name, and status 2.
template <class Read, class Run>
int main_of(const char* program, int argc, char** argv, Read&& read, Run&& run) {
  try {
    const auto options = read(argc, argv);
    return options ? run(*options) : 0;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s: %s\n", program, e.what());
    return 2;
  }
}

}  // namespace example
