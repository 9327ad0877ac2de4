// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <ceres/ceres.h>
#include <ceres/version.h>

#include "traceur/motion/correction.hpp"

namespace traceur::motion {

/// How the loss is solved as a problem of least squares. The defaults end near the minimum in tens of iterations.
struct CeresCorrectionOptions {
  CorrectionWeights weights;
  /// Kinks are rounded over widths that fall from the first to the last, by equal factors, in so many stages, and are
  /// held by multipliers after each; then so many times more at the last widths, which need not be narrow.
  KinkRounding first_rounding{0.09, 1e9, 1}, rounding{0.003, 1e5, 1};
  int stages = 6;
  int stage_iterations = 5;  ///< at most, of each stage
  /// A stage ends when the loss falls by less than this share of itself in an iteration.
  double stage_tolerance = 1e-2;
  int holds = 1;
  int hold_iterations = 10;  ///< the same of what follows each hold
  double hold_tolerance = 1e-4;
  double guard = 0.1;  ///< m; points nearer above the ground are kept from going under unseen
  /// Of terms that cost nothing yet, as a share of what a parabola with its foot there has.
  double guard_curvature = 0.03;
  double guard_falloff = 4;  ///< power of width over distance with which that falls away from the kink

  /// Far down within four iterations, not much farther after twelve more: kinks are narrow from the first, which takes
  /// guards that keep steps short.
  static CeresCorrectionOptions quick() {
    CeresCorrectionOptions out;
    out.first_rounding = out.rounding = {0.002, 2e3, 1};
    out.stages = 1;
    out.stage_iterations = 4;
    out.holds = 3;
    out.hold_iterations = 4;
    out.guard_curvature = 0.15;
    out.guard_falloff = 0;
    return out;
  }

  /// Goes on until little is left to gain.
  static CeresCorrectionOptions thorough() {
    CeresCorrectionOptions out;
    out.first_rounding = {0.3, 1e10, 1};
    out.stages = 8;
    out.stage_iterations = 20;
    out.stage_tolerance = 1e-3;
    out.holds = 4;
    out.hold_iterations = 15;
    return out;
  }
};

namespace detail {

/// A kink that is held by a multiplier m, 0 <= m <= w: the least over s of w max(s, 0) - m s + w / (2 e) (s - r)^2, but
/// for a constant, which rounds the kink over the width e and puts the slope m, not 0, to r = 0. With m the slope that
/// balances all else at the minimum, the minimum of what is rounded is that of what is not (method of multipliers;
/// Moreau's envelope). The same for w |r|, where -w <= m <= w.
struct HeldValue {
  double value = 0, slope = 0;
  double past;  ///< how far beyond the foot of the parabola, m or m/s^3; negative where nothing is to pay
  HeldValue(double weight, double r, double e, double multiplier, bool both_sides) noexcept
      : past(weight > 0 ? r + e * multiplier / weight : r) {
    const double side = both_sides && past < 0 ? -1 : 1;
    past *= side;
    if (!(past > 0)) return;
    value = past < e ? 0.5 * weight / e * past * past : weight * (past - 0.5 * e);
    slope = side * weight * std::min(past / e, 1.0);
  }
};

/// A curvature for a held kink: that of a parabola above it that touches it where the motion is, and for a term that
/// costs nothing yet a share of that of the parabola with its foot there. Without any, a step breaks what held so far;
/// with all of it steps are shorter than need be.
inline double curvature(const HeldValue& kink, double weight, double width,
                        const CeresCorrectionOptions& options) noexcept {
  const double past = std::abs(kink.past);
  if (kink.slope != 0) return weight / std::max(width, past);
  return options.guard_curvature * weight / (width + past) * std::pow(width / (width + past), options.guard_falloff);
}

/// The loss put so that Gauss and Newton's method can work on it.
///
/// Sums of distances are no sums of squares: with r = sqrt(2 loss) a step would go twice as far as it should, and
/// Ceres' own loss functions want a residual for each of some thousand points. So all terms of a frame are gathered
/// into a gradient g and a matrix H of curvatures that lie above the loss, and with H = L L^T the frame's residuals are
///
///     (L^-1 g, c),   with Jacobian (L^T, 0)   and   c^2 = 2 loss - |L^-1 g|^2.
///
/// Then half their square is the loss itself, J^T r its exact gradient and J^T J = H. c is real because each term's
/// parabola stays above zero. The jerk of a body couples four frames and has three rows and a c of its own; its
/// Jacobian holds the joints that carry the body, no others, which keeps J^T J cheap.
template <core::Executor E>
class CorrectionTerms final : public ceres::EvaluationCallback {
public:
  CorrectionTerms(const CorrectionLoss& loss, Eigen::MatrixXd& d, const CeresCorrectionOptions& options, E& executor)
      : loss_(loss), d_(d), options_(options), executor_(executor), w_(loss.workspace()) {
    const auto n = static_cast<std::size_t>(loss.keys());
    const int nv = loss.nv();
    frames_.assign(n, {0, Eigen::VectorXd::Zero(nv), Eigen::MatrixXd::Zero(nv, nv)});
    jerks_.assign((n - 3) * static_cast<std::size_t>(bodies()), Jerk{});
    motions_.assign(n, Eigen::MatrixXd::Zero(nv, 3 * bodies()));
    rows_.assign(n, Eigen::VectorXd::Zero(nv));
  }

