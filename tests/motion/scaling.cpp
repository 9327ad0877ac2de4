// SPDX-License-Identifier: MIT
#include <traceur/motion/scaling.hpp>

#include <doctest/doctest.h>

#include "figure.hpp"

using namespace traceur;
using namespace figure;

TEST_CASE("the mean pose averages heights and angles over time, and tangent vectors from it cancel") {
  std::mt19937_64 rng(31);
  const auto clip = random_clip(rng, 8);
  const Vec mean = motion::mean_pose(clip);
  const int knee = clip.skeleton[clip.skeleton.find("left_knee")].q_index;
  double height = 0, angle = 0;
  const int n = 100000;
  for (int i = 0; i < n; ++i) {
    const Vec q = clip.sample((i + 0.5) / n * clip.duration());
    height += q[2] / n;
    angle += q[knee] / n;
  }
  CHECK(mean[2] == doctest::Approx(height).epsilon(1e-5));
  CHECK(mean[knee] == doctest::Approx(angle).epsilon(1e-5));
  Vec d(clip.skeleton.nv()), sum = Vec::Zero(clip.skeleton.nv());
  for (int k = 0; k < clip.keys(); ++k) {
    body::difference(clip.skeleton, mean.data(), clip.poses.col(k).data(), d.data());
    const double before = k > 0 ? clip.times[k] - clip.times[k - 1] : 0;
    const double after = k + 1 < clip.keys() ? clip.times[k + 1] - clip.times[k] : 0;
    sum += 0.5 * (before + after) * d;
  }
  CHECK(sum.norm() < 1e-9);
}

TEST_CASE("one leaves a clip as it is, zero stops it at its mean, factors multiply") {
  Gait g;
  const auto clip = gait(g, 2.0, 31);
  CHECK(largest_gap(motion::scale_amplitude(clip, 1), clip) < 1e-9);
  const auto still = motion::scale_amplitude(clip, 0);
  const Vec mean = motion::mean_pose(clip);
  for (int k = 0; k < still.keys(); ++k) {
    CHECK(still.poses.col(k).segment(7, clip.skeleton.nq() - 7).isApprox(mean.tail(clip.skeleton.nq() - 7), 1e-9));
    CHECK(still.poses(2, k) == doctest::Approx(mean[2]));
    CHECK(still.poses(0, k) == doctest::Approx(clip.poses(0, 0)));
    CHECK(std::abs(still.poses(6, k)) == doctest::Approx(1.0));  // upright
  }
  const auto twice = motion::scale_amplitude(motion::scale_amplitude(clip, 0.6), 1.5);
  CHECK(largest_gap(twice, motion::scale_amplitude(clip, 0.9)) < 1e-6);
}

TEST_CASE("rotations keep their axis and scale their angle, the root's towards the identity") {
  Gait g;
  const auto clip = gait(g, 1.2, 25);
  const double alpha = 0.4;
  const auto scaled = motion::scale_amplitude(clip, alpha);
  const Vec mean = motion::mean_pose(clip);
  for (int k = 0; k < clip.keys(); ++k) {
    using Q = Quaternion<double>;
    const auto before = log_map(Q::from(clip.poses.col(k).data() + 3)), after = log_map(Q::from(scaled.poses.col(k).data() + 3));
    CHECK(norm(after - alpha * before) < 1e-9);
    // The paper's other wording: interpolation with the identity.
    const Q slerped = core::slerp(Q::identity(), Q::from(clip.poses.col(k).data() + 3), alpha);
    CHECK(norm(log_map(slerped) - after) < 1e-9);
    const int hip = clip.skeleton[clip.skeleton.find("left_hip")].q_index;
    const Q center = Q::from(mean.data() + hip).conjugate();
    const auto from_mean = log_map(center * Q::from(clip.poses.col(k).data() + hip));
    const auto scaled_from_mean = log_map(center * Q::from(scaled.poses.col(k).data() + hip));
    CHECK(norm(scaled_from_mean - alpha * from_mean) < 1e-9);
  }
}

TEST_CASE("velocities scale with the amplitude where rotations share an axis") {
  Gait g;
  auto clip = gait(g, 1.2, 121);
  const auto scaled = motion::scale_amplitude(clip, 0.5);
  for (const double phi : {0.2, 0.55, 1.0}) {
    const Vec v = clip.velocity(phi), w = scaled.velocity(phi);
    for (const int i : {0, 1, 2}) CHECK(w[i] == doctest::Approx(0.5 * v[i]).scale(1.0).epsilon(1e-9));
    for (const char* name : {"left_knee", "right_elbow"}) {
      const int i = clip.skeleton[clip.skeleton.find(name)].v_index;
      CHECK(w[i] == doctest::Approx(0.5 * v[i]).scale(1.0).epsilon(1e-9));
    }
    const int chest = clip.skeleton[1].v_index;
    CHECK((w.segment(chest, 3) - 0.5 * v.segment(chest, 3)).norm() < 1e-9);
  }
  motion::AmplitudeScaling stay;
  stay.travel = false;
  CHECK(motion::scale_amplitude(clip, 0.5, stay).poses.topRows(2) == clip.poses.topRows(2));
}

TEST_CASE("another upright than the identity keeps the heading") {
  Gait g;
  g.heading = 2.0;
  const auto clip = gait(g, 1.2, 25);
  motion::AmplitudeScaling options;
  options.upright = core::about_axis(Vector3<double>{0, 0, 1}, 2.0);
  const auto still = motion::scale_amplitude(clip, 0, options);
  for (int k = 0; k < clip.keys(); ++k)
    CHECK(norm(log_map(Quaternion<double>::from(still.poses.col(k).data() + 3)) - Vector3<double>{0, 0, 2.0}) < 1e-9);
}

TEST_CASE("duration scales linearly and speed inversely") {
  Gait g;
  const auto clip = gait(g, 1.2, 25);
  const auto slow = motion::scale_duration(clip, 1.5);
  CHECK(slow.duration() == doctest::Approx(1.8));
  CHECK(distance(clip.skeleton, slow.sample(0.9), clip.sample(0.6)) < 1e-12);
  CHECK((1.5 * slow.velocity(0.9, 0.015) - clip.velocity(0.6, 0.01)).norm() < 1e-9);
  CHECK(fails_with([&] { motion::scale_duration(clip, 0); }, "clip 'gait': scale_duration"));
  CHECK(fails_with([&] { motion::scale_amplitude(clip, -1); }, "clip 'gait': scale_amplitude"));
}
