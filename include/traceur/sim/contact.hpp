// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/core/matrix3.hpp"
#include "traceur/core/pack.hpp"
#include "traceur/sim/parameters.hpp"

namespace traceur::sim {

// Unqualified calls with plain numbers find nothing by argument and would meet POSIX's select.
using core::select;

/// What one contact sphere remembers from one step to the next.
template <class S>
struct ContactMemory {
  core::Vector3<S> bristle;  ///< tangential deflection of the sticking spring, m, world axes
  S normal_force;            ///< N, of the last step
  S sliding_speed;           ///< tangential speed at the start of the last step, m/s
};

/// How contacts slide while they carry.
template <class S>
struct LoadedSlide {
  S load;  ///< sum of normal forces, N
  S sum;   ///< sum of normal forces times tangential speeds, N m/s
};

/// A contact linearised about the present velocity u of the touching point: it pushes with `force - resistance u'` where u'
/// is the velocity at the end of the step.
template <class S>
struct LinearContact {
  core::Vector3<S> force;
  core::Symmetric3<S> resistance;
};

/// The contact law, implicit in velocity (no global solver: each contact is a small inertia added to its body).
///
/// Normal: a spring on the penetration (capped) and a damper that grows with its square, so that heavy bodies stop within
/// some millimetres and light ones do not stick; never pulling at the present velocity. Tangential: a bristle,
/// that is a damped spring anchored to the ground, weakened by the share that brings its force down to the Coulomb cone
/// mu f_n. Below the cone it holds its place, so a standing foot does not creep; beyond it the force is mu f_n however slow
/// the slide. The speed that sets the share is extrapolated from the last two steps, which keeps sliding friction at mu f_n
/// to second order in dt while the implicit form stays a plain damper.
///
/// `depth` > 0 m is the penetration, `normal` the unit outward normal, `velocity` that of the touching point (m/s).
template <class S>
[[gnu::always_inline]] inline LinearContact<S> linearize_contact(const Parameters& p, const S& friction, const S& depth,
                                                                 const core::Vector3<S>& normal,
                                                                 const core::Vector3<S>& velocity,
                                                                 const ContactMemory<S>& memory) {
  using core::Symmetric3;
  using core::Vector3;
  using std::abs;
  using std::sqrt;
  using T = core::Element<S>;
  const auto constant = [](double x) { return S(static_cast<T>(x)); };
  const S zero = constant(0);
  const S deep = constant(1 / p.damping_depth) * core::max(depth, zero);
  const S damping = constant(p.contact_damping) * (constant(1) + deep * deep);
  const S kn = constant(p.contact_stiffness * p.dt) + damping;
  const S spring = constant(p.contact_stiffness) * core::min(depth, constant(p.spring_depth));
  const S un = dot(normal, velocity);
  const Vector3<S> ut = velocity - un * normal;
  const S predicted = spring - kn * un;
  const auto pushing = (depth > zero) & (predicted > zero);
  // A contact that has just begun has no force yet; its own prediction, damper included, would overstate an impact.
  const S fn = select(memory.normal_force > zero, memory.normal_force, core::min(predicted, spring + damping * abs(un)));
  const S cone = friction * fn;
  const S stick = constant(p.bristle_stiffness * p.dt + p.bristle_damping);
  const Vector3<S> hold = constant(p.bristle_stiffness) * memory.bristle;
  const S speed = sqrt(squared_norm(ut));
  const S before = select(memory.normal_force > zero, memory.sliding_speed, speed);
  const S ahead = core::max(speed + (speed - before), constant(0.5) * speed);
  const Vector3<S> trial = hold + (stick * ahead / core::max(speed, constant(1e-12))) * ut;
  const S share = cone / core::max(core::max(sqrt(squared_norm(trial)), cone), constant(1e-12));
  const S kt = share * stick;
  const Vector3<S> push = spring * normal - share * hold;
  // kt (1 - n n^T) + kn n n^T
  Symmetric3<S> k = Symmetric3<S>::scalar(kt);
  k += Symmetric3<S>::outer(kn - kt, normal);
  return {select(pushing, push, Vector3<S>::zero()), {select(pushing, k.xx, zero), select(pushing, k.yy, zero), select(pushing, k.zz, zero),
                                                      select(pushing, k.xy, zero), select(pushing, k.xz, zero), select(pushing, k.yz, zero)}};
}

/// Moves the memory on by one step, given the velocity u' that came out and the force that acted.
template <class S>
[[gnu::always_inline]] inline void update_contact(const Parameters& p, const S& friction, const S& depth,
                                                  const core::Vector3<S>& normal, const core::Vector3<S>& before,
                                                  const core::Vector3<S>& after, const core::Vector3<S>& force,
                                                  ContactMemory<S>& memory) {
  using core::Vector3;
  using std::sqrt;
  using T = core::Element<S>;
  const auto constant = [](double x) { return S(static_cast<T>(x)); };
  const S zero = constant(0);
  const S fn = core::max(dot(normal, force), zero);
  const auto touching = depth > zero;
  const Vector3<S> step = constant(p.dt) * after;
  Vector3<S> z = memory.bristle + step;
  z -= dot(normal, z) * normal;
  const S longest = friction * fn * constant(1.0 / std::max(p.bristle_stiffness, 1e-9));
  const S length = sqrt(squared_norm(z));
  const S shrink = select(length > longest, longest / core::max(length, constant(1e-12)), constant(1));
  const Vector3<S> ut = before - dot(normal, before) * normal;
  const S speed = sqrt(squared_norm(ut));
  memory.bristle = select(touching, shrink * z, Vector3<S>::zero());
  memory.normal_force = select(touching, fn, zero);
  memory.sliding_speed = select(touching, speed, zero);
}

}  // namespace traceur::sim
