// SPDX-License-Identifier: MIT
#pragma once

#include <string>

#include <traceur/core/error.hpp>

namespace traceur_test {

/// What the Error says that f throws; nothing if it throws none.
template <class F>
std::string message(F&& f) {
  try {
    f();
  } catch (const traceur::Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace traceur_test
