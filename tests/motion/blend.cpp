// SPDX-License-Identifier: MIT
#include <traceur/motion/blend.hpp>

#include <doctest/doctest.h>

#include "figure.hpp"

using namespace traceur;
using namespace figure;
using motion::Blend;

TEST_CASE("smoothstep is flat at both ends, symmetric and increasing") {
  CHECK(motion::smoothstep(-1.0) == 0.0);
  CHECK(motion::smoothstep(0.5) == 0.5);
  CHECK(motion::smoothstep(2.0) == 1.0);
  for (double u = 0.01; u < 1; u += 0.01) {
    CHECK(motion::smoothstep(u) + motion::smoothstep(1 - u) == doctest::Approx(1));
    CHECK(motion::smoothstep(static_cast<float>(u)) == doctest::Approx(motion::smoothstep(u)).epsilon(1e-5));
  }
  using P = core::Pack<float, 4>;
  CHECK(core::all(motion::smoothstep(P(3.0f)) <= P(1.0f)));
}

TEST_CASE("a blend is the first clip before it, the second after it") {
  std::mt19937_64 rng(51);
  const auto a = random_clip(rng, 8), b = random_clip(rng, 9);
  Blend o;
  o.start = 0.5;
  o.duration = 0.3;
  o.phase = 0.2;
  o.align = false;
  const auto c = motion::blend(a, b, o);
  CHECK_NOTHROW(c.check());
  CHECK(c.duration() == doctest::Approx(0.5 + b.duration() - 0.2));
  for (double t = 0; t <= 0.5; t += 0.01) CHECK(distance(a.skeleton, c.sample(t), a.sample(t)) < 1e-9);
  for (double t = 0.801; t <= c.duration(); t += 0.01) CHECK(distance(a.skeleton, c.sample(t), b.sample(t - 0.3)) < 1e-9);
  Vec half(a.skeleton.nq());
  body::interpolate(a.skeleton, a.sample(0.65).data(), b.sample(0.35).data(), 0.5, half.data());
  CHECK(distance(a.skeleton, c.sample(0.65), half) < 1e-9);
}

TEST_CASE("a clip blended into itself is itself") {
  std::mt19937_64 rng(52);
  const auto clip = random_clip(rng, 10);
  Blend o;
  o.start = o.phase = 0.4;
  const auto same = motion::blend(clip, clip, o);
  for (double t = 0; t < clip.duration(); t += 0.01) CHECK(distance(clip.skeleton, same.sample(t), clip.sample(t)) < 1e-9);
}

TEST_CASE("an aligned blend goes on wherever the first clip led: a straight gait stays straight") {
  Gait g, elsewhere;
  elsewhere.heading = 2.2;
  elsewhere.lead = 0.9;
  const auto a = gait(g, 2.4, 145);
  auto b = gait(elsewhere, 2.4, 145);
  b.poses.row(0).array() += 4;
  Blend o;
  o.start = 1.2;
  o.duration = 0.4;
  // Where the second gait's legs are as the first's are when the blend begins.
  o.phase = 1.2 - 0.9 / (2 * pi) * g.period;
  const auto c = motion::blend(a, b, o);
  for (double t = 0; t < c.duration(); t += 0.05) CHECK(distance(a.skeleton, c.sample(t), gait_pose(a.skeleton, g, t)) < 0.01);
}

TEST_CASE("a blend leaves no jump in velocity between gaits of different speed") {
  Gait slow, fast;
  fast.speed = 2.0;
  fast.period = 0.9;
  const auto a = gait(slow, 1.2, 121, true), b = gait(fast, 0.9, 91, true);
  Blend o;
  o.start = 2.0;
  o.duration = 0.45;
  const auto c = motion::blend(a, b, o);
  CHECK(c.duration() == doctest::Approx(2.9));
  double worst = 0;
  Vec previous = c.velocity(1.9);
  for (double t = 1.91; t < 2.6; t += 0.01) {
    const Vec v = c.velocity(t);
    worst = std::max(worst, (v - previous).cwiseAbs().maxCoeff());
    previous = v;
  }
  CHECK(worst < 0.8);  // a hard cut jumps by more than 2
}

TEST_CASE("labels are blended and errors name both clips") {
  std::mt19937_64 rng(53);
  auto a = random_clip(rng, 8), b = random_clip(rng, 9);
  a.contacts = Eigen::MatrixXd::Ones(a.skeleton.size(), a.keys());
  b.contacts = Eigen::MatrixXd::Zero(b.skeleton.size(), b.keys());
  Blend o;
  o.start = 0.2;
  const auto c = motion::blend(a, b, o);
  Vec labels(a.skeleton.size());
  c.sample_contacts(0.35, labels);
  CHECK(labels[0] == doctest::Approx(0.5));
  o.duration = 0;
  CHECK(fails_with([&] { motion::blend(a, b, o); }, "clip 'random' and clip 'random': blend: expected a positive duration"));
  o.duration = 0.3;
  o.start = 99;
  CHECK(fails_with([&] { motion::blend(a, b, o); }, "within the first clip"));
  o.start = 0;
  o.phase = 99;
  CHECK(fails_with([&] { motion::blend(a, b, o); }, "within the second clip"));
  motion::Clip other = b;
  other.skeleton = Skeleton();
  other.skeleton.add(joint("root", -1, JointType::free, {0, 0, 0}));
  CHECK(fails_with([&] { motion::blend(a, other, Blend{}); }, "expected the same joints"));
}
