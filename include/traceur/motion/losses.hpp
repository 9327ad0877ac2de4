// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "traceur/body/surface_points.hpp"
#include "traceur/core/executor.hpp"
#include "traceur/motion/clip.hpp"
#include "traceur/terrain/signed_distance.hpp"

namespace traceur::motion {

/// How deep all surface points of a body are below the ground, summed, m (PARC Eq. 7). One frame, any scalar.
template <core::Scalar S>
inline S penetration(const terrain::HeightGrid& ground, std::span<const body::SurfacePoint> points,
                     const body::Frames<S>& frames) noexcept {
  using core::select;
  S sum(0.0);
  for (const body::SurfacePoint& p : points) {
    const S d = terrain::signed_distance(ground, frames.point(p.body, p.local.cast<S>()));
    sum += select(d < S(0.0), -d, S(0.0));
  }
  return sum;
}

/// For each body that is to touch, how far its nearest surface point is from the surface of the ground, on either side,
/// times its label; summed, m (PARC Eq. 8). One frame, any scalar. `labels` has a number for each body; the points of a
/// body follow one another. A body without points adds nothing.
template <core::Scalar S>
inline S contact(const terrain::HeightGrid& ground, std::span<const body::SurfacePoint> points, const double* labels,
                 const body::Frames<S>& frames) noexcept {
  using core::select;
  S sum(0.0);
  for (std::size_t k = 0; k < points.size();) {
    const int b = points[k].body;
    std::size_t end = k;
    while (end < points.size() && points[end].body == b) ++end;
    if (labels[b] != 0) {
      S nearest(0.0);
      for (std::size_t i = k; i < end; ++i) {
        const S d = terrain::signed_distance(ground, frames.point(b, points[i].local.cast<S>()));
        const S distance = select(d < S(0.0), -d, d);
        nearest = i == k ? distance : core::min(distance, nearest);
      }
      sum += S(labels[b]) * nearest;
    }
    k = end;
  }
  return sum;
}

/// Jerk of a point by the third difference of four places in a row, `dt` s apart, m/s^3. Grouped so that a point at rest
/// has none, wherever it is.
template <core::Scalar S>
inline core::Vector3<S> jerk(const core::Vector3<S>& p0, const core::Vector3<S>& p1, const core::Vector3<S>& p2,
                             const core::Vector3<S>& p3, double dt) noexcept {
  return S(1 / (dt * dt * dt)) * ((p3 - p0) - S(3.0) * (p2 - p1));
}

/// By how much the size of a jerk is above `limit` > 0, m/s^3 (PARC Eq. 9, one joint).
template <core::Scalar S>
inline S jerk_excess(const core::Vector3<S>& jerk, double limit) noexcept {
  using core::select;
  using std::sqrt;
  const S squared = squared_norm(jerk);
  const auto above = squared > S(limit * limit);
  return select(above, S(sqrt(select(above, squared, S(1.0))) - S(limit)), S(0.0));
}

/// What each way of changing a pose costs (PARC E.2 weighs them alike; its released code takes 1, 10, 1).
struct RegularizationWeights {
  double root_position = 1;  ///< 1/m^2
  double root_rotation = 1;  ///< 1/rad^2
  double joints = 1;         ///< 1/rad^2
};

namespace detail {

/// The weight of every number of a tangent vector.
inline Eigen::VectorXd tangent_weights(const body::Skeleton& skeleton, const RegularizationWeights& w) {
  Eigen::VectorXd out = Eigen::VectorXd::Constant(skeleton.nv(), w.joints);
  if (skeleton.free_root()) {
    out.head<3>().setConstant(w.root_position);
    out.segment<3>(3).setConstant(w.root_rotation);
  }
  return out;
}

/// Coefficients (1 - cos t) / t^2 and (t - sin t) / t^3 of the exponential map's derivative, t = |d|.
struct ExpDerivative {
  double b, c;
  explicit ExpDerivative(const core::Vector3<double>& d) noexcept {
    const double t2 = squared_norm(d);
    if (t2 < 1e-6) {
      b = 0.5 - t2 / 24;
      c = 1.0 / 6 - t2 / 120;
    } else {
      const double t = std::sqrt(t2);
      b = (1 - std::cos(t)) / t2;
      c = (t - std::sin(t)) / (t2 * t);
    }
  }
};

/// Transpose of the map from the rate of d to the angular velocity of exp(d), in the turned frame, times a torque.
inline core::Vector3<double> exp_torque_local(const core::Vector3<double>& d, const core::Vector3<double>& torque) noexcept {
  const ExpDerivative e(d);
  const core::Vector3<double> once = cross(d, torque);
  return torque + e.b * once + e.c * cross(d, once);
}

/// The same for the angular velocity seen from outside.
inline core::Vector3<double> exp_torque_outer(const core::Vector3<double>& d, const core::Vector3<double>& torque) noexcept {
  const ExpDerivative e(d);
  const core::Vector3<double> once = cross(d, torque);
  return torque - e.b * once + e.c * cross(d, once);
}

/// Forces on bodies at their joints' places and torques about them, world axes.
struct BodyForces {
  std::vector<core::Vector3<double>> force, torque;

