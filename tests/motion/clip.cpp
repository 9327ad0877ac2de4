// SPDX-License-Identifier: MIT
#include <traceur/motion/clip.hpp>

#include <doctest/doctest.h>

#include <limits>

#include "figure.hpp"

using namespace traceur;
using namespace figure;
using motion::Clip;

TEST_CASE("a clip shows its keys and interpolates along geodesics") {
  std::mt19937_64 rng(1);
  const Clip clip = random_clip(rng);
  CHECK_NOTHROW(clip.check());
  for (int k = 0; k < clip.keys(); ++k) CHECK(distance(clip.skeleton, clip.sample(clip.times[k]), clip.poses.col(k)) < 1e-12);
  // A third of the way in time is a third of the tangent vector between the keys.
  Vec d(clip.skeleton.nv()), expected(clip.skeleton.nq());
  body::difference(clip.skeleton, clip.poses.col(2).data(), clip.poses.col(3).data(), d.data());
  d /= 3;
  body::displace(clip.skeleton, clip.poses.col(2).data(), d.data(), expected.data());
  const double third = clip.times[2] + (clip.times[3] - clip.times[2]) / 3;
  CHECK(distance(clip.skeleton, clip.sample(third), expected) < 1e-10);
}

TEST_CASE("a clip that is not cyclic holds its ends") {
  std::mt19937_64 rng(2);
  const Clip clip = random_clip(rng);
  CHECK(distance(clip.skeleton, clip.sample(-3.0), clip.poses.col(0)) < 1e-12);
  CHECK(distance(clip.skeleton, clip.sample(clip.duration() + 3), clip.poses.col(clip.keys() - 1)) < 1e-12);
  CHECK(clip.velocity(-1.0).norm() == 0.0);
  CHECK(clip.velocity(clip.duration() + 1).norm() == 0.0);
}

TEST_CASE("a cyclic clip goes on as the motion it was cut from, straight or turning, forwards and backwards") {
  for (const double turn : {0.0, 0.7, -1.9, 1e-9}) {
    Gait g;
    g.turn = turn;
    g.heading = 0.4;
    const Clip clip = gait(g, g.period, 61, true);
    for (const int cycle : {-7, -2, -1, 0, 1, 2, 9})
      for (const int k : {0, 13, 42}) {
        const double phi = cycle * g.period + clip.times[k];
        CAPTURE(turn);
        CAPTURE(phi);
        CHECK(distance(clip.skeleton, clip.sample(phi), gait_pose(clip.skeleton, g, phi)) < 1e-7);
      }
  }
}

TEST_CASE("carrying the root by n cycles is carrying it by one n times, and has an inverse") {
  std::mt19937_64 rng(3);
  const Clip clip = random_clip(rng, 5, true);
  Vec q = random_pose(clip.skeleton, rng), once = q, many = q;
  for (int i = 0; i < 5; ++i) clip.carry_root(1, once);
  clip.carry_root(5, many);
  CHECK(distance(clip.skeleton, once, many) < 1e-12);
  clip.carry_root(-5, many);
  CHECK(distance(clip.skeleton, q, many) < 1e-12);
  CHECK(many[2] == q[2]);
}

TEST_CASE("velocity is that of the motion, in the documented axes") {
  Clip clip{"spin", biped(), Vec::LinSpaced(2, 0, 0.5), Eigen::MatrixXd(), Eigen::MatrixXd(), false};
  std::mt19937_64 rng(4);
  clip.poses.resize(clip.skeleton.nq(), 2);
  clip.poses.col(0) = random_pose(clip.skeleton, rng);
  Vec v(clip.skeleton.nv());
  for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = uniform(rng, -2, 2);
  const Vec d = 0.5 * v;
  body::displace(clip.skeleton, clip.poses.col(0).data(), d.data(), clip.poses.col(1).data());
  for (const double phi : {0.0, 0.2, 0.5}) CHECK((clip.velocity(phi) - v).norm() < 1e-9);
  Vec out(v.size()), a(clip.skeleton.nq()), b(clip.skeleton.nq());
  clip.velocity(0.2, 0.01, out, a, b);
  CHECK((out - v).norm() < 1e-9);
}

