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

#include "traceur/motion/correction.hpp"

namespace traceur::motion {

/// How the loss is solved as a problem of least squares.
struct CeresCorrectionOptions {
  CorrectionWeights weights;
  int iterations = 60;              ///< at most
  double tolerance = 1e-3;          ///< ends when the loss falls by less than this share of itself in an iteration
  double distance_rounding = 1e-4;  ///< m; kinks of the distances are rounded over this width
  double jerk_rounding = 10;        ///< m/s^3; that of the jerk's excess
  double jerk_margin = 0;           ///< m/s^3; the jerk's kink is put this far below its limit
  double first_rounding = 10;       ///< of the first iterations, times that of distances; wide kinks are soon near their feet
  double first_jerk_rounding = 10;  ///< the same for jerk
  int stages = 1;                   ///< in which widths fall from the first to the last, by equal factors
  int first_iterations = 12;        ///< of each stage at most; 0 begins with the last widths
  double stage_tolerance = 0.05;    ///< ends a stage
  double guard = 0.1;               ///< m; points nearer above the ground are kept from going under unseen
  double guard_curvature = 0.15;    ///< of terms that cost nothing yet, as a share of what a parabola with its foot there has
  double guard_falloff = 0;         ///< power of width over distance with which that falls away from the kink

  /// Settings that come near the minimum of the loss, at the price of more iterations than the quick ones: guards shorten steps,
  /// so they are weak, which needs kinks that begin as wide as to be parabolas and narrow slowly.
  static CeresCorrectionOptions thorough() {
    CeresCorrectionOptions out;
    out.iterations = 450;
    out.tolerance = 1e-4;
    out.jerk_rounding = 300;
    out.jerk_margin = 1;
    out.first_rounding = 1e3;
    out.first_jerk_rounding = 1e6;
    out.stages = 10;
    out.first_iterations = 30;
    out.stage_tolerance = 1e-3;
    out.guard_curvature = 0.01;
    out.guard_falloff = 1;
    return out;
  }
};

namespace detail {

/// The kink w max(r, 0) rounded to w (sqrt(r^2 + e^2) - e) where r > 0, with slope and the curvature of a parabola above
/// it that touches it at r: for r > 0 that of iteratively reweighted least squares, for r < 0 a share of that of the parabola
/// with its foot at r. Without any a step breaks what held so far; with all of it steps are shorter than need be.
struct RoundedKink {
  double value = 0, slope = 0, curvature;
  RoundedKink(double weight, double r, double e, const CeresCorrectionOptions& options) noexcept {
    if (!(r > 0)) {
      const double guard = options.guard_curvature * weight / (e - r);
      curvature = options.guard_falloff > 0 ? guard * std::pow(e / (e - r), options.guard_falloff) : guard;
      return;
    }
    const RoundedValue rounded(weight, r, e);
    value = rounded.value;
    slope = rounded.slope;
    curvature = slope / r;
  }
};

/// The loss put so that Gauss and Newton's method can work on it.
///
/// Sums of distances are no sums of squares: with r = sqrt(2 loss) a step would go twice as far as it should, and Ceres'
/// own loss functions want a residual for each of some thousand points. So all terms of a frame are gathered into a
/// gradient g and a matrix H of curvatures that lie above the loss, and with H = L L^T the frame's residuals are
///
///     (L^-1 g, c),   with Jacobian (L^T, 0)   and   c^2 = 2 loss - |L^-1 g|^2.
///
/// Then half their square is the loss itself, J^T r its exact gradient and J^T J = H. c is real because each term's
/// parabola stays above zero. The jerk of a body couples four frames and has three rows and a c of its own; its Jacobian
/// holds the joints that carry the body, no others, which keeps J^T J cheap.
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
  /// Multiplies the widths from here on.
  void set_rounding(double distance, double jerk) {
    distance_rounding_ = distance * options_.distance_rounding;
    jerk_rounding_ = jerk * options_.jerk_rounding;
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
    loss_.each_ground_term(k, at, jacobians ? options_.guard : 0,
                           [&](int b, const core::Vector3<double>& place, const core::Vector3<double>& along,
                               double distance, double weight, bool) {
                             const RoundedKink kink(weight, distance, distance_rounding_, options_);
                             value += kink.value;
                             if (!jacobians) return;
                             row.setZero();
                             add_gradient(s, at, d.data(), b, place, along, row.data());
                             g += kink.slope * row;
                             h.selfadjointView<Eigen::Lower>().rankUpdate(row, kink.curvature);
                           });
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
    const double limit = loss_.weights().jerk_limit - options_.jerk_margin;
    const core::Vector3<double> j = loss_.jerk_of(b, k, w_);
    const double size = norm(j), excess = size - limit;
    const RoundedKink kink(loss_.weights().jerk, excess, jerk_rounding_, options_);
    out.residual.setZero();
    out.rest = std::sqrt(2 * kink.value);
    if (!jacobians) return;
    const double along = std::sqrt(kink.curvature);
    out.turn = along * Eigen::Matrix3d::Identity();
    if (!(excess > 0)) return;
    const Eigen::Vector3d u = j.eigen() / size;
    const double across = along * std::sqrt(excess / size);
    out.turn = across * Eigen::Matrix3d::Identity() + (along - across) * u * u.transpose();
    out.residual = (kink.slope / along) * u;
    out.rest = std::sqrt(std::max(0.0, 2 * kink.value - out.residual.squaredNorm()));
  }