  BodyForces() = default;
  explicit BodyForces(const body::Skeleton& s)
      : force(static_cast<std::size_t>(s.size())), torque(static_cast<std::size_t>(s.size())) {}
  void clear() noexcept {
    std::fill(force.begin(), force.end(), core::Vector3<double>{0, 0, 0});
    std::fill(torque.begin(), torque.end(), core::Vector3<double>{0, 0, 0});
  }
  void add(const body::Frames<double>& frames, int b, const core::Vector3<double>& at,
           const core::Vector3<double>& f) noexcept {
    const auto k = static_cast<std::size_t>(b);
    force[k] += f;
    torque[k] += cross(at - frames.position[k], f);
  }
};

/// One joint's share of a gradient: what a force on the joint and a torque about it do along its numbers of d, where the
/// pose is q (+) d.
inline void joint_gradient(const body::Joint& j, const body::Frames<double>& frames, int index, const double* d,
                           const core::Vector3<double>& force, const core::Vector3<double>& torque, double* out) noexcept {
  using core::Vector3;
  const core::Quaternion<double>& turned = frames.rotation[static_cast<std::size_t>(index)];
  double* o = out + j.v_index;
  switch (j.type) {
    case body::JointType::fixed:
      break;
    case body::JointType::hinge:
      o[0] += dot(j.axis, turned.conjugate().rotate(torque));
      break;
    case body::JointType::ball: {
      const Vector3<double> g =
          exp_torque_local(Vector3<double>::from(d + j.v_index), turned.conjugate().rotate(torque));
      o[0] += g.x, o[1] += g.y, o[2] += g.z;
      break;
    }
    case body::JointType::free: {
      o[0] += force.x, o[1] += force.y, o[2] += force.z;
      const Vector3<double> g =
          exp_torque_outer(Vector3<double>::from(d + j.v_index + 3), j.rest.conjugate().rotate(torque));
      o[3] += g.x, o[4] += g.y, o[5] += g.z;
      break;
    }
  }
}

/// Adds to `out` (nv numbers) the gradient with respect to d of a function whose derivative with respect to the bodies'
/// places is `forces`, at the pose q (+) d behind `frames`. Overwrites `forces`.
inline void add_gradient(const body::Skeleton& skeleton, const body::Frames<double>& frames, const double* d,
                         BodyForces& forces, double* out) noexcept {
  for (int i = skeleton.size() - 1; i >= 0; --i) {
    const body::Joint& j = skeleton[i];
    const auto k = static_cast<std::size_t>(i);
    joint_gradient(j, frames, i, d, forces.force[k], forces.torque[k], out);
    if (j.parent < 0) continue;
    const auto p = static_cast<std::size_t>(j.parent);
    forces.force[p] += forces.force[k];
    forces.torque[p] += forces.torque[k] + cross(frames.position[k] - frames.position[p], forces.force[k]);
  }
}

/// The same for one force at one place: only the joints above the body are visited.
inline void add_gradient(const body::Skeleton& skeleton, const body::Frames<double>& frames, const double* d, int body,
                         const core::Vector3<double>& at, const core::Vector3<double>& force, double* out) noexcept {
  for (int i = body; i >= 0; i = skeleton[i].parent)
    joint_gradient(skeleton[i], frames, i, d, force, cross(at - frames.position[static_cast<std::size_t>(i)], force), out);
}

}  // namespace detail

/// Weights of the four losses (PARC E.2).
struct CorrectionWeights {
  double regularization = 1;
  double penetration = 1000;  ///< 1/m
  double contact = 1000;      ///< 1/m
  double jerk = 1000;         ///< s^3/m
  double jerk_limit = 1000;   ///< m/s^3
  RegularizationWeights change;
};

/// Over how much the kinks of the losses are rounded, so that a descent finds a slope that tells how near they are.
/// With zeros nothing is.
struct KinkRounding {
  double distance = 0;     ///< m; of penetration and contact
  double jerk = 0;         ///< m/s^3
  double jerk_margin = 0;  ///< m/s^3; rounding begins this far below the limit, so that it ends with no excess
};

namespace detail {

/// w r for r >= 0, its kink at 0 rounded to w (sqrt(r^2 + e^2) - e).
struct RoundedValue {
  double value, slope;
  RoundedValue(double weight, double r, double e) noexcept : value(weight * r), slope(weight) {
    if (!(e > 0)) return;
    const double s = std::sqrt(r * r + e * e);
    value = weight * (r * r / (s + e));
    slope = weight * (r / s);
  }
};

}  // namespace detail

/// The four losses of a motion, summed over its frames and not yet weighted, and their weighted sum.
struct CorrectionLosses {
  double regularization = 0;  ///< m^2 + rad^2
  double penetration = 0;     ///< m
  double contact = 0;         ///< m
  double jerk = 0;            ///< m/s^3
  double total = 0;
  double rounded = 0;  ///< the weighted sum with kinks rounded

