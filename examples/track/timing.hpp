// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <string>

#include "../common/progress.hpp"

namespace track {

/// How long a run has taken, over all its parts: `timing.csv` in its folder, with a line for every checkpoint. It is kept
/// apart from checkpoints, which are equal byte for byte when runs are.
class Timing {
public:
  /// Goes on where the file leaves off, or begins anew.
  Timing(const std::filesystem::path& folder, bool resume);

  double seconds() const { return before_ + clock_.seconds(); }
  /// Writes a line down.
  void note(double samples);

private:
  std::filesystem::path path_;
  std::string text_ = "samples,wall_s\n";
  double before_ = 0;
  example::Clock clock_;
};

}  // namespace track
