// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <vector>

#include "traceur/control/mirror.hpp"
#include "traceur/control/pd_targets.hpp"
#include "traceur/control/sole_slide.hpp"
#include "traceur/control/tracking_cost.hpp"
#include "traceur/core/random.hpp"
#include "traceur/sim/world.hpp"

namespace traceur::control {

/// Settings of the sampling search (Liu, Yin, van de Panne, Shao, Xu 2010, "Sampling-based contact-rich motion control").
struct SamplingParameters {
  int samples = 3072;        ///< simulated per window
  int elites = 384;          ///< kept per window
  int children = 24;         ///< kept per parent at most, so that one lucky start does not crowd out the rest
  int rounds = 14;           ///< passes over the whole motion
  int window_ticks = 6;      ///< control ticks in a window; 0.1 s at 60 Hz
  int steps_per_tick = 8;    ///< simulation steps in a control tick
  double lead = 0.1;         ///< s of reference joint velocity that targets run ahead
  double hip = 0.30;         ///< first standard deviations of the offsets, rad
  double leg = 0.25;         ///< knees and ankles
  double trunk = 0.15;       ///< waist, shoulders, elbows
  double head = 0.05;
  double shrink = 0.9;       ///< factor on standard deviations from round to round
  double history = 0.15;     ///< share of a path's accumulated cost that counts in ranking
  double slide = 0;          ///< cost of soles that slide at 1 m/s through a window while they carry the body
  int lag = 3;               ///< windows between a window and the elites whose ancestors set its next mean
  /// Long motions: all rounds are made over so many windows, then over as many from `stride` windows later, and so on, so
  /// that what comes late is not searched from states that have not settled. 0: the whole motion at once.
  int horizon = 0;
  int stride = 8;            ///< windows
  std::uint64_t seed = 1;
  Eigen::MatrixXd targets;  ///< nq x ticks, what offsets are added to; empty: the reference, led
  Eigen::MatrixXd offsets;  ///< nv x windows, where the first round searches around; empty: zero
  /// Cyclic motions: first ticks of the windows of one period (or of its first half when `mirrored`), ascending from 0, and
  /// the ticks in that period (half). Empty: windows of `window_ticks`, each its own.
  std::vector<int> period_starts;
  int period_ticks = 0;
  bool mirrored = false;  ///< the second half of a period is the first, mirrored