  int bodies() const { return loss_.source().skeleton.size(); }
  /// Sets the widths from here on.
  void round(const KinkRounding& rounding) { rounding_ = rounding; }
  /// Holds kinks where the motion is: the slopes they have there become their multipliers.
  void hold() {
    executor_.run(loss_.chunks(), [&](int chunk) {
      loss_.each_key(chunk, [&](int k) {
        loss_.pose(d_, k, w_);
        auto points = points_.col(k), next = next_points_.col(k);
        next.setZero();
        loss_.each_ground_term(
            k, w_.frames[static_cast<std::size_t>(k)], 0,
            [&](const CorrectionLoss::GroundTerm& term) {
              const double slope = held(k, term).slope;
              (term.contact ? contacts_(term.body, k) : next[static_cast<Eigen::Index>(term.point)]) = slope;
            },
            points.data());
        points = next;
      });
    });
    for (int k = 0; k + 3 < loss_.keys(); ++k)
      for (int b = 0; b < bodies(); ++b)
        jerk_multipliers_(b, k) = held_jerk(k, b, excess(loss_.jerk_of(b, k, w_))).slope;
  }

  void PrepareForEvaluation(bool jacobians, bool new_point) override {
    if (!new_point && (!jacobians || jacobians_)) return;
    jacobians_ = jacobians;
    executor_.run(loss_.chunks(), [&](int chunk) {
      loss_.each_key(chunk, [&](int k) {
        if (new_point) loss_.pose(d_, k, w_);
        frame(k, jacobians);
      });
    });
    executor_.run(loss_.chunks(), [&](int chunk) {
      loss_.each_key(chunk, [&](int k) {
        for (int b = 0; k + 3 < loss_.keys() && b < bodies(); ++b) jerk(k, b, jacobians);
      });
    });
  }

  /// Of one frame: everything but jerk.
  struct Frame {
    double rest;               ///< c
    Eigen::VectorXd residual;  ///< L^-1 g
    Eigen::MatrixXd factor;    ///< L^T
  };
  /// Of one body over four frames.
  struct Jerk {
    double rest = 0;
    Eigen::Vector3d residual = Eigen::Vector3d::Zero();
    Eigen::Matrix3d turn = Eigen::Matrix3d::Zero();  ///< from a change of the jerk to that of the residual
  };

  const Frame& at(int k) const { return frames_[static_cast<std::size_t>(k)]; }
  const Jerk& jerk_at(int k, int body) const {
    return jerks_[static_cast<std::size_t>(k) * static_cast<std::size_t>(bodies()) + static_cast<std::size_t>(body)];
  }
  /// How a body's place follows the numbers of frame k: nv x 3.
  auto motion(int k, int body) const { return motions_[static_cast<std::size_t>(k)].middleCols<3>(3 * body); }
  double jerk_share(int part) const {
    constexpr double share[4] = {-1, 3, -3, 1};
    return share[part] / (loss_.dt() * loss_.dt() * loss_.dt());
  }

private:
  HeldValue held(int k, const CorrectionLoss::GroundTerm& term) const noexcept {
    return {term.weight, term.contact ? term.height : -term.height, rounding_.distance,
            term.contact ? contacts_(term.body, k) : points_(static_cast<Eigen::Index>(term.point), k), term.contact};
  }
  double excess(const core::Vector3<double>& jerk) const noexcept {
    return norm(jerk) - (loss_.weights().jerk_limit - rounding_.jerk_margin);
  }
  HeldValue held_jerk(int k, int b, double excess) const noexcept {
    return {loss_.weights().jerk, excess, rounding_.jerk, jerk_multipliers_(b, k), false};
  }

