// SPDX-License-Identifier: MIT
#include <traceur/control/tracking_cost.hpp>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace figures;
using control::TrackingCost;
using control::TrackingCostWeights;

namespace {

const TrackingCostWeights none{0, 0, 0, 0, 0, 0, 0, 0};

/// A reference of one pose, as a clip of two ticks has it.
control::TrackingReference reference_at(const Figure& f, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  control::TrackingReference r;
  r.poses = q.replicate(1, 2);
  r.velocities = v.replicate(1, 2);
  control::measure_reference(f.model, f.roles, f.points, r);
  return r;
}

template <class S>
struct Stage {
  sim::Parameters parameters;
  sim::Ground<core::Element<S>> ground;
  sim::Lanes<S> lanes;
  explicit Stage(const Figure& f) : lanes(f.model, parameters, ground) {}
};

double cost_of(const Figure& f, const TrackingCostWeights& w, const control::TrackingReference& r, const Eigen::VectorXd& q,
               const Eigen::VectorXd& v) {
  Stage<double> s(f);
  put(s.lanes, 0, q, v);
  s.lanes.refresh();
  return TrackingCost(f.model, f.roles, f.points, w)(s.lanes, r, 0);
}

}  // namespace

TEST_CASE("the cost of the reference itself is zero") {
  for (const Figure* f : {&humanoid(), &small()}) {
    core::RandomStream random(11);
    const Eigen::VectorXd q = any_pose(*f, random), v = any_velocity(*f, random);
    CHECK(cost_of(*f, {}, reference_at(*f, q, v), q, v) < 1e-20);
    CHECK(cost_of(*f, {}, reference_at(*f, q, v), q, 1.1 * v) > 1e-4);
  }
}

TEST_CASE("carried away by d and by a velocity u, only the terms that see them rise") {
  const Figure& f = humanoid();
  core::RandomStream random(12);
  const Eigen::VectorXd q = any_pose(f, random), v = any_velocity(f, random);
  const control::TrackingReference r = reference_at(f, q, v);
  const Vector d{0.1, -0.2, 0.05}, u{0.3, 0.1, -0.2};
  Eigen::VectorXd moved = q, faster = v;
  (Vector::from(q.data()) + d).store(moved.data());
  (Vector::from(v.data()) + u).store(faster.data());
  const TrackingCostWeights w{60, 21, 22, 23, 5, 1, 1.5, 0.05};
  CHECK(cost_of(f, w, r, moved, v) == doctest::Approx((60 + 21 + 22) * squared_norm(d)));
  CHECK(cost_of(f, w, r, q, faster) == doctest::Approx(1.5 * squared_norm(u)));
  CHECK(cost_of(f, w, r, moved, faster) == doctest::Approx((60 + 21 + 22) * squared_norm(d) + 1.5 * squared_norm(u)));
}

TEST_CASE("each term is the squared error its weight names") {
  for (const Figure* f : {&humanoid(), &small()})
    for (std::uint64_t k = 0; k < 3; ++k) {
      core::RandomStream random(13, k);
      const Eigen::VectorXd q0 = any_pose(*f, random), v0 = any_velocity(*f, random);
      const Eigen::VectorXd d = 0.3 * any_velocity(*f, random), v1 = any_velocity(*f, random);
      Eigen::VectorXd q1(f->model.nq);
      body::displace(f->skeleton(), q0.data(), d.data(), q1.data());
      const control::TrackingReference r = reference_at(*f, q0, v0);
      const auto only = [&](double TrackingCostWeights::*term) {
        TrackingCostWeights w = none;
        w.*term = 3;
        return cost_of(*f, w, r, q1, v1) / 3;
      };
      const control::TrackingReference now = reference_at(*f, q1, v1);
      const Eigen::VectorXd points = now.points.col(0) - r.points.col(0), feet = now.feet.col(0) - r.feet.col(0);
      const Eigen::Vector3d com = now.center_of_mass.col(0) - r.center_of_mass.col(0);
      CHECK(only(&TrackingCostWeights::points) == doctest::Approx(points.squaredNorm() / static_cast<double>(f->points.size())));
      CHECK(only(&TrackingCostWeights::center_of_mass) == doctest::Approx(com.squaredNorm()));
      CHECK(only(&TrackingCostWeights::feet) == doctest::Approx(feet.squaredNorm() / 2));
      const double balance = ((com - feet.head(3)).head(2).squaredNorm() + (com - feet.tail(3)).head(2).squaredNorm()) / 2;
      CHECK(only(&TrackingCostWeights::balance) == doctest::Approx(balance));
      CHECK(only(&TrackingCostWeights::root_rotation) == doctest::Approx(d.segment(3, 3).squaredNorm()));
      CHECK(only(&TrackingCostWeights::center_velocity) ==
            doctest::Approx((now.center_velocity.col(0) - r.center_velocity.col(0)).squaredNorm()));
      CHECK(only(&TrackingCostWeights::root_angular_velocity) == doctest::Approx((v1 - v0).segment(3, 3).squaredNorm()));
      // A joint counts by the root of the mass it carries; the shares add up to one.
      double sum = 0, weights = 0;
      for (std::size_t b = 1; b < f->model.bodies.size(); ++b) {
        double carried = 0;
        for (int j = 0; j < f->skeleton().size(); ++j)
          for (int up = j; up >= 0; up = f->skeleton()[up].parent)
            if (up == f->model.bodies[b].joint) carried += f->model.character.inertias[static_cast<std::size_t>(j)].mass;
        const int n = body::velocity_size(f->model.bodies[b].type);
        sum += std::sqrt(carried) * d.segment(f->model.bodies[b].v_index, n).squaredNorm();
        weights += std::sqrt(carried);
      }
      CHECK(only(&TrackingCostWeights::joints) == doctest::Approx(sum / weights));
    }
}

TEST_CASE_TEMPLATE("lanes of a pack have the cost they have alone", S, float, core::Pack<float, 4>, core::Pack<double, 2>) {
  const Figure& f = humanoid();
  core::RandomStream random(14);
  const control::TrackingReference r = reference_at(f, any_pose(f, random), any_velocity(f, random));
  Stage<S> stage(f);
  std::vector<double> alone;
  for (int lane = 0; lane < core::lane_count<S>; ++lane) {
    const Eigen::VectorXd q = any_pose(f, random), v = any_velocity(f, random);
    put(stage.lanes, lane, q, v);
    alone.push_back(cost_of(f, {}, r, q, v));
  }
  stage.lanes.refresh();
  const S cost = TrackingCost(f.model, f.roles, f.points)(stage.lanes, r, 0);
  const double tolerance = sizeof(core::Element<S>) == 4 ? 1e-5 : 1e-8;
  for (int lane = 0; lane < core::lane_count<S>; ++lane)
    CHECK(static_cast<double>(core::lane_of(cost, lane)) == doctest::Approx(alone[static_cast<std::size_t>(lane)]).epsilon(tolerance));
}
