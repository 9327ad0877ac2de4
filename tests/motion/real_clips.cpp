// SPDX-License-Identifier: MIT
#include <doctest/doctest.h>

#include <cstdlib>
#include <fstream>
#include <sstream>

#include <traceur/motion/contact_labels.hpp>
#include <traceur/motion/flight_consistency.hpp>
#include <traceur/motion/loop.hpp>
#include <traceur/motion/scaling.hpp>
#include <traceur/motion/smooth.hpp>

#include "figure.hpp"

using namespace traceur;
using namespace figure;
using motion::Clip;

namespace {

/// The 13-body humanoid that the captured clips were fitted to, z up, without hands. Masses (kg) are points at the bodies.
body::Character captured_humanoid() {
  body::Character c;
  c.name = "humanoid";
  Skeleton& s = c.skeleton;
  s.add(joint("root", -1, JointType::free, {0, 0, 0}));
  s.add(joint("chest", 0, JointType::ball, {0, 0, 0.236151}));
  s.add(joint("neck", 1, JointType::ball, {0, 0, 0.223894}));
  for (const double side : {-1.0, 1.0}) {
    const std::string name = side > 0 ? "left_" : "right_";
    const int hip = s.add(joint(name + "hip", 0, JointType::ball, {0, side * 0.084887, 0}));
    const int knee = s.add(joint(name + "knee", hip, JointType::hinge, {0, 0, -0.421546}, {0, -1, 0}));
    s.add(joint(name + "ankle", knee, JointType::ball, {0, 0, -0.40987}));
    const int shoulder = s.add(joint(name + "shoulder", 1, JointType::ball, {-0.02405, side * 0.18311, 0.2435}));
    s.add(joint(name + "elbow", shoulder, JointType::hinge, {0, 0, -0.274788}, {0, -1, 0}));
  }
  const double masses[] = {6, 14, 2, 4.5, 3, 1, 1.5, 1.5, 4.5, 3, 1, 1.5, 1.5};
  c.inertias.resize(13);
  c.actuators.resize(13);
  for (std::size_t i = 0; i < 13; ++i) {
    c.inertias[i].mass = masses[i];
    c.inertias[i].about_center = core::Symmetric3<double>::scalar(0.02);
  }
  return c;
}

/// Reads the frames of a clip in that humanoid's order of joints; no keys if the file is not there.
Clip captured(const std::string& motion) {
  Clip clip;
  clip.name = motion;
  clip.skeleton = captured_humanoid().skeleton;
  std::ifstream in(std::string(TRACEUR_SOURCE_DIR) + "/../shared/motions/deepmimic/humanoid3d_" + motion + ".txt");
  if (!in) return clip;
  std::ostringstream all;
  all << in.rdbuf();
  std::string text = all.str();
  text = text.substr(text.find("\"Frames\""));
  std::vector<double> numbers;
  const char* at = text.c_str() + text.find('[');
  while (*at != 0) {
    char* end = nullptr;
    const double value = std::strtod(at, &end);
    if (end == at) {
      ++at;
      continue;
    }
    numbers.push_back(value);
    at = end;
  }
  const auto frames = static_cast<Eigen::Index>(numbers.size() / 44);
  clip.times = Vec::Zero(frames);
  clip.poses.resize(clip.skeleton.nq(), frames);
  for (Eigen::Index k = 0; k < frames; ++k) {
    const double* f = numbers.data() + 44 * k;
    if (k > 0) clip.times[k] = clip.times[k - 1] + *(f - 44);
    Vec q = clip.skeleton.neutral_pose();
    q.head(3) << f[1], -f[3], f[2];
    int from = 4;
    // The file's order: chest, neck, right leg, right arm, left leg, left arm, which is the skeleton's own.
    for (const Joint& j : clip.skeleton.joints()) {
      if (j.type == JointType::hinge) {
        q[j.q_index] = f[from++];
      } else {
        const int r = j.q_index + (j.type == JointType::free ? 3 : 0);
        q.segment(r, 4) << f[from + 1], -f[from + 3], f[from + 2], f[from];
        from += 4;
      }
    }
    body::normalize(clip.skeleton, q.data());
    clip.poses.col(k) = q;
  }
  clip.check();
  return clip;
}

std::vector<motion::ContactPoint> soles(const Skeleton& s) {
  std::vector<motion::ContactPoint> points;
  for (const char* name : {"right_ankle", "left_ankle"})
    for (const double x : {-0.045, 0.135})
      for (const double y : {-0.03, 0.03}) points.push_back({s.find(name), {x, y, -0.055}, 0});
  return points;
}

}  // namespace

