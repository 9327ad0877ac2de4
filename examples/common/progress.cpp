// SPDX-License-Identifier: MIT
#include "progress.hpp"

#include <csignal>

namespace example {

namespace {
volatile std::sig_atomic_t asked = 0;
extern "C" void note(int signal) {
  asked = 1;
  std::signal(signal, SIG_DFL);
}
}  // namespace

void listen_for_interruption() {
  std::signal(SIGINT, note);
  std::signal(SIGTERM, note);
}
bool interruption_asked() { return asked != 0; }

}  // namespace example
