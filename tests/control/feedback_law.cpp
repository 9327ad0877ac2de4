// SPDX-License-Identifier: MIT
#include <traceur/control/feedback_law.hpp>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace figures;
using control::FeedbackLimits;
using control::FeedbackSets;
using control::FeedbackShape;

namespace {

const FeedbackSets all_sets[] = {{},
                                 {.swing_foot = true},
                                 {.root_spin = true},
                                 {.ankles = true},
                                 {.swing_foot = true, .root_spin = true},
                                 {.swing_foot = true, .root_spin = true, .ankles = true}};

/// da = clamp(M_ap (M_sp clamp(ds))) with dense matrices.
Eigen::VectorXd dense(const FeedbackShape& shape, const FeedbackLimits& limits, const double* law, const Eigen::VectorXd& ds) {
  const int m = shape.sets.actions(), n = shape.sets.sensors(), r = shape.rank;
  const Eigen::Map<const Eigen::MatrixXd> ap(law, m, r), sp(law + m * r, r, n);
  Eigen::VectorXd s(n);
  s.head(12) = ds.head(12);
  if (shape.sets.swing_foot) s.segment(12, 3) = ds.segment(12, 3);
  if (shape.sets.root_spin) s.tail(3) = ds.tail(3);
  s[3] = std::clamp(s[3], -limits.forward, limits.forward);
  for (const int k : {4, 5}) s[k] = std::clamp(s[k], -limits.sideways, limits.sideways);
  const Eigen::VectorXd da = ap * (sp * s);
  return da.cwiseMax(-limits.action).cwiseMin(limits.action);
}

Eigen::VectorXd random_numbers(core::RandomStream& random, int n, double size) {
  Eigen::VectorXd x(n);
  for (double& k : x) k = size * random.normal();
  return x;
}

}  // namespace

TEST_CASE("laws have the sizes of the paper") {
  CHECK(FeedbackShape{}.size() == 63);
  const FeedbackShape skill{{.swing_foot = true, .root_spin = true, .ankles = true}, 3, 1};
  CHECK(skill.sets.sensors() == 18);
  CHECK(skill.sets.actions() == 15);
  CHECK(skill.size() == 99);
  CHECK(FeedbackShape{skill.sets, 3, 3}.size() == 297);
}

TEST_CASE_TEMPLATE("a law is the product of its two matrices", S, float, double, core::Pack<float, 4>, core::Pack<double, 2>) {
  using T = core::Element<S>;
  core::RandomStream random(31);
  for (const FeedbackSets& sets : all_sets)
    for (const int rank : {1, 3, 5}) {
      const FeedbackShape shape{sets, rank, 2};
      // Each lane has a law and a measurement of its own; both limits are met by some and not by others.
      const FeedbackLimits limits{0.3, 0.5, 1.5};
      std::vector<S> law(static_cast<std::size_t>(shape.size())), ds(control::full_sensors), da(15);
      std::vector<Eigen::VectorXd> laws, seen;
      for (int lane = 0; lane < core::lane_count<S>; ++lane) {
        laws.push_back(random_numbers(random, shape.size(), 0.5));
        seen.push_back(random_numbers(random, control::full_sensors, 0.5));
        for (std::size_t k = 0; k < law.size(); ++k) core::set_lane(law[k], lane, static_cast<T>(laws.back()[static_cast<Eigen::Index>(k)]));
        for (std::size_t k = 0; k < ds.size(); ++k) core::set_lane(ds[k], lane, static_cast<T>(seen.back()[static_cast<Eigen::Index>(k)]));
      }
      for (int phase = 0; phase < 2; ++phase) {
        control::feedback(shape, limits, law.data() + phase * shape.phase_size(), ds.data(), da.data());
        for (int lane = 0; lane < core::lane_count<S>; ++lane) {
          const auto l = static_cast<std::size_t>(lane);
          const Eigen::VectorXd expected = dense(shape, limits, laws[l].data() + phase * shape.phase_size(), seen[l]);
          for (int k = 0; k < shape.sets.actions(); ++k)
            CHECK(static_cast<double>(core::lane_of(da[static_cast<std::size_t>(k)], lane)) ==
                  doctest::Approx(expected[k]).epsilon(sizeof(T) == 4 ? 1e-4 : 1e-12));
        }
      }
    }
}

