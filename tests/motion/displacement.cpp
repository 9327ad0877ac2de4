// SPDX-License-Identifier: MIT
#include <traceur/motion/displacement.hpp>

#include <doctest/doctest.h>

#include "../core/support.hpp"
#include "figure.hpp"
#include <traceur/motion/time_warp.hpp>

using namespace traceur;
using namespace figure;
using motion::Displacement;

namespace {

Displacement<double> random_displacement(std::mt19937_64& rng, const Skeleton& s, int keys, double duration, double size) {
  Displacement<double> d{Vec::LinSpaced(keys, 0, duration), Eigen::MatrixXd(s.nv(), keys)};
  for (Eigen::Index i = 0; i < d.values.size(); ++i) d.values.data()[i] = uniform(rng, -size, size);
  return d;
}

}  // namespace

TEST_CASE("displacing multiplies every rotation on the right and adds to positions") {
  std::mt19937_64 rng(21);
  const Skeleton s = biped();
  const Vec q = random_pose(s, rng);
  Vec d(s.nv()), out(s.nq());
  for (Eigen::Index i = 0; i < d.size(); ++i) d[i] = uniform(rng, -1, 1);
  motion::displace_local(s, q.data(), d.data(), out.data());
  CHECK((out.head(3) - q.head(3) - d.head(3)).norm() < 1e-15);
  const auto right = [&](int from, int tangent) {
    const Eigen::Vector3d w = d.segment(tangent, 3);
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(w.norm(), w.normalized()));
    const Eigen::Quaterniond expected = Eigen::Quaterniond(Eigen::Vector4d(q.segment(from, 4))) * turn;
    CHECK((expected.coeffs() - Eigen::Vector4d(out.segment(from, 4))).norm() < 1e-12);
  };
  right(3, 3);
  for (const char* name : {"chest", "left_hip", "right_shoulder"}) right(s[s.find(name)].q_index, s[s.find(name)].v_index);
  const Joint& knee = s[s.find("left_knee")];
  CHECK(out[knee.q_index] == doctest::Approx(q[knee.q_index] + d[knee.v_index]));

  Vec back(s.nv()), in_place = q;
  motion::difference_local(s, q.data(), out.data(), back.data());
  CHECK((back - d).norm() < 1e-9);
  motion::displace_local(s, in_place.data(), d.data(), in_place.data());
  CHECK((in_place - out).norm() == 0.0);
}

TEST_CASE("a displacement map is piecewise linear and held beyond its ends") {
  const Skeleton s = biped();
  Displacement<double> d{Vec::LinSpaced(3, 0.2, 1.0), Eigen::MatrixXd::Zero(s.nv(), 3)};
  d.values.row(5) << 1, 3, -1;
  Vec out(s.nv());
  const auto at = [&](double phi) {
    d.sample(phi, out.data());
    return out[5];
  };
  CHECK(at(0.0) == doctest::Approx(1));
  CHECK(at(0.4) == doctest::Approx(2));
  CHECK(at(0.6) == doctest::Approx(3));
  CHECK(at(0.9) == doctest::Approx(0));
  CHECK(at(5.0) == doctest::Approx(-1));
  d.times = Vec::Constant(1, 0.5);
  d.values = Eigen::MatrixXd::Constant(s.nv(), 1, 0.25);
  CHECK(at(-1.0) == 0.25);
  CHECK(at(9.0) == 0.25);
}

TEST_CASE("the displacement between two clips leads from one to the other") {
  std::mt19937_64 rng(22);
  const auto a = random_clip(rng, 6);
  auto b = random_clip(rng, 9);
  b.times *= a.duration() / b.duration();
  const auto d = motion::displacement_between(a, b);
  const auto moved = motion::displaced(a, d);
  for (int k = 0; k < moved.keys(); ++k)
    CHECK(distance(a.skeleton, moved.poses.col(k), b.sample(moved.times[k])) < 1e-8);
}

TEST_CASE("a displaced clip yields the displacement back, and zero changes nothing") {
  std::mt19937_64 rng(23);
  const auto clip = random_clip(rng, 6);
  const auto d = random_displacement(rng, clip.skeleton, 5, clip.duration(), 0.8);
  const auto moved = motion::displaced(clip, d);
  CHECK_NOTHROW(moved.check());
  const auto found = motion::displacement_between(clip, moved);
  Vec expected(clip.skeleton.nv());
  for (Eigen::Index k = 0; k < found.times.size(); ++k) {
    d.sample(found.times[k], expected.data());
    CHECK((found.values.col(k) - expected).norm() < 1e-8);
  }
  auto zero = d;
  zero.values.setZero();
  const auto same = motion::displaced(clip, zero);
  for (double t = 0; t < clip.duration(); t += 0.02) CHECK(distance(clip.skeleton, same.sample(t), clip.sample(t)) < 1e-9);
}