  bool tied() const { return !period_starts.empty(); }
  /// Rounds of all horizons together, for a motion of so many windows.
  int passes(int windows) const {
    if (horizon == 0 || windows <= horizon) return rounds;
    return rounds * (1 + (windows - horizon + stride - 1) / stride);
  }
};

/// PD target trajectories that make a simulated character perform a clip: open-loop control.
struct SampledControl {
  Eigen::MatrixXd offsets;     ///< nv x windows, tangent offsets added to led targets, rad
  Eigen::MatrixXd targets;     ///< nq x ticks, what the motors were given
  Eigen::MatrixXd poses;       ///< nq x (ticks + 1), the simulated motion
  Eigen::MatrixXd velocities;  ///< nv x (ticks + 1)
  Eigen::MatrixXd tied_offsets;    ///< nv x windows of a period (half): the plan common to all cycles; empty when not tied
  std::vector<double> round_cost;  ///< cost of the best path after each round
  double mean_joint_error = 0;     ///< m, mean over tracked points and ticks, global
  double mean_local_error = 0;     ///< m, after taking the root's position off both
  double worst_tick_error = 0;     ///< m, mean over points at the worst tick
  double simulated_seconds = 0;
};

/// What a search simulates besides the character and the ground: grips, and what is done to the lanes after every tick.
struct NoSamplingAid {
  sim::Extras extras;
  /// `tick` has just been simulated. All that it knows of a lane must be in the lane's state. An aid that has a `cost(lanes,
  /// tick)` as well adds that to what a window costs, as a mean over its ticks.
  template <class S>
  void operator()(sim::Lanes<S>&, int) const noexcept {}
};

/// Told after every round: round, cost of the best path. Returning false ends the search after that round.
using SamplingProgress = std::function<bool(int round, double cost)>;

/// Searches joint offsets, constant over windows, around the led targets of a reference.
///
/// Each round goes through the windows in order: samples start from the elite end states of the window before, are given
/// Gaussian offsets and ranked by their distance from the reference at mid-window and end. The mean of a window's next
/// Gaussian is half the best path and half a rank-weighted mean over the ancestors of elites `lag` windows later; the
/// spread shrinks. The best path of the round before is always among the samples, so its cost never rises. Where windows
/// are tied, equal phases of all cycles (and mirrored halves) share one mean: one plan for every cycle.
///
/// The simulation begins at the reference's first tick. Deterministic for a seed on any executor. S is the simulator's
/// scalar. Throws Error naming a setting that is out of range.
template <class S, core::Executor E, class Aid = NoSamplingAid>
SampledControl sample_control(const sim::Model& model, const sim::Parameters& simulation, const sim::Ground<core::Element<S>>& ground,
                              const TrackingCost& cost, const TrackingReference& reference, const SamplingParameters& p, E& executor,
                              const SamplingProgress& progress = {}, const Aid& aid = {}) {
  using T = core::Element<S>;
  using core::Quaternion;
  using core::Vector3;
  constexpr int width = core::lane_count<S>;
  if (p.samples < 1 || p.elites < 1 || p.children < 1 || p.rounds < 1 || p.window_ticks < 1 || p.steps_per_tick < 1)
    throw Error("sampling control: samples, elites, children, rounds, window_ticks and steps_per_tick must be positive");
  if (p.lag < 0) throw Error("sampling control: lag must be zero or more");
  if (!(p.slide >= 0) || !std::isfinite(p.slide)) throw Error("sampling control: slide must be zero or more");
  if (p.horizon < 0 || (p.horizon > 0 && (p.stride < 1 || p.stride > p.horizon)))
    throw Error("sampling control: horizon must be zero or more, and stride between 1 and horizon");
  if (p.horizon > 0 && p.tied()) throw Error("sampling control: a horizon is for motions without period_starts");
  for (std::size_t k = 0; k < p.period_starts.size(); ++k)
    if (p.period_starts[k] >= p.period_ticks || (k == 0 ? p.period_starts[0] != 0 : p.period_starts[k] <= p.period_starts[k - 1]))
      throw Error("sampling control: period_starts must ascend from 0 and stay below period_ticks");
  const int ticks = reference.ticks;
  std::vector<int> starts;  // first tick of each window, and the end
  if (p.tied()) {
    for (int cycle = 0; cycle * p.period_ticks < ticks; ++cycle)
      for (const int s : p.period_starts)
        if (cycle * p.period_ticks + s < ticks) starts.push_back(cycle * p.period_ticks + s);
  } else {
    for (int t = 0; t < ticks; t += p.window_ticks) starts.push_back(t);
  }
  starts.push_back(ticks);
  const int windows = static_cast<int>(starts.size()) - 1;
  const int phases = static_cast<int>(p.period_starts.size());
  const int nv = model.nv;
  const Roles& roles = cost.roles();

  Eigen::VectorXd sigma = Eigen::VectorXd::Zero(nv);
  for (std::size_t b = 1; b < model.bodies.size(); ++b) {
    const int index = static_cast<int>(b);
    double s = p.trunk;
    if (roles.is_leg(index)) s = (index == roles.legs[0].hip || index == roles.legs[1].hip) ? p.hip : p.leg;
    if (std::find(roles.head.begin(), roles.head.end(), index) != roles.head.end()) s = p.head;
    sigma.segment(model.bodies[b].v_index, body::velocity_size(model.bodies[b].type)).setConstant(s);
  }
  if (p.targets.size() > 0 && (p.targets.rows() != model.nq || p.targets.cols() != ticks))
    throw Error("sampling control: targets must be empty or have a column for every tick");
  if (p.offsets.size() > 0 && (p.offsets.rows() != nv || p.offsets.cols() != windows))
    throw Error("sampling control: offsets must be empty or have a column for every window");
  const Eigen::MatrixXd base = p.targets.size() > 0 ? p.targets : led_targets(model, reference, p.lead);
  const T slide_weight = static_cast<T>(p.slide / (model.total_mass * 9.81));

  struct Window {
    Eigen::VectorXd mean;
    std::vector<int> parent;
    std::vector<float> window_cost, path_cost;
    Eigen::MatrixXf offsets;  // nv x elites
    std::vector<T> states;    // state x elites
    int carried = -1;         // elite that continues the best path
  };
  const auto state_size = static_cast<std::size_t>(sim::Lanes<S>::state_size(model, aid.extras));
  std::vector<Window> path(static_cast<std::size_t>(windows));
  for (int w = 0; w < windows; ++w)
    path[static_cast<std::size_t>(w)].mean = p.offsets.size() > 0 ? Eigen::VectorXd(p.offsets.col(w)) : Eigen::VectorXd::Zero(nv);

  // The start: one elite before the first window.
  std::vector<T> start(state_size, T(0));
  for (int i = 0; i < model.nq; ++i) start[static_cast<std::size_t>(i)] = static_cast<T>(reference.poses(i, 0));
  for (int i = 0; i < nv; ++i) start[static_cast<std::size_t>(model.nq + i)] = static_cast<T>(reference.velocities(i, 0));

  std::vector<T> carried_on = start;

  const int groups = (p.samples + width - 1) / width;
  const int samples = groups * width;
  std::vector<sim::Lanes<S>> lanes;
  for (int i = 0; i < executor.concurrency(); ++i) lanes.emplace_back(model, simulation, ground, aid.extras);
  Eigen::MatrixXf offsets(nv, samples);
  std::vector<int> parents(static_cast<std::size_t>(samples));
  std::vector<float> window_cost(static_cast<std::size_t>(samples)), score(static_cast<std::size_t>(samples));
  std::vector<T> end_states(state_size * static_cast<std::size_t>(samples));
  Eigen::MatrixXf best = Eigen::MatrixXf::Zero(nv, windows);
  SampledControl out;

  // Gives the lanes of one group their targets for a tick: base * exp(offset).
  const auto give_targets = [&](sim::Lanes<S>& l, const std::vector<Quaternion<S>>& turn, const std::vector<S>& add, int tick) {
    const double* t = base.col(tick).data();
    for (std::size_t b = 1; b < model.bodies.size(); ++b) {
      const sim::MovingBody& m = model.bodies[b];
      const auto constant = [&](int k) { return S(static_cast<T>(t[m.q_index + k])); };
      if (m.type == body::JointType::ball) {
        (Quaternion<S>{constant(0), constant(1), constant(2), constant(3)} * turn[b]).store(l.target() + m.q_index);
      } else {
        l.target()[m.q_index] = constant(0) + add[b];
      }
    }
  };
  const auto load_offsets = [&](std::vector<Quaternion<S>>& turn, std::vector<S>& add, auto&& entry) {
    for (std::size_t b = 1; b < model.bodies.size(); ++b) {
      const sim::MovingBody& m = model.bodies[b];
      if (m.type == body::JointType::ball) {
        turn[b] = exp_map(Vector3<S>{entry(m.v_index), entry(m.v_index + 1), entry(m.v_index + 2)});
      } else {
        add[b] = entry(m.v_index);
      }
    }
  };

  // Windows before `first` are settled; those before `known` have been part of a best path.
  int first = 0, known = 0, end = p.horizon > 0 ? std::min(windows, p.horizon) : windows;
  for (int pass = 0; pass < p.passes(windows); ++pass) {
    const int round = pass % p.rounds;
    if (pass > 0 && round == 0) {
      const Window& settled = path[static_cast<std::size_t>(first + p.stride - 1)];
      std::copy_n(settled.states.data() + state_size * static_cast<std::size_t>(settled.carried), state_size, carried_on.data());
      first += p.stride;
      end = std::min(windows, end + p.stride);
    }
    const double spread = std::pow(p.shrink, round);
    for (int w = first; w < end; ++w) {
      Window& window = path[static_cast<std::size_t>(w)];
      const bool has_best = w < known;
      const Window* before = w > first ? &path[static_cast<std::size_t>(w - 1)] : nullptr;
      const int candidates = before ? static_cast<int>(before->parent.size()) : 1;
      const int first_tick = starts[static_cast<std::size_t>(w)];
      const int last_tick = starts[static_cast<std::size_t>(w + 1)];
      const int middle = (first_tick + last_tick) / 2;
      executor.run(groups, [&](int g, int worker) {
        sim::Lanes<S>& l = lanes[static_cast<std::size_t>(worker)];
        std::vector<Quaternion<S>> turn(model.bodies.size());
        std::vector<S> add(model.bodies.size());
        for (int i = 0; i < width; ++i) {
          const int s = g * width + i;
          const bool carry = s == 0 && has_best;
          const int parent = carry ? (before ? before->carried : 0) : s % candidates;
          parents[static_cast<std::size_t>(s)] = parent;
          if (carry) {
            offsets.col(s) = best.col(w);
          } else {
            core::RandomStream random(p.seed, static_cast<std::uint64_t>(pass) * 100000 + static_cast<std::uint64_t>(w),
                                      static_cast<std::uint64_t>(s));
            for (int k = 0; k < nv; ++k)
              offsets(k, s) = sigma[k] > 0 ? static_cast<float>(window.mean[k] + spread * sigma[k] * random.normal()) : 0.0f;
          }
          const T* from = before ? before->states.data() + state_size * static_cast<std::size_t>(parent) : carried_on.data();
          for (std::size_t k = 0; k < state_size; ++k) core::set_lane(l.state()[k], i, from[k]);
          l.clear_failed(i);
        }
        load_offsets(turn, add, [&](int k) {
          S x(T(0));
          for (int i = 0; i < width; ++i) core::set_lane(x, i, static_cast<T>(offsets(k, g * width + i)));
          return x;
        });
        S c(T(0));
        for (int t = first_tick; t < last_tick; ++t) {
          give_targets(l, turn, add, t);
          l.step(p.steps_per_tick);
          aid(l, t);
          if constexpr (requires { aid.cost(l, t); }) c += S(T(1) / static_cast<T>(last_tick - first_tick)) * aid.cost(l, t);
          if (p.slide > 0) c += S(slide_weight / static_cast<T>(last_tick - first_tick)) * sole_slide(l, roles).sum;
          if (t + 1 == middle) c += S(static_cast<T>(0.3)) * cost(l, reference, t + 1);
        }
        c += S(static_cast<T>(0.7)) * cost(l, reference, last_tick);
        for (int i = 0; i < width; ++i) {
          const int s = g * width + i;
          const auto k = static_cast<std::size_t>(s);
          float value = static_cast<float>(core::lane_of(c, i));
          if (l.failed(i) || !std::isfinite(value)) value = std::numeric_limits<float>::infinity();
          window_cost[k] = value;
          const float so_far = before ? before->path_cost[static_cast<std::size_t>(parents[k])] : 0.0f;
          score[k] = value + static_cast<float>(p.history) * so_far;
          T* to = end_states.data() + state_size * k;
          for (std::size_t n = 0; n < state_size; ++n) to[n] = core::lane_of(l.state()[n], i);
        }
      });
      out.simulated_seconds += samples * (last_tick - first_tick) * p.steps_per_tick * simulation.dt;

      std::vector<int> order(static_cast<std::size_t>(samples));
      std::iota(order.begin(), order.end(), 0);
      std::sort(order.begin(), order.end(), [&](int a, int b) {
        const float sa = score[static_cast<std::size_t>(a)], sb = score[static_cast<std::size_t>(b)];
        return sa != sb ? sa < sb : a < b;
      });
      std::vector<int> chosen;
      std::vector<int> used(static_cast<std::size_t>(candidates), 0);
      for (const int s : order) {
        if (static_cast<int>(chosen.size()) == p.elites || !std::isfinite(score[static_cast<std::size_t>(s)])) break;
        const auto parent = static_cast<std::size_t>(parents[static_cast<std::size_t>(s)]);
        if (candidates > p.elites / p.children && used[parent] == p.children) continue;
        ++used[parent];
        chosen.push_back(s);
      }
      if (chosen.empty()) throw Error("sampling control: every sample of window " + std::to_string(w) + " ended in numbers that are not finite");
      window.carried = -1;
      if (has_best) {
        const auto at = std::find(chosen.begin(), chosen.end(), 0);
        if (at == chosen.end()) {
          chosen.back() = 0;
          window.carried = static_cast<int>(chosen.size()) - 1;
        } else {
          window.carried = static_cast<int>(at - chosen.begin());
        }
      }
      const std::size_t n = chosen.size();
      window.parent.resize(n);
      window.window_cost.resize(n);
      window.path_cost.resize(n);
      window.offsets.resize(nv, static_cast<Eigen::Index>(n));
      window.states.resize(n * state_size);
      for (std::size_t e = 0; e < n; ++e) {
        const auto s = static_cast<std::size_t>(chosen[e]);
        window.parent[e] = parents[s];
        window.window_cost[e] = window_cost[s];
        window.path_cost[e] = window_cost[s] + (before ? before->path_cost[static_cast<std::size_t>(parents[s])] : 0.0f);
        window.offsets.col(static_cast<Eigen::Index>(e)) = offsets.col(chosen[e]);
        std::copy_n(end_states.data() + state_size * s, state_size, window.states.data() + state_size * e);
      }
    }

    // The best path, traced from the last window.
    const Window& last = path[static_cast<std::size_t>(end - 1)];
    known = end;
    int e = static_cast<int>(std::min_element(last.path_cost.begin(), last.path_cost.end()) - last.path_cost.begin());
    out.round_cost.push_back(last.path_cost[static_cast<std::size_t>(e)]);
    for (int w = end; w-- > first;) {
      Window& window = path[static_cast<std::size_t>(w)];
      best.col(w) = window.offsets.col(e);
      window.carried = e;
      e = window.parent[static_cast<std::size_t>(e)];
    }
    for (int w = first; w < end; ++w) {
      const int from = std::min(end - 1, w + p.lag);
      const Window& ahead = path[static_cast<std::size_t>(from)];
      Eigen::VectorXd sum = Eigen::VectorXd::Zero(nv);
      double weights = 0;
      for (std::size_t i = 0; i < ahead.parent.size(); ++i) {
        int a = static_cast<int>(i);
        for (int k = from; k > w; --k) a = path[static_cast<std::size_t>(k)].parent[static_cast<std::size_t>(a)];
        const double weight = 1.0 / static_cast<double>(i + 1);
        sum += weight * path[static_cast<std::size_t>(w)].offsets.col(a).template cast<double>();
        weights += weight;
      }
      path[static_cast<std::size_t>(w)].mean = 0.5 * best.col(w).cast<double>() + (0.5 / weights) * sum;
    }
    if (p.tied()) {
      out.tied_offsets = Eigen::MatrixXd::Zero(nv, phases);
      std::vector<int> members(static_cast<std::size_t>(phases), 0);
      for (int w = 0; w < windows; ++w) {
        const bool flipped = p.mirrored && (w / phases) % 2 == 1;
        const Eigen::VectorXd mean = path[static_cast<std::size_t>(w)].mean;
        out.tied_offsets.col(w % phases) += flipped ? mirrored_tangent(model, roles, mean) : mean;
        ++members[static_cast<std::size_t>(w % phases)];
      }
      for (int k = 0; k < phases; ++k) out.tied_offsets.col(k) /= std::max(1, members[static_cast<std::size_t>(k)]);
      for (int w = 0; w < windows; ++w) {
        const bool flipped = p.mirrored && (w / phases) % 2 == 1;
        const Eigen::VectorXd shared = out.tied_offsets.col(w % phases);
        path[static_cast<std::size_t>(w)].mean = flipped ? mirrored_tangent(model, roles, shared) : shared;
      }
    }
    if (progress && !progress(pass, out.round_cost.back())) break;
  }

  // The best path once more, recorded tick by tick.
  out.offsets = best.cast<double>();
  out.targets.resize(model.nq, ticks);
  out.poses.resize(model.nq, ticks + 1);
  out.velocities.resize(nv, ticks + 1);
  sim::Lanes<S>& l = lanes[0];
  for (int i = 0; i < width; ++i) {
    for (std::size_t k = 0; k < state_size; ++k) core::set_lane(l.state()[k], i, start[k]);
    l.clear_failed(i);
  }
  std::vector<Quaternion<S>> turn(model.bodies.size());
  std::vector<S> add(model.bodies.size());
  out.poses.col(0) = reference.poses.col(0);
  out.velocities.col(0) = reference.velocities.col(0);
  double global = 0, local = 0;
  for (int t = 0, window = 0; t < ticks; ++t) {
    if (t == starts[static_cast<std::size_t>(window + 1)]) ++window;
    load_offsets(turn, add, [&](int k) { return S(static_cast<T>(best(k, window))); });
    give_targets(l, turn, add, t);
    for (int i = 0; i < model.nq; ++i) out.targets(i, t) = core::lane_of(l.target()[i], 0);
    out.targets.col(t).head(7) = reference.poses.col(t).head(7);
    l.step(p.steps_per_tick);
    aid(l, t);
    for (int i = 0; i < model.nq; ++i) out.poses(i, t + 1) = core::lane_of(l.q()[i], 0);
    for (int i = 0; i < nv; ++i) out.velocities(i, t + 1) = core::lane_of(l.v()[i], 0);
    const double* ref = reference.points.col(t + 1).data();
    const Vector3<double> shift = Vector3<double>::from(out.poses.col(t + 1).data()) - Vector3<double>::from(reference.poses.col(t + 1).data());
    double here = 0;
    for (std::size_t i = 0; i < cost.points().size(); ++i) {
      const Vector3<S> at = cost.place(l, i);
      const Vector3<double> d = Vector3<double>{core::lane_of(at.x, 0), core::lane_of(at.y, 0), core::lane_of(at.z, 0)} - Vector3<double>::from(ref + 3 * i);
      here += norm(d);
      local += norm(d - shift);
    }
    global += here;
    out.worst_tick_error = std::max(out.worst_tick_error, here / static_cast<double>(cost.points().size()));
  }
  const double count = static_cast<double>(ticks) * static_cast<double>(cost.points().size());
  out.mean_joint_error = global / count;
  out.mean_local_error = local / count;
  return out;
}

}  // namespace traceur::control
