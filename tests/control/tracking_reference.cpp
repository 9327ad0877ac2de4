// SPDX-License-Identifier: MIT
#include <traceur/control/tracking_reference.hpp>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace figures;

namespace {

/// A clip that wanders smoothly, with joints that turn at changing rates.
motion::Clip wandering(const Figure& f, int ticks, bool cyclic = false) {
  core::RandomStream random(3);
  const Eigen::VectorXd q = any_pose(f, random, 0.4);
  const Eigen::VectorXd d = any_velocity(f, random, 0.5);
  return clip_of(
      f, "wander", ticks,
      [&](double t) {
        const Eigen::VectorXd now = std::sin(1.3 * t) * d;
        Eigen::VectorXd out(f.model.nq);
        body::displace(f.skeleton(), q.data(), now.data(), out.data());
        return out;
      },
      cyclic);
}

}  // namespace

TEST_CASE("tracked points are every joint, welded ones too, and the middle of the head") {
  for (const Figure* f : {&humanoid(), &small()}) {
    const body::Skeleton& s = f->skeleton();
    REQUIRE(f->points.size() == static_cast<std::size_t>(s.size()) + 1);
    core::RandomStream random(5);
    const Eigen::VectorXd q = any_pose(*f, random);
    body::Frames<double> frames(s);
    body::forward_kinematics(s, q.data(), frames);
    const auto place = [&](const control::TrackedPoint& p) { return frames.point(f->model.bodies[static_cast<std::size_t>(p.body)].joint, p.local); };
    for (int j = 0; j < s.size(); ++j)
      CHECK(apart(place(f->points[static_cast<std::size_t>(j)]), frames.position[static_cast<std::size_t>(j)]) < 1e-12);
  }
  const Figure& f = humanoid();
  CHECK(f.points.back().body == f.roles.head[0]);
  CHECK(f.points.back().local.z == doctest::Approx(0.175));
}

TEST_CASE("a reference holds the clip on its ticks") {
  const Figure& f = small();
  const motion::Clip clip = wandering(f, 30);
  const control::TrackingReference r = reference_of(f, clip, clip.duration());
  REQUIRE(r.ticks == 30);
  for (int t = 0; t <= r.ticks; ++t) {
    CHECK((r.poses.col(t) - clip.sample(t / 60.0)).norm() < 1e-12);
    CHECK((r.velocities.col(t) - clip.velocity(t / 60.0)).norm() < 1e-9);
    const auto m = momentum_of(f, r.poses.col(t), r.velocities.col(t));
    CHECK(apart(Vector::from(r.center_of_mass.col(t)), m.center_of_mass) < 1e-12);
    CHECK(apart(Vector::from(r.center_velocity.col(t)), m.velocity()) < 1e-12);
    body::Frames<double> frames(f.skeleton());
    body::forward_kinematics(f.skeleton(), r.poses.col(t).data(), frames);
    for (int j = 0; j < f.skeleton().size(); ++j)
      CHECK(apart(Vector::from(r.points.col(t).data() + 3 * j), frames.position[static_cast<std::size_t>(j)]) < 1e-12);
    const auto at = [&](const char* joint) { return frames.position[static_cast<std::size_t>(f.skeleton().find(joint))]; };
    CHECK(apart(Vector::from(r.feet.col(t).data()), at("right ankle")) < 1e-12);
    CHECK(apart(Vector::from(r.feet.col(t).data() + 3), at("left ankle")) < 1e-12);
    const Vector forward = Quaternion::from(r.poses.col(t).data() + 3).rotate({1, 0, 0});
    CHECK(std::remainder(r.heading[t] - std::atan2(forward.y, forward.x), 2 * std::numbers::pi) == doctest::Approx(0).epsilon(1e-9));
  }
  // The velocity of the centre of mass is what its place changes by.
  for (int t = 1; t < r.ticks; ++t) {
    const Vector change = 30.0 * (Vector::from(r.center_of_mass.col(t + 1)) - Vector::from(r.center_of_mass.col(t - 1)));
    CHECK(apart(Vector::from(r.center_velocity.col(t)), change) < 0.02);
  }
}

TEST_CASE("a reference has at least one tick, and goes on past the end of a cyclic clip") {
  const Figure& f = small();
  CHECK(reference_of(f, wandering(f, 30), 0).ticks == 1);
  const motion::Clip clip = wandering(f, 20, true);
  const control::TrackingReference r = reference_of(f, clip, 3 * clip.duration());
  REQUIRE(r.ticks == 60);
  CHECK((r.poses.col(47) - clip.sample(47 / 60.0)).norm() < 1e-12);
  CHECK((r.poses.col(47).tail(f.model.nq - 7) - r.poses.col(7).tail(f.model.nq - 7)).norm() < 1e-9);
  CHECK((r.poses.col(47).head(2) - r.poses.col(7).head(2)).norm() > 0.05);
}
