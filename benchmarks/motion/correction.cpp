// SPDX-License-Identifier: MIT
// Kinematic correction of a motion that is 5 cm too low, by Adam as PARC does it (3000 steps of 0.001), by Adam over several
// time scales, and by Ceres, quick or thorough. The motion is PARC's teaser (142 frames, 304 surface points) if
// TRACEUR_MOTIONS names a folder that holds it, else a body of the same shapes that crawls over boxes. `ceres_to_adam` is
// quick Ceres with as few holds as it takes to be below the best of the paper's Adam; `speedup` compares its whole time with
// that Adam's. All use two threads.
#include <cmath>
#include <cstdlib>
#include <filesystem>

#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/io/mjcf.hpp>
#include <traceur/io/motion_json.hpp>
#include <traceur/io/terrain_file.hpp>
#include <traceur/motion/correction_ceres.hpp>
#include <traceur/motion/retarget.hpp>
#include <traceur/terrain/generators.hpp>

namespace {

using namespace traceur;

const std::filesystem::path here = std::filesystem::path(__FILE__).parent_path();

struct Scene {
  body::Character character = io::read_mjcf(here / "../../examples/characters/humanoid.xml");
  terrain::HeightGrid ground = terrain::HeightGrid::flat();
  motion::Clip clip;
  std::vector<body::SurfacePoint> points = body::surface_points(character);
};

motion::Clip made_up(const body::Character& c, const terrain::HeightGrid& ground) {
  constexpr int keys = 142;
  motion::Clip clip{"made up", c.skeleton, Eigen::VectorXd::LinSpaced(keys, 0, (keys - 1) / 30.0),
                    Eigen::MatrixXd(c.skeleton.nq(), keys), Eigen::MatrixXd::Zero(c.skeleton.size(), keys), false};
  for (int k = 0; k < keys; ++k) {
    const double t = clip.times[k];
    Eigen::VectorXd d = Eigen::VectorXd::Zero(c.skeleton.nv()), q = c.skeleton.neutral_pose();
    for (Eigen::Index i = 6; i < d.size(); ++i) d[i] = 0.3 * std::sin(4 * t + static_cast<double>(i));
    body::displace(c.skeleton, q.data(), d.data(), q.data());
    q[0] = 1 + t;
    q[1] = 3;
    q[2] = 0.9 + ground.height(q[0], q[1]);
    clip.poses.col(k) = q;
    clip.contacts(c.skeleton.find_body(k % 20 < 10 ? "left_foot" : "right_foot"), k) = 1;
  }
  return clip;
}

Scene scene() {
  Scene s;
  const char* folder = std::getenv("TRACEUR_MOTIONS");
  const std::filesystem::path file =
      folder == nullptr ? "" : std::filesystem::path(folder) / "parc" / "dec2024_teaser_717_1_opt_dm.json";
  if (folder != nullptr && std::filesystem::exists(file)) {
    const io::LoadedClip loaded = io::read_motion_json(file);
    s.ground = io::read_terrain(file);
    motion::RetargetOptions as_is;
    as_is.align = as_is.flat_ground = false;
    s.clip = motion::retarget(loaded.clip, s.character, as_is).clip;
    s.clip.contacts = loaded.clip.contacts;
  } else {
    terrain::RandomBoxes boxes;
    core::RandomStream random(1, 0, 0);
    boxes.height_min = -0.2;
    boxes.height_max = 0.2;
    s.ground = terrain::random_boxes(boxes, random);
    s.clip = made_up(s.character, s.ground);
  }
  s.clip.poses.row(2).array() -= 0.05;
  return s;
}

void report(benchmark::State& state, const motion::CorrectionReport& r) {
  state.counters["loss"] = r.after.total;
  state.counters["penetration_m"] = r.after.penetration;
  state.counters["penetration_before_m"] = r.before.penetration;
  state.counters["contact_m"] = r.after.contact;
  state.counters["contact_before_m"] = r.before.contact;
  state.counters["jerk_excess"] = r.after.jerk;
  state.counters["regularization"] = r.after.regularization;
  state.counters["iterations"] = r.iterations;
}

motion::CorrectionReport& paper_adam() {
  static motion::CorrectionReport r;
  return r;
}

void adam(benchmark::State& state, const motion::CorrectionOptions& options) {
  const Scene s = scene();
  core::ThreadExecutor threads(2);
  motion::CorrectionReport last;
  for (auto _ : state) last = motion::correct(s.clip, s.points, s.ground, options, threads).report;
  report(state, last);
  state.counters["last_loss"] = last.history.back();
  if (options.final_step == options.step) paper_adam() = last;
}

motion::CorrectionReport ceres_solve(benchmark::State& state, const motion::CeresCorrectionOptions& options) {
  const Scene s = scene();
  core::ThreadExecutor threads(2);
  motion::CorrectionReport last;
  for (auto _ : state) last = motion::correct_ceres(s.clip, s.points, s.ground, options, threads).report;
  report(state, last);
  return last;
}

void one_gradient(benchmark::State& state) {
  const Scene s = scene();
  const motion::CorrectionLoss loss(s.clip, s.points, s.ground);
  motion::CorrectionLoss::Workspace w = loss.workspace();
  const Eigen::MatrixXd d = Eigen::MatrixXd::Zero(loss.nv(), loss.keys());
  Eigen::MatrixXd g = d;
  for (auto _ : state) {
    loss.gradient(d, g, w, core::SerialExecutor{});
    benchmark::DoNotOptimize(g.data());
  }
}

void adam_of_the_paper(benchmark::State& state) { adam(state, {}); }
void adam_slowing_down(benchmark::State& state) {
  motion::CorrectionOptions options;
  options.final_step = 1e-6;
  adam(state, options);
}
void adam_over_time_scales(benchmark::State& state) {
  adam(state, motion::CorrectionOptions::multiscale(static_cast<int>(state.range(0))));
}
void ceres_to_adam(benchmark::State& state) {
  const Scene s = scene();
  core::ThreadExecutor threads(2);
  motion::CeresCorrectionOptions options = motion::CeresCorrectionOptions::quick();
  const int most = options.holds;
  const motion::CorrectionReport& adam = paper_adam();
  if (adam.history.empty()) return state.SkipWithError("needs adam_of_the_paper in the same run");
  for (options.holds = 0; options.holds < most; ++options.holds)
    if (motion::correct_ceres(s.clip, s.points, s.ground, options, threads).report.after.total < adam.after.total) break;
  state.counters["speedup"] = adam.seconds / ceres_solve(state, options).seconds;
}
void ceres_quick(benchmark::State& state) { ceres_solve(state, motion::CeresCorrectionOptions::quick()); }
void ceres_default(benchmark::State& state) { ceres_solve(state, {}); }
void ceres_thorough(benchmark::State& state) { ceres_solve(state, motion::CeresCorrectionOptions::thorough()); }

}  // namespace

BENCHMARK(one_gradient)->Unit(benchmark::kMillisecond);
BENCHMARK(adam_of_the_paper)->Unit(benchmark::kMillisecond)->Iterations(1)->UseRealTime();
BENCHMARK(adam_slowing_down)->Unit(benchmark::kMillisecond)->Iterations(1)->UseRealTime();
BENCHMARK(adam_over_time_scales)->Arg(1000)->Arg(3000)->Arg(10000)->Unit(benchmark::kMillisecond)->Iterations(1)->UseRealTime();
BENCHMARK(ceres_to_adam)->Unit(benchmark::kMillisecond)->Iterations(1)->UseRealTime();
BENCHMARK(ceres_quick)->Unit(benchmark::kMillisecond)->Iterations(1)->UseRealTime();
BENCHMARK(ceres_default)->Unit(benchmark::kMillisecond)->Iterations(1)->UseRealTime();
BENCHMARK(ceres_thorough)->Unit(benchmark::kMillisecond)->Iterations(1)->UseRealTime();
