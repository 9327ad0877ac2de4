// SPDX-License-Identifier: MIT
#pragma once

#include "../common/progress.hpp"
#include "course.hpp"

namespace terrain_runner {

/// Watches one runner: how fast it is computed, and where it is. If `live`, it is held back so that simulated time is
/// never ahead of the wall's, and about once a second a line says where it is.
class Pace {
public:
  explicit Pace(bool live) : live_(live) {}

  /// A CourseRunner's watch; the first call begins the count. Throws example::Interrupted when interruption is asked
  /// for.
  void operator()(const CourseMoment& m);

  /// Simulated seconds for each second in which it was not held back; 0 before the first tick.
  double real_time_factor() const { return busy_ > 0 ? simulated_ / busy_ : 0; }
  /// The same for each second of a core's time, which what else the machine does has no part in.
  double core_time_factor() const { return core_ > 0 ? simulated_ / core_ : 0; }

private:
  bool live_;
  example::Clock clock_;
  double begun_ = 0, slept_ = 0, busy_ = 0, core_begun_ = 0, core_ = 0, simulated_ = 0, told_ = 0;  ///< s
};

}  // namespace terrain_runner
