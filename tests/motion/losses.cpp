// SPDX-License-Identifier: MIT
#include <traceur/motion/losses.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/pack.hpp>
#include <traceur/core/random.hpp>

#include "../error_message.hpp"
#include "walk_on_boxes.hpp"

using namespace traceur;
using motion::CorrectionLoss;
using motion::CorrectionLosses;
using Vec3 = core::Vector3<double>;

namespace {

/// Distance from the union of boxes that stand on every cell, the border's reaching out without end; inside, the way to
/// the union of the air above. By trying all cells.
double distance_to_boxes(const terrain::HeightGrid& g, const Vec3& p) {
  constexpr double far = 1e9;
  const auto of_column = [&](int i, int j, double sign) {
    const double x0 = i == 0 ? -far : g.x0() + i * g.cell(), x1 = i == g.nx() - 1 ? far : g.x0() + (i + 1) * g.cell();
    const double y0 = j == 0 ? -far : g.y0() + j * g.cell(), y1 = j == g.ny() - 1 ? far : g.y0() + (j + 1) * g.cell();
    const double dx = std::max({x0 - p.x, p.x - x1, 0.0}), dy = std::max({y0 - p.y, p.y - y1, 0.0});
    const double dz = std::max(sign * (p.z - g(i, j)), 0.0);
    return std::sqrt(dx * dx + dy * dy + dz * dz);
  };
  double solid = far, air = far;
  for (int i = 0; i < g.nx(); ++i)
    for (int j = 0; j < g.ny(); ++j) {
      solid = std::min(solid, of_column(i, j, 1));
      air = std::min(air, of_column(i, j, -1));
    }
  return solid > 0 ? solid : -air;
}

struct Brute {
  double penetration = 0, contact = 0, jerk = 0, regularization = 0;
};

/// All four losses from the paper's formulas.
Brute brute(const motion::Clip& clip, const std::vector<body::SurfacePoint>& points, const terrain::HeightGrid& g,
            const motion::Clip& source, double limit, const motion::RegularizationWeights& change) {
  Brute out;
  std::vector<body::Frames<double>> frames(static_cast<std::size_t>(clip.keys()), body::Frames<double>(clip.skeleton));
  Eigen::VectorXd d(clip.skeleton.nv());
  for (int k = 0; k < clip.keys(); ++k) {
    auto& f = frames[static_cast<std::size_t>(k)];
    body::forward_kinematics(clip.skeleton, clip.poses.col(k).data(), f);
    std::vector<double> nearest(static_cast<std::size_t>(clip.skeleton.size()), 1e9);
    for (const auto& p : points) {
      const double at = distance_to_boxes(g, f.point(p.body, p.local));
      out.penetration += std::max(-at, 0.0);
      double& n = nearest[static_cast<std::size_t>(p.body)];
      n = std::min(n, std::abs(at));
    }
    for (int b = 0; b < clip.skeleton.size(); ++b)
      if (clip.contacts(b, k) > 0) out.contact += clip.contacts(b, k) * nearest[static_cast<std::size_t>(b)];
    body::difference(clip.skeleton, source.poses.col(k).data(), clip.poses.col(k).data(), d.data());
    out.regularization += change.root_position * d.head(3).squaredNorm() +
                          change.root_rotation * d.segment(3, 3).squaredNorm() +
                          change.joints * d.tail(d.size() - 6).squaredNorm();
  }
  const double dt = clip.times[1] - clip.times[0];
  for (std::size_t k = 0; k + 3 < frames.size(); ++k)
    for (std::size_t b = 0; b < frames[k].position.size(); ++b) {
      const Vec3 third = frames[k + 3].position[b] - 3.0 * frames[k + 2].position[b] + 3.0 * frames[k + 1].position[b] -
                         frames[k].position[b];
      out.jerk += std::max(norm(third) / (dt * dt * dt) - limit, 0.0);
    }
  return out;
}

}  // namespace

