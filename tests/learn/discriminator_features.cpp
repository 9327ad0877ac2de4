// SPDX-License-Identifier: MIT
#include <traceur/learn/discriminator_features.hpp>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace traceur;
using namespace traceur::learn;
using namespace learn_test;

TEST_CASE("features are those of the paper's list, in the character's frame") {
  Character c = creature();
  const DiscriminatorFeatures features(c.skeleton, {1, 2}, 3);
  CHECK(features.size() == 6 + 2 * (c.skeleton.nv() - 6) + 6 + 9);
  Eigen::VectorXd q = c.skeleton.neutral_pose(), v = Eigen::VectorXd::Zero(c.skeleton.nv());
  q.head(3) << 4, 5, 1;
  core::about_axis(Vector3<double>{0, 0, 1}, std::acos(0.0)).store(q.data() + 3);  // faces +y
  v.head(6) << -0.5, 2, 0.25, 0, 1, 3;
  v[6] = 0.7;
  const TrackingState<double> s = at(c, q, v);
  Eigen::VectorXd out = Eigen::VectorXd::Constant(features.size(), -1);
  FeatureWriter<double, double> to(out.data(), 0);
  features.write(s, to);
  CHECK(to.rows() == features.size());
  Eigen::VectorXd expected(6);
  expected << 2, 0.5, 0.25, 1, 0, 3;
  CHECK((out.head(6) - expected).cwiseAbs().maxCoeff() < 1e-12);
  CHECK(out.segment(6, c.skeleton.nv() - 6).norm() < 1e-12);
  CHECK(out[6 + c.skeleton.nv() - 6] == 0.7);
  const Eigen::Index first = 6 + 2 * (c.skeleton.nv() - 6);
  const Vector3<double> away = s.frames.position[1] - s.frames.position[0];
  CHECK(out[first] == doctest::Approx(away.y));
  CHECK(out[first + 1] == doctest::Approx(-away.x));
  CHECK(out[first + 2] == doctest::Approx(away.z));
  CHECK(out.tail(9) == Eigen::VectorXd::Constant(9, -1));  // the scene's points are the caller's
}

TEST_CASE("features that cannot be are refused") {
  const Character c = creature();
  CHECK_THROWS_AS(DiscriminatorFeatures(c.skeleton, {99}), Error);
  CHECK_THROWS_AS(DiscriminatorFeatures(c.skeleton, {}, -1), Error);
  CHECK_THROWS_WITH_AS(DiscriminatorFeatures(Skeleton(), {}), "discriminator features: expected a skeleton with a free root", Error);
}
