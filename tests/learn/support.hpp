// SPDX-License-Identifier: MIT
// Two moving characters that differ a little, for tracking rewards and terminations.
#pragma once

#include <vector>

#include <traceur/body/pose.hpp>
#include <traceur/learn/tracking_state.hpp>

#include "../body/support.hpp"

namespace learn_test {

using body_test::creature;
using body_test::random_pose;
using body_test::random_tangent;
using traceur::body::Character;
using traceur::body::Skeleton;
using traceur::core::Quaternion;
using traceur::core::RandomStream;
using traceur::core::Vector3;
using traceur::learn::TrackingState;

inline TrackingState<double> at(const Character& c, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  TrackingState<double> s(c);
  s.q.assign(q.data(), q.data() + q.size());
  s.v.assign(v.data(), v.data() + v.size());
  s.measure(c);
  return s;
}

/// A reference and, for each share of an error in pose and velocity, what tracks it that badly.
struct Pair {
  Character character = creature();
  Eigen::VectorXd q, v, dq, dv;

  explicit Pair(std::uint64_t seed) {
    RandomStream random(seed);
    const Skeleton& s = character.skeleton;
    q = random_pose(s, random);
    v = random_tangent(s, random, 2);
    dq = random_tangent(s, random, 0.3);
    dv = random_tangent(s, random, 1);
  }
  TrackingState<double> reference() const { return at(character, q, v); }
  TrackingState<double> off(double pose, double velocity) const {
    Eigen::VectorXd moved = q;
    const Eigen::VectorXd d = pose * dq;
    traceur::body::displace(character.skeleton, q.data(), d.data(), moved.data());
    return at(character, moved, v + velocity * dv);
  }
};

/// The same state in every lane of a pack.
template <class P>
TrackingState<P> wide(const Character& c, const TrackingState<double>& s) {
  TrackingState<P> out(c);
  for (std::size_t i = 0; i < s.q.size(); ++i) out.q[i] = P(s.q[i]);
  for (std::size_t i = 0; i < s.v.size(); ++i) out.v[i] = P(s.v[i]);
  out.measure(c);
  return out;
}

/// Calls f(reward at error size u) for growing u and says whether it always falls.
template <class F>
bool falls(F&& f) {
  double before = f(0.0);
  for (double u = 0.1; u < 1.05; u += 0.1) {
    const double now = f(u);
    if (!(now < before)) return false;
    before = now;
  }
  return true;
}

}  // namespace learn_test
