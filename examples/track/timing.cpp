// SPDX-License-Identifier: MIT
#include "timing.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include "traceur/io/atomic_file.hpp"

namespace track {

Timing::Timing(const std::filesystem::path& folder, bool resume) : path_(folder / "timing.csv") {
  std::ifstream in(path_);
  if (!resume || !in) return;
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    const auto comma = line.find(',');
    const double seconds = comma == std::string::npos ? -1 : std::strtod(line.c_str() + comma + 1, nullptr);
    // Times are for people to read: what is not one is passed over.
    if (!(seconds >= 0) || !std::isfinite(seconds)) continue;
    before_ = seconds;
    text_ += line + "\n";
  }
}

void Timing::note(double samples) {
  char line[64];
  std::snprintf(line, sizeof line, "%.0f,%.3f\n", samples, seconds());
  text_ += line;
  traceur::io::write_atomically(path_, text_);
}

}  // namespace track
