// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "traceur/backends/detail/joint_terms.hpp"
#include "traceur/sim/parameters.hpp"
#include "traceur/sim/scene.hpp"

namespace traceur::backends::detail {

/// Principal moments of an inertia, kg m^2, and the rotation from its principal axes to the axes it was given in.
struct PrincipalInertia {
  core::Vector3<double> moments;
  core::Quaternion<double> axes;
};

/// Diagonalises by Jacobi rotations, which leave an inertia that is diagonal already exactly as it is.
inline PrincipalInertia principal_inertia(const core::Symmetric3<double>& inertia) {
  using core::Matrix3;
  Matrix3<double> m = inertia.full();
  core::Quaternion<double> axes = core::Quaternion<double>::identity();
  for (int round = 0; round < 60; ++round) {
    const double xy = std::abs(m.xy), xz = std::abs(m.xz), yz = std::abs(m.yz);
    const double largest = std::max({xy, xz, yz});
    if (!(largest > 1e-15 * (std::abs(m.xx) + std::abs(m.yy) + std::abs(m.zz)))) break;
    // One turn about the axis that takes part in neither side of the largest entry.
    core::Vector3<double> about{0, 0, 0};
    double angle = 0;
    if (largest == xy) {
      about.z = 1;
      angle = 0.5 * std::atan2(2 * m.xy, m.xx - m.yy);
    } else if (largest == yz) {
      about.x = 1;
      angle = 0.5 * std::atan2(2 * m.yz, m.yy - m.zz);
    } else {
      about.y = 1;
      angle = 0.5 * std::atan2(2 * m.xz, m.zz - m.xx);
    }
    axes = (axes * about_axis(about, angle)).normalized();
    const Matrix3<double> r = axes.matrix();
    m = r.transpose() * inertia.full() * r;
  }
  return {{m.xx, m.yy, m.zz}, axes};
}

/// A height grid as solid boxes: each covers a rectangle of cells of one height, those at the border reach `beyond` m
/// further, and all end `below` m under the lowest.
inline std::vector<terrain::Box> columns(const terrain::HeightGrid& grid, double beyond, double below) {
  const int nx = grid.nx(), ny = grid.ny();
  std::vector<char> taken(static_cast<std::size_t>(nx) * static_cast<std::size_t>(ny), 0);
  const auto at = [&](int i, int j) -> char& { return taken[static_cast<std::size_t>(i) + static_cast<std::size_t>(nx) * static_cast<std::size_t>(j)]; };
  const double bottom = grid.heights().minCoeff() - below;
  std::vector<terrain::Box> boxes;
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) {
      if (at(i, j)) continue;
      const double height = grid(i, j);
      int i1 = i + 1, j1 = j + 1;
      while (i1 < nx && !at(i1, j) && grid(i1, j) == height) ++i1;
      const auto row_fits = [&](int row) {
        for (int k = i; k < i1; ++k)
          if (at(k, row) || grid(k, row) != height) return false;
        return true;
      };
      while (j1 < ny && row_fits(j1)) ++j1;
      for (int b = j; b < j1; ++b)
        for (int a = i; a < i1; ++a) at(a, b) = 1;
      const double x0 = grid.x0() + i * grid.cell() - (i == 0 ? beyond : 0);
      const double x1 = grid.x0() + i1 * grid.cell() + (i1 == nx ? beyond : 0);
      const double y0 = grid.y0() + j * grid.cell() - (j == 0 ? beyond : 0);
      const double y1 = grid.y0() + j1 * grid.cell() + (j1 == ny ? beyond : 0);
      terrain::Box box;
      box.center = {0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (bottom + height)};
      box.half_size = {0.5 * (x1 - x0), 0.5 * (y1 - y0), 0.5 * (height - bottom)};
      boxes.push_back(box);
    }
  return boxes;
}

/// What motor and stops do to a joint over one time step: a torque `motor + stop` (N m, joint axes; hinge: x) and a damper
/// `motor_damping + stop_damping` (N m s/rad) to be taken implicitly. The law of the bundled simulator.
struct Drive {
  core::Vector3<double> motor{0, 0, 0}, stop{0, 0, 0};
  double motor_damping = 0, stop_damping = 0;
};

/// The spring is taken at the end of the step: kp (error - dt w) - kd w. A motor whose torque would pass its limit at the
/// joint acceleration `rate` of the step before (rad/s^2, joint axes) is weakened, spring and damper alike.
/// `q`, `v` and `target` are whole vectors.
inline Drive drive(const sim::MovingBody& b, const sim::Parameters& p, double dt, const double* q, const double* v,
                   const double* target, const core::Vector3<double>& rate) noexcept {
  using core::Quaternion;
  using core::Vector3;
  Drive out;
  if (b.type == body::JointType::free) return out;
  const body::Actuator& a = b.actuator;
  const bool ball = b.type == body::JointType::ball;
  Vector3<double> present{0, 0, 0}, error{0, 0, 0}, velocity{0, 0, 0};
  if (ball) {
    const Quaternion<double> r = Quaternion<double>::from(q + b.q_index);
    error = log_map(r.conjugate() * Quaternion<double>::from(target + b.q_index));
    velocity = Vector3<double>::from(v + b.v_index);
    present = log_map(r);
  } else {
    present.x = q[b.q_index];
    error.x = target[b.q_index] - present.x;
    velocity.x = v[b.v_index];
  }
  const double damping = a.stiffness * dt + a.damping;
  const Vector3<double> torque = a.stiffness * error - damping * velocity - (dt * damping) * rate;
  const double size = norm(torque);
  const double scale = size > a.torque_limit ? a.torque_limit / size : 1;
  out.motor = (scale * a.stiffness) * error;
  out.motor_damping = scale * damping;
  const Vector3<double> excess = stop_excess(a, ball, present);
  if (squared_norm(excess) > 0) {
    out.stop = -p.stop_stiffness * excess;
    out.stop_damping = p.stop_stiffness * dt + p.stop_damping;
  }
  return out;
}

}  // namespace traceur::backends::detail
