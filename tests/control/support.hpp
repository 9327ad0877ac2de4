// SPDX-License-Identifier: MIT
// Characters, clips and states that several tests of control share.
#pragma once

#include <cmath>
#include <numbers>

#include "biped.hpp"
#include <traceur/control/tracking_reference.hpp>
#include <traceur/core/random.hpp>
#include <traceur/sim/lanes.hpp>

// Compiled once, in support.cpp: a step takes a compiler long.
extern template void traceur::sim::Lanes<double>::step(int) noexcept;
extern template void traceur::sim::Lanes<traceur::core::Pack<float>>::step(int) noexcept;
extern template void traceur::sim::Lanes<traceur::core::Pack<float, 4>>::step(int) noexcept;
extern template void traceur::sim::Lanes<traceur::core::Pack<double, 2>>::step(int) noexcept;

namespace figures {

namespace body = traceur::body;
namespace control = traceur::control;
namespace core = traceur::core;
namespace motion = traceur::motion;
namespace sim = traceur::sim;

/// A model with its roles.
struct Figure {
  sim::Model model;
  control::Roles roles;
  std::vector<control::TrackedPoint> points;
  explicit Figure(const body::Character& c)
      : model(sim::make_model(c)), roles(control::find_roles(model)), points(control::tracked_points(model, roles)) {}
  const body::Skeleton& skeleton() const { return model.character.skeleton; }
};

/// The humanoid of the examples. Defined apart, so that one file only has to compile the reader.
const Figure& humanoid();
inline const Figure& small() {
  static const Figure figure(biped());
  return figure;
}

/// Any pose, its root anywhere near the origin, its joints up to about `angle` radians from rest.
inline Eigen::VectorXd any_pose(const Figure& f, core::RandomStream& random, double angle = 1) {
  Eigen::VectorXd d(f.model.nv), q = f.skeleton().neutral_pose();
  for (Eigen::Index k = 0; k < d.size(); ++k) d[k] = (k < 6 ? 1.0 : angle) * random.uniform(-1.0, 1.0);
  body::displace(f.skeleton(), q.data(), d.data(), q.data());
  return q;
}
inline Eigen::VectorXd any_velocity(const Figure& f, core::RandomStream& random, double speed = 1) {
  Eigen::VectorXd v(f.model.nv);
  for (double& x : v) x = speed * random.uniform(-1.0, 1.0);
  return v;
}
inline Eigen::VectorXd at_rest(const Figure& f) { return Eigen::VectorXd::Zero(f.model.nv); }

/// Momenta at (q, v), computed by the body module and not by the simulator.
inline body::Momentum<double> momentum_of(const Figure& f, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  body::Frames<double> frames(f.skeleton());
  body::Twists<double> twists(f.skeleton());
  body::forward_kinematics(f.skeleton(), q.data(), frames);
  body::forward_velocities(f.skeleton(), frames, v.data(), twists);
  return body::momentum(f.model.character, frames, twists);
}

/// Where a joint is, m, world.
inline Vector place_of(const Figure& f, const Eigen::VectorXd& q, const std::string& joint) {
  body::Frames<double> frames(f.skeleton());
  body::forward_kinematics(f.skeleton(), q.data(), frames);
  return frames.position[static_cast<std::size_t>(f.skeleton().find(joint))];
}

/// The moving body of a joint.
inline int body_of(const Figure& f, const std::string& joint) {
  return f.model.moving_of_joint[static_cast<std::size_t>(f.skeleton().find(joint))];
}

/// The humanoid leaning forward a little from its ankles, which puts its weight over the middle of its feet.
inline Eigen::VectorXd standing_pose() {
  const body::Skeleton& s = humanoid().skeleton();
  Eigen::VectorXd q = s.neutral_pose();
  q[2] = 0.8835;
  about_axis(Vector{0, 1, 0}, 0.045).store(q.data() + 3);
  for (const char* ankle : {"right_ankle", "left_ankle"})
    about_axis(Vector{0, 1, 0}, -0.045).store(q.data() + s[s.find(ankle)].q_index);
  return q;
}

/// Poses at `ticks` + 1 ticks of 1/60 s as a clip that runs through them.
template <class Pose>
motion::Clip clip_of(const Figure& f, const char* name, int ticks, Pose&& pose, bool cyclic = false) {
  motion::Clip clip{name, f.skeleton(), Eigen::VectorXd(ticks + 1), Eigen::MatrixXd(f.model.nq, ticks + 1), {}, cyclic};
  for (int t = 0; t <= ticks; ++t) {
    clip.times[t] = t / 60.0;
    clip.poses.col(t) = pose(t / 60.0);
  }
  clip.check();
  return clip;
}

/// The humanoid on both feet with its knees bent (rad), ankles where they are when it stands straight.
inline Eigen::VectorXd crouch(double thigh) {
  const body::Skeleton& s = humanoid().skeleton();
  Eigen::VectorXd q = standing_pose();
  const Vector before = place_of(humanoid(), q, "right_ankle");
  const double shin = std::asin(0.421546 / 0.40987 * std::sin(thigh));
  const Quaternion root = Quaternion::from(q.data() + 3);
  for (const char* side : {"right", "left"}) {
    const auto at = [&](const char* joint) { return q.data() + s[s.find(std::string(side) + "_" + joint)].q_index; };
    const Quaternion hip = about_axis(Vector{0, 1, 0}, -thigh);
    hip.store(at("hip"));
    at("knee")[0] = thigh + shin;
    (root * hip * about_axis(Vector{0, 1, 0}, thigh + shin)).conjugate().store(at("ankle"));
  }
  (Vector::from(q.data()) + before - place_of(humanoid(), q, "right_ankle")).store(q.data());
  return q;
}

inline motion::Clip standing_clip(int ticks) {
  return clip_of(humanoid(), "stand", ticks, [](double) { return standing_pose(); });
}
/// Down and up again.
inline motion::Clip squat_clip(int ticks, double deepest = 0.5) {
  return clip_of(humanoid(), "squat", ticks, [=](double t) {
    return crouch(0.5 * deepest * (1 - std::cos(2 * std::numbers::pi * t * 60 / ticks)));
  });
}
/// A cyclic sway from side to side, left first, whose second half is its first mirrored; feet stay where they are.
inline motion::Clip sway_clip(int ticks, double width = 0.03) {
  return clip_of(
      humanoid(), "sway", ticks,
      [=](double t) {
        const body::Skeleton& s = humanoid().skeleton();
        Eigen::VectorXd q = standing_pose();
        const double shift = width * std::sin(2 * std::numbers::pi * t * 60 / ticks), lean = std::asin(shift / 0.83);
        q[1] = shift;
        for (const char* side : {"right", "left"}) {
          const auto at = [&](const char* joint) { return q.data() + s[s.find(std::string(side) + "_" + joint)].q_index; };
          about_axis(Vector{1, 0, 0}, lean).store(at("hip"));
          (about_axis(Vector{0, 1, 0}, -0.045) * about_axis(Vector{1, 0, 0}, -lean)).store(at("ankle"));
        }
        return q;
      },
      true);
}

inline control::TrackingReference reference_of(const Figure& f, const motion::Clip& clip, double seconds) {
  return control::make_reference(f.model, f.roles, f.points, clip, seconds, 1.0 / 60);
}

/// Puts one lane of a group into a state; `refresh` is the caller's to call.
template <class S>
void put(sim::Lanes<S>& lanes, int lane, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  using T = core::Element<S>;
  for (Eigen::Index k = 0; k < q.size(); ++k) core::set_lane(lanes.q()[k], lane, static_cast<T>(q[k]));
  for (Eigen::Index k = 0; k < v.size(); ++k) core::set_lane(lanes.v()[k], lane, static_cast<T>(v[k]));
}

inline double apart(const Vector& a, const Vector& b) { return norm(a - b); }
/// The angle between two rotations, rad.
inline double apart(const Quaternion& a, const Quaternion& b) { return norm(log_map(a * b.conjugate())); }

/// The message of the Error that f throws, or "" if it throws none.
template <class F>
std::string error_of(F&& f) {
  try {
    f();
  } catch (const traceur::Error& e) {
    return e.what();
  }
  return "";
}
inline bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

}  // namespace figures
