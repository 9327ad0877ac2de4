// SPDX-License-Identifier: MIT
// One round of the sampling search for a half-second squat of the humanoid. `steps` are simulation steps of 1/480 s in all
// samples per CPU second of one thread; the simulator's own rate without a search is in benchmarks/sim.
#include <traceur/control/sampling_control.hpp>

#include <cmath>
#include <filesystem>
#include <numbers>

#include <benchmark/benchmark.h>

#include <traceur/io/mjcf.hpp>

namespace {

using namespace traceur;
using Vector = core::Vector3<double>;

/// Knees bend and straighten once, feet on the ground.
motion::Clip squat(const body::Skeleton& s) {
  constexpr int ticks = 30;
  motion::Clip clip{"squat", s, Eigen::VectorXd::LinSpaced(ticks + 1, 0, 0.5), s.neutral_pose().replicate(1, ticks + 1), {}, false};
  for (int t = 0; t <= ticks; ++t) {
    double* q = clip.poses.col(t).data();
    const double bend = 0.25 * (1 - std::cos(2 * std::numbers::pi * t / ticks));
    q[2] = 0.0524 + 0.8314 * std::cos(bend);
    for (const char* side : {"right_", "left_"}) {
      const auto at = [&](const char* joint) { return q + s[s.find(std::string(side) + joint)].q_index; };
      about_axis(Vector{0, 1, 0}, -bend).store(at("hip"));
      at("knee")[0] = 2 * bend;
      about_axis(Vector{0, 1, 0}, -bend).store(at("ankle"));
    }
  }
  clip.check();
  return clip;
}

template <class S>
void search(benchmark::State& state) {
  const auto here = std::filesystem::path(__FILE__).parent_path();
  const sim::Model model = sim::make_model(io::read_mjcf(here / "../../examples/characters/humanoid.xml"));
  const control::Roles roles = control::find_roles(model);
  const auto points = control::tracked_points(model, roles);
  const motion::Clip clip = squat(model.character.skeleton);
  const control::TrackingReference reference = control::make_reference(model, roles, points, clip, clip.duration(), 1.0 / 60);
  const control::TrackingCost cost(model, roles, points);
  const sim::Parameters simulation;
  const sim::Ground<core::Element<S>> ground;
  control::SamplingParameters p;
  p.rounds = 1;
  p.samples = static_cast<int>(state.range(0));
  p.elites = p.samples / 8;
  core::SerialExecutor serial;
  double steps = 0;
  for (auto _ : state) {
    const auto found = control::sample_control<S>(model, simulation, ground, cost, reference, p, serial);
    steps += found.simulated_seconds / simulation.dt;
  }
  state.counters["steps"] = benchmark::Counter(steps, benchmark::Counter::kIsRate);
}

}  // namespace

BENCHMARK(search<core::Pack<float>>)->Arg(256)->Arg(1024)->Unit(benchmark::kMillisecond);