  CorrectionLosses& operator+=(const CorrectionLosses& o) {
    regularization += o.regularization;
    penetration += o.penetration;
    contact += o.contact;
    jerk += o.jerk;
    total += o.total;
    rounded += o.rounded;
    return *this;
  }
};

/// The loss that kinematic correction makes small (PARC Eq. 15), as a function of a change of a motion.
///
/// The change is a tangent vector d for each frame, nv x frames: frame k shows q_k (+) d_k (body::displace). So the
/// regularisation, the weighted square of d, is that of the angles by which joints were turned. Penetration, contact and
/// jerk are Eq. 7 to 9 summed over frames; a clip without contact labels has no contact loss. Where the loss has a kink
/// the gradient is that of one side.
class CorrectionLoss {
public:
  /// What an evaluation writes to; sized once.
  struct Workspace {
    std::vector<body::Frames<double>> frames;    ///< of each key
    std::vector<detail::BodyForces> forces;      ///< on the bodies of each key
    Eigen::MatrixXd poses;                       ///< nq x keys
    std::vector<CorrectionLosses> losses;        ///< each key's own; a jerk belongs to the first of its four
  };

  /// Throws Error if the clip has fewer than four frames or they are not evenly spaced (motion::resample), if a point
  /// names a body that does not exist, or if the points of a body do not follow one another.
  CorrectionLoss(const Clip& source, std::span<const body::SurfacePoint> points, const terrain::HeightGrid& ground,
                 const CorrectionWeights& weights = {})
      : source_(source), points_(points.begin(), points.end()), ground_(ground), weights_(weights) {
    const std::string where = detail::where(source) + ": correction: ";
    source.check();
    if (keys() < 4) throw Error(where + "expected at least four frames");
    dt_ = source.duration() / (keys() - 1);
    for (int k = 1; k < keys(); ++k)
      if (std::abs(source.times[k] - source.times[k - 1] - dt_) > 1e-3 * dt_)
        throw Error(where + "expected frames that are evenly spaced");
    first_.assign(static_cast<std::size_t>(source.skeleton.size()) + 1, 0);
    for (std::size_t k = 0; k < points_.size(); ++k) {
      const int b = points_[k].body;
      if (b < 0 || b >= source.skeleton.size())
        throw Error(where + "a point names body " + std::to_string(b) + ", which does not exist");
      if (k > 0 && b < points_[k - 1].body) throw Error(where + "expected points in the order of their bodies");
      ++first_[static_cast<std::size_t>(b) + 1];
    }
    for (std::size_t b = 1; b < first_.size(); ++b) first_[b] += first_[b - 1];
    if (!(weights.jerk_limit > 0)) throw Error(where + "expected a jerk limit above zero");
    tangent_weights_ = weights.regularization * detail::tangent_weights(source.skeleton, weights.change);
  }