TEST_CASE("losses: the paper's formulas, by trying every cell and point") {
  const auto points = body::surface_points(walk_on_boxes::character());
  const terrain::HeightGrid ground = walk_on_boxes::ground();
  motion::CorrectionWeights w;
  w.jerk_limit = 700;
  w.change = {1, 10, 2};
  for (const double sunk : {0.0, 0.05, 0.2}) {
    const motion::Clip source = walk_on_boxes::clip(12, sunk);
    const CorrectionLoss loss(source, points, ground, w);
    const Eigen::MatrixXd d = walk_on_boxes::random_change(source, 0.03);
    const CorrectionLosses l = loss.losses(d);
    const Brute b = brute(loss.changed(d), points, ground, source, w.jerk_limit, w.change);
    CHECK(l.penetration == doctest::Approx(b.penetration).epsilon(1e-9));
    CHECK(l.contact == doctest::Approx(b.contact).epsilon(1e-9));
    CHECK(l.jerk == doctest::Approx(b.jerk).epsilon(1e-6));
    CHECK(l.regularization == doctest::Approx(b.regularization).epsilon(1e-9));
    CHECK(l.total == doctest::Approx(b.regularization + 1000 * (b.penetration + b.contact + b.jerk)).epsilon(1e-6));
    if (sunk == 0.2) CHECK(b.penetration > 1);
    CHECK(b.contact > 0.01);
    CHECK(b.jerk > 1000);
  }
}

TEST_CASE("losses: the scalar-generic sum and the one with a gradient are one number") {
  const auto points = body::surface_points(walk_on_boxes::character());
  const motion::Clip source = walk_on_boxes::clip(10, 0.1);
  const CorrectionLoss loss(source, points, walk_on_boxes::ground());
  const Eigen::MatrixXd d = walk_on_boxes::random_change(source, 0.02);
  Eigen::MatrixXd g = d;
  CorrectionLoss::Workspace w = loss.workspace();
  const double total = loss.gradient(d, g, w, core::SerialExecutor{}).total;
  CHECK(loss.value(d.data()) == doctest::Approx(total).epsilon(1e-12));
  CHECK(loss.losses(d).total == doctest::Approx(total).epsilon(1e-12));
  const Eigen::MatrixXf single = d.cast<float>();
  CHECK(static_cast<double>(loss.value(single.data())) == doctest::Approx(total).epsilon(1e-3));
  using P = core::Pack<float>;
  std::vector<P> lanes;
  for (Eigen::Index i = 0; i < d.size(); ++i) lanes.push_back(P(single.data()[i]));
  CHECK(static_cast<double>(loss.value(lanes.data())[P::width - 1]) == doctest::Approx(total).epsilon(1e-3));
}

TEST_CASE("losses: the gradient is that of central differences") {
  const auto points = body::surface_points(walk_on_boxes::character());
  motion::CorrectionWeights weights;
  weights.jerk = 1;  // else jerk drowns the rest
  weights.change = {1, 10, 2};
  const motion::Clip source = walk_on_boxes::clip(9, 0.1);
  const CorrectionLoss loss(source, points, walk_on_boxes::ground(), weights);
  Eigen::MatrixXd d = walk_on_boxes::random_change(source, 0.3), g = d, unused = d;
  CorrectionLoss::Workspace w = loss.workspace();
  const CorrectionLosses l = loss.gradient(d, g, w, core::SerialExecutor{});
  CHECK(l.penetration > 0.1);
  CHECK(l.contact > 0.01);
  CHECK(l.jerk > 1000);
  core::RandomStream random(3, 0, 0);
  int kinks = 0;
  for (int trial = 0; trial < 120; ++trial) {
    const auto i = static_cast<Eigen::Index>(random.below(static_cast<std::uint32_t>(d.size())));
    const double at = d.data()[i], step = 1e-6;
    const auto total = [&](double x) {
      d.data()[i] = x;
      const double value = loss.gradient(d, unused, w, core::SerialExecutor{}).total;
      d.data()[i] = at;
      return value;
    };
    const double ahead = (total(at + step) - l.total) / step, behind = (l.total - total(at - step)) / step;
    // At a kink the two sides differ.
    if (std::abs(ahead - behind) > 1e-2 * (1 + std::abs(g.data()[i]))) {
      ++kinks;
      continue;
    }
    CHECK(g.data()[i] == doctest::Approx(0.5 * (ahead + behind)).epsilon(1e-4));
  }
  CHECK(kinks < 12);
}

