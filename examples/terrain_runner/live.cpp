// SPDX-License-Identifier: MIT
#include "live.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <string>
#include <thread>

namespace terrain_runner {

namespace {

constexpr const char* stages[] = {"", ", the step before", "",
                                  ", coming back to balance"};  // as control::RunStage has them

double core_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

}  // namespace

void Pace::operator()(const CourseMoment& m) {
  if (m.seconds == 0) {
    begun_ = clock_.seconds();
    core_begun_ = core_seconds();
  }
  simulated_ = m.seconds;
  busy_ = clock_.seconds() - begun_ - slept_;
  core_ = core_seconds() - core_begun_;
  if (!live_) return;
  if (example::interruption_asked()) throw example::Interrupted{};
  if (m.seconds == 0 || m.seconds - told_ >= 1) {
    told_ = m.seconds;
    const std::string obstacle =
        m.next < m.obstacles ? std::to_string(m.next + 1) + " of " + std::to_string(m.obstacles) : "none left";
    std::printf("%5.1f s: %5.1f m, %.1f m/s, obstacle %s, %s%s\n", m.seconds, std::max(0.0, m.distance), m.speed,
                obstacle.c_str(), m.skill, stages[static_cast<int>(m.stage)]);
    std::fflush(stdout);
  }
  const double before = clock_.seconds(), ahead = m.seconds - (before - begun_);
  if (ahead <= 0) return;
  std::this_thread::sleep_for(std::chrono::duration<double>(ahead));
  slept_ += clock_.seconds() - before;
}

}  // namespace terrain_runner
