// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include "traceur/body/momentum.hpp"
#include "traceur/motion/clip.hpp"

namespace traceur::motion {

/// How far a clip is from physics while nothing touches: no tracker can follow it closer than these numbers allow.
///
/// In flight the centre of mass must fall with gravity alone and the angular momentum about it stay constant.
struct FlightConsistency {
  int flights = 0;      ///< intervals without contact that are long enough to measure
  double flight_s = 0;  ///< their total length

  double horizontal_acceleration_max_m_s2 = 0;  ///< of the centre of mass; physics: 0
  double horizontal_acceleration_rms_m_s2 = 0;
  double vertical_acceleration_min_m_s2 = 0;  ///< physics: -gravity, both
  double vertical_acceleration_max_m_s2 = 0;
  double vertical_error_rms_m_s2 = 0;  ///< of vertical acceleration plus gravity
  /// Of all flights together, by the parabolas of one common curvature that fit the heights best; physics: -gravity. A clip
  /// that is played n times too fast falls n squared times too fast.
  double fall_acceleration_m_s2 = 0;

  double ballistic_error_max_m = 0;  ///< centre of mass from the best ballistic path of its flight; physics: 0

  double angular_momentum_min_kg_m2_s = 0;  ///< norm; physics: constant during a flight
  double angular_momentum_max_kg_m2_s = 0;
  double angular_momentum_drift_kg_m2_s = 0;  ///< largest distance from the mean over its flight; physics: 0
};

/// Settings of check_flight.
struct FlightCheck {
  double gravity = 9.81;    ///< m/s^2
  double step = 1.0 / 60;   ///< between measurements, s; a longest key interval that exceeds it takes its place
  double label = 0.5;       ///< a body with a contact label of this or more touches
};

/// Measures a clip while no body touches according to its contact labels. Accelerations are second differences of the
/// centre of mass over `step` seconds to either side, so all poses they see are in flight. A flight that spans the seam of a
/// cyclic clip counts as one. Without flight all numbers are zero. Throws Error if the clip has no contact labels or the
/// character is not of its joints.
inline FlightConsistency check_flight(const Clip& clip, const body::Character& character, const FlightCheck& options = {}) {
  using core::Vector3;
  const std::string where = detail::where(clip) + ": check_flight: ";
  if (clip.contacts.cols() != clip.keys()) throw Error(where + "expected a clip with contact labels");
  if (character.skeleton.size() != clip.skeleton.size() || character.skeleton.nq() != clip.skeleton.nq() ||
      character.inertias.size() != static_cast<std::size_t>(clip.skeleton.size()))
    throw Error(where + "expected a character with the clip's joints");
  if (!(options.step > 0)) throw Error(where + "expected a positive step");

  const int keys = clip.keys(), last = keys - 1;
  std::vector<char> airborne(static_cast<std::size_t>(keys));
  for (int k = 0; k < keys; ++k) airborne[static_cast<std::size_t>(k)] = clip.contacts.col(k).maxCoeff() < options.label;
  const auto flying = [&](int k) { return airborne[static_cast<std::size_t>(k)] != 0; };

  struct Interval {
    double from, to;
  };
  std::vector<Interval> flights;
  for (int k = 0; k < keys; ++k) {
    if (!flying(k) || (k > 0 && flying(k - 1))) continue;
    int end = k;
    while (end < last && flying(end + 1)) ++end;
    flights.push_back({clip.times[k], clip.times[end]});
  }
  if (clip.cyclic && flights.size() > 1 && flying(0) && flying(last)) {
    flights.back().to = clip.duration() + flights.front().to;
    flights.erase(flights.begin());
  }

  double step = options.step;
  for (int k = 0; k < last; ++k) step = std::max(step, clip.times[k + 1] - clip.times[k]);
  body::Frames<double> frames(clip.skeleton);
  body::Twists<double> twists(clip.skeleton);
  Eigen::VectorXd q(clip.skeleton.nq()), v(clip.skeleton.nv()), before(clip.skeleton.nq()), after(clip.skeleton.nq());

  FlightConsistency out;
  out.vertical_acceleration_min_m_s2 = out.angular_momentum_min_kg_m2_s = std::numeric_limits<double>::infinity();
  out.vertical_acceleration_max_m_s2 = -std::numeric_limits<double>::infinity();
  double horizontal_squares = 0, vertical_squares = 0, bend = 0, bend_squares = 0;
  int accelerations = 0;
  for (const Interval& flight : flights) {
    const int samples = static_cast<int>(std::floor((flight.to - flight.from) / step + 1e-9)) + 1;
    if (samples < 3) continue;
    ++out.flights;
    out.flight_s += flight.to - flight.from;
    const double h = (flight.to - flight.from) / (samples - 1);
    Eigen::MatrixXd center(3, samples), spin(3, samples - 2);
    for (int k = 0; k < samples; ++k) {
      clip.sample(flight.from + k * h, q.data());
      body::forward_kinematics(clip.skeleton, q.data(), frames);
      body::center_of_mass(character, frames).store(center.col(k).data());
      if (k == 0 || k == samples - 1) continue;
      clip.velocity(flight.from + k * h, h, v, before, after);
      body::forward_velocities(clip.skeleton, frames, v.data(), twists);
      body::momentum(character, frames, twists).angular.store(spin.col(k - 1).data());
    }
    for (int k = 1; k + 1 < samples; ++k) {
      const Eigen::Vector3d a = (center.col(k + 1) - 2 * center.col(k) + center.col(k - 1)) / (h * h);
      const double horizontal = a.head(2).norm(), error = a.z() + options.gravity;
      out.horizontal_acceleration_max_m_s2 = std::max(out.horizontal_acceleration_max_m_s2, horizontal);
      out.vertical_acceleration_min_m_s2 = std::min(out.vertical_acceleration_min_m_s2, a.z());
      out.vertical_acceleration_max_m_s2 = std::max(out.vertical_acceleration_max_m_s2, a.z());
      horizontal_squares += horizontal * horizontal;
      vertical_squares += error * error;
      ++accelerations;
    }
    // Least squares line through what is left of the path once the fall is taken out.
    Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(samples, -0.5 * h * (samples - 1), 0.5 * h * (samples - 1));
    // Half of t squared, without what a line can make up for: t itself is orthogonal to it already.
    const Eigen::VectorXd half_square = 0.5 * (t.array().square() - t.array().square().mean()).matrix();
    bend += half_square.dot(center.row(2));
    bend_squares += half_square.squaredNorm();
    Eigen::MatrixXd path = center;
    path.row(2) += (0.5 * options.gravity * t.array().square()).matrix().transpose();
    const Eigen::Vector3d mean = path.rowwise().mean();
    const Eigen::Vector3d slope = path * t / t.squaredNorm();
    for (int k = 0; k < samples; ++k)
      out.ballistic_error_max_m = std::max(out.ballistic_error_max_m, (path.col(k) - mean - slope * t[k]).norm());
    const Eigen::Vector3d mean_spin = spin.rowwise().mean();
    for (int k = 0; k < samples - 2; ++k) {
      const double size = spin.col(k).norm();
      out.angular_momentum_min_kg_m2_s = std::min(out.angular_momentum_min_kg_m2_s, size);
      out.angular_momentum_max_kg_m2_s = std::max(out.angular_momentum_max_kg_m2_s, size);
      out.angular_momentum_drift_kg_m2_s = std::max(out.angular_momentum_drift_kg_m2_s, (spin.col(k) - mean_spin).norm());
    }
  }
  if (accelerations == 0) return FlightConsistency{};
  out.fall_acceleration_m_s2 = bend / bend_squares;
  out.horizontal_acceleration_rms_m_s2 = std::sqrt(horizontal_squares / accelerations);
  out.vertical_error_rms_m_s2 = std::sqrt(vertical_squares / accelerations);
  return out;
}

/// How many times too fast a clip plays, by its fall: a power of two, since it is rates such as 60 and 120 frames a second
/// that get mistaken. 1 unless it falls at more than three times gravity, which no noise of a capture explains; slow falls
/// tell nothing, as hands and walls that carry have no contact labels.
inline double played_too_fast(const FlightConsistency& flight, double gravity = 9.81) {
  const double ratio = -flight.fall_acceleration_m_s2 / gravity;
  if (!(ratio > 3) || flight.flight_s < 0.1) return 1;
  return std::exp2(std::round(0.5 * std::log2(ratio)));
}

}  // namespace traceur::motion
