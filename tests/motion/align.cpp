// SPDX-License-Identifier: MIT
#include <traceur/motion/align.hpp>

#include <doctest/doctest.h>

#include <traceur/body/kinematics.hpp>

#include "figure.hpp"

using namespace traceur;
using namespace figure;

TEST_CASE("ground transforms form a group") {
  std::mt19937_64 rng(41);
  const auto random = [&] {
    motion::GroundTransform t;
    t.turn = core::about_axis(Vector3<double>{0, 0, 1}, uniform(rng, -3, 3));
    t.shift = {uniform(rng, -5, 5), uniform(rng, -5, 5), 0};
    return t;
  };
  const auto a = random(), b = random();
  const auto p = random_vector(rng, 2);
  CHECK(norm((a * b).apply(p) - a.apply(b.apply(p))) < 1e-12);
  CHECK(norm(a.inverse().apply(a.apply(p)) - p) < 1e-12);
  CHECK(norm((a * a.inverse()).shift) < 1e-12);
}

TEST_CASE("an aligned clip begins over the origin and faces +x, and the transform leads there") {
  std::mt19937_64 rng(42);
  for (const double phi : {0.0, 0.4}) {
    const auto clip = random_clip(rng);
    const auto [aligned, transform] = motion::align(clip, phi);
    const Vec q = aligned.sample(phi);
    CHECK(std::abs(q[0]) < 1e-12);
    CHECK(std::abs(q[1]) < 1e-12);
    const auto forward = Quaternion<double>::from(q.data() + 3).rotate({1, 0, 0});
    CHECK(std::abs(forward.y) < 1e-12);
    CHECK(forward.x > 0);
    CHECK(aligned.poses.row(2) == clip.poses.row(2));
    CHECK(aligned.poses.bottomRows(clip.skeleton.nq() - 7) == clip.poses.bottomRows(clip.skeleton.nq() - 7));
    // Every joint moves as the transform says.
    body::Frames<double> before(clip.skeleton), after(clip.skeleton);
    for (int k = 0; k < clip.keys(); ++k) {
      body::forward_kinematics(clip.skeleton, clip.poses.col(k).data(), before);
      body::forward_kinematics(clip.skeleton, aligned.poses.col(k).data(), after);
      for (std::size_t i = 0; i < before.position.size(); ++i)
        CHECK(norm(transform.apply(before.position[i]) - after.position[i]) < 1e-12);
    }
    CHECK(largest_gap(motion::moved(aligned, transform.inverse()), clip) < 1e-12);
    Vec v = clip.velocity(0.3);
    transform.apply_root_velocity(v);
    CHECK((v - aligned.velocity(0.3)).norm() < 1e-9);
  }
}

TEST_CASE("the facing direction can be any axis of the root") {
  std::mt19937_64 rng(43);
  const auto clip = random_clip(rng);
  const auto aligned = motion::align(clip, 0, {0, 1, 0}).clip;
  const auto forward = Quaternion<double>::from(aligned.poses.col(0).data() + 3).rotate({0, 1, 0});
  CHECK(std::abs(forward.y) < 1e-12);
  CHECK(forward.x > 0);
}

TEST_CASE("a clip aligned to a pose of itself does not move") {
  std::mt19937_64 rng(44);
  const auto clip = random_clip(rng);
  CHECK(largest_gap(motion::align_to(clip, 0.2, clip.sample(0.2)).clip, clip) < 1e-9);
  const Vec target = random_pose(clip.skeleton, rng);
  const Vec q = motion::align_to(clip, 0.2, target).clip.sample(0.2);
  CHECK((q.head(2) - target.head(2)).norm() < 1e-12);
  const auto h = [](const Vec& pose) { return core::heading(Quaternion<double>::from(pose.data() + 3)); };
  CHECK(norm(log_map(h(q) * h(target).conjugate())) < 1e-9);
}

TEST_CASE("what has no free root cannot be moved") {
  motion::Clip arm;
  arm.name = "arm";
  arm.skeleton.add(joint("base", -1, JointType::fixed, {0, 0, 1}));
  arm.skeleton.add(joint("elbow", 0, JointType::hinge, {0, 0, 0.3}));
  arm.times = Vec::LinSpaced(2, 0, 1);
  arm.poses = Eigen::RowVector2d(0, 1);
  CHECK(fails_with([&] { motion::align(arm); }, "clip 'arm': expected a skeleton with a free root"));
  std::mt19937_64 rng(45);
  const auto clip = random_clip(rng);
  CHECK(fails_with([&] { motion::align_to(clip, 0, Vec::Zero(3)); }, "clip 'random': align_to: expected a pose"));
}
