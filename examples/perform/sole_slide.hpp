// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <vector>

#include "traceur/body/kinematics.hpp"
#include "traceur/control/roles.hpp"
#include "traceur/sim/ground.hpp"

namespace perform {

/// How fast the soles slide: the mean speed along the ground of the points of the feet that touch it, weighted by what each
/// carries. A body's load is shared among its points by their depth.
class SoleSlide {
public:
  SoleSlide(const traceur::sim::Model& model, const traceur::control::Roles& roles, const traceur::sim::Ground<float>& ground)
      : model_(model), roles_(roles), ground_(ground), last_(model.contacts.size()) {}

  /// Takes the next tick: where the bodies are, `seconds` after the last one, and the size of the force (N) on each moving body
  /// during it. A point counts when it touches at both ends of a tick: one that lands or leaves does not slide.
  template <class Load>
  void add(const traceur::body::Frames<double>& frames, double seconds, Load&& load) {
    using traceur::core::Vector3;
    for (const auto& leg : roles_.legs) {
      const traceur::sim::MovingBody& foot = model_.bodies[static_cast<std::size_t>(leg.foot)];
      std::vector<Point> now(static_cast<std::size_t>(foot.contacts));
      double depths = 0;
      for (int i = 0; i < foot.contacts; ++i) {
        const traceur::sim::ContactSphere& s = model_.contacts[static_cast<std::size_t>(foot.first_contact + i)];
        const Vector3<double> center = frames.point(foot.joint, s.center);
        const auto under = ground_.sample(center.cast<float>());
        Point& p = now[static_cast<std::size_t>(i)];
        p.normal = under.normal.cast<double>();
        p.depth = std::max(0.0, s.radius - static_cast<double>(under.distance));
        p.at = center - s.radius * p.normal;
        p.on_foot = frames.rotation[static_cast<std::size_t>(foot.joint)].conjugate().rotate(
            p.at - frames.position[static_cast<std::size_t>(foot.joint)]);
        depths += p.depth;
      }
      for (int i = 0; i < foot.contacts; ++i) {
        const Point& p = now[static_cast<std::size_t>(i)];
        Point& before = last_[static_cast<std::size_t>(foot.first_contact + i)];
        if (seen_ && p.depth > 0 && before.depth > 0) {
          const Vector3<double> moved = frames.point(foot.joint, before.on_foot) - before.at;
          const double weight = load(leg.foot) * p.depth / depths;
          sum_ += weight * norm(moved - dot(moved, p.normal) * p.normal) / seconds;
          weights_ += weight;
        }
        before = p;
      }
    }
    seen_ = true;
  }

  /// m/s; 0 if nothing has stood.
  double mean() const { return weights_ > 0 ? sum_ / weights_ : 0; }

private:
  struct Point {
    traceur::core::Vector3<double> at{0, 0, 0}, on_foot{0, 0, 0}, normal{0, 0, 1};
    double depth = 0;
  };

  const traceur::sim::Model& model_;
  const traceur::control::Roles& roles_;
  const traceur::sim::Ground<float>& ground_;
  std::vector<Point> last_;
  bool seen_ = false;
  double sum_ = 0, weights_ = 0;
};

}  // namespace perform
