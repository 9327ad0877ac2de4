// SPDX-License-Identifier: MIT
#include <traceur/control/pd_targets.hpp>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace figures;

namespace {

/// Every joint turns at a constant rate about an axis of its own; the root stays where it is.
control::TrackingReference turning(const Figure& f, const Eigen::VectorXd& rates) {
  const motion::Clip clip = clip_of(f, "turn", 30, [&](double t) {
    Eigen::VectorXd q = f.skeleton().neutral_pose();
    const Eigen::VectorXd d = t * rates;
    body::displace(f.skeleton(), q.data(), d.data(), q.data());
    return q;
  });
  return reference_of(f, clip, clip.duration());
}

Eigen::VectorXd some_rates(const Figure& f) {
  core::RandomStream random(21);
  Eigen::VectorXd rates = any_velocity(f, random, 1.5);
  rates.head(6).setZero();
  return rates;
}

}  // namespace

TEST_CASE("with a lead of kd / kp the motors of a steady motion pull nowhere") {
  for (const Figure* f : {&humanoid(), &small()}) {
    const Eigen::VectorXd rates = some_rates(*f);
    const control::TrackingReference r = turning(*f, rates);
    // All gains of both characters are in the ratio 10 to 1.
    for (const auto& a : f->model.character.actuators) CHECK(a.damping == doctest::Approx(0.1 * a.stiffness));
    const Eigen::MatrixXd led = control::led_targets(f->model, r, 0.1), late = control::led_targets(f->model, r, 0);
    REQUIRE(led.cols() == r.ticks + 1);
    for (int t = 0; t <= r.ticks; ++t) {
      Eigen::VectorXd error(f->model.nv);
      body::difference(f->skeleton(), r.poses.col(t).data(), led.col(t).data(), error.data());
      // The torque on each axis over its stiffness: kp e - kd w.
      CHECK((error - 0.1 * rates).cwiseAbs().maxCoeff() < 1e-9);
      CHECK((late.col(t) - r.poses.col(t)).norm() < 1e-12);
      CHECK(led.col(t).head(7) == r.poses.col(t).head(7));
    }
  }
}

TEST_CASE("a simulated body follows led targets without delay and late ones with kd / kp of it") {
  const Figure& f = small();
  const int elbow = f.skeleton()[f.skeleton().find("left elbow")].v_index, place = f.skeleton()[f.skeleton().find("left elbow")].q_index;
  Eigen::VectorXd rates = Eigen::VectorXd::Zero(f.model.nv);
  rates[elbow] = 2;
  const control::TrackingReference r = turning(f, rates);
  sim::Parameters parameters;
  parameters.gravity = 0;
  const sim::Ground<double> ground = sim::Ground<double>::plane({0, 0, 1}, -100);
  const auto behind = [&](double lead) {
    const Eigen::MatrixXd targets = control::led_targets(f.model, r, lead);
    sim::Lanes<double> lanes(f.model, parameters, ground);
    put(lanes, 0, r.poses.col(0), r.velocities.col(0));
    for (int t = 0; t < r.ticks; ++t) {
      std::copy_n(targets.col(t).data(), f.model.nq, lanes.target());
      lanes.step(8);
    }
    return r.poses(place, r.ticks) - lanes.q()[place];
  };
  CHECK(std::abs(behind(0.1)) < 0.02);
  CHECK(behind(0) == doctest::Approx(0.1 * 2).epsilon(0.1));
}
