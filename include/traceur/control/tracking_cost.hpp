// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "traceur/control/tracking_reference.hpp"
#include "traceur/sim/lanes.hpp"

namespace traceur::control {

/// Weights of the distance between a simulated state and a reference state; all terms are squared errors. The balance term
/// compares the horizontal vectors from the feet to the centre of mass, after Liu et al. 2010.
struct TrackingCostWeights {
  double points = 60;             ///< mean over tracked points, 1/m^2
  double center_of_mass = 20;     ///< 1/m^2
  double feet = 20;               ///< mean of both feet, 1/m^2
  double balance = 20;            ///< mean of both feet, 1/m^2
  double root_rotation = 5;       ///< 1/rad^2
  double joints = 1;              ///< weighted mean over joints, 1/rad^2
  double center_velocity = 1;     ///< s^2/m^2
  double root_angular_velocity = 0.05;  ///< s^2/rad^2
};

/// Pose distance between lanes of the simulator and one tick of a reference, evaluated on whole packs.
class TrackingCost {
 public:
  TrackingCost(const sim::Model& model, const Roles& roles, std::vector<TrackedPoint> points, const TrackingCostWeights& weights = {})
      : model_(&model), roles_(roles), points_(std::move(points)), weights_(weights) {
    // Joints count by their share of the body they move, so hands and head do not outweigh hips.
    joint_weight_.assign(model.bodies.size(), 0.0);
    std::vector<double> carried(model.bodies.size());
    double sum = 0;
    for (std::size_t b = model.bodies.size(); b-- > 1;) {
      carried[b] += model.bodies[b].mass;
      if (model.bodies[b].parent >= 0) carried[static_cast<std::size_t>(model.bodies[b].parent)] += carried[b];
      joint_weight_[b] = std::sqrt(carried[b]);
      sum += joint_weight_[b];
    }
    for (double& w : joint_weight_) w /= sum;
  }

  const std::vector<TrackedPoint>& points() const { return points_; }
  const sim::Model& model() const { return *model_; }
  const Roles& roles() const { return roles_; }

  /// Cost of every lane against tick `t` of the reference.
  template <class S>
  S operator()(const sim::Lanes<S>& lanes, const TrackingReference& r, int t) const {
    using core::Quaternion;
    using core::Vector3;
    using T = core::Element<S>;
    const auto constant = [](double x) { return S(static_cast<T>(x)); };
    const auto wide = [&](const double* p) { return Vector3<S>{constant(p[0]), constant(p[1]), constant(p[2])}; };
    const auto& w = lanes.work();
    S cost = constant(0);
    cost += constant(weights_.points / static_cast<double>(points_.size())) * point_error(lanes, r, t);
    const Vector3<S> com_error = w.center_of_mass - wide(r.center_of_mass.col(t).data());
    cost += constant(weights_.center_of_mass) * squared_norm(com_error);
    for (std::size_t side = 0; side < 2; ++side) {
      const Vector3<S> foot = w.bodies[static_cast<std::size_t>(roles_.legs[side].foot)].position - wide(r.feet.col(t).data() + 3 * side);
      cost += constant(0.5 * weights_.feet) * squared_norm(foot);
      const S bx = com_error.x - foot.x, by = com_error.y - foot.y;
      cost += constant(0.5 * weights_.balance) * (bx * bx + by * by);
    }
    const double* q = r.poses.col(t).data();
    const double* v = r.velocities.col(t).data();
    for (std::size_t b = 0; b < model_->bodies.size(); ++b) {
      const sim::MovingBody& m = model_->bodies[b];
      const int k = m.q_index + (m.type == body::JointType::free ? 3 : 0);
      const S* mine = lanes.q() + k;
      if (m.type == body::JointType::hinge) {
        const S d = mine[0] - constant(q[k]);
        cost += constant(weights_.joints * joint_weight_[b]) * d * d;
      } else {
        const Quaternion<S> ref{constant(q[k]), constant(q[k + 1]), constant(q[k + 2]), constant(q[k + 3])};
        const S d2 = squared_norm(log_map(Quaternion<S>::from(mine).conjugate() * ref));
        cost += constant(b == 0 ? weights_.root_rotation : weights_.joints * joint_weight_[b]) * d2;
      }
    }
    const Vector3<S> velocity = constant(1.0 / model_->total_mass) * w.linear_momentum - wide(r.center_velocity.col(t).data());
    cost += constant(weights_.center_velocity) * squared_norm(velocity);
    const Vector3<S> spin = Vector3<S>::from(lanes.v() + 3) - wide(v + 3);
    cost += constant(weights_.root_angular_velocity) * squared_norm(spin);
    return cost;
  }

  /// Sum over tracked points of squared position error, m^2.
  template <class S>
  S point_error(const sim::Lanes<S>& lanes, const TrackingReference& r, int t) const {
    using core::Vector3;
    using T = core::Element<S>;
    S sum(static_cast<T>(0));
    const double* p = r.points.col(t).data();
    for (std::size_t i = 0; i < points_.size(); ++i) sum += squared_norm(place(lanes, i) - Vector3<S>{S(static_cast<T>(p[3 * i])), S(static_cast<T>(p[3 * i + 1])), S(static_cast<T>(p[3 * i + 2]))});
    return sum;
  }

  /// World position of tracked point i in every lane, m.
  template <class S>
  core::Vector3<S> place(const sim::Lanes<S>& lanes, std::size_t i) const {
    using T = core::Element<S>;
    const TrackedPoint& p = points_[i];
    const auto& k = lanes.work().bodies[static_cast<std::size_t>(p.body)];
    return k.position + k.rotation * p.local.template cast<T>().template cast<S>();
  }

 private:
  const sim::Model* model_;
  Roles roles_;
  std::vector<TrackedPoint> points_;
  TrackingCostWeights weights_;
  std::vector<double> joint_weight_;
};

}  // namespace traceur::control
