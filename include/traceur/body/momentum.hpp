// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/body/character.hpp"

namespace traceur::body {

/// Whole-body measures of a moving character, in world axes.
template <class S>
struct Momentum {
  S mass;                             ///< kg
  core::Vector3<S> center_of_mass;    ///< m
  core::Vector3<S> linear;            ///< kg m/s
  core::Vector3<S> angular;           ///< about the centre of mass, kg m^2/s
  S kinetic_energy;                   ///< J
  core::Vector3<S> velocity() const { return (S(1.0) / mass) * linear; }
};

/// Centre of mass of the whole character, m, world.
template <class S>
inline core::Vector3<S> center_of_mass(const Character& character, const Frames<S>& frames) {
  core::Vector3<S> sum = core::Vector3<S>::zero();
  double mass = 0;
  for (int i = 0; i < character.skeleton.size(); ++i) {
    const Inertia& in = character.inertias[static_cast<std::size_t>(i)];
    sum += S(in.mass) * frames.point(i, in.center.cast<S>());
    mass += in.mass;
  }
  return S(1.0 / mass) * sum;
}

/// Mass, centre of mass, linear and angular momentum and kinetic energy. Rotor inertias (armature) are left out: they are
/// internal to the motors.
template <class S>
inline Momentum<S> momentum(const Character& character, const Frames<S>& frames, const Twists<S>& twists) {
  using core::Vector3;
  Momentum<S> out{S(character.total_mass()), center_of_mass(character, frames), Vector3<S>::zero(), Vector3<S>::zero(), S(0.0)};
  for (int i = 0; i < character.skeleton.size(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    const Inertia& in = character.inertias[k];
    const Vector3<S> arm = frames.rotation[k].rotate(in.center.cast<S>());
    const Vector3<S> velocity = twists.linear[k] + cross(twists.angular[k], arm);
    const Vector3<S> p = S(in.mass) * velocity;
    const Vector3<S> spin = rotated(in.about_center.cast<S>(), frames.rotation[k].matrix()) * twists.angular[k];
    out.linear += p;
    out.angular += cross(frames.position[k] + arm - out.center_of_mass, p) + spin;
    out.kinetic_energy += S(0.5) * (dot(p, velocity) + dot(spin, twists.angular[k]));
  }
  return out;
}

}  // namespace traceur::body
