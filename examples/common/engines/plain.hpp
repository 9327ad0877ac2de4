// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <string>

#include "traceur/sim/parameters.hpp"

namespace example {

/// What an engine is made for: plain numbers and text, so that it may be compiled with other flags than its user.
struct EngineRequest {
  const char* character = nullptr;  ///< MJCF
  traceur::sim::Parameters parameters;
  const double* heights_m = nullptr;  ///< of a height grid, nx x ny, x fastest; null: level ground at 0
  int nx = 0, ny = 0;
  double cell_m = 0, x0_m = 0, y0_m = 0;
};

/// One character in a physics engine, in plain numbers: the laws of sim::Simulator, of one lane.
class PlainSimulator {
public:
  virtual ~PlainSimulator() = default;
  virtual void reset(const double* q, const double* v) = 0;
  virtual void set_target(const double* q) = 0;
  virtual void push(int joint, const double* force, const double* point) = 0;
  virtual void hold(int joint, const double* point, const double* anchor) = 0;
  virtual void release(int joint) = 0;
  virtual void contact_force(int joint, double* out) const = 0;
  virtual void step(int count) = 0;
  virtual void pose(double* q) const = 0;
  virtual void velocity(double* v) const = 0;
  virtual bool failed() const = 0;
};

/// Makes a simulator, or returns null with one line of at most `size` - 1 characters in `fault`.
using EngineFactory = PlainSimulator*(const EngineRequest& request, char* fault, int size);

// One for each engine that was found when this was built.
EngineFactory make_mujoco, make_bullet, make_ode, make_dart;

}  // namespace example
