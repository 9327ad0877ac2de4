// SPDX-License-Identifier: MIT
#include <traceur/evaluate/motion_quality.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

#include "../error_message.hpp"

namespace {

using namespace traceur;
using core::RandomStream;
using terrain::HeightGrid;

template <class T>
using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;

constexpr double no_number = std::numeric_limits<double>::quiet_NaN();

HeightGrid rough(RandomStream& random) {
  Eigen::MatrixXd h(10, 10);
  for (Eigen::Index k = 0; k < h.size(); ++k) h.data()[k] = random.uniform(-1, 1);
  return HeightGrid(h, 0.4, -2, -2);
}

Eigen::MatrixXd any_points(RandomStream& random, int points, int frames) {
  Eigen::MatrixXd p(3 * points, frames);
  for (Eigen::Index k = 0; k < p.size(); ++k) p.data()[k] = random.uniform(-1.5, 1.5);
  return p;
}

using traceur_test::message;

}  // namespace

TEST_CASE("FWD: horizontal; net displacement too") {
  CHECK(evaluate::final_waypoint_distance<double>({3, 4, 0.9}, {0, 0, 0}) == 5);
  CHECK(evaluate::final_waypoint_distance<float>({1, 1, 0.9f}, {1, 1, -2}) == 0);
  Eigen::MatrixXd root(3, 3);
  root << 1, 5, 4, 2, 0, -1, 0.9, 2, 1;
  const auto d = evaluate::net_displacement<double>(root);
  CHECK(d.x == 3);
  CHECK(d.y == -3);
  CHECK(d.z == 0);
}

TEST_CASE("TPL: the sum of depths") {
  // Two points 0.1 and 0.3 m in flat ground and one above it, for five frames.
  Eigen::MatrixXd points(9, 5);
  points.setZero();
  points.row(2).setConstant(1.9);
  points.row(5).setConstant(1.7);
  points.row(8).setConstant(2.4);
  CHECK(evaluate::penetration_loss<double>(HeightGrid::flat(2), points) == doctest::Approx(5 * 0.4));
  RandomStream random(81);
  const HeightGrid grid = rough(random);
  for (int trial = 0; trial < 20; ++trial) {
    const Eigen::MatrixXd p = any_points(random, 40, 6);
    double expected = 0;
    for (int t = 0; t < 6; ++t)
      for (int k = 0; k < 40; ++k)
        expected -= std::min(
            terrain::signed_distance(grid, core::Vector3<double>{p(3 * k, t), p(3 * k + 1, t), p(3 * k + 2, t)}), 0.0);
    CHECK(expected > 0);
    CHECK(evaluate::penetration_loss<double>(grid, p) == doctest::Approx(expected));
    const Matrix<float> single = p.cast<float>();
    CHECK(static_cast<double>(evaluate::penetration_loss<float>(grid, single)) ==
          doctest::Approx(expected).epsilon(1e-3));
    Eigen::MatrixXd bad = p;
    bad(5, 3) = no_number;
    CHECK(std::isnan(evaluate::penetration_loss<double>(grid, bad)));
  }
}

TEST_CASE("TCL: the nearest point of every body that is to touch") {
  RandomStream random(82);
  const HeightGrid grid = rough(random);
  const std::vector<int> bodies{0, 0, 1, 2, 2, 2, 0};
  for (int trial = 0; trial < 30; ++trial) {
    const Eigen::MatrixXd p = any_points(random, 7, 4);
    Eigen::MatrixXd labels(3, 4);
    for (Eigen::Index k = 0; k < labels.size(); ++k) labels.data()[k] = random.below(3) * 0.5;
    double expected = 0;
    for (int t = 0; t < 4; ++t)
      for (int b = 0; b < 3; ++b) {
        double least = 1e9;
        for (int k = 0; k < 7; ++k)
          if (bodies[static_cast<std::size_t>(k)] == b)
            least = std::min(least, std::abs(terrain::signed_distance(
                                        grid, core::Vector3<double>{p(3 * k, t), p(3 * k + 1, t), p(3 * k + 2, t)})));
        expected += labels(b, t) * least;
      }
    CHECK(evaluate::contact_loss<double>(grid, p, bodies, labels) == doctest::Approx(expected));
    CHECK(evaluate::contact_loss<double>(grid, p, bodies, Eigen::MatrixXd::Zero(3, 4)) == 0);
  }
  // Feet on the ground cost nothing, a finger's breadth off or in it the same.
  Eigen::MatrixXd foot = Eigen::MatrixXd::Zero(3, 2);
  const Eigen::MatrixXd touching = Eigen::MatrixXd::Ones(1, 2);
  const std::vector<int> one{0};
  CHECK(evaluate::contact_loss<double>(HeightGrid::flat(), foot, one, touching) == 0);
  foot(2, 0) = 0.02;
  foot(2, 1) = -0.02;
  CHECK(evaluate::contact_loss<double>(HeightGrid::flat(), foot, one, touching) == doctest::Approx(0.04));
  foot(0, 1) = no_number;
  CHECK(std::isnan(evaluate::contact_loss<double>(HeightGrid::flat(), foot, one, touching)));
}

