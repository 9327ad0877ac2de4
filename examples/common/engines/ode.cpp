// SPDX-License-Identifier: MIT
#include "traceur/backends/ode.hpp"

#include <mutex>

#include "adaptor.hpp"

namespace {

/// ODE as distributions build it has one set of collision data for the whole process, so one thread steps at a time.
std::mutex turn;

class OdeInTurn final : public example::Plain<traceur::backends::Ode> {
public:
  using Plain::Plain;
  void reset(const double* q, const double* v) override {
    const std::lock_guard<std::mutex> lock(turn);
    Plain::reset(q, v);
  }
  void step(int count) override {
    const std::lock_guard<std::mutex> lock(turn);
    // Where it was built otherwise, it wants such data in every thread.
    dAllocateODEDataForThread(static_cast<unsigned int>(dAllocateMaskAll));
    Plain::step(count);
  }
};

}  // namespace

example::PlainSimulator* example::make_ode(const EngineRequest& request, char* fault, int size) {
  return make_plain<OdeInTurn>(request, fault, size);
}