  const Clip& source() const { return source_; }
  const CorrectionWeights& weights() const { return weights_; }
  const std::vector<body::SurfacePoint>& points() const { return points_; }
  const terrain::HeightGrid& ground() const { return ground_; }
  int keys() const { return source_.keys(); }
  int nv() const { return source_.skeleton.nv(); }
  /// Time between frames, s.
  double dt() const { return dt_; }
  /// The weight of the square of each number of d, nv of them.
  const Eigen::VectorXd& tangent_weights() const { return tangent_weights_; }

  Workspace workspace() const {
    const auto n = static_cast<std::size_t>(keys());
    Workspace w;
    w.frames.assign(n, body::Frames<double>(source_.skeleton));
    w.forces.assign(n, detail::BodyForces(source_.skeleton));
    w.poses.resize(source_.skeleton.nq(), keys());
    w.losses.resize(n);
    return w;
  }

  /// The weighted sum at the change d (nv x keys, column after column), straight from the definitions. Any scalar.
  template <core::Scalar S>
  S value(const S* d) const {
    const body::Skeleton& s = source_.skeleton;
    std::vector<body::Frames<S>> frames(static_cast<std::size_t>(keys()), body::Frames<S>(s));
    std::vector<S> q(static_cast<std::size_t>(s.nq()));
    S sum(0.0);
    for (int k = 0; k < keys(); ++k) {
      const S* dk = d + static_cast<std::ptrdiff_t>(k) * nv();
      body::Frames<S>& f = frames[static_cast<std::size_t>(k)];
      body::displace(s, source_.poses.col(k).data(), dk, q.data());
      body::forward_kinematics(s, q.data(), f);
      for (int i = 0; i < nv(); ++i) sum += S(tangent_weights_[i]) * dk[i] * dk[i];
      sum += S(weights_.penetration) * penetration(ground_, std::span<const body::SurfacePoint>(points_), f);
      if (source_.contacts.cols() != 0)
        sum += S(weights_.contact) *
               contact(ground_, std::span<const body::SurfacePoint>(points_), source_.contacts.col(k).data(), f);
    }
    for (std::size_t k = 0; k + 3 < frames.size(); ++k)
      for (std::size_t b = 0; b < static_cast<std::size_t>(s.size()); ++b)
        sum += S(weights_.jerk) * jerk_excess(jerk(frames[k].position[b], frames[k + 1].position[b],
                                                   frames[k + 2].position[b], frames[k + 3].position[b], dt_),
                                              weights_.jerk_limit);
    return sum;
  }

  /// The losses at d and the gradient of their weighted sum, both exact; `gradient` is nv x keys. If kinks are to be
  /// rounded the gradient is that of the rounded sum, the losses remain what they are. Allocates nothing. The same bits on
  /// any executor.
  template <core::Executor E>
  CorrectionLosses gradient(const Eigen::MatrixXd& d, Eigen::MatrixXd& gradient, Workspace& w, E&& executor,
                            const KinkRounding& rounding = {}) const {
    executor.run(chunks(), [&](int chunk) {
      each_key(chunk, [&](int k) {
        pose(d, k, w);
        ground_forces(k, w, rounding.distance);
      });
    });
    executor.run(chunks(), [&](int chunk) {
      each_key(chunk, [&](int k) {
        const auto i = static_cast<std::size_t>(k);
        jerk_forces(k, w, rounding);
        const auto dk = d.col(k);
        auto g = gradient.col(k);
        g = 2 * tangent_weights_.cwiseProduct(dk);
        detail::add_gradient(source_.skeleton, w.frames[i], dk.data(), w.forces[i], g.data());
        finish(k, dk, w);
      });
    });
    return sum(w);
  }