TEST_CASE("jerk: that of a cubic is its third derivative, of anything slower zero") {
  constexpr double dt = 1.0 / 30;
  Eigen::MatrixXd joints(6, 12);
  for (int t = 0; t < 12; ++t) {
    const double s = t * dt;
    joints.col(t) << 2 * s * s * s, -s * s * s, 2 * s * s * s, 4 + s - s * s, 3 * s, 1000;
  }
  const Eigen::MatrixXd j = evaluate::jerks<double>(joints, dt);
  CHECK(j.rows() == 2);
  CHECK(j.cols() == 9);
  for (int t = 0; t < 9; ++t) {
    CHECK(j(0, t) == doctest::Approx(6 * 3.0));
    CHECK(std::abs(j(1, t)) < 1e-7);
  }
}

TEST_CASE("%HJF: one joint's jolt makes the frames around it high, wherever the motion is") {
  constexpr double dt = 1.0 / 30;
  for (const double place : {0.0, 100.0}) {
    Matrix<float> joints = Matrix<float>::Constant(9, 33, static_cast<float>(place));
    CHECK(evaluate::high_jerk_share<float>(joints, 1.0f / 30) == 0);
    // One frame off by 1 m shows in four differences, 27000 m/s^3 and three times that.
    joints(4, 16) += 1;
    CHECK(evaluate::high_jerk_share<float>(joints, 1.0f / 30) == doctest::Approx(4.0 / 30));
    CHECK(evaluate::high_jerk_share<float>(joints, 1.0f / 30, 50000.0f) == doctest::Approx(2.0 / 30));
    CHECK(evaluate::high_jerk_share<float>(joints, 1.0f / 30, 1e6f) == 0);
  }
  Eigen::MatrixXd joints = Eigen::MatrixXd::Zero(3, 13);
  joints(0, 0) = no_number;
  CHECK(evaluate::high_jerk_share<double>(joints, dt) == doctest::Approx(0.1));
  CHECK(evaluate::parc_jerk_limit == 11666);
}

TEST_CASE("joint error: the mean distance") {
  RandomStream random(83);
  const Eigen::MatrixXd a = any_points(random, 5, 7);
  CHECK(evaluate::mean_joint_error<double>(a, a) == 0);
  Eigen::MatrixXd b = a;
  b.row(0).array() += 0.3;
  b.row(1).array() -= 0.4;
  CHECK(evaluate::mean_joint_error<double>(a, b) == doctest::Approx(0.1));
  CHECK(evaluate::mean_joint_error<double>(b, a) == doctest::Approx(0.1));
}

TEST_CASE("summary: the mean of each number") {
  std::vector<evaluate::MotionQuality> motions;
  for (int k = 0; k < 40; ++k) motions.push_back({0.1 * k, 2.0, 0.01 * k, k % 2 == 0 ? 0.0 : 0.5});
  const auto s = evaluate::summarize(motions);
  CHECK(s.final_waypoint_distance_m.estimate == doctest::Approx(1.95));
  CHECK(s.final_waypoint_distance_m.low < 1.95);
  CHECK(s.final_waypoint_distance_m.high > 1.95);
  CHECK(s.penetration_loss_m.low == 2);
  CHECK(s.penetration_loss_m.high == 2);
  CHECK(s.contact_loss_m.estimate == doctest::Approx(0.195));
  CHECK(s.high_jerk_share.estimate == doctest::Approx(0.25));
}

TEST_CASE("quality: motions that do not fit are refused") {
  const HeightGrid grid = HeightGrid::flat();
  const Eigen::MatrixXd four = Eigen::MatrixXd::Zero(4, 5), six = Eigen::MatrixXd::Zero(6, 5),
                        labels = Eigen::MatrixXd::Ones(2, 5);
  CHECK(message([&] { evaluate::penetration_loss<double>(grid, four); }) ==
        "penetration loss: expected three rows for each point, found 4");
  const std::vector<int> one{0}, both{0, 2}, first{0, 0};
  CHECK(message([&] { evaluate::contact_loss<double>(grid, six, one, labels); }) ==
        "contact loss: expected a body for each point");
  CHECK(message([&] { evaluate::contact_loss<double>(grid, six, both, labels); }) ==
        "contact loss: a point names body 2, which has no label");
  CHECK(message([&] { evaluate::contact_loss<double>(grid, six, first, labels); }) ==
        "contact loss: body 1 is to touch but has no point");
  CHECK(message([&] { evaluate::contact_loss<double>(grid, six, first, labels.leftCols(3)); }) ==
        "contact loss: expected labels for each frame");
  CHECK(message([&] { evaluate::jerks<double>(six.leftCols(3), 0.1); }) == "jerk: expected at least four frames");
  CHECK(message([&] { evaluate::jerks<double>(six, 0.0); }) == "jerk: expected a positive time between frames");
  CHECK(message([&] { evaluate::mean_joint_error<double>(six, six.leftCols(2)); }) ==
        "joint error: expected two motions of the same joints and frames, at least one");
}
