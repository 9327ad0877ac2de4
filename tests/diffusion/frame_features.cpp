// SPDX-License-Identifier: MIT
#include <traceur/diffusion/frame_features.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/body/kinematics.hpp>

#include "figure.hpp"
#include "support.hpp"

using namespace traceur::diffusion;
using traceur::body::Frames;
using traceur::core::Quaternion;
using traceur::core::Vector3;
using traceur::terrain::HeadingFrame;

namespace {

const HeadingFrame<double> somewhere = HeadingFrame<double>::at({1.5, -0.5, 0.8}, 2.2);

double angle(const Quaternion<double>& a, const Quaternion<double>& b) {
  return norm(traceur::core::log_map(a.conjugate() * b));
}

}  // namespace

TEST_CASE("the features of a frame stand one after the other") {
  const FrameFeatures f(figure::skeleton());
  CHECK(f.joints() == 5);
  CHECK(f.size() == 6 + 6 * 5 + 6);
  std::vector<Eigen::Index> rows;
  for (int i = 0; i < 6; ++i) {
    for (int k = 0; k < 3; ++k) {
      rows.push_back(f.position(i) + k);
      rows.push_back(f.rotation(i) + k);
    }
    rows.push_back(f.contact(i));
  }
  std::sort(rows.begin(), rows.end());
  for (std::size_t i = 0; i < rows.size(); ++i) CHECK(rows[i] == static_cast<Eigen::Index>(i));
}

TEST_CASE_TEMPLATE("a pose comes back from its features", S, float, double) {
  const double tolerance = sizeof(S) == 4 ? 2e-6 : 1e-12;
  const FrameFeatures f(figure::skeleton());
  Frames<double> scratch(f.skeleton()), expected(f.skeleton()), found(f.skeleton());
  Frames<S> local(f.skeleton());
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Eigen::VectorXd q = figure::random_pose(f.skeleton(), seed);
    std::vector<double> contacts{0, 0.25, 1, 0.5, 1, 0}, labels(6);
    std::vector<S> x(static_cast<std::size_t>(f.size()));
    f.encode(q.data(), contacts.data(), somewhere, scratch, x.data());
    Eigen::VectorXd back(q.size());
    f.decode(x.data(), somewhere, back.data(), labels.data());
    traceur::body::forward_kinematics(f.skeleton(), q.data(), expected);
    traceur::body::forward_kinematics(f.skeleton(), back.data(), found);
    f.kinematics(x.data(), local);
    for (int i = 0; i < f.skeleton().size(); ++i) {
      const auto k = static_cast<std::size_t>(i);
      CHECK(norm(found.position[k] - expected.position[k]) < 10 * tolerance);
      CHECK(angle(found.rotation[k], expected.rotation[k]) < 10 * tolerance);
      // Kinematics of features is that of the body, seen from the frame; so are the positions among the features.
      const Vector3<double> seen = somewhere.to_local(expected.position[k]);
      CHECK(norm(local.position[k].template cast<double>() - seen) < 10 * tolerance);
      CHECK(norm(Vector3<S>::from(x.data() + f.position(i)).template cast<double>() - seen) < 10 * tolerance);
      CHECK(labels[k] == contacts[k]);
    }
    // What a body can do is left as it is.
    std::vector<S> projected = x;
    f.project(projected.data(), local);
    for (std::size_t i = 0; i < x.size(); ++i) CHECK(std::abs(static_cast<double>(projected[i] - x[i])) < 10 * tolerance);
  }
}

TEST_CASE("projection gives what the body can do, and does nothing twice") {
  const FrameFeatures f(figure::skeleton());
  Table<double> x = random_table<double>(f.size(), 1, 3), once, twice;
  Frames<double> frames(f.skeleton());
  once = x;
  f.project(once.data(), frames);
  twice = once;
  f.project(twice.data(), frames);
  CHECK((once - twice).norm() < 1e-12);
  CHECK(once.middleRows(f.rotation(2), 3).norm() == 0);                            // fixed
  CHECK(once(f.rotation(4)) == 0);                                                 // a hinge about y
  CHECK(once(f.rotation(4) + 1) == doctest::Approx(x(f.rotation(4) + 1)));
  CHECK(once.topRows(9) == x.topRows(9));                                          // root and ball joint
  CHECK(once.bottomRows(6).minCoeff() >= 0);
  CHECK(once.bottomRows(6).maxCoeff() <= 1);
  Eigen::VectorXd q(f.skeleton().nq());
  std::vector<double> contacts(6);
  f.decode(x.data(), somewhere, q.data(), contacts.data());
  std::vector<double> again(static_cast<std::size_t>(f.size()));
  f.encode(q.data(), contacts.data(), somewhere, frames, again.data());
  for (int i = 0; i < 6; ++i) {
    for (int k = 0; k < 3; ++k) {
      CHECK(again[static_cast<std::size_t>(f.position(i) + k)] == doctest::Approx(once(f.position(i) + k)));
    }
  }
}

TEST_CASE("features seen from another frame are those encoded there") {
  const FrameFeatures f(figure::skeleton());
  const Eigen::VectorXd q = figure::random_pose(f.skeleton(), 5);
  const auto other = HeadingFrame<double>::at({-1, 2, 0.1}, -0.7);
  Frames<double> scratch(f.skeleton());
  Table<double> x(f.size(), 1), y(f.size(), 1);
  f.encode(q.data(), nullptr, somewhere, scratch, x.data());
  f.encode(q.data(), nullptr, other, scratch, y.data());
  f.change_frame(somewhere, other, x.data());
  CHECK((x - y).norm() < 1e-12);
}

TEST_CASE("a hinge keeps angles beyond half a turn") {
  const FrameFeatures f(figure::skeleton());
  Eigen::VectorXd q = f.skeleton().neutral_pose(), back(q.size());
  const int shin = f.skeleton()[4].q_index;
  q[shin] = 3.7;
  Frames<double> scratch(f.skeleton());
  std::vector<double> x(static_cast<std::size_t>(f.size()));
  f.encode(q.data(), nullptr, somewhere, scratch, x.data());
  f.decode(x.data(), somewhere, back.data(), nullptr);
  CHECK(back[shin] == doctest::Approx(3.7));
}

TEST_CASE("scaled features have mean 0 and deviation 1, and come back") {
  Table<double> frames = random_table<double>(4, 200, 1);
  frames.row(1).array() *= 7;
  frames.row(2).array() += 3;
  frames.row(3).setConstant(5);
  const auto scale = FeatureScale<double>::of(frames);
  Table<double> scaled = frames;
  scale.apply(scaled.data(), 200);
  for (int i = 0; i < 3; ++i) {
    CHECK(std::abs(scaled.row(i).mean()) < 1e-12);
    CHECK(scaled.row(i).squaredNorm() / 200 == doctest::Approx(1.0));
  }
  CHECK(scaled.row(3).norm() < 1e-9);
  CHECK(scale.deviation[3] == 0.01);
  scale.undo(scaled.data(), 200);
  CHECK((scaled - frames).norm() < 1e-10);
}

TEST_CASE("a figure without a free root has no features") {
  traceur::body::Skeleton s;
  s.add(figure::joint("base", -1, traceur::body::JointType::fixed, {0, 0, 0}));
  CHECK_THROWS_AS(FrameFeatures{s}, traceur::Error);
}
