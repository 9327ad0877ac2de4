// SPDX-License-Identifier: MIT
#include <traceur/control/sampling_control.hpp>

#include <doctest/doctest.h>

#include <atomic>

#include "support.hpp"

using namespace figures;
using control::SampledControl;
using control::SamplingParameters;

namespace {

// Four lanes whatever the machine, so that all machines search alike.
using S = core::Pack<float, 4>;

struct Search {
  const Figure& f = humanoid();
  sim::Parameters simulation;
  sim::Ground<float> ground;
  control::TrackingReference reference;
  control::TrackingCost cost{f.model, f.roles, f.points};
  SamplingParameters settings;

  Search(const motion::Clip& clip, double seconds) : reference(reference_of(f, clip, seconds)) {
    settings.samples = 96;
    settings.elites = 16;
    settings.children = 4;
    settings.rounds = 6;
    settings.hip = settings.leg = settings.trunk = 0.05;
    settings.head = 0.01;
  }
  template <class E>
  SampledControl run(E&& executor, const control::SamplingProgress& progress = {}) const {
    return control::sample_control<S>(f.model, simulation, ground, cost, reference, settings, executor, progress);
  }
  SampledControl run() const { return run(core::SerialExecutor{}); }

  /// Poses reached under targets, and what they cost by the search's measure: 0.3 at the middle, 0.7 at the end of windows.
  struct Outcome {
    Eigen::MatrixXd poses;
    double cost = 0;
    double slide = 0;  ///< of the soles, m/s, mean over time, weighted by their share of the weight
  };
  Outcome simulate(const Eigen::MatrixXd& targets) const {
    sim::Lanes<S> lanes(f.model, simulation, ground);
    for (int i = 0; i < core::lane_count<S>; ++i) put(lanes, i, reference.poses.col(0), reference.velocities.col(0));
    Outcome out{Eigen::MatrixXd(f.model.nq, reference.ticks + 1)};
    out.poses.col(0) = reference.poses.col(0);
    for (int t = 0; t < reference.ticks; ++t) {
      for (int k = 7; k < f.model.nq; ++k) lanes.target()[k] = S(targets(k, t));
      lanes.step(settings.steps_per_tick);
      out.slide += static_cast<double>(control::sole_slide(lanes, f.roles).sum[3]) / (f.model.total_mass * 9.81);
      for (int k = 0; k < f.model.nq; ++k) out.poses(k, t + 1) = static_cast<double>(lanes.q()[k][3]);
      const int in_window = (t + 1) % settings.window_ticks;
      if (in_window == settings.window_ticks / 2) out.cost += 0.3 * static_cast<double>(cost(lanes, reference, t + 1)[3]);
      if (in_window == 0) out.cost += 0.7 * static_cast<double>(cost(lanes, reference, t + 1)[3]);
    }
    out.cost += settings.slide * out.slide / settings.window_ticks;
    out.slide /= reference.ticks;
    return out;
  }
};

}  // namespace