  /// The losses alone.
  template <core::Executor E>
  CorrectionLosses losses(const Eigen::MatrixXd& d, Workspace& w, E&& executor) const {
    executor.run(chunks(), [&](int chunk) {
      each_key(chunk, [&](int k) {
        pose(d, k, w);
        ground_losses(k, w);
      });
    });
    for (int k = 0; k < keys(); ++k) {
      jerk_losses(k, w);
      finish(k, d.col(k), w);
      w.losses[static_cast<std::size_t>(k)].rounded = w.losses[static_cast<std::size_t>(k)].total;
    }
    return sum(w);
  }
  CorrectionLosses losses(const Eigen::MatrixXd& d) const {
    Workspace w = workspace();
    return losses(d, w, core::SerialExecutor{});
  }

  /// What one surface point costs in one frame, or the nearest point of a body that is to touch.
  struct GroundTerm {
    int body;
    std::size_t point;                    ///< its index
    core::Vector3<double> place, normal;  ///< of the point, and out of the ground
    double height;                        ///< above the ground, m; negative below
    double weight;                        ///< of a metre
    bool contact;                         ///< on either side; else of depth
    /// What counts, m, and the direction in which the point's way adds to it.
    double distance() const noexcept { return contact ? std::abs(height) : -height; }
    core::Vector3<double> along() const noexcept { return contact && height > 0 ? normal : -normal; }
  };

  /// Calls f(GroundTerm) for every surface point of key k that is below the ground or less than `reach` above it, or
  /// whose entry in `also`, if given, is above zero; and for the nearest point of every body that is to touch.
  template <class F>
  void each_ground_term(int k, const body::Frames<double>& frames, double reach, F&& f,
                        const double* also = nullptr) const noexcept {
    using Vec = core::Vector3<double>;
    const terrain::HeightTable<double>& table = ground_.table<double>();
    const bool labelled = source_.contacts.cols() != 0;
    for (int b = 0; b < source_.skeleton.size(); ++b) {
      const auto body = static_cast<std::size_t>(b);
      const std::size_t begin = first_[body], end = first_[body + 1];
      if (begin == end) continue;
      const double label = labelled ? source_.contacts(b, k) : 0.0;
      const core::Matrix3<double> turn = frames.rotation[body].matrix();
      GroundTerm touching{b, 0, {0, 0, 0}, {0, 0, 1}, std::numeric_limits<double>::infinity(), 0, true};
      for (std::size_t i = begin; i < end; ++i) {
        const Vec p = frames.position[body] + turn * points_[i].local;
        const bool below = p.z < table.height(table.column(p.x), table.row(p.y));
        const bool asked = also != nullptr && also[i] > 0;
        if (!below && label == 0 && !asked && !(reach > 0 && p.z < table.highest + reach)) continue;
        const terrain::SurfaceSample<double> s = terrain::surface(ground_, p);
        if (s.distance < 0 || s.distance < reach || asked)
          f(GroundTerm{b, i, p, s.normal, s.distance, weights_.penetration, false});
        if (label != 0 && std::abs(s.distance) < std::abs(touching.height))
          touching = {b, i, p, s.normal, s.distance, label * weights_.contact, true};
      }
      if (std::isfinite(touching.height)) f(touching);
    }
  }

  /// The jerk of body b over the four keys from k.
  core::Vector3<double> jerk_of(int b, int k, const Workspace& w) const noexcept {
    const auto i = static_cast<std::size_t>(k), body = static_cast<std::size_t>(b);
    return jerk(w.frames[i].position[body], w.frames[i + 1].position[body], w.frames[i + 2].position[body],
                w.frames[i + 3].position[body], dt_);
  }

  /// Brings pose and frames of key k up to date with d.
  void pose(const Eigen::MatrixXd& d, int k, Workspace& w) const noexcept {
    double* q = w.poses.col(k).data();
    body::displace(source_.skeleton, source_.poses.col(k).data(), d.col(k).data(), q);
    body::forward_kinematics(source_.skeleton, q, w.frames[static_cast<std::size_t>(k)]);
  }

