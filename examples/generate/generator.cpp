// SPDX-License-Identifier: MIT
#include "generator.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>

#include "../common/files.hpp"
#include "../common/progress.hpp"
#include "../common/retargeting.hpp"
#include "traceur/diffusion/blended_denoiser.hpp"
#include "traceur/diffusion/long_horizon.hpp"
#include "traceur/diffusion/motion_generator.hpp"
#include "traceur/diffusion/motion_loss.hpp"
#include "traceur/diffusion/motion_windows.hpp"
#include "traceur/diffusion/network_denoiser.hpp"
#include "traceur/diffusion/training.hpp"
#include "traceur/evaluate/motion_quality.hpp"
#include "traceur/io/safetensors.hpp"
#include "traceur/motion/correction_ceres.hpp"
#include "traceur/motion/hesitation.hpp"
#include "traceur/motion/mirror.hpp"
#include "traceur/motion/selection.hpp"
#include "traceur/nn/optimizer.hpp"
#include "traceur/nn/schedule.hpp"
#include "traceur/plan/a_star.hpp"
#include "traceur/terrain/augmentation.hpp"
#include "traceur/terrain/generators.hpp"

namespace generate {

using namespace traceur;
using namespace traceur::diffusion;
namespace fs = std::filesystem;

namespace {

using Windows = MotionWindows<float>;
using Matrix = Eigen::MatrixXf;
constexpr Eigen::Index windows_in_step = 32;
constexpr int steps_in_block = 50, noise_levels = 21, stride = 5;
constexpr double every_tenth = 0.1;  // steps on random terrain, where penetration alone counts (PARC s5.3)

WindowParameters window_parameters(const std::string& size) {
  WindowParameters p;
  if (size == "small") p.map = {.spacing = 0.4, .back = 2, .ahead = 6, .side = 4, .limit = 3};
  return p;
}

MotionGenerator make_network(const Windows& windows, const std::string& size) {
  MotionGenerator::Parameters p;
  p.frame_features = windows.features().size();
  if (size == "small") {
    p.terrain = {.height = 9, .width = 9, .layers = {{8, 3}, {16, 2}}, .patch = 2, .token = 64, .scale = 1.0 / 3};
    p.target_hidden = p.hidden = p.feed_forward = 64;
    p.heads = 4;
    p.layers = 2;
  }
  return MotionGenerator(p);
}

/// Level ground around everything the clip reaches, of cells that augmentation can raise.
terrain::HeightGrid level_ground(const motion::Clip& clip) {
  constexpr double margin = 5, cell = terrain::HeightGrid::default_cell;
  const double x0 = clip.poses.row(0).minCoeff() - margin, y0 = clip.poses.row(1).minCoeff() - margin;
  const auto cells = [&](int row, double from) {
    return static_cast<Eigen::Index>(std::ceil((clip.poses.row(row).maxCoeff() + margin - from) / cell));
  };
  return terrain::HeightGrid(Eigen::MatrixXd::Zero(cells(0, x0), cells(1, y0)), cell, x0, y0);
}

/// The ground reflected across the world's x-z plane, as motion::Mirror reflects clips.
terrain::HeightGrid mirrored(const terrain::HeightGrid& g) {
  return terrain::HeightGrid(g.heights().rowwise().reverse(), g.cell(), g.x0(), -(g.y0() + g.ny() * g.cell()));
}

/// The heights to which augmentation may bring the ground: those of the whole clip, with poses between its keys.
terrain::HeightBounds bounds_of(const body::Character& character, const Material& m) {
  terrain::HeightBounds bounds(m.ground);
  body::Frames<double> frames(character.skeleton);
  Eigen::VectorXd q(character.skeleton.nq());
  // Windows of a cycle reach into the next.
  const double end = m.clip.duration() + (m.clip.cyclic ? 1.0 : 0.0);
  const int samples = static_cast<int>(std::ceil(60 * end));
  for (int k = 0; k <= samples; ++k) {
    m.clip.sample(end * k / samples, q);
    body::forward_kinematics(character.skeleton, q.data(), frames);
    bounds.add(character, frames);
  }
  return bounds;
}

/// A ground of boxes that is as high under the frame's origin as another is.
terrain::HeightGrid boxes_around(const terrain::HeadingFrame<double>& frame, double height, double relief,
                                 core::RandomStream& random) {
  terrain::RandomBoxes p;
  p.height_min = -relief;
  p.height_max = relief;
  const terrain::HeightGrid g = terrain::random_boxes(p, random);
  const double half = 0.5 * g.cell() * g.nx(), x0 = frame.origin.x - half, y0 = frame.origin.y - half;
  const double under = g.height(half, half);
  return terrain::HeightGrid((g.heights().array() + (height - under)).matrix(), g.cell(), x0, y0);
}

Schedule schedule() { return Schedule::cosine(noise_levels); }

/// Seconds of all clips up to each, by which they are drawn.
std::vector<double> ends_of(const Scene& scene) {
  std::vector<double> out;
  for (const Material& m : scene.material) out.push_back((out.empty() ? 0 : out.back()) + m.clip.duration());
  return out;
}

std::size_t draw_clip(const std::vector<double>& ends, core::RandomStream& random) {
  const double at = random.uniform(0, ends.back());
  return static_cast<std::size_t>(
      std::min(std::upper_bound(ends.begin(), ends.end(), at) - ends.begin(), static_cast<std::ptrdiff_t>(ends.size()) - 1));
}

void add_scale(io::Safetensors& file, const Windows& windows) {
  io::add_vector(file, "scale.mean", windows.scale().mean);
  io::add_vector(file, "scale.deviation", windows.scale().deviation);
}

FeatureScale<float> get_scale(const io::Safetensors& file, Eigen::Index features) {
  return {io::get_vector<float>(file, "scale.mean", features), io::get_vector<float>(file, "scale.deviation", features)};
}

/// A run between two blocks of steps, as a file.
struct Checkpoint {
  Eigen::VectorXf theta, average, moments;
  std::int64_t step = 0;
  std::vector<Milestone> milestones;
};

void save(const Options& o, const Windows& windows, const Checkpoint& c) {
  const fs::path path = o.out / "checkpoint.safetensors";
  io::Safetensors file(path.string());
  add_scale(file, windows);
  io::add_vector(file, "theta", c.theta);
  io::add_vector(file, "average", c.average);
  io::add_vector(file, "moments", c.moments);
  std::vector<double> looks{static_cast<double>(c.step)};
  for (const Milestone& m : c.milestones) looks.insert(looks.end(), {m.step, m.loss});
  file.add<double>("milestones", {looks.size()}, looks);
  file.metadata = {{"arguments", job_arguments(o).dump()}};
  example::write_tensors(path, file);
}

Checkpoint load(const Options& o, Windows& windows, Eigen::Index parameters) {
  const io::Safetensors file = example::read_tensors(o.out / "checkpoint.safetensors");
  windows.set_scale(get_scale(file, windows.features().size()));
  Checkpoint c{io::get_vector<float>(file, "theta", parameters), io::get_vector<float>(file, "average", parameters),
               io::get_vector<float>(file, "moments", 2 * parameters), 0, {}};
  const std::vector<double> looks = file.values<double>("milestones");
  if (looks.size() % 2 != 1) throw Error(file.where() + ": tensor 'milestones': expected 1 + 2 n numbers");
  c.step = static_cast<std::int64_t>(looks[0]);
  for (std::size_t i = 1; i < looks.size(); i += 2) c.milestones.push_back({looks[i], looks[i + 1]});
  return c;
}

/// A generator as it was trained.
struct Trained {
  Windows windows;
  MotionGenerator net;
  Eigen::VectorXf theta;
};

Trained read_trained(const Scene& scene, const Options& options, const fs::path& path) {
  const io::Safetensors file = example::read_tensors(path);
  Windows windows(FrameFeatures(scene.character.skeleton), window_parameters(options.size));
  windows.set_scale(get_scale(file, windows.features().size()));
  MotionGenerator net = make_network(windows, options.size);
  Eigen::VectorXf theta(net.parameters());
  io::read_module<float>(file, net, theta.data(), "network.");
  return {std::move(windows), std::move(net), std::move(theta)};
}

/// Distance between a window's joints where its features have them and where forward kinematics of its rotations does, mean over
/// generated frames, m. `x` is not scaled.
double fk_gap(const Windows& windows, const float* x, body::Frames<float>& scratch) {
  const FrameFeatures& features = windows.features();
  double sum = 0;
  for (int f = windows.parameters().past; f < windows.frames(); ++f) {
    const float* frame = x + f * features.size();
    features.kinematics(frame, scratch);
    for (int i = 1; i < features.skeleton().size(); ++i)
      sum += static_cast<double>(norm(core::Vector3<float>::from(frame + features.position(i)) - scratch.position[static_cast<std::size_t>(i)]));
  }
  return sum / (windows.parameters().future * features.joints());
}

motion::Clip decoded(const Windows& windows, const float* x, const terrain::HeadingFrame<double>& frame) {
  const body::Skeleton& s = windows.features().skeleton();
  motion::Clip clip{"window", s, Eigen::VectorXd::LinSpaced(windows.frames(), 0, windows.duration()),
                    Eigen::MatrixXd(s.nq(), windows.frames()), Eigen::MatrixXd(s.size(), windows.frames()), false};
  for (int f = 0; f < windows.frames(); ++f)
    windows.features().decode(x + f * windows.features().size(), frame, clip.poses.col(f).data(), clip.contacts.col(f).data());
  return clip;
}

/// The mean by duration of what has none of the end's distance.
void add(Quality& sum, const Quality& q) {
  const double share = q.seconds / (sum.seconds + q.seconds);
  for (double Quality::*x : {&Quality::penetration_m, &Quality::contact_m, &Quality::high_jerk_share, &Quality::foot_slide_m_s})
    sum.*x += share * (q.*x - sum.*x);
  sum.seconds += q.seconds;
}

std::vector<int> feet_of(const body::Skeleton& skeleton) {
  std::vector<int> feet;
  for (const char* name : {"left_foot", "right_foot"})
    if (const int b = skeleton.find_body(name); b >= 0) feet.push_back(b);
  return feet;
}

/// Of one clip; the end of its path, if it has one.
Quality measure(const body::Character& character, const motion::Clip& clip, const terrain::HeightGrid& ground,
                const core::Vector3<double>* end) {
  Quality out;
  out.seconds = clip.duration();
  const auto points = body::surface_points(character);
  const motion::MotionScore score = motion::score(clip, points, ground, true);
  out.penetration_m = score.penetration / clip.keys();
  out.contact_m = score.contact / clip.keys();
  const body::Skeleton& s = character.skeleton;
  Eigen::MatrixXd joints(3 * s.size(), clip.keys());
  body::Frames<double> frames(s);
  for (int k = 0; k < clip.keys(); ++k) {
    body::forward_kinematics(s, clip.poses.col(k).data(), frames);
    for (std::size_t b = 0; b < frames.position.size(); ++b)
      frames.position[b].store(joints.col(k).data() + 3 * static_cast<std::ptrdiff_t>(b));
  }
  const double dt = clip.duration() / (clip.keys() - 1);
  if (clip.keys() >= 4) out.high_jerk_share = evaluate::high_jerk_share<double>(joints, dt);
  double way = 0;
  int steps = 0;
  for (const int foot : feet_of(s))
    for (int k = 1; clip.contacts.cols() != 0 && k < clip.keys(); ++k) {
      if (clip.contacts(foot, k - 1) < 0.5 || clip.contacts(foot, k) < 0.5) continue;
      way += (joints.col(k) - joints.col(k - 1)).segment<2>(3 * foot).norm();
      ++steps;
    }
  if (steps > 0) out.foot_slide_m_s = way / (steps * dt);
  if (end != nullptr)
    out.end_distance_m = evaluate::final_waypoint_distance<double>(
        core::Vector3<double>::from(clip.poses.col(clip.keys() - 1).data()), *end);
  return out;
}

}  // namespace

Scene load_scene(const Options& options) {
  Scene s;
  s.character = example::read_character(options.character);
  const motion::Mirror mirror(s.character.skeleton);
  for (const fs::path& path : options.clips) {
    const io::LoadedClip loaded = example::load_clip(path);
    std::printf("%s", loaded.report.text().c_str());
    motion::RetargetOptions retargeting;
    // What came with its ground stays where it is on it.
    retargeting.align = retargeting.flat_ground = !loaded.terrain;
    const motion::Retargeted on_character = example::retarget(loaded.clip, s.character, retargeting);
    std::printf("on '%s': %s", s.character.name.c_str(), on_character.report.text().c_str());
    motion::Clip clip = on_character.clip;
    // Labels of the source are better than what kinematics tells, if they are for the same bodies and frames.
    if (loaded.terrain && loaded.clip.contacts.rows() == clip.contacts.rows() && loaded.clip.contacts.cols() == clip.contacts.cols())
      clip.contacts = loaded.clip.contacts;
    std::optional<terrain::HeightGrid> ground;
    if (loaded.terrain) {
      const io::TerrainHeights& t = *loaded.terrain;
      ground.emplace(t.heights, t.dx, t.min_point.x() - 0.5 * t.dx, t.min_point.y() - 0.5 * t.dx, path.string());
    }
    if (!ground) ground = level_ground(clip);
    s.material.push_back({clip, *ground});
    s.material.push_back({mirror.clip(clip), mirrored(*ground)});
    std::printf("clip '%s': %.2f s%s\n", clip.name.c_str(), clip.duration(), loaded.terrain ? " with its terrain" : " on level ground");
  }
  return s;
}

Training train(const Scene& scene, const Options& options) {
  const example::Clock clock;
  core::ThreadExecutor executor(options.threads);
  Windows windows(FrameFeatures(scene.character.skeleton), window_parameters(options.size));
  std::vector<const motion::Clip*> clips;
  std::vector<terrain::HeightBounds> bounds;
  const std::vector<double> ends = ends_of(scene);
  for (const Material& m : scene.material) {
    windows.check(m.clip);
    clips.push_back(&m.clip);
    bounds.push_back(bounds_of(scene.character, m));
  }
  windows.set_scale(measure_scale<float>(windows, clips));
  const MotionGenerator net = make_network(windows, options.size);
  const Eigen::Index n = net.parameters();
  Checkpoint c{Eigen::VectorXf(n), {}, Eigen::VectorXf::Zero(2 * n), 0, {}};
  core::RandomStream start(options.seed);
  net.initialize(c.theta.data(), start);
  c.average = c.theta;
  if (options.resume) {
    c = load(options, windows, n);
    std::printf("goes on after %lld steps\n", static_cast<long long>(c.step));
  }
  MotionLoss<float> loss(windows.features(), windows.scale(), windows.frames(), windows.dt(), {}, body::surface_points(scene.character));
  diffusion::Training<float, MotionGenerator, MotionLoss<float>> training(
      net, schedule(), loss,
      {.batch = windows_in_step,
       .chunks = 8,
       .drops = {{past_seen, 0.15}, {past_part, 0.5}, {terrain_part, 0.025}, {target_part, 0.025}},
       .seed = options.seed});
  nn::Adam<float> adam(n, {.weight_decay = 0.01});
  adam.restore(c.moments, c.step);
  nn::ExponentialAverage<float> average(c.average, 0.99);
  const nn::WarmUp rate{50, nn::CosineRate{.first = 5e-4, .last = 1e-5, .steps = options.steps}};

  Eigen::VectorXf gradient(n);
  Matrix samples(windows.sample_features(), windows_in_step), conditions(windows.condition_features(), windows_in_step);
  std::vector<std::optional<terrain::HeightGrid>> grounds(windows_in_step);
  std::vector<const terrain::HeightGrid*> under(windows_in_step);
  std::vector<terrain::HeadingFrame<float>> frames(windows_in_step);
  std::vector<Windows::Scratch> scratch;
  for (int i = 0; i < executor.concurrency(); ++i) scratch.push_back(windows.scratch());
  const auto draw = [&](int j, int worker, std::int64_t step, bool elsewhere) {
    core::RandomStream random(options.seed + 1, static_cast<std::uint64_t>(j), static_cast<std::uint64_t>(step));
    const auto k = static_cast<std::size_t>(j);
    const std::size_t m = draw_clip(ends, random);
    Windows::Scratch& w = scratch[static_cast<std::size_t>(worker)];
    grounds[k].emplace(terrain::augmented(bounds[m], {}, random));
    const core::RandomStream again = random;
    core::RandomStream first = again;
    auto frame = windows.draw(*clips[m], *grounds[k], first, w, samples.col(j).data(), conditions.col(j).data());
    if (elsewhere) {
      // The same window, on a ground it was not made for.
      const double height = grounds[k]->height(frame.origin.x, frame.origin.y);
      grounds[k].emplace(boxes_around(frame, height, std::max(options.relief, 0.2), first));
      core::RandomStream second = again;
      frame = windows.draw(*clips[m], *grounds[k], second, w, samples.col(j).data(), conditions.col(j).data());
    }
    under[k] = &*grounds[k];
    frames[k] = {frame.origin.cast<float>(), static_cast<float>(frame.cosine), static_cast<float>(frame.sine)};
  };

  example::ProgressLine line("training, steps", static_cast<int>(c.step), options.steps);
  double sum = 0;
  int counted = 0;
  const std::int64_t begun = c.step;
  const auto out_of_time = [&] { return options.minutes > 0 && c.step > begun && clock.seconds() > 60 * options.minutes; };
  while (c.step < options.steps && !out_of_time()) {
    const std::int64_t end = std::min<std::int64_t>(c.step + steps_in_block, options.steps);
    for (std::int64_t step = c.step; step < end; ++step) {
      core::RandomStream kind(options.seed + 2, 0, static_cast<std::uint64_t>(step));
      const bool elsewhere = kind.bernoulli(every_tenth);
      executor.run(static_cast<int>(windows_in_step), [&](int j, int worker) { draw(j, worker, step, elsewhere); });
      loss.set_weights(elsewhere ? MotionLossWeights::penetration_only() : MotionLossWeights{});
      loss.set_terrain(under, frames);
      gradient.setZero();
      const double value = training.run(executor, c.theta.data(), samples, {conditions}, static_cast<std::uint64_t>(step), gradient);
      if (!std::isfinite(value)) throw Error("training: the loss is not finite at step " + std::to_string(step));
      nn::clip_global_norm(gradient.data(), gradient.size(), 1.0);
      adam.step(c.theta, gradient, rate(step));
      average.update(c.theta);
      if (!elsewhere) sum += value, ++counted;
      char text[64];
      std::snprintf(text, sizeof text, "loss %.3f", counted > 0 ? sum / counted : 0.0);
      line.tell(static_cast<int>(step + 1), text);
      if (example::interruption_asked()) throw example::Interrupted{};
    }
    c.step = end;
    c.average = average.value();
    c.moments = adam.state();
    c.milestones.push_back({static_cast<double>(end), counted > 0 ? sum / counted : 0.0});
    sum = counted = 0;
    save(options, windows, c);
  }
  const fs::path path = options.out / "generator.safetensors";
  io::Safetensors file(path.string());
  add_scale(file, windows);
  io::add_module<float>(file, net, c.average.data(), "network.");
  file.metadata = {{"arguments", job_arguments(options).dump()}};
  example::write_tensors(path, file);
  return {c.milestones, static_cast<int>(c.step), clock.seconds(), static_cast<long>(n)};
}

Course make_course(const Options& options) {
  for (std::uint64_t attempt = 0; attempt < 100; ++attempt) {
    core::RandomStream random(options.seed + 3, attempt, 0);
    Course out;
    if (options.terrain == "stairs") {
      out.ground = terrain::stairs({}, random);
    } else if (options.terrain == "walks") {
      terrain::RandomWalks p;
      p.height_min = -options.relief;
      p.height_max = options.relief;
      out.ground = terrain::random_walks(p, random);
    } else {
      terrain::RandomBoxes p;
      p.height_min = -options.relief;
      p.height_max = options.relief;
      out.ground = terrain::random_boxes(p, random);
    }
    const plan::NavigationGraph graph(out.ground);
    const auto ends = plan::random_endpoints(graph, {}, random);
    if (!ends) continue;
    plan::PathPlanner planner;
    std::vector<int> nodes;
    if (!std::isfinite(planner.plan(graph, ends->start, ends->goal, options.seed, attempt, nodes)) || nodes.size() < 2) continue;
    for (const int node : nodes)
      out.path.push_back({out.ground.center_x(graph.column(node)), out.ground.center_y(graph.row(node)), graph.height(node)});
    return out;
  }
  throw Error("none of a hundred grounds has a path from edge to edge");
}

Generated generate_along(const Scene& scene, const Options& options, const Course& course, const fs::path& path) {
  core::ThreadExecutor executor(options.threads);
  const auto [windows, net, theta] = read_trained(scene, options, path);
  NetworkDenoiser<float, MotionGenerator, core::ThreadExecutor> denoiser(net, theta.data(), executor, options.batch);
  BlendedDenoiser<float, decltype(denoiser)> blended(denoiser, {past_seen, 0.5}, options.batch);
  LongHorizonParameters p;
  p.longest = options.seconds;
  p.feet = feet_of(scene.character.skeleton);
  LongHorizon<float> horizon(windows, schedule(), stride, options.batch, p);

  Generated out;
  const example::Clock clock;
  horizon.generate(denoiser, blended, course.path, course.ground, options.seed, options.batch);
  out.generation_wall_s = clock.seconds();
  const auto points = body::surface_points(scene.character);
  std::vector<motion::MotionScore> scores(static_cast<std::size_t>(options.batch));
  out.motions = options.batch;
  for (int b = 0; b < options.batch; ++b) {
    motion::MotionScore& s = scores[static_cast<std::size_t>(b)];
    s.reached_end = horizon.end(b) == LongHorizonEnd::arrived;
    out.arrived += s.reached_end;
    out.not_finite += horizon.end(b) == LongHorizonEnd::not_finite;
    s.penetration = std::numeric_limits<double>::quiet_NaN();
    if (horizon.frames(b) >= 15) s = motion::score(horizon.clip(b), points, course.ground, s.reached_end);
  }
  const auto best = static_cast<int>(motion::best_motions(scores, 1)[0]);
  if (horizon.frames(best) < 15) throw Error("none of the generated motions is half a second long: the generator is not trained");
  out.best = horizon.clip(best);
  motion::Clip brisk = motion::without_hesitation(out.best);
  if (brisk.keys() < 15) brisk = out.best;
  out.cut_frames = out.best.keys() - brisk.keys();
  const motion::Corrected corrected = motion::correct_ceres(brisk, points, course.ground, {}, executor);
  out.corrected = corrected.clip;
  out.corrected.name = "corrected";
  out.correction_wall_s = corrected.report.seconds;
  out.correction_iterations = corrected.report.iterations;
  out.best_quality = measure(scene.character, out.best, course.ground, &course.path.back());
  out.corrected_quality = measure(scene.character, out.corrected, course.ground, &course.path.back());
  return out;
}

Quality quality_of(const Scene& scene) {
  Quality sum;
  for (std::size_t i = 0; i < scene.material.size(); i += 2)
    add(sum, measure(scene.character, scene.material[i].clip, scene.material[i].ground, nullptr));
  return sum;
}

WindowsQuality quality_of_windows(const Scene& scene, const Options& options, const fs::path& path) {
  core::ThreadExecutor executor(options.threads);
  const Trained t = read_trained(scene, options, path);
  const Windows& windows = t.windows;
  WindowsQuality out;
  const Eigen::Index size = windows.sample_features();
  Matrix truth(size, out.count), x(size, out.count), conditions(windows.condition_features(), out.count);
  std::vector<terrain::HeadingFrame<double>> frames;
  std::vector<const Material*> of;
  Windows::Scratch scratch = windows.scratch();
  const std::vector<double> ends = ends_of(scene);
  for (Eigen::Index j = 0; j < out.count; ++j) {
    core::RandomStream random(options.seed + 4, static_cast<std::uint64_t>(j), 0);
    of.push_back(&scene.material[draw_clip(ends, random)]);
    frames.push_back(windows.draw(of.back()->clip, of.back()->ground, random, scratch, truth.col(j).data(), conditions.col(j).data()));
    // Training's past is noisy, this one is not.
    std::copy_n(truth.col(j).data(), windows.parameters().past * windows.features().size(), conditions.col(j).data() + windows.past_row());
  }
  NetworkDenoiser<float, MotionGenerator, core::ThreadExecutor> denoiser(t.net, t.theta.data(), executor, out.count);
  BlendedDenoiser<float, decltype(denoiser)> blended(denoiser, {past_seen, 0.5}, out.count);
  WindowProjection<float> project(windows);
  project.set_condition({conditions}, past_part);
  body::Frames<float> kinematics(scene.character.skeleton);
  Eigen::VectorXf window(size);
  const auto mean_gap = [&](const auto& samples) {
    double sum = 0;
    for (Eigen::Index j = 0; j < out.count; ++j) {
      window = samples.col(j);
      windows.scale().undo(window.data(), windows.frames());
      sum += fk_gap(windows, window.data(), kinematics);
    }
    return sum / out.count;
  };
  draw_noise<float>(x, options.seed + 5);
  Ddim<float> ddim(schedule(), stride, size, out.count);
  ddim.sample(blended, {conditions}, x, [&](nn::Matrix<float> clean) {
    out.generated_fk_gap_m = mean_gap(clean);  // of the last estimate, in the end
    project(clean);
  });
  out.clips_fk_gap_m = mean_gap(truth);
  for (Eigen::Index j = 0; j < out.count; ++j) {
    const auto k = static_cast<std::size_t>(j);
    for (const auto& [samples, quality] : {std::pair{&x, &out.generated}, std::pair{&truth, &out.clips}}) {
      window = samples->col(j);
      windows.scale().undo(window.data(), windows.frames());
      add(*quality, measure(scene.character, decoded(windows, window.data(), frames[k]), of[k]->ground, nullptr));
    }
  }
  return out;
}

}  // namespace generate