TEST_CASE("losses: any executor gives the same bits") {
  const auto points = body::surface_points(walk_on_boxes::character());
  const motion::Clip source = walk_on_boxes::clip(30, 0.1);
  const CorrectionLoss loss(source, points, walk_on_boxes::ground());
  const Eigen::MatrixXd d = walk_on_boxes::random_change(source, 0.1);
  CorrectionLoss::Workspace w = loss.workspace();
  Eigen::MatrixXd serial = d, threaded = d;
  const double a = loss.gradient(d, serial, w, core::SerialExecutor{}).total;
  core::ThreadExecutor threads(3);
  const double b = loss.gradient(d, threaded, w, threads).total;
  CHECK(a == b);
  CHECK(serial == threaded);
}

TEST_CASE("losses: a body at rest on the ground costs nothing, one through it its depth times its points") {
  body::Character c;
  body::Joint root;
  root.name = root.body = "root";
  root.type = body::JointType::free;
  c.skeleton.add(root);
  body::Shape box;
  box.kind = body::Shape::Kind::box;
  box.size = {0.1, 0.1, 0.1};
  c.shapes = {box};
  const auto points = body::surface_points(c);
  motion::Clip clip{"box", c.skeleton, Eigen::VectorXd::LinSpaced(5, 0, 0.4), Eigen::MatrixXd::Zero(7, 5),
                    Eigen::MatrixXd::Ones(1, 5), false};
  clip.poses.row(6).setOnes();
  clip.poses.row(2).setConstant(0.1);
  const auto at_rest = CorrectionLoss(clip, points, terrain::HeightGrid::flat()).losses(Eigen::MatrixXd::Zero(6, 5));
  CHECK(at_rest.total < 1e-9);
  clip.poses.row(2).setConstant(0.07);
  const auto sunk = CorrectionLoss(clip, points, terrain::HeightGrid::flat()).losses(Eigen::MatrixXd::Zero(6, 5));
  CHECK(sunk.penetration == doctest::Approx(5 * 18 * 0.03));
  CHECK(sunk.contact == doctest::Approx(5 * 0.03));
  CHECK(sunk.jerk == 0);
  clip.contacts.resize(0, 0);
  CHECK(CorrectionLoss(clip, points, terrain::HeightGrid::flat()).losses(Eigen::MatrixXd::Zero(6, 5)).contact == 0);
}

TEST_CASE("losses: a constant jerk is found as it is, and one at rest is none") {
  const double dt = 1.0 / 30;
  std::vector<Vec3> p;
  for (int k = 0; k < 4; ++k) {
    const double t = k * dt;
    p.push_back({1e3 + 40 * t * t * t, -2 + 5 * t * t, 7 * t});  // jerk 240, 0, 0
  }
  const Vec3 j = motion::jerk(p[0], p[1], p[2], p[3], dt);
  CHECK(norm(j - Vec3{240, 0, 0}) < 1e-4);
  CHECK(motion::jerk_excess(j, 200) == doctest::Approx(40).epsilon(1e-4));
  CHECK(motion::jerk_excess(j, 300) == 0);
  CHECK(norm(motion::jerk(p[0], p[0], p[0], p[0], dt)) == 0);
}

TEST_CASE("losses: what does not fit together is refused") {
  const auto points = body::surface_points(walk_on_boxes::character());
  const terrain::HeightGrid g = walk_on_boxes::ground();
  const auto refused = [&](const motion::Clip& clip, std::vector<body::SurfacePoint> p, const std::string& part) {
    return traceur_test::message([&] { CorrectionLoss(clip, p, g); }).find(part) != std::string::npos;
  };
  motion::Clip clip = walk_on_boxes::clip(12);
  auto wrong = points;
  wrong[0].body = 99;
  CHECK(refused(clip, wrong, "body 99"));
  wrong = points;
  std::swap(wrong.front(), wrong.back());
  CHECK(refused(clip, wrong, "order of their bodies"));
  CHECK(refused(walk_on_boxes::clip(3), points, "four frames"));
  clip.times[5] += 0.01;
  CHECK(refused(clip, points, "evenly spaced"));
}