TEST_CASE("a search for a squat: costs never rise, the plan is recorded to the bit, threads do not matter") {
  const Search search(squat_clip(36), 0.6);
  std::vector<double> told;
  const SampledControl found = search.run(core::SerialExecutor{}, [&](int round, double cost) {
    CHECK(round == static_cast<int>(told.size()));
    told.push_back(cost);
    return true;
  });
  CHECK(told == found.round_cost);
  REQUIRE(found.round_cost.size() == 6);
  for (std::size_t k = 1; k < 6; ++k) CHECK(found.round_cost[k] <= found.round_cost[k - 1]);
  CHECK(found.offsets.cols() == 6);
  CHECK(found.tied_offsets.size() == 0);
  CHECK(found.simulated_seconds == doctest::Approx(6 * 96 * 0.6));

  SUBCASE("recorded targets lead to recorded poses, and these have the cost of the last round") {
    const Search::Outcome again = search.simulate(found.targets);
    CHECK((again.poses - found.poses).cwiseAbs().maxCoeff() == 0);
    CHECK(again.cost == doctest::Approx(found.round_cost.back()).epsilon(1e-5));
  }
  SUBCASE("the plan beats the led targets it started from") {
    const Search::Outcome led = search.simulate(control::led_targets(search.f.model, search.reference, search.settings.lead));
    MESSAGE("cost ", led.cost, " of led targets, ", found.round_cost.front(), " to ", found.round_cost.back(), " in the search");
    CHECK(found.round_cost.back() < 0.8 * led.cost);
  }
  SUBCASE("targets are led targets displaced by each window's offset") {
    const Eigen::MatrixXd led = control::led_targets(search.f.model, search.reference, search.settings.lead);
    for (int t = 0; t < search.reference.ticks; ++t) {
      Eigen::VectorXd target(search.f.model.nq);
      const Eigen::VectorXd d = found.offsets.col(t / 6);
      CHECK(d.head(6).isZero());
      body::displace(search.f.skeleton(), led.col(t).data(), d.data(), target.data());
      CHECK((target - found.targets.col(t)).cwiseAbs().maxCoeff() < 1e-6);
    }
  }
  SUBCASE("errors are distances between recorded and reference points") {
    control::TrackingReference reached = search.reference;
    reached.poses = found.poses;
    reached.velocities = found.velocities;
    control::measure_reference(search.f.model, search.f.roles, search.f.points, reached);
    double global = 0, local = 0, worst = 0;
    for (int t = 1; t <= search.reference.ticks; ++t) {
      const Eigen::Vector3d root = (found.poses.col(t) - search.reference.poses.col(t)).head(3);
      double here = 0;
      for (Eigen::Index p = 0; p < reached.points.rows(); p += 3) {
        const Eigen::Vector3d d = reached.points.block<3, 1>(p, t) - search.reference.points.block<3, 1>(p, t);
        here += d.norm();
        local += (d - root).norm();
      }
      global += here;
      worst = std::max(worst, here);
    }
    const double points = static_cast<double>(search.f.points.size());
    CHECK(found.mean_joint_error == doctest::Approx(global / 36 / points).epsilon(1e-4));
    CHECK(found.mean_local_error == doctest::Approx(local / 36 / points).epsilon(1e-4));
    CHECK(found.worst_tick_error == doctest::Approx(worst / points).epsilon(1e-4));
  }
  SUBCASE("two threads and a second run give the same bits, another seed others") {
    core::ThreadExecutor threads(2);
    for (const SampledControl& other : {search.run(threads), search.run()}) {
      CHECK(other.offsets == found.offsets);
      CHECK(other.poses == found.poses);
      CHECK(other.round_cost == found.round_cost);
    }
    Search changed = search;
    changed.settings.seed = 2;
    CHECK(changed.run().offsets != found.offsets);
  }
  SUBCASE("progress may end the search early") {
    const SampledControl early = search.run(core::SerialExecutor{}, [](int round, double) { return round < 1; });
    CHECK(early.round_cost == std::vector<double>(told.begin(), told.begin() + 2));
  }
}

TEST_CASE("costs do not rise however few and wild the samples") {
  Search search(standing_clip(18), 0.3);
  search.settings.samples = 4;
  search.settings.elites = 2;
  search.settings.rounds = 8;
  search.settings.shrink = 1;
  search.settings.hip = search.settings.leg = search.settings.trunk = 0.3;
  const SampledControl found = search.run();
  for (std::size_t k = 1; k < 8; ++k) CHECK(found.round_cost[k] <= found.round_cost[k - 1]);
}

