// SPDX-License-Identifier: MIT
#pragma once

#include <stdexcept>

namespace traceur {

/// Thrown by constructors and loaders. `what()` is one line that names the file, line or field at fault and says what
/// was expected.
class Error : public std::runtime_error {
public:
  using std::runtime_error::runtime_error;
};

}  // namespace traceur