  const CorrectionLoss& loss_;
  const Eigen::MatrixXd& d_;
  CeresCorrectionOptions options_;
  E& executor_;
  CorrectionLoss::Workspace w_;
  double distance_rounding_ = options_.distance_rounding, jerk_rounding_ = options_.jerk_rounding;
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
/// couples four frames. It takes tens of iterations where Adam takes thousands, and no step size. The losses are the same
/// but for their kinks, which are rounded over the widths the options name; the report's `before` and `after` are
/// unrounded, its history is not. The same bits on any executor.
template <core::Executor E>
inline Corrected correct_ceres(const Clip& clip, std::span<const body::SurfacePoint> points,
                               const terrain::HeightGrid& ground, const CeresCorrectionOptions& options, E&& executor) {
  const std::string where = detail::where(clip) + ": correction: ";
  if (options.iterations < 0) throw Error(where + "expected no negative number of iterations");
  if (!(options.distance_rounding > 0) || !(options.jerk_rounding > 0))
    throw Error(where + "expected widths of rounding above zero");
  if (!(options.first_rounding > 0) || !(options.first_jerk_rounding > 0) || options.stages < 0)
    throw Error(where + "expected first roundings above zero and no negative number of stages");
  if (!(options.jerk_margin >= 0 && options.jerk_margin < options.weights.jerk_limit))
    throw Error(where + "expected a margin below the jerk's limit, and none below zero");
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
  solver.parameter_tolerance = 1e-9;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  solver.callbacks.push_back(&history);
  const auto solve = [&](double distance_rounding, double jerk_rounding, int iterations, double tolerance) {
    terms.set_rounding(distance_rounding, jerk_rounding);
    solver.max_num_iterations = iterations;
    solver.function_tolerance = tolerance;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem, &summary);
    if (summary.termination_type == ceres::FAILURE || !d.allFinite())
      throw Error(where + "the solve failed: " + summary.message);
    out.report.iterations += std::max(0, static_cast<int>(summary.iterations.size()) - 1);
  };
  for (int i = 0; i < options.stages; ++i) {
    const int most = std::min(options.first_iterations, options.iterations - out.report.iterations);
    const double left = 1 - static_cast<double>(i) / options.stages;
    if (most > 0)
      solve(std::pow(options.first_rounding, left), std::pow(options.first_jerk_rounding, left), most,
            options.stage_tolerance);
  }
  solve(1, 1, options.iterations - out.report.iterations, options.tolerance);
  out.report.after = loss.losses(d, w, executor);
  out.clip = loss.changed(d);
  out.report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return out;
}

inline Corrected correct_ceres(const Clip& clip, std::span<const body::SurfacePoint> points,
                               const terrain::HeightGrid& ground, const CeresCorrectionOptions& options = {}) {
  core::SerialExecutor serial;
  return correct_ceres(clip, points, ground, options, serial);
}

}  // namespace traceur::motion