TEST_CASE("tied windows search around one plan for all cycles, mirrored in every second half") {
  Search search(sway_clip(24), 1.2);
  search.settings.rounds = 1;
  search.settings.period_starts = {0, 5};
  search.settings.period_ticks = 12;
  search.settings.mirrored = true;
  search.settings.history = 1;
  // Few samples with wild offsets: the mean over cycles is calmer than any of them, and wins as soon as it is tried.
  search.settings.samples = 4;
  search.settings.elites = 2;
  search.settings.children = 2;
  search.settings.hip = search.settings.leg = search.settings.trunk = 0.3;
  // Without spread in the second round, all samples but the carried best are the means.
  search.settings.shrink = 0;
  const SampledControl one = search.run();
  search.settings.rounds = 2;
  const SampledControl two = search.run();
  REQUIRE(one.tied_offsets.cols() == 2);
  REQUIRE(two.offsets.cols() == 12);
  CHECK(one.tied_offsets.norm() > 0.01);
  int shared = 0;
  for (int w = 0; w < 12; ++w) {
    const Eigen::VectorXd plan = one.tied_offsets.col(w % 2);
    const Eigen::VectorXd mean = (w / 2) % 2 == 1 ? control::mirrored_tangent(search.f.model, search.f.roles, plan) : plan;
    const bool is_mean = (two.offsets.col(w) - mean).norm() < 1e-6;
    const bool is_best = two.offsets.col(w) == one.offsets.col(w);
    CHECK((is_mean || is_best));
    shared += is_mean ? 1 : 0;
  }
  CHECK(shared >= 4);
  CHECK(two.round_cost[1] < two.round_cost[0]);

  SUBCASE("the plan is the mean over cycles of every window's own mean") {
    // After one round a window's mean is half its best and half its elites; with one elite both are the best.
    search.settings.rounds = 1;
    search.settings.elites = 1;
    search.settings.children = 1;
    search.settings.lag = 0;
    const SampledControl alone = search.run();
    for (int k = 0; k < 2; ++k) {
      Eigen::VectorXd sum = Eigen::VectorXd::Zero(search.f.model.nv);
      for (int w = k; w < 12; w += 2) {
        const Eigen::VectorXd d = alone.offsets.col(w);
        sum += (w / 2) % 2 == 1 ? control::mirrored_tangent(search.f.model, search.f.roles, d) : d;
      }
      CHECK((alone.tied_offsets.col(k) - sum / 6).cwiseAbs().maxCoeff() < 1e-12);
    }
  }
}

TEST_CASE("over a horizon the plan is settled piece by piece, and is one simulation all the same") {
  Search search(squat_clip(60), 1.0);  // ten windows
  search.settings.rounds = 3;
  const SampledControl whole = search.run();
  search.settings.horizon = 4;
  search.settings.stride = 2;
  REQUIRE(search.settings.passes(10) == 3 * 4);
  CHECK(search.settings.passes(4) == 3);
  CHECK(search.settings.passes(5) == 6);
  std::vector<int> passes;
  const SampledControl found = search.run(core::SerialExecutor{}, [&](int pass, double) {
    passes.push_back(pass);
    return true;
  });
  CHECK(passes.size() == 12);
  CHECK(passes.back() == 11);
  for (std::size_t k = 1; k < 12; ++k)
    if (k % 3 != 0) CHECK(found.round_cost[k] <= found.round_cost[k - 1]);
  // Every window is in two horizons, but for the first two and the last.
  CHECK(found.simulated_seconds == doctest::Approx(12 * 4 * 96 * 0.1));
  CHECK((search.simulate(found.targets).poses - found.poses).cwiseAbs().maxCoeff() == 0);

  SUBCASE("what is settled stays") {
    const SampledControl early = search.run(core::SerialExecutor{}, [](int pass, double) { return pass < 2; });
    CHECK(early.offsets.leftCols(2) == found.offsets.leftCols(2));
    CHECK(early.offsets.rightCols(6).isZero());
    CHECK(!found.offsets.rightCols(1).isZero());
  }
  SUBCASE("one as long as the motion, or none, is the search of the whole") {
    search.settings.horizon = 10;
    CHECK(search.run().offsets == whole.offsets);
  }
  SUBCASE("two threads give the same bits") {
    core::ThreadExecutor threads(2);
    CHECK(search.run(threads).offsets == found.offsets);
  }
}

TEST_CASE("soles that slide while they carry cost what they are said to, and less of it is found") {
  Search search(squat_clip(36), 0.6);
  search.simulation.friction = 0.1;
  const double free = search.simulate(search.run().targets).slide;
  search.settings.slide = 20;
  const SampledControl held = search.run();
  const Search::Outcome outcome = search.simulate(held.targets);
  CHECK(outcome.cost == doctest::Approx(held.round_cost.back()).epsilon(1e-4));
  CHECK(outcome.slide < 0.7 * free);
}

