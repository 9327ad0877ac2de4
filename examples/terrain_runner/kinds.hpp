// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstddef>

namespace terrain_runner {

/// Ways to clear an obstacle: a step up, a box, a cliff down (drop-roll).
enum class Kind { jump, vault, drop };
inline constexpr std::array<Kind, 3> kinds{Kind::jump, Kind::vault, Kind::drop};
/// "jump", "vault" or "drop".
inline const char* name_of(Kind kind) {
  constexpr std::array<const char*, kinds.size()> names{"jump", "vault", "drop"};
  return names[static_cast<std::size_t>(kind)];
}
inline std::size_t index_of(Kind kind) { return static_cast<std::size_t>(kind); }

/// One thing of each kind.
template <class T>
using OfKinds = std::array<T, kinds.size()>;

}  // namespace terrain_runner
