// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <cstdio>

namespace example {

/// Thrown by a long step after it has saved what it needs to go on another day.
struct Interrupted {};

/// Notes Ctrl-C and termination requests from now on; a second one ends the program at once.
void listen_for_interruption();
bool interruption_asked();

class Clock {
public:
  double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count(); }

private:
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

/// Lines about a long step, with the time that is left if it goes on as it has; at most one every two seconds, and the
/// last.
class ProgressLine {
public:
  ProgressLine(const char* step, int done, int all) : step_(step), first_(done), all_(all) {}

  void tell(int done, const char* detail) {
    const double now = clock_.seconds();
    if (done < all_ && now - told_ < 2 && told_ > 0) return;
    told_ = now;
    const double left = done > first_ ? now / (done - first_) * (all_ - done) : 0;
    std::printf("%s %d/%d: %s, at most %.0f s left\n", step_, done, all_, detail, left);
    std::fflush(stdout);
  }

private:
  const char* step_;
  int first_, all_;
  double told_ = 0;
  Clock clock_;
};

}  // namespace example