namespace {

/// Charges for every tick, and counts them.
struct Charge : control::NoSamplingAid {
  std::atomic<int>* ticks;
  double cost_of_tick;
  template <class L>
  void operator()(sim::Lanes<L>&, int) const noexcept {
    ++*ticks;
  }
  template <class L>
  L cost(const sim::Lanes<L>&, int) const noexcept {
    return L(static_cast<float>(cost_of_tick));
  }
};

}  // namespace

TEST_CASE("a search begins where it is told to, and an aid sees every tick and adds to every window's cost") {
  Search s(squat_clip(24), 0.4);
  s.settings.rounds = 2;
  const SampledControl plain = s.run();
  std::atomic<int> ticks{0};
  Charge charge;
  charge.ticks = &ticks;
  charge.cost_of_tick = 0.5;
  core::SerialExecutor executor;
  const SampledControl charged = control::sample_control<S>(s.f.model, s.simulation, s.ground, s.cost, s.reference, s.settings, executor, {}, charge);
  // The same for all changes nothing but the sum, half a unit for each of four windows.
  CHECK(charged.offsets == plain.offsets);
  CHECK(charged.round_cost.back() == doctest::Approx(plain.round_cost.back() + 4 * 0.5).epsilon(1e-4));
  CHECK(ticks == s.reference.ticks * (1 + 2 * (s.settings.samples / core::lane_count<S>)));
  // With next to no spread, what is found is what it began with, around the targets it was given.
  s.settings.hip = s.settings.leg = s.settings.trunk = s.settings.head = 1e-9;
  s.settings.offsets = plain.offsets;
  s.settings.targets = control::led_targets(s.f.model, s.reference, s.settings.lead).leftCols(s.reference.ticks);
  const SampledControl again = s.run();
  CHECK((again.offsets - plain.offsets).cwiseAbs().maxCoeff() < 1e-6);
  s.settings.offsets.conservativeResize(Eigen::NoChange, 1);
  CHECK_THROWS_AS(s.run(), traceur::Error);
  s.settings.offsets.resize(0, 0);
  s.settings.targets.conservativeResize(Eigen::NoChange, 3);
  CHECK_THROWS_AS(s.run(), traceur::Error);
}

TEST_CASE("settings and starts that cannot be searched are refused") {
  const Search good(standing_clip(12), 0.2);
  const auto refusal = [&](auto&& spoil) {
    Search s = good;
    spoil(s);
    return error_of([&] { s.run(); });
  };
  CHECK(contains(refusal([](Search& s) { s.settings.samples = 0; }), "samples, elites, children"));
  CHECK(contains(refusal([](Search& s) { s.settings.children = 0; }), "must be positive"));
  CHECK(contains(refusal([](Search& s) { s.settings.steps_per_tick = 0; }), "must be positive"));
  CHECK(contains(refusal([](Search& s) { s.settings.lag = -1; }), "lag"));
  CHECK(contains(refusal([](Search& s) { s.settings.slide = -1; }), "slide"));
  CHECK(contains(refusal([](Search& s) { s.settings.slide = std::nan(""); }), "slide"));
  CHECK(contains(refusal([](Search& s) { s.settings.horizon = -1; }), "horizon"));
  CHECK(contains(refusal([](Search& s) { s.settings.horizon = 4, s.settings.stride = 5; }), "stride"));
  CHECK(contains(refusal([](Search& s) {
                   s.settings.horizon = 8;
                   s.settings.period_starts = {0};
                   s.settings.period_ticks = 6;
                 }),
                 "horizon"));
  CHECK(contains(refusal([](Search& s) { s.settings.period_starts = {0}; }), "period_starts"));
  CHECK(contains(refusal([](Search& s) { s.settings.period_starts = {1}, s.settings.period_ticks = 6; }), "period_starts"));
  CHECK(contains(refusal([](Search& s) { s.settings.period_starts = {0, 3, 3}, s.settings.period_ticks = 6; }), "period_starts"));
  CHECK(contains(refusal([](Search& s) { s.reference.velocities(8, 0) = std::nan(""); }), "every sample of window 0"));
}