  void frame(int k, bool jacobians) {
    const auto i = static_cast<std::size_t>(k);
    Frame& out = frames_[i];
    const body::Frames<double>& at = w_.frames[i];
    const body::Skeleton& s = loss_.source().skeleton;
    const auto d = d_.col(k);
    const Eigen::VectorXd& weights = loss_.tangent_weights();
    double value = weights.dot(d.cwiseAbs2());
    Eigen::MatrixXd& h = out.factor;
    Eigen::VectorXd& g = out.residual;
    if (jacobians) {
      h = (2 * weights).asDiagonal();
      // Numbers that cost nothing to change would leave H singular.
      h.diagonal().array() += 1e-9;
      g = 2 * weights.cwiseProduct(d);
    }
    Eigen::VectorXd& row = rows_[i];
    loss_.each_ground_term(
        k, at, jacobians ? options_.guard : 0,
        [&](const CorrectionLoss::GroundTerm& term) {
          const HeldValue kink = held(k, term);
          value += kink.value;
          if (!jacobians) return;
          row.setZero();
          add_gradient(s, at, d.data(), term.body, term.place, term.contact ? term.normal : -term.normal, row.data());
          g += kink.slope * row;
          h.selfadjointView<Eigen::Lower>().rankUpdate(row, curvature(kink, term.weight, rounding_.distance, options_));
        },
        points_.col(k).data());
    if (!jacobians) {
      out.rest = std::sqrt(2 * value);
      out.residual.setZero();
      return;
    }
    const Eigen::LLT<Eigen::MatrixXd> cholesky(h);
    h = cholesky.matrixU();
    cholesky.matrixL().solveInPlace(g);
    out.rest = std::sqrt(std::max(0.0, 2 * value - g.squaredNorm()));
    Eigen::MatrixXd& motions = motions_[i];
    motions.setZero();
    for (int b = 0; b < s.size(); ++b)
      for (int axis = 0; axis < 3; ++axis)
        add_gradient(s, at, d.data(), b, at.position[static_cast<std::size_t>(b)],
                     {axis == 0 ? 1.0 : 0.0, axis == 1 ? 1.0 : 0.0, axis == 2 ? 1.0 : 0.0},
                     motions.col(3 * b + axis).data());
  }

  void jerk(int k, int b, bool jacobians) {
    Jerk& out = jerks_[static_cast<std::size_t>(k) * static_cast<std::size_t>(bodies()) + static_cast<std::size_t>(b)];
    const core::Vector3<double> j = loss_.jerk_of(b, k, w_);
    const HeldValue kink = held_jerk(k, b, excess(j));
    out.residual.setZero();
    out.rest = std::sqrt(2 * kink.value);
    if (!jacobians) return;
    const double along = std::sqrt(curvature(kink, loss_.weights().jerk, rounding_.jerk, options_));
    out.turn = along * Eigen::Matrix3d::Identity();
    const double size = norm(j);
    // A jerk that is held may be none by now, and leads nowhere then.
    if (!(kink.slope > 0) || !(size > 0)) return;
    const Eigen::Vector3d u = j.eigen() / size;
    const double across = std::sqrt(kink.slope / size);
    out.turn = across * Eigen::Matrix3d::Identity() + (along - across) * u * u.transpose();
    out.residual = (kink.slope / along) * u;
    out.rest = std::sqrt(std::max(0.0, 2 * kink.value - out.residual.squaredNorm()));
  }

