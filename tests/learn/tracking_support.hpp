// SPDX-License-Identifier: MIT
// Clips on the humanoid, and an engine that puts it wherever a test wants it.
#pragma once

#include <cmath>
#include <functional>
#include <numbers>
#include <string>

#include <traceur/control/roles.hpp>
#include <traceur/io/mjcf.hpp>
#include <traceur/learn/tracking.hpp>

extern template void traceur::sim::Lanes<traceur::core::Pack<float>>::step(int) noexcept;

namespace learn_test {

using Lane = traceur::core::Pack<float>;
using Lanes = traceur::sim::Lanes<Lane>;

inline const traceur::sim::Model& humanoid() {
  static const traceur::sim::Model model =
      traceur::sim::make_model(traceur::io::read_mjcf(TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml"));
  return model;
}
inline const traceur::control::Roles& roles() {
  static const traceur::control::Roles found = traceur::control::find_roles(humanoid());
  return found;
}

/// A person who goes ahead at `speed` m/s along `heading`, turning by `turn` rad in all, and raises an arm and lowers it
/// again, in a second.
inline traceur::motion::Clip wave(bool cyclic, double speed = 0, double heading = 0, double turn = 0, double height = 0.89) {
  using traceur::core::Vector3;
  traceur::motion::Clip c;
  c.name = "wave";
  c.skeleton = humanoid().character.skeleton;
  c.cyclic = cyclic;
  constexpr int keys = 61;
  c.times = Eigen::VectorXd::LinSpaced(keys, 0, 1);
  c.poses.resize(c.skeleton.nq(), keys);
  const auto& shoulder = c.skeleton[c.skeleton.find("left_shoulder")];
  double x = 2, y = -1;
  for (int k = 0; k < keys; ++k) {
    const double t = c.times[k], way = heading + turn * t;
    Eigen::VectorXd q = c.skeleton.neutral_pose();
    q.head(3) << x, y, height;
    traceur::core::about_axis(Vector3<double>{0, 0, 1}, way).store(q.data() + 3);
    const double angle = 0.6 * (1 - std::cos(2 * std::numbers::pi * t));
    traceur::core::about_axis(Vector3<double>{1, 0, 0}, angle).store(q.data() + shoulder.q_index);
    c.poses.col(k) = q;
    x += speed / (keys - 1) * std::cos(way);
    y += speed / (keys - 1) * std::sin(way);
  }
  return c;
}

/// Puts the lanes where a function says: lane, step of the engine since it began, pose and velocity to write.
class Puppeteer final : public traceur::control::Engine<Lane> {
 public:
  using Place = std::function<void(int lane, int step, Eigen::VectorXf& q, Eigen::VectorXf& v)>;
  explicit Puppeteer(Place place) : place_(std::move(place)) {}

  bool fits(const traceur::sim::Model&) const override { return true; }
  void begin(const traceur::sim::Lanes<Lane>&, int) override {}
  void push(int, int, const traceur::core::Vector3<double>&, const traceur::core::Vector3<double>&) override {}
  void step(traceur::sim::Lanes<Lane>& lanes, double, std::span<const bool>) override {
    ++steps_;
    target.resize(humanoid().nq);
    for (int i = 0; i < humanoid().nq; ++i) target[i] = traceur::core::lane_of(lanes.target()[i], 0);
    Eigen::VectorXf q(humanoid().nq), v(humanoid().nv);
    for (int lane = 0; lane < traceur::core::lane_count<Lane>; ++lane) {
      place_(lane, steps_, q, v);
      for (int i = 0; i < humanoid().nq; ++i) traceur::core::set_lane(lanes.q()[i], lane, q[i]);
      for (int i = 0; i < humanoid().nv; ++i) traceur::core::set_lane(lanes.v()[i], lane, v[i]);
    }
    lanes.refresh();
  }

  Eigen::VectorXf target;  ///< of lane 0, as the last step was asked for

 private:
  Place place_;
  int steps_ = 0;
};

}  // namespace learn_test