TEST_CASE("exact samples agree with the displaced clip at its keys, cycle after cycle") {
  std::mt19937_64 rng(24);
  Gait g;
  const auto clip = gait(g, g.period, 13, true);
  auto d = random_displacement(rng, clip.skeleton, 6, clip.duration(), 0.3);
  d.values.col(5) = d.values.col(0);
  d.values.row(5).setZero();  // heading
  d.values.row(3).setZero();
  d.values.row(4).setZero();
  const auto moved = motion::displaced(clip, d);
  CHECK(moved.cyclic);
  Vec q(clip.skeleton.nq()), scratch(clip.skeleton.nv());
  for (const int cycle : {-2, 0, 3})
    for (int k = 0; k + 1 < moved.keys(); ++k) {
      const double phi = moved.times[k] + cycle * clip.duration() + 1e-12;
      motion::sample_displaced(clip, d, phi, q.data(), scratch.data());
      CHECK(distance(clip.skeleton, q, moved.sample(phi)) < 1e-6);
    }
}

TEST_CASE("an episode's trace rebuilds its motion by displacement and warp") {
  std::mt19937_64 rng(26);
  const auto clip = random_clip(rng, 6);
  Vec tau(10);
  for (int i = 0; i < 10; ++i) tau[i] = uniform(rng, -0.5, 0.5);
  motion::TimeWarp<> shape(tau, 0.1);
  const Vec phases = shape.phases() * (clip.duration() / shape.phases()[10]);
  const auto w = motion::TimeWarp<>::through(shape.times(), phases);
  Eigen::MatrixXd episode(clip.skeleton.nq(), 11);
  for (int k = 0; k < 11; ++k) episode.col(k) = random_pose(clip.skeleton, rng);
  const auto d = motion::displacement_trace(clip, phases, episode);
  const auto variant = motion::variant(clip, d, w);
  CHECK(variant.duration() == doctest::Approx(1.0));
  for (int k = 0; k < 11; ++k) CHECK(distance(clip.skeleton, variant.sample(0.1 * k), episode.col(k)) < 1e-8);
}

TEST_CASE("errors name the clip and the frame") {
  std::mt19937_64 rng(27);
  const auto clip = random_clip(rng, 4);
  auto d = random_displacement(rng, clip.skeleton, 3, 1, 0.1);
  d.values(2, 1) = std::nan("");
  CHECK(fails_with([&] { motion::displaced(clip, d); }, "clip 'random': displacement, frame 1"));
  d.values.resize(3, 3);
  CHECK(fails_with([&] { motion::displaced(clip, d); }, "rows, found 3"));
  auto longer = clip;
  longer.times *= 2;
  CHECK(fails_with([&] { motion::displacement_between(clip, longer); }, "same duration"));
  CHECK(fails_with([&] { motion::displacement_trace(clip, Vec::Zero(3), clip.poses); }, "one pose of"));
}

TEST_CASE("exact samples are the same in single precision, and dual numbers carry the derivative of warp and displacement") {
  std::mt19937_64 rng(27);
  Gait g;
  const auto clip = gait(g, g.period, 13, true);
  const auto d = random_displacement(rng, clip.skeleton, 6, clip.duration(), 0.3);
  const Vec direction = Vec::NullaryExpr(d.values.size(), [&] { return uniform(rng, -1, 1); });
  // The pose at time t of the motion displaced along the direction by e, and played faster by exp(e) in its first half.
  const auto pose = [&]<class S>(const S& e, double t) {
    motion::Displacement<S> moved{d.times, d.values.cast<S>()};
    for (Eigen::Index i = 0; i < d.values.size(); ++i) moved.values.data()[i] += e * S(static_cast<core::Element<S>>(direction[i]));
    Eigen::Matrix<S, Eigen::Dynamic, 1> tau(2);
    tau << e, S(0);
    const motion::TimeWarp<S> warp(tau, clip.duration() / 2);
    Eigen::Matrix<S, Eigen::Dynamic, 1> q(clip.skeleton.nq()), scratch(clip.skeleton.nv());
    motion::sample_displaced(clip, moved, warp.phase(S(static_cast<core::Element<S>>(t))), q.data(), scratch.data());
    return q;
  };
  for (const double share : {0.13, 0.41, 0.77}) {
    const double t = share * clip.duration();
    const Vec q = pose(0.0, t);
    CHECK((pose(0.0F, t).cast<double>() - q).cwiseAbs().maxCoeff() < 1e-5);
#ifdef TRACEUR_TEST_JET_HEADER
    using Jet = ceres::Jet<double, 1>;
    const auto dual = pose(Jet(0.0, 0), t);
    constexpr double h = 1e-6;
    const Vec slope = (pose(h, t) - pose(-h, t)) / (2 * h);
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      CHECK(dual[i].a == doctest::Approx(q[i]).epsilon(1e-12));
      CHECK(dual[i].v[0] == doctest::Approx(slope[i]).epsilon(1e-6).scale(1.0));
    }
#endif
  }
}
