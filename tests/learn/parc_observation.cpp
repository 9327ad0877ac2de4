// SPDX-License-Identifier: MIT
#include <traceur/learn/parc_observation.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <optional>
#include <sstream>

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include <traceur/body/surface_points.hpp>
#include <traceur/io/mjcf.hpp>
#include <traceur/io/motion_json.hpp>
#include <traceur/io/terrain_file.hpp>
#include <traceur/terrain/augmentation.hpp>

#include "../error_message.hpp"
#include "../io/motions.hpp"
#include "support.hpp"

using namespace traceur;
using learn::ParcObservation;
using Vec = core::Vector3<double>;
using Quat = core::Quaternion<double>;

namespace {

const body::Character& humanoid() {
  static const body::Character c = io::read_mjcf(TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml");
  return c;
}

/// PARC's tracker rests with its arms hanging, as our humanoid does; its clips rest with arms stretched out. Both agree
/// about everything else, so a clip's rotations become ours by a quarter turn of the arms' frames.
Eigen::VectorXd with_hanging_arms(const body::Skeleton& from, const double* q, const body::Skeleton& to) {
  constexpr double quarter = 1.5707963267948966;
  const auto turn = [&](int i) {
    const std::string& name = from[i].body;
    const bool arm = name.find("arm") != std::string::npos || name.find("hand") != std::string::npos;
    const double side = name.find("left") == 0 ? 1 : -1;
    return arm ? core::about_axis(Vec{1, 0, 0}, side * quarter) : Quat::identity();
  };
  Eigen::VectorXd out = to.neutral_pose();
  out.head(7) = Eigen::Map<const Eigen::VectorXd>(q, 7);
  for (int i = 1; i < from.size(); ++i) {
    const Quat local = turn(from[i].parent).conjugate() * body::joint_rotation(from[i], q) * turn(i);
    if (to[i].type == body::JointType::ball) local.store(out.data() + to[i].q_index);
    if (to[i].type == body::JointType::hinge) out[to[i].q_index] = core::twist_angle(local, to[i].axis);
  }
  return out;
}

struct Recording {
  io::LoadedClip loaded;
  terrain::HeightGrid ground;
  nlohmann::json json;
  Eigen::MatrixXd observed;  ///< 1312 x frames
};

std::optional<std::filesystem::path> recording_file() {
  const auto folder = motions::folder();
  if (!folder) return std::nullopt;
  const auto file = *folder / "parc" / "dec2024_teaser_717_1_opt_dm.json";
  if (!std::filesystem::exists(file)) return std::nullopt;
  return file;
}

Recording read_recording(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::stringstream text;
  text << in.rdbuf();
  Recording r{io::read_motion_json(file), io::read_terrain(file), nlohmann::json::parse(text.str()), {}};
  const auto& rows = r.json["obs"];
  r.observed.resize(static_cast<Eigen::Index>(rows[0].size()), static_cast<Eigen::Index>(rows.size()));
  for (std::size_t t = 0; t < rows.size(); ++t)
    for (std::size_t i = 0; i < rows[t].size(); ++i)
      r.observed(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(t)) = rows[t][i].get<double>();
  return r;
}

/// The rotation whose images of x and z are six numbers of an observation.
Quat rotation_from(const double* o) {
  const Vec x = Vec::from(o), z = Vec::from(o + 3), y = cross(z, x);
  Eigen::Matrix3d m;
  m << x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z;
  return Quat::from(Eigen::Quaterniond(m)).normalized();
}

}  // namespace

TEST_CASE("parc observation: as long as PARC's, part by part") {
  const ParcObservation<double> o(humanoid().skeleton);
  CHECK(o.own_size() == 136);
  CHECK(o.future_size() == 105);
  CHECK(o.future_begin() == 136);
  CHECK(o.future_labels_begin() == 766);
  CHECK(o.own_labels_begin() == 856);
  CHECK(o.heights_begin() == 871);
  CHECK(o.size() == 1312);
}

TEST_CASE("parc observation: where the character is and heads does not show") {
  const body::Character c = learn_test::creature();
  ParcObservation<double>::Settings settings;
  settings.future_frames = 1;
  settings.key_bodies = {c.skeleton[2].body};
  const ParcObservation<double> o(c.skeleton, settings);
  core::RandomStream random(2, 0, 0);
  const Eigen::VectorXd q = learn_test::random_pose(c.skeleton, random), later = learn_test::random_pose(c.skeleton, random);
  const Eigen::VectorXd v = Eigen::VectorXd::LinSpaced(c.skeleton.nv(), -1, 1);
  const std::vector<double> labels(static_cast<std::size_t>(c.skeleton.size()), 0.5);
  const auto seen = [&](const Vec& shift, double angle) {
    const Quat turn = core::about_axis(Vec{0, 0, 1}, angle);
    const auto moved = [&](Eigen::VectorXd p) {
      (turn.rotate(Vec::from(p.data())) + shift).store(p.data());
      (turn * Quat::from(p.data() + 3)).store(p.data() + 3);
      return p;
    };
    const Eigen::VectorXd a = moved(q), b = moved(later);
    Eigen::VectorXd u = v;
    turn.rotate(Vec::from(v.data())).store(u.data());
    turn.rotate(Vec::from(v.data() + 3)).store(u.data() + 3);
    body::Frames<double> fa(c.skeleton), fb(c.skeleton);
    body::forward_kinematics(c.skeleton, a.data(), fa);
    body::forward_kinematics(c.skeleton, b.data(), fb);
    const auto span = [](const Eigen::VectorXd& x) { return std::span<const double>(x.data(), static_cast<std::size_t>(x.size())); };
    const std::array<ParcObservation<double>::Seen, 1> future{{{span(b), &fb, labels}}};
    std::vector<double> out(static_cast<std::size_t>(o.size()));
    o.observe({span(a), &fa, labels}, span(u), future, terrain::HeightGrid::flat(shift.z), out);
    return out;
  };
  const auto home = seen({0, 0, 0}, 0), away = seen({30, -7, 2}, 2.1);
  for (std::size_t i = 0; i < home.size(); ++i) CHECK(home[i] == doctest::Approx(away[i]).epsilon(1e-9));
}

TEST_CASE("parc observation: what is missing is named") {
  ParcObservation<float>::Settings settings;
  settings.key_bodies = {"tail"};
  CHECK(traceur_test::message([&] { ParcObservation<float>(humanoid().skeleton, settings); }).find("'tail'") !=
        std::string::npos);
}

TEST_CASE("parc observation: PARC's own recording") {
  const auto file = recording_file();
  if (!file) {
    MESSAGE("skipped: no PARC recording on this machine");
    return;
  }
  const Recording r = read_recording(*file);
  const body::Skeleton& s = humanoid().skeleton;
  const motion::Clip& clip = r.loaded.clip;
  const ParcObservation<double> o(s);
  const Eigen::Index frames = clip.keys();
  REQUIRE(r.observed.rows() == o.size());
  REQUIRE(r.observed.cols() == frames);
  const std::array<int, 6> steps{1, 2, 3, 10, 20, 30};

  std::vector<Eigen::VectorXd> own;
  for (Eigen::Index t = 0; t < frames; ++t) own.push_back(with_hanging_arms(clip.skeleton, clip.poses.col(t).data(), s));
  // The reference is not in the file, but every observation shows its next frame; put together these are the reference,
  // which all other steps must show too.
  std::vector<Eigen::VectorXd> reference(static_cast<std::size_t>(frames + 1), s.neutral_pose());
  std::vector<Eigen::VectorXd> reference_labels(static_cast<std::size_t>(frames + 1), Eigen::VectorXd::Zero(15));
  for (Eigen::Index t = 0; t < frames; ++t) {
    const auto i = static_cast<std::size_t>(t);
    const double* next = r.observed.col(t).data() + o.future_begin();
    const Quat heading = core::heading(Quat::from(own[i].data() + 3));
    Eigen::VectorXd& q = reference[i + 1];
    (Vec::from(own[i].data()) + heading.rotate(Vec::from(next))).store(q.data());
    (heading * rotation_from(next + 3)).store(q.data() + 3);
    for (int j = 1; j < s.size(); ++j) {
      const Quat local = rotation_from(next + 9 + 6 * (j - 1));
      if (s[j].type == body::JointType::ball) local.store(q.data() + s[j].q_index);
      if (s[j].type == body::JointType::hinge) q[s[j].q_index] = core::twist_angle(local, s[j].axis);
    }
    reference_labels[i + 1] = r.observed.col(t).segment(o.future_labels_begin(), 15);
  }

  double rotations = 0, keys = 0, root_velocity = 0, joint_velocity = 0, future = 0, labels = 0, heights = 0;
  int inside = 0, outside = 0, outside_off = 0;
  terrain::HeightFan fan;
  const terrain::LocalMap<double> places(fan);
  std::vector<double> out(static_cast<std::size_t>(o.size()));
  body::Frames<double> at(s);
  std::vector<body::Frames<double>> ahead(6, at);
  const auto span = [](const Eigen::VectorXd& x) { return std::span<const double>(x.data(), static_cast<std::size_t>(x.size())); };
  for (Eigen::Index t = 0; t < frames; ++t) {
    const auto i = static_cast<std::size_t>(t);
    body::forward_kinematics(s, own[i].data(), at);
    Eigen::VectorXd v(s.nv());
    const std::size_t before = i > 0 ? i - 1 : i, after = std::min(i + 1, own.size() - 1);
    body::difference(s, own[before].data(), own[after].data(), v.data());
    v *= 30.0 / static_cast<double>(after - before);
    const Eigen::VectorXd own_labels = clip.contacts.col(t);
    std::vector<ParcObservation<double>::Seen> later;
    for (std::size_t k = 0; k < steps.size(); ++k) {
      const auto n = std::min(i + static_cast<std::size_t>(steps[k]), reference.size() - 1);
      body::forward_kinematics(s, reference[n].data(), ahead[k]);
      later.push_back({span(reference[n]), &ahead[k], span(reference_labels[n])});
    }
    o.observe({span(own[i]), &at, span(own_labels)}, span(v), later, r.ground, out);
    const auto off = [&](int begin, int size) {
      double worst = 0;
      for (int k = begin; k < begin + size; ++k) worst = std::max(worst, std::abs(out[static_cast<std::size_t>(k)] - r.observed(k, t)));
      return worst;
    };
    rotations = std::max({rotations, off(0, 6), off(12, 84)});
    keys = std::max(keys, off(124, 12));
    root_velocity = std::max(root_velocity, off(6, 6));
    joint_velocity = std::max(joint_velocity, off(96, 28));
    for (std::size_t k = 0; k < steps.size(); ++k) {
      if (t + steps[k] > frames) continue;
      future = std::max(future, off(136 + 105 * static_cast<int>(k), 105));
      labels = std::max(labels, off(766 + 15 * static_cast<int>(k), 15));
    }
    labels = std::max(labels, off(856, 15));
    const auto frame = terrain::HeadingFrame<double>::of(at.position[0], at.rotation[0]);
    for (int k = 0; k < places.size(); ++k) {
      const Vec p = frame.to_world(places.place(k));
      const double x1 = r.ground.x0() + r.ground.nx() * r.ground.cell(), y1 = r.ground.y0() + r.ground.ny() * r.ground.cell();
      const double error = off(871 + k, 1);
      if (p.x >= r.ground.x0() && p.x < x1 && p.y >= r.ground.y0() && p.y < y1) {
        ++inside;
        heights = std::max(heights, error);
      } else {
        ++outside;
        outside_off += error > 1e-3;
      }
    }
  }
  MESSAGE("largest differences: rotations " << rotations << ", key bodies " << keys << ", future frames " << future
          << ", labels " << labels << ", heights " << heights << " (" << inside << " places; " << outside_off << " of "
          << outside << " beyond the terrain differ); from central differences: root " << root_velocity << ", joints "
          << joint_velocity);
  CHECK(rotations < 1e-3);
  CHECK(keys < 1e-3);
  CHECK(future < 1e-3);
  CHECK(labels == 0);
  CHECK(heights < 1e-3);
  CHECK(inside > 53000);
  // Velocities are the engine's at the end of a frame; the motion itself only tells their means.
  CHECK(root_velocity < 10);
}

TEST_CASE("parc observation: bounds of the recording's terrain") {
  const auto file = recording_file();
  if (!file) {
    MESSAGE("skipped: no PARC recording on this machine");
    return;
  }
  const Recording r = read_recording(*file);
  const body::Skeleton& s = humanoid().skeleton;
  const motion::Clip& clip = r.loaded.clip;
  const auto points = body::surface_points(humanoid());
  const int nx = r.ground.nx(), ny = r.ground.ny();
  // The authors' rule: where a sample point of the body ever was above a cell, its height is fixed; unless all stayed 0.8 m
  // above it, then it may rise to 0.8 m below the lowest. Elsewhere the highest root + 3 m and the lowest cell - 3 m.
  Eigen::MatrixXd lowest = Eigen::MatrixXd::Constant(nx, ny, 1e9);
  terrain::HeightBounds bounds(r.ground);
  body::Frames<double> frames(s);
  std::vector<double> places(3 * points.size());
  for (Eigen::Index t = 0; t < clip.keys(); ++t) {
    const Eigen::VectorXd q = with_hanging_arms(clip.skeleton, clip.poses.col(t).data(), s);
    body::forward_kinematics(s, q.data(), frames);
    bounds.add(humanoid(), frames);
    body::place_points<double>(points, frames, places.data());
    for (std::size_t k = 0; k < points.size(); ++k) {
      double& l = lowest(r.ground.column(places[3 * k]), r.ground.row(places[3 * k + 1]));
      l = std::min(l, places[3 * k + 2]);
    }
  }
  const double top = clip.poses.row(2).maxCoeff() + 3, bottom = r.ground.heights().minCoeff() - 3;
  int same = 0, differ = 0, fixed = 0, agree = 0;
  double worst = 0;
  const auto& recorded = r.json["terrain"]["hf_maxmin"];
  for (int i = 0; i < nx; ++i)
    for (int j = 0; j < ny; ++j) {
      const double upper = recorded[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)][0].get<double>();
      const double lower = recorded[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)][1].get<double>();
      const double h = r.ground(i, j), l = lowest(i, j);
      double u = top, d = bottom;
      if (l < 1e8) u = d = h;
      if (l < 1e8 && l - h >= 0.8) u = l - 0.8, d = bottom;
      const double error = std::max(std::abs(u - upper), std::abs(d - lower));
      (error < 0.01 ? same : differ)++;
      if (error < 0.01) worst = std::max(worst, error);
      // The paper asks only that no frame is met: its bounds are wider, never narrower, where a motion was near.
      if (upper == lower) {
        ++fixed;
        agree += bounds.upper()(i, j) >= h && bounds.lower()(i, j) <= h;
      }
    }
  MESSAGE("bounds: " << same << " cells as the authors' rule has them (within " << worst << "), " << differ << " not; "
          << fixed << " fixed");
  CHECK(agree == fixed);
  // Where a capsule's few sample points are around its axis is not told, nor, by the paper, how far below a jump the ground
  // may rise: a cell at which that decides comes out otherwise.
  CHECK(differ <= 3);
}