TEST_CASE("a captured run closes, becomes symmetric and repeats") {
  const Clip run = captured("run");
  if (run.keys() == 0) {
    MESSAGE("captured clips not found, left out");
    return;
  }
  const auto misfit = motion::cycle_misfit(run, 0, run.duration());
  MESSAGE("run as captured: joint " << misfit.joint_rad << " rad, tilt " << misfit.tilt_rad << " rad, position " << misfit.position_m << " m");
  CHECK(misfit.position_m > 0.01);
  CHECK(motion::is_cyclic_candidate(run));
  const Clip closed = motion::close_cycle(run);
  CHECK(motion::cycle_misfit(closed, 0, closed.duration()).position_m < 1e-9);

  const motion::Mirror mirror(run.skeleton);
  CHECK(mirror.asymmetry() < 1e-6);
  const Clip gait = motion::symmetrize_gait(run, mirror);
  const double advance = 0.5 * gait.poses(0, gait.keys() - 1);
  CHECK(2 * advance / gait.duration() == doctest::Approx(3.5).epsilon(0.1));
  for (double phi = 0; phi < gait.duration(); phi += 0.05) {
    Vec image = mirror.pose(gait.sample(phi));
    image[0] += advance;
    CHECK(distance(gait.skeleton, gait.sample(phi + 0.5 * gait.duration()), image) < 1e-8);
  }
  CHECK(largest_gap(motion::resample(gait, 30), motion::resample(closed, 30)) < 0.9);
}

TEST_CASE("one period of a captured walk is found in three of them") {
  const Clip walk = captured("walk");
  if (walk.keys() == 0) {
    MESSAGE("captured clips not found, left out");
    return;
  }
  Clip cycle = motion::close_cycle(walk);
  const Clip capture = motion::cut(cycle, 0.2, 0.2 + 3 * cycle.duration());
  const auto found = motion::find_cycle(capture);
  REQUIRE(found.has_value());
  CHECK(found->end - found->start == doctest::Approx(cycle.duration()).epsilon(0.02));
  CHECK(found->misfit.position_m < 0.05);
}

TEST_CASE("a captured gait has both feet in turn on the ground") {
  Clip walk = captured("walk");
  if (walk.keys() == 0) {
    MESSAGE("captured clips not found, left out");
    return;
  }
  walk = motion::close_cycle(walk);
  const auto points = soles(walk.skeleton);
  const auto ground = motion::estimate_ground(walk, points);
  MESSAGE("walk: ground at " << ground.height << " m, by stance " << ground.by_stance);
  CHECK(std::abs(ground.height) < 0.1);
  const Clip labels = motion::label_contacts(motion::grounded(walk, points), points);
  for (const char* name : {"right_ankle", "left_ankle"}) {
    const double share = labels.contacts.row(labels.skeleton.find(name)).mean();
    CHECK(share > 0.4);
    CHECK(share < 0.85);
  }
  // Walking never leaves the ground.
  CHECK(labels.contacts.colwise().sum().minCoeff() >= 1);
}

TEST_CASE("a captured backflip is not physical in flight, and the numbers say by how much") {
  Clip flip = captured("backflip");
  if (flip.keys() == 0) {
    MESSAGE("captured clips not found, left out");
    return;
  }
  flip.contacts = Eigen::MatrixXd::Zero(flip.skeleton.size(), flip.keys());
  const auto points = soles(flip.skeleton);
  const Clip labelled = motion::label_contacts(motion::grounded(flip, points), points);
  const auto r = motion::check_flight(labelled, captured_humanoid());
  MESSAGE("backflip: " << r.flights << " flights, " << r.flight_s << " s; horizontal up to " << r.horizontal_acceleration_max_m_s2
                       << " m/s^2, vertical " << r.vertical_acceleration_min_m_s2 << " to " << r.vertical_acceleration_max_m_s2
                       << " m/s^2; angular momentum " << r.angular_momentum_min_kg_m2_s << " to " << r.angular_momentum_max_kg_m2_s
                       << " kg m^2/s; off a ballistic path by " << r.ballistic_error_max_m << " m");
  CHECK(r.flights >= 1);
  CHECK(r.flight_s > 0.3);
  CHECK(r.horizontal_acceleration_max_m_s2 > 1);
  const auto smoother = motion::check_flight(motion::smooth(labelled, 0.04), captured_humanoid());
  CHECK(smoother.horizontal_acceleration_rms_m_s2 < r.horizontal_acceleration_rms_m_s2);
}
