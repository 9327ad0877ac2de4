// SPDX-License-Identifier: MIT
#include <traceur/learn/feature_writer.hpp>

#include <doctest/doctest.h>

#include <traceur/body/pose.hpp>

#include "../body/support.hpp"

using namespace traceur;
using namespace traceur::learn;

TEST_CASE("lanes go into columns, features into rows") {
  using P = core::Pack<float>;
  constexpr int width = core::lane_count<P>;
  Eigen::MatrixXf m = Eigen::MatrixXf::Constant(5, width, -1);
  FeatureWriter<P> to(m.data(), m.rows());
  P x(0.0);
  for (int lane = 0; lane < width; ++lane) x.set(lane, static_cast<float>(lane));
  to.put(x);
  float* const own = to.skip(1);
  to.put(core::Vector3<P>{P(1.0), P(2.0), x});
  CHECK(to.rows() == 5);
  CHECK(own == &m(1, 0));
  for (int lane = 0; lane < width; ++lane) {
    CHECK(m(0, lane) == static_cast<float>(lane));
    CHECK(m(1, lane) == -1);
    CHECK(m(2, lane) == 1);
    CHECK(m(3, lane) == 2);
    CHECK(m(4, lane) == static_cast<float>(lane));
  }
}

TEST_CASE("axes are the first and last column of the matrix; joints are the tangent from rest") {
  const body::Character c = body_test::creature();
  core::RandomStream random(3);
  const Eigen::VectorXd q = body_test::random_pose(c.skeleton, random), rest = c.skeleton.neutral_pose();
  Eigen::VectorXd d(c.skeleton.nv()), out(c.skeleton.nv());
  body::difference(c.skeleton, rest.data(), q.data(), d.data());
  FeatureWriter<double, double> to(out.data(), 0);
  const auto r = core::Quaternion<double>::from(q.data() + 3);
  to.put_axes(r);
  const Eigen::Matrix3d m = r.eigen().toRotationMatrix();
  CHECK((out.head(3) - m.col(0)).norm() < 1e-12);
  CHECK((out.segment(3, 3) - m.col(2)).norm() < 1e-12);
  to.put_joints(c.skeleton, q.data());
  CHECK(to.rows() == c.skeleton.nv());
  CHECK((out.tail(c.skeleton.nv() - 6) - d.tail(c.skeleton.nv() - 6)).norm() < 1e-9);
}