  const CorrectionLoss& loss_;
  const Eigen::MatrixXd& d_;
  CeresCorrectionOptions options_;
  E& executor_;
  CorrectionLoss::Workspace w_;
  KinkRounding rounding_ = options_.rounding;
  // Of each frame: of surface points, of bodies that are to touch, of bodies' jerks.
  Eigen::MatrixXd points_ = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(loss_.points().size()), loss_.keys());
  Eigen::MatrixXd contacts_ = Eigen::MatrixXd::Zero(bodies(), loss_.keys()), jerk_multipliers_ = contacts_;
  Eigen::MatrixXd next_points_ = points_;  ///< scratch
  bool jacobians_ = false;
  std::vector<Frame> frames_;
  std::vector<Jerk> jerks_;
  std::vector<Eigen::MatrixXd> motions_;  ///< nv x 3 bodies, of each key
  std::vector<Eigen::VectorXd> rows_;     ///< scratch of each key
};

/// A joint's numbers in a tangent vector.
struct JointNumbers {
  int begin, size;
};

using RowMajorMap = Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;

template <class Terms>
class FrameCost final : public ceres::CostFunction {
public:
  FrameCost(const Terms& terms, int key, int nv, std::vector<JointNumbers> joints)
      : terms_(terms), key_(key), nv_(nv), joints_(std::move(joints)) {
    set_num_residuals(nv + 1);
    for (const JointNumbers& j : joints_) mutable_parameter_block_sizes()->push_back(j.size);
  }
  bool Evaluate(const double* const*, double* residuals, double** jacobians) const override {
    const auto& f = terms_.at(key_);
    Eigen::Map<Eigen::VectorXd>(residuals, nv_) = f.residual;
    residuals[nv_] = f.rest;
    for (std::size_t i = 0; jacobians != nullptr && i < joints_.size(); ++i) {
      if (jacobians[i] == nullptr) continue;
      RowMajorMap j(jacobians[i], nv_ + 1, joints_[i].size);
      j.topRows(nv_) = f.factor.middleCols(joints_[i].begin, joints_[i].size);
      j.row(nv_).setZero();
    }
    return std::isfinite(f.rest);
  }

private:
  const Terms& terms_;
  int key_, nv_;
  std::vector<JointNumbers> joints_;
};

template <class Terms>
class JerkCost final : public ceres::CostFunction {
public:
  JerkCost(const Terms& terms, int key, int body, std::vector<JointNumbers> joints)
      : terms_(terms), key_(key), body_(body), joints_(std::move(joints)) {
    set_num_residuals(4);
    for (int part = 0; part < 4; ++part)
      for (const JointNumbers& j : joints_) mutable_parameter_block_sizes()->push_back(j.size);
  }
  bool Evaluate(const double* const*, double* residuals, double** jacobians) const override {
    const auto& f = terms_.jerk_at(key_, body_);
    Eigen::Map<Eigen::Vector3d>(residuals, 3) = f.residual;
    residuals[3] = f.rest;
    for (int part = 0; jacobians != nullptr && part < 4; ++part)
      for (std::size_t i = 0; i < joints_.size(); ++i) {
        double* const to = jacobians[static_cast<std::size_t>(part) * joints_.size() + i];
        if (to == nullptr) continue;
        RowMajorMap j(to, 4, joints_[i].size);
        j.topRows<3>().noalias() =
            (terms_.jerk_share(part) * f.turn) *
            terms_.motion(key_ + part, body_).middleRows(joints_[i].begin, joints_[i].size).transpose();
        j.row(3).setZero();
      }
    return std::isfinite(f.rest);
  }

private:
  const Terms& terms_;
  int key_, body_;
  std::vector<JointNumbers> joints_;
};

/// Notes the loss after every iteration.
class HistoryOfSolve final : public ceres::IterationCallback {
public:
  HistoryOfSolve(CorrectionReport& report, std::chrono::steady_clock::time_point started)
      : report_(report), started_(started) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    report_.history.push_back(summary.cost);
    report_.elapsed.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - started_).count());
    return ceres::SOLVER_CONTINUE;
  }

private:
  CorrectionReport& report_;
  std::chrono::steady_clock::time_point started_;
};

}  // namespace detail

