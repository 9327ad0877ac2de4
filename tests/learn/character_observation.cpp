// SPDX-License-Identifier: MIT
#include <traceur/learn/character_observation.hpp>

#include <cmath>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace traceur;
using namespace traceur::learn;
using namespace learn_test;

namespace {

/// A state moved along the ground and turned about the vertical as a whole.
TrackingState<double> moved(const Character& c, const Eigen::VectorXd& q, const Eigen::VectorXd& v, double turn) {
  const auto r = core::about_axis(Vector3<double>{0, 0, 1}, turn);
  Eigen::VectorXd p = q, w = v;
  const Vector3<double> at = r.rotate(Vector3<double>::from(q.data())) + Vector3<double>{3, -7, 0};
  at.store(p.data());
  (r * Quaternion<double>::from(q.data() + 3)).store(p.data() + 3);
  r.rotate(Vector3<double>::from(v.data())).store(w.data());
  r.rotate(Vector3<double>::from(v.data() + 3)).store(w.data() + 3);
  return learn_test::at(c, p, w);
}

}  // namespace

TEST_CASE("observations do not know where a character is nor which way it heads") {
  const Pair pair(7);
  const Character& c = pair.character;
  const auto written = [&](double turn, bool bodies) {
    const TrackingState<double> s = moved(c, pair.q, pair.v, turn);
    const Eigen::Index size = bodies ? BodyObservation::size(c.skeleton) : CharacterObservation::size(c.skeleton);
    Eigen::VectorXd out(size);
    FeatureWriter<double, double> to(out.data(), 0);
    if (bodies)
      BodyObservation::write(s, 0.2, to);
    else
      CharacterObservation::write(c.skeleton, s, 0.2, to);
    CHECK(to.rows() == size);
    CHECK(out[0] == doctest::Approx(s.frames.position[0].z - 0.2));
    return out;
  };
  for (const bool bodies : {false, true}) {
    const Eigen::VectorXd here = written(0, bodies);
    for (const double turn : {0.8, 2.4, -3.0}) CHECK((written(turn, bodies) - here).cwiseAbs().maxCoeff() < 1e-9);
  }
}

TEST_CASE("a rotation seen from a frame is that of the world turned back by its heading") {
  core::RandomStream random(2);
  for (const double heading : {0.0, 0.3, 1.9, 3.1, -0.6, -2.8}) {
    const auto frame = terrain::HeadingFrame<double>::at({1, 2, 3}, heading);
    const auto r = core::exp_map(Vector3<double>{random.normal(), random.normal(), random.normal()});
    const auto back = core::about_axis(Vector3<double>{0, 0, 1}, -heading) * r;
    CHECK(std::abs(core::dot(rotation_to_local(frame, r), back)) == doctest::Approx(1).epsilon(1e-12));
  }
}

TEST_CASE("packs see what numbers see") {
  using P = core::Pack<double>;
  const Pair pair(9);
  const Character& c = pair.character;
  const TrackingState<double> s = pair.reference();
  const Eigen::Index size = BodyObservation::size(c.skeleton);
  Eigen::VectorXd one(size);
  Eigen::MatrixXd many(size, core::lane_count<P>);
  FeatureWriter<double, double> to(one.data(), 0);
  FeatureWriter<P, double> wide_to(many.data(), size);
  BodyObservation::write(s, 0.0, to);
  BodyObservation::write(wide<P>(c, s), P(0.0), wide_to);
  for (int lane = 0; lane < core::lane_count<P>; ++lane) CHECK((many.col(lane) - one).cwiseAbs().maxCoeff() < 1e-9);
}

TEST_CASE("a reference straight ahead is seen straight ahead") {
  const Pair pair(5);
  const Character& c = pair.character;
  const TrackingState<double> s = pair.reference();
  const auto frame = heading_frame(s);
  Eigen::VectorXd ahead = pair.q, out(ReferenceObservation::size(c.skeleton));
  (Vector3<double>::from(pair.q.data()) + frame.direction_to_world({2, 0, 0.5})).store(ahead.data());
  FeatureWriter<double, double> to(out.data(), 0);
  ReferenceObservation::write(c.skeleton, frame, ahead.data(), to);
  CHECK(to.rows() == out.size());
  CHECK((out.head(3) - Eigen::Vector3d(2, 0, 0.5)).norm() < 1e-12);
  double target[3];
  FeatureWriter<double, double> at(target, 0);
  TargetObservation::write(frame, Vector3<double>::from(ahead.data()), at);
  CHECK(target[0] == doctest::Approx(2));
  CHECK(at.rows() == TargetObservation::size);
}
