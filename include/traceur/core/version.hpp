// SPDX-License-Identifier: MIT
#pragma once

#include <compare>
#include <string_view>

namespace traceur::core {

/// A release of this library. Before 1.0 a new minor number may break callers; a new patch number does not.
struct Version {
  int major;
  int minor;
  int patch;

  friend constexpr auto operator<=>(const Version&, const Version&) = default;
};

/// The release these headers belong to, and the same as "major.minor.patch".
inline constexpr Version version{0, 1, 0};
inline constexpr std::string_view version_string{"0.1.0"};

}  // namespace traceur::core
