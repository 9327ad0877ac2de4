// SPDX-License-Identifier: MIT
#pragma once

#include <cstdio>
#include <utility>

#include "plain.hpp"
#include "traceur/io/mjcf.hpp"
#include "traceur/sim/scene.hpp"

namespace example {

/// A simulator of one lane in plain numbers.
template <class W>
class Plain : public PlainSimulator {
public:
  explicit Plain(const EngineRequest& r)
      : simulator_(traceur::io::parse_mjcf(r.character, "character"), 1, r.parameters, scene(r)),
        nq_(simulator_.character().skeleton.nq()),
        nv_(simulator_.character().skeleton.nv()) {}

  void reset(const double* q, const double* v) override {
    simulator_.reset(0, Vector::Map(q, nq_), Vector::Map(v, nv_));
  }
  void set_target(const double* q) override { simulator_.set_target(0, Vector::Map(q, nq_)); }
  void push(int joint, const double* force, const double* point) override {
    simulator_.push(0, joint, Vector3::from(force), Vector3::from(point));
  }
  void hold(int joint, const double* point, const double* anchor) override { simulator_.hold(0, joint, Vector3::from(point), Vector3::from(anchor)); }
  void release(int joint) override { simulator_.release(0, joint); }
  void contact_force(int joint, double* out) const override { simulator_.contact_force(0, joint).store(out); }
  void step(int count) override { simulator_.step(count); }
  void pose(double* q) const override {
    Eigen::Map<Vector> out(q, nq_);
    simulator_.pose(0, out);
  }
  void velocity(double* v) const override {
    Eigen::Map<Vector> out(v, nv_);
    simulator_.velocity(0, out);
  }
  bool failed() const override { return simulator_.failed(0); }

private:
  using Vector = Eigen::VectorXd;
  using Vector3 = traceur::core::Vector3<double>;

  static traceur::sim::Scene scene(const EngineRequest& r) {
    traceur::sim::Scene s;
    if (r.heights_m)
      s.ground = traceur::terrain::HeightGrid(Eigen::MatrixXd::Map(r.heights_m, r.nx, r.ny), r.cell_m, r.x0_m, r.y0_m);
    return s;
  }

  W simulator_;
  Eigen::Index nq_, nv_;
};

template <class P>
PlainSimulator* make_plain(const EngineRequest& request, char* fault, int size) {
  try {
    return new P(request);
  } catch (const std::exception& e) {
    std::snprintf(fault, static_cast<std::size_t>(size), "%s", e.what());
    return nullptr;
  }
}

}  // namespace example