  /// The source changed by d.
  Clip changed(const Eigen::MatrixXd& d) const {
    Clip out = source_;
    for (int k = 0; k < keys(); ++k) {
      body::displace(source_.skeleton, source_.poses.col(k).data(), d.col(k).data(), out.poses.col(k).data());
      body::normalize(source_.skeleton, out.poses.col(k).data());
    }
    return out;
  }

  /// Keys are handed to an executor in runs of eight.
  int chunks() const noexcept { return (keys() + 7) / 8; }
  template <class F>
  void each_key(int chunk, F&& f) const {
    for (int k = 8 * chunk; k < std::min(8 * chunk + 8, keys()); ++k) f(k);
  }

private:
  void ground_losses(int k, Workspace& w) const noexcept {
    CorrectionLosses& out = w.losses[static_cast<std::size_t>(k)];
    out = {};
    each_ground_term(k, w.frames[static_cast<std::size_t>(k)], 0, [&](const GroundTerm& term) { count(out, term); });
  }
  void ground_forces(int k, Workspace& w, double rounding) const noexcept {
    const auto i = static_cast<std::size_t>(k);
    CorrectionLosses& out = w.losses[i];
    out = {};
    w.forces[i].clear();
    each_ground_term(k, w.frames[i], 0, [&](const GroundTerm& term) {
      count(out, term);
      const detail::RoundedValue kink(term.weight, term.distance(), rounding);
      out.rounded += kink.value;
      w.forces[i].add(w.frames[i], term.body, term.place, kink.slope * term.along());
    });
  }
  void count(CorrectionLosses& out, const GroundTerm& term) const noexcept {
    if (term.contact) {
      out.contact += weights_.contact > 0 ? term.weight / weights_.contact * term.distance() : 0;
    } else {
      out.penetration += term.distance();
    }
    out.total += term.weight * term.distance();
  }

  void jerk_losses(int k, Workspace& w) const noexcept {
    if (k + 3 >= keys()) return;
    for (int b = 0; b < source_.skeleton.size(); ++b)
      w.losses[static_cast<std::size_t>(k)].jerk += jerk_excess(jerk_of(b, k, w), weights_.jerk_limit);
  }

  /// Every key looks at the four jerks it takes part in, so that keys are independent of one another.
  void jerk_forces(int k, Workspace& w, const KinkRounding& rounding) const noexcept {
    constexpr double share[4] = {-1, 3, -3, 1};
    const auto i = static_cast<std::size_t>(k);
    const double scale = 1 / (dt_ * dt_ * dt_), limit = weights_.jerk_limit - rounding.jerk_margin;
    for (int part = 0; part < 4; ++part) {
      const int first = k - part;
      if (first < 0 || first + 3 >= keys()) continue;
      for (int b = 0; b < source_.skeleton.size(); ++b) {
        const core::Vector3<double> j = jerk_of(b, first, w);
        const double excess = jerk_excess(j, limit);
        if (!(excess > 0)) continue;
        const detail::RoundedValue kink(weights_.jerk, excess, rounding.jerk);
        if (part == 0) {
          w.losses[i].jerk += std::max(0.0, excess - rounding.jerk_margin);
          w.losses[i].rounded += kink.value;
        }
        w.forces[i].force[static_cast<std::size_t>(b)] += (share[part] * scale * kink.slope / (excess + limit)) * j;
      }
    }
  }

  void finish(int k, const Eigen::Ref<const Eigen::VectorXd>& dk, Workspace& w) const noexcept {
    CorrectionLosses& out = w.losses[static_cast<std::size_t>(k)];
    const double squared = tangent_weights_.dot(dk.cwiseAbs2());
    out.regularization = weights_.regularization > 0 ? squared / weights_.regularization : 0;
    out.total += squared + weights_.jerk * out.jerk;
    out.rounded += squared;
  }
  CorrectionLosses sum(const Workspace& w) const noexcept {
    CorrectionLosses out;
    for (const CorrectionLosses& l : w.losses) out += l;
    return out;
  }

  Clip source_;
  std::vector<body::SurfacePoint> points_;
  std::vector<std::size_t> first_;  ///< index of each body's first point; one more at the end
  terrain::HeightGrid ground_;
  CorrectionWeights weights_;
  Eigen::VectorXd tangent_weights_;
  double dt_ = 0;
};

}  // namespace traceur::motion
