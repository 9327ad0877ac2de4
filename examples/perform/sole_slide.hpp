// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <vector>

#include "traceur/body/kinematics.hpp"
#include "traceur/control/roles.hpp"
#include "traceur/sim/contact.hpp"
#include "traceur/sim/ground.hpp"

namespace perform {

/// How fast loaded soles move along the ground: means over the points of the feet that touch it, weighted by what each carries.
/// Points are of the foot's material, so a foot that rolls over its edge moves none of those it rests on.
struct SlideShares {
  double moved_m_s = 0;  ///< all of it
  // Of the bundled simulator, step by step:
  double slip_m_s = 0;   ///< with friction at its cone: the anchor of the contact's bristle goes along
  double give_m_s = 0;   ///< the bristle's own bending, back and forth about an anchor that stays
  double drift_m_s = 0;  ///< within the cone, by what the time step's velocities leave out of the way that a point goes
};

class SoleSlide {
public:
  /// `friction` is that of every contact.
  SoleSlide(const traceur::sim::Model& model, const traceur::control::Roles& roles, const traceur::sim::Ground<float>& ground,
            const traceur::sim::Parameters& simulation)
      : model_(model), roles_(roles), ground_(ground), simulation_(simulation), last_(model.contacts.size()) {}

  /// Takes where the bodies are `seconds` after the last call, in the middle of which the force (N) on a moving body was
  /// `load(body)`. A body's load is shared among its points by their depth. A point counts when it touches at both ends: one
  /// that lands or leaves does not slide.
  template <class Load>
  void add(const traceur::body::Frames<double>& frames, double seconds, Load&& load) {
    each_foot(frames, [&](int body, double depths, const Point& before, Point& now, std::size_t) {
      if (!(seen_ && before.depth > 0 && now.depth > 0)) return;
      weigh(load(body) * now.depth / depths, moved(frames, body, before), seconds, &SlideShares::moved_m_s);
    });
  }

  /// The same after one time step of the bundled simulator, with what its contacts remember: `memory(c)` of sphere `c`. Points
  /// count by their own normal force.
  template <class Memory>
  void add_step(const traceur::body::Frames<double>& frames, Memory&& memory) {
    const double dt = simulation_.dt;
    each_foot(frames, [&](int body, double, const Point& before, Point& now, std::size_t c) {
      const traceur::sim::ContactMemory<double> m = memory(c);
      now.bristle = m.bristle;
      now.force = m.normal_force;
      if (!(seen_ && before.force > 0 && now.force > 0)) return;
      const Vector3 way = moved(frames, body, before), give = now.bristle - before.bristle, rest = way - give;
      // The bristle is cut to the cone's edge while the contact slides.
      const double edge = simulation_.friction * now.force / simulation_.bristle_stiffness;
      const bool slides = norm(now.bristle) > 0.999 * edge;
      weigh(now.force, way, dt, &SlideShares::moved_m_s);
      sums_.give_m_s += now.force * norm(give) / dt;
      (slides ? sums_.slip_m_s : sums_.drift_m_s) += now.force * norm(rest) / dt;
    });
  }

  /// Zeros if nothing has stood.
  SlideShares mean() const {
    SlideShares out = sums_;
    for (double* x : {&out.moved_m_s, &out.slip_m_s, &out.give_m_s, &out.drift_m_s}) *x = weights_ > 0 ? *x / weights_ : 0;
    return out;
  }

private:
  using Vector3 = traceur::core::Vector3<double>;
  struct Point {
    Vector3 at{0, 0, 0}, on_foot{0, 0, 0}, normal{0, 0, 1}, bristle{0, 0, 0};
    double depth = 0, force = 0;
  };

  template <class Use>
  void each_foot(const traceur::body::Frames<double>& frames, Use&& use) {
    for (const auto& leg : roles_.legs) {
      const traceur::sim::MovingBody& foot = model_.bodies[static_cast<std::size_t>(leg.foot)];
      const auto joint = static_cast<std::size_t>(foot.joint);
      std::vector<Point> now(static_cast<std::size_t>(foot.contacts));
      double depths = 0;
      for (std::size_t i = 0; i < now.size(); ++i) {
        const traceur::sim::ContactSphere& s = model_.contacts[static_cast<std::size_t>(foot.first_contact) + i];
        const Vector3 center = frames.point(foot.joint, s.center);
        const auto under = ground_.sample(center.cast<float>());
        Point& p = now[i];
        p.normal = under.normal.cast<double>();
        p.depth = std::max(0.0, s.radius - static_cast<double>(under.distance));
        p.at = center - s.radius * p.normal;
        p.on_foot = frames.rotation[joint].conjugate().rotate(p.at - frames.position[joint]);
        depths += p.depth;
      }
      for (std::size_t i = 0; i < now.size(); ++i) {
        const std::size_t c = static_cast<std::size_t>(foot.first_contact) + i;
        use(leg.foot, depths, last_[c], now[i], c);
        last_[c] = now[i];
      }
    }
    seen_ = true;
  }

  /// Along the ground, of the foot's material at a point.
  Vector3 moved(const traceur::body::Frames<double>& frames, int body, const Point& before) const {
    const Vector3 way = frames.point(model_.bodies[static_cast<std::size_t>(body)].joint, before.on_foot) - before.at;
    return way - dot(way, before.normal) * before.normal;
  }
  void weigh(double weight, const Vector3& way, double seconds, double SlideShares::*sum) {
    sums_.*sum += weight * norm(way) / seconds;
    weights_ += weight;
  }

  const traceur::sim::Model& model_;
  const traceur::control::Roles& roles_;
  const traceur::sim::Ground<float>& ground_;
  const traceur::sim::Parameters& simulation_;
  std::vector<Point> last_;
  bool seen_ = false;
  SlideShares sums_;
  double weights_ = 0;
};

}  // namespace perform