/// As `correct`, solved by Ceres: Levenberg and Marquardt's method on a problem whose matrix is banded, since a jerk
/// couples four frames. It takes tens of iterations where Adam takes thousands, no step size, and ends lower: with
/// kinks held by multipliers (HeldValue) no width has to become so narrow that steps are short. The result is the best
/// of what stages and holds ended with. The report's `before` and `after` are of the losses as they are, its history is
/// of what was minimised. The same bits on any executor.
template <core::Executor E>
inline Corrected correct_ceres(const Clip& clip, std::span<const body::SurfacePoint> points,
                               const terrain::HeightGrid& ground, const CeresCorrectionOptions& options, E&& executor) {
  const std::string where = detail::where(clip) + ": correction: ";
  if (options.stages < 0 || options.holds < 0 || options.stage_iterations < 0 || options.hold_iterations < 0)
    throw Error(where + "expected no negative number of stages, holds or iterations");
  for (const KinkRounding& r : {options.first_rounding, options.rounding}) {
    if (!(r.distance > 0) || !(r.jerk > 0)) throw Error(where + "expected widths of rounding above zero");
    if (!(r.jerk_margin >= 0 && r.jerk_margin < options.weights.jerk_limit))
      throw Error(where + "expected a margin below the jerk's limit, and none below zero");
  }
  if (!(options.guard_curvature >= 0) || !(options.guard_falloff >= 0))
    throw Error(where + "expected no negative guard");
  const auto started = std::chrono::steady_clock::now();
  const CorrectionLoss loss(clip, points, ground, options.weights);
  Eigen::MatrixXd d = Eigen::MatrixXd::Zero(loss.nv(), loss.keys());
  CorrectionLoss::Workspace w = loss.workspace();
  Corrected out;
  out.report.before = loss.losses(d, w, executor);
  using Terms = detail::CorrectionTerms<std::remove_reference_t<E>>;
  Terms terms(loss, d, options, executor);

  const body::Skeleton& skeleton = clip.skeleton;
  const auto numbers = [&](int joint, std::vector<detail::JointNumbers>& to) {
    const int size = body::velocity_size(skeleton[joint].type);
    if (size > 0) to.push_back({skeleton[joint].v_index, size});
  };
  std::vector<detail::JointNumbers> all;
  std::vector<std::vector<detail::JointNumbers>> carriers(static_cast<std::size_t>(skeleton.size()));
  for (int b = 0; b < skeleton.size(); ++b) {
    numbers(b, all);
    // A joint's own rotation does not move its place.
    for (int i = b == 0 ? 0 : skeleton[b].parent; i >= 0; i = skeleton[i].parent)
      numbers(i, carriers[static_cast<std::size_t>(b)]);
  }
  ceres::Problem::Options problem_options;
  problem_options.evaluation_callback = &terms;
  ceres::Problem problem(problem_options);
  std::vector<double*> blocks;
  for (int k = 0; k < loss.keys(); ++k) {
    blocks.clear();
    for (const detail::JointNumbers& j : all) blocks.push_back(d.col(k).data() + j.begin);
    problem.AddResidualBlock(new detail::FrameCost<Terms>(terms, k, loss.nv(), all), nullptr, blocks);
  }
  for (int k = 0; k + 3 < loss.keys(); ++k)
    for (int b = 0; b < skeleton.size(); ++b) {
      const std::vector<detail::JointNumbers>& joints = carriers[static_cast<std::size_t>(b)];
      if (joints.empty()) continue;
      blocks.clear();
      for (int part = 0; part < 4; ++part)
        for (const detail::JointNumbers& j : joints) blocks.push_back(d.col(k + part).data() + j.begin);
      problem.AddResidualBlock(new detail::JerkCost<Terms>(terms, k, b, joints), nullptr, blocks);
    }
  detail::HistoryOfSolve history(out.report, started);
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
#if CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR < 2
  // The matrix is banded and small: twice as quick as SuiteSparse with a BLAS whose threads wait for each other. (Later
  // versions are without it; Eigen's own factorisation is as quick, but not safe where Ceres was compiled for other
  // registers than this.)
  if (ceres::IsSparseLinearAlgebraLibraryTypeAvailable(ceres::CX_SPARSE))
    solver.sparse_linear_algebra_library_type = ceres::CX_SPARSE;
#endif
  solver.parameter_tolerance = 1e-9;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  solver.callbacks.push_back(&history);
  out.report.after = out.report.before;
  Eigen::MatrixXd best = d;
  const auto solve = [&](const KinkRounding& rounding, int iterations, double tolerance) {
    terms.round(rounding);
    solver.max_num_iterations = iterations;
    solver.function_tolerance = tolerance;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem, &summary);
    if (summary.termination_type == ceres::FAILURE || !d.allFinite())
      throw Error(where + "the solve failed: " + summary.message);
    out.report.iterations += std::max(0, static_cast<int>(summary.iterations.size()) - 1);
    // Steps were as long as this in the end; a solve that begins with longer ones loses iterations on finding that out.
    if (!summary.iterations.empty())
      solver.initial_trust_region_radius = std::clamp(4 * summary.iterations.back().trust_region_radius, 1e-2, 1e4);
    const CorrectionLosses now = loss.losses(d, w, executor);
    if (now.total < out.report.after.total) {
      out.report.after = now;
      best = d;
    }
    terms.hold();
  };
  const KinkRounding &from = options.first_rounding, &to = options.rounding;
  for (int i = 0; i < options.stages; ++i) {
    const double share = static_cast<double>(i) / options.stages;
    solve({detail::between(from.distance, to.distance, share), detail::between(from.jerk, to.jerk, share),
           detail::between(from.jerk_margin, to.jerk_margin, share)},
          options.stage_iterations, options.stage_tolerance);
  }
  for (int i = 0; i < options.holds; ++i) solve(to, options.hold_iterations, options.hold_tolerance);
  out.clip = loss.changed(best);
  out.report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return out;
}

inline Corrected correct_ceres(const Clip& clip, std::span<const body::SurfacePoint> points,
                               const terrain::HeightGrid& ground, const CeresCorrectionOptions& options = {}) {
  core::SerialExecutor serial;
  return correct_ceres(clip, points, ground, options, serial);
}

}  // namespace traceur::motion