TEST_CASE("contact labels interpolate and repeat") {
  std::mt19937_64 rng(5);
  Clip clip = random_clip(rng, 3, true);
  clip.contacts = Eigen::MatrixXd::Zero(clip.skeleton.size(), 3);
  clip.contacts(4, 1) = 1;
  Vec c(clip.skeleton.size());
  clip.sample_contacts(0.5 * clip.times[1], c);
  CHECK(c[4] == doctest::Approx(0.5));
  clip.sample_contacts(clip.times[1] + 3 * clip.duration(), c);
  CHECK(c[4] == doctest::Approx(1.0));
  CHECK(c.sum() == doctest::Approx(1.0));
}

TEST_CASE("a fixed root is never carried") {
  Clip arm;
  arm.name = "arm";
  arm.skeleton.add(joint("base", -1, JointType::fixed, {0, 0, 1}));
  arm.skeleton.add(joint("elbow", 0, JointType::hinge, {0, 0, 0.3}));
  arm.times = Vec::LinSpaced(3, 0, 1);
  arm.poses = Eigen::RowVector3d(0, 1, 0);
  arm.cyclic = true;
  CHECK_NOTHROW(arm.check());
  CHECK(arm.sample(7.25)[0] == doctest::Approx(0.5));
}

TEST_CASE("cut and resample show the same motion") {
  std::mt19937_64 rng(6);
  const Clip clip = random_clip(rng, 9);
  const double from = 0.3 * clip.duration(), to = 0.8 * clip.duration();
  const Clip part = motion::cut(clip, from, to);
  CHECK_NOTHROW(part.check());
  CHECK(part.duration() == doctest::Approx(to - from));
  for (double t = 0; t < to - from; t += 0.01)
    CHECK(distance(clip.skeleton, part.sample(t), clip.sample(from + t)) < 1e-9);

  const Clip even = motion::resample(clip, 200);
  CHECK(even.duration() == doctest::Approx(clip.duration()));
  for (int k = 0; k < even.keys(); ++k)
    CHECK(distance(clip.skeleton, even.poses.col(k), clip.sample(even.times[k])) < 1e-9);

  Gait g;
  g.turn = 0.5;
  const Clip cycle = gait(g, g.period, 41, true);
  const Clip later = motion::cut(cycle, -0.7, 2.9);
  CHECK(later.duration() == doctest::Approx(3.6));
  for (double t = 0.01; t < 3.6; t += 0.05)
    CHECK(distance(cycle.skeleton, later.sample(t), cycle.sample(t - 0.7)) < 1e-7);
}

TEST_CASE("errors name the clip and the frame") {
  std::mt19937_64 rng(7);
  const Clip good = random_clip(rng);
  Clip clip = good;
  clip.poses(3, 4) = 3;
  CHECK(fails_with([&] { clip.check(); }, "clip 'random', frame 4: joint 'root': expected a unit quaternion"));
  clip = good;
  clip.poses(0, 2) = std::numeric_limits<double>::quiet_NaN();
  CHECK(fails_with([&] { clip.check(); }, "frame 2: joint 'root' is not finite"));
  clip = good;
  clip.times[3] = clip.times[2];
  CHECK(fails_with([&] { clip.check(); }, "frame 3: expected a time after"));
  clip = good;
  clip.times[0] = 0.01;
  CHECK(fails_with([&] { clip.check(); }, "at time 0"));
  clip = good;
  clip.contacts = Eigen::MatrixXd::Constant(clip.skeleton.size(), clip.keys(), 1.5);
  CHECK(fails_with([&] { clip.check(); }, "frame 0: body 'root_body'"));
  clip = good;
  clip.poses.conservativeResize(Eigen::NoChange, 3);
  CHECK(fails_with([&] { clip.check(); }, "expected 7 poses, found 3"));
  CHECK(fails_with([&] { motion::cut(good, 1.0, 0.5); }, "clip 'random': cut"));
  CHECK(fails_with([&] { motion::cut(good, 0.1, 99); }, "clip 'random': cut"));
  CHECK(fails_with([&] { motion::resample(good, 0); }, "clip 'random': resample"));
}