TEST_CASE("far off the reference, what a law sees and does is limited") {
  FeedbackShape shape;
  shape.rank = 1;
  const FeedbackLimits limits{0.3, 0.5, 0.6};
  const auto act = [&](int sensor, double value, double gain) {
    Eigen::VectorXd law = Eigen::VectorXd::Zero(shape.size()), ds = Eigen::VectorXd::Zero(control::full_sensors), da(9);
    law[2] = gain;
    law[9 + sensor] = 1;
    ds[sensor] = value;
    control::feedback(shape, limits, law.data(), ds.data(), da.data());
    CHECK(da.cwiseAbs().maxCoeff() <= limits.action);
    if (std::isfinite(value)) CHECK(da.cwiseAbs().sum() == std::abs(da[2]));
    return da[2];
  };
  CHECK(act(3, 0.2, 1) == doctest::Approx(0.2));
  CHECK(act(3, 7, 1) == doctest::Approx(0.3));
  CHECK(act(3, -7, 1) == doctest::Approx(-0.3));
  CHECK(act(4, 7, 1) == doctest::Approx(0.5));
  CHECK(act(5, -7, 1) == doctest::Approx(-0.5));
  CHECK(act(6, 0.55, 1) == doctest::Approx(0.55));
  CHECK(act(6, 7, 1) == doctest::Approx(0.6));
  CHECK(act(6, -7, 1) == doctest::Approx(-0.6));
  act(0, std::nan(""), 1);
}

TEST_CASE("the step placement law steps to where the body drifts and brings the trunk back up") {
  const Figure& f = humanoid();
  for (const FeedbackSets& sets : all_sets) {
    const FeedbackShape shape{sets, 4, 2};
    const Eigen::VectorXd law = control::step_placement_law(shape);
    REQUIRE(law.size() == shape.size());
    CHECK(law.head(shape.phase_size()) == law.tail(shape.phase_size()));
    const auto act = [&](int sensor, double value) {
      Eigen::VectorXd ds = Eigen::VectorXd::Zero(control::full_sensors), da(15);
      ds[sensor] = value;
      control::feedback(shape, {}, law.data(), ds.data(), da.data());
      return da;
    };
    // Right stance: the left thigh's target turned by the action; where its ankle is then.
    const auto step = [&](const Eigen::VectorXd& da) {
      Eigen::VectorXd q = f.skeleton().neutral_pose();
      const Vector before = place_of(f, q, "left_ankle");
      exp_map(Vector::from(da.data())).store(q.data() + f.skeleton()[f.skeleton().find("left_hip")].q_index);
      return place_of(f, q, "left_ankle") - before;
    };
    const Vector forward = step(act(6, 0.5)), behind = step(act(9, -0.1)), sideways = step(act(7, 0.5)), rolling = step(act(10, -0.1));
    CHECK(forward.x > 0.03);  // drifting forward
    CHECK(std::abs(forward.y) < 1e-9);
    CHECK(behind.x > 0.005);  // stance foot behind
    CHECK(sideways.y > 0.03);
    CHECK(std::abs(sideways.x) < 1e-9);
    CHECK(rolling.y > 0.005);
    CHECK(step(act(6, -0.5)).x < -0.03);
    // With the stance thigh held by the foot, turning its target one way turns the trunk the other.
    CHECK(act(1, 0.2)[4] > 0);
    CHECK(act(0, 0.2)[3] > 0);
    CHECK(act(1, 0.2)[7] < 0);
    CHECK(control::step_placement_law(shape, 2).norm() == doctest::Approx(std::sqrt(2) * law.norm()));
  }
  FeedbackShape thin;
  thin.rank = 2;
  CHECK(control::step_placement_law(thin).isZero());
}
