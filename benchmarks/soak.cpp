// SPDX-License-Identifier: MIT
// soak [--steps N] [--seed N] [--threads N] [--width 4|8|16] [--rewind yes] [--report FILE]: humanoids with bodies of their own, thrashing about in walled
// courts of random boxes until N steps are done, all lanes counted. Each lane's targets jump to random poses thirty times a
// second and it is struck now and then; every few seconds it gets another body, gravity, friction and court. No lane may
// meet a number that is not finite, and no body may get into a wall. Prints a hash of all states, which is the same for
// any number of threads, for packs of 4, 8 or 16 lanes, and with every thirtieth of a second rewound to its saved state and
// done again (--rewind). Exit status 1 if a law was broken.
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include <traceur/body/proportions.hpp>
#include <traceur/core/random.hpp>
#include <traceur/io/atomic_file.hpp>
#include <traceur/io/mjcf.hpp>
#include <traceur/sim/world.hpp>

namespace {

using namespace traceur;
using Vector = core::Vector3<double>;

constexpr int lanes = 256, steps_per_target = 16, targets_per_life = 150;
constexpr double court = 4, wall = 0.25, height = 8;  // half width, half thickness, half height, m
// As deep as a body's joint may be inside a wall: all of its shapes are thicker than this around it.
constexpr double into_wall = 0.02;  // m

struct Arguments {
  double steps = 1e7;
  std::uint64_t seed = 1;
  int threads = 0, width = core::Pack<float>::width;
  bool rewind = false;
  std::string report;
};

Arguments read(int argc, char** argv) {
  Arguments a;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string name = argv[i];
    if (name == "--steps") {
      a.steps = std::stod(argv[i + 1]);
    } else if (name == "--seed") {
      a.seed = std::stoull(argv[i + 1]);
    } else if (name == "--threads") {
      a.threads = std::stoi(argv[i + 1]);
    } else if (name == "--width") {
      a.width = std::stoi(argv[i + 1]);
    } else if (name == "--rewind") {
      a.rewind = std::string(argv[i + 1]) == "yes";
    } else if (name == "--report") {
      a.report = argv[i + 1];
    } else {
      throw Error("soak: unknown option '" + name + "'");
    }
  }
  if (argc % 2 == 0) throw Error("soak: expected a value after '" + std::string(argv[argc - 1]) + "'");
  if (!(a.steps >= 1)) throw Error("soak: --steps: expected a positive number");
  return a;
}

std::shared_ptr<const sim::Scene> random_court(core::RandomStream& random) {
  std::vector<terrain::Box> boxes;
  for (int side = 0; side < 4; ++side) {
    const double s = side % 2 == 0 ? 1 : -1;
    if (side < 2) boxes.push_back({{s * (court + wall), 0, height}, {wall, court, height}});
    if (side >= 2) boxes.push_back({{0, s * (court + wall), height}, {court + 2 * wall, wall, height}});
  }
  while (boxes.size() < 20) {
    terrain::Box box;
    box.half_size = {random.uniform(0.1, 0.6), random.uniform(0.1, 0.6), random.uniform(0.05, 0.6)};
    box.rotation = about_axis(Vector{0, 0, 1}, random.uniform(-3.0, 3.0));
    box.center = {random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0), box.half_size.z};
    bool free = norm(Vector{box.center.x, box.center.y, 0}) > 1.6;
    for (const terrain::Box& other : boxes) free = free && terrain::BoxScene::overlap_of(box, other) < 0;
    if (free) boxes.push_back(box);
  }
  return std::make_shared<const sim::Scene>(sim::Scene{sim::Ground<double>(), terrain::BoxScene(std::move(boxes))});
}

/// Limbs as long and wide as Lee et al. 2021, Table 1, lets them be.
body::Character random_body(const body::Character& humanoid, core::RandomStream& random) {
  std::vector<body::SegmentScale> scales(static_cast<std::size_t>(humanoid.skeleton.size()));
  const body::SegmentScale arms{random.uniform(0.65, 1.65), random.uniform(1.0, 2.0), 1};
  const body::SegmentScale legs{random.uniform(0.65, 1.65), random.uniform(1.0, 1.6), 1};
  for (int i = 0; i < humanoid.skeleton.size(); ++i) {
    const std::string& name = humanoid.skeleton[i].name;
    const auto has = [&](const char* part) { return name.find(part) != std::string::npos; };
    if (has("shoulder") || has("elbow")) scales[static_cast<std::size_t>(i)] = arms;
    if (has("hip") || has("knee")) scales[static_cast<std::size_t>(i)] = legs;
  }
  return body::with_proportions(humanoid, scales);
}

Eigen::VectorXd random_pose(const body::Skeleton& s, core::RandomStream& random, double angle) {
  Eigen::VectorXd q = s.neutral_pose();
  for (const auto& j : s.joints()) {
    if (j.type == body::JointType::hinge) q[j.q_index] = random.uniform(-angle, angle);
    if (j.type == body::JointType::ball)
      exp_map(angle * Vector{random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0)})
          .store(q.data() + j.q_index);
  }
  return q;
}

template <class S>
int run(const Arguments& a) {
  const auto here = std::filesystem::path(__FILE__).parent_path();
  const body::Character humanoid = io::read_mjcf((here / "../examples/characters/humanoid.xml").string());
  sim::Extras extras;
  extras.obstacles = true;
  sim::World<S> world(humanoid, lanes, {}, sim::Ground<float>(), extras);
  core::ThreadExecutor executor(a.threads);
  std::vector<std::vector<float>> saved(lanes, std::vector<float>(static_cast<std::size_t>(world.state_size())));
  std::vector<Vector> blows(lanes);
  const auto begin = std::chrono::steady_clock::now();
  double steps = 0, deepest = -court;
  long long failed = 0, inside = 0, calls = 0;
  const auto seconds = [&] { return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count(); };
  while (steps < a.steps) {
    // Lives begin at different times, so that making bodies and courts is spread out.
    executor.run(lanes / world.group_width(), [&](int g, int) {
      for (int lane = g * world.group_width(); lane < (g + 1) * world.group_width(); ++lane) {
        core::RandomStream random(a.seed, static_cast<std::uint64_t>(calls), static_cast<std::uint64_t>(lane));
        if (calls % targets_per_life == lane * targets_per_life / lanes || calls == 0) {
          world.set_scene(lane, random_court(random));
          world.set_body(lane, random_body(humanoid, random));
          world.set_gravity(lane, 9.81 * random.uniform(0.2, 1.65));
          world.set_friction(lane, random.uniform(0.2, 1.2));
          Eigen::VectorXd q = random_pose(humanoid.skeleton, random, 0.5);
          Eigen::VectorXd v(humanoid.skeleton.nv());
          q[2] = 1.8;
          for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = 3 * random.uniform(-1.0, 1.0);
          world.reset(lane, q, v);
        }
        world.set_target(lane, random_pose(humanoid.skeleton, random, 2));
        auto& blow = blows[static_cast<std::size_t>(lane)];
        blow = Vector::zero();
        if (random.uniform(0.0, 1.0) < 0.05)
          blow = {3000 * random.uniform(-1.0, 1.0), 3000 * random.uniform(-1.0, 1.0), 1000 * random.uniform(0.0, 1.0)};
        world.push(lane, 0, blow);
        if (a.rewind) world.save(lane, saved[static_cast<std::size_t>(lane)].data());
      }
      world.step_group(g, steps_per_target);
      if (!a.rewind) return;
      for (int lane = g * world.group_width(); lane < (g + 1) * world.group_width(); ++lane) {
        world.restore(lane, saved[static_cast<std::size_t>(lane)].data());
        world.push(lane, 0, blows[static_cast<std::size_t>(lane)]);
      }
      world.step_group(g, steps_per_target);
    });
    steps += static_cast<double>(lanes) * steps_per_target;
    ++calls;
    for (int lane = 0; lane < lanes; ++lane) {
      if (world.failed(lane)) ++failed;
      for (std::size_t b = 0; b < world.model().bodies.size(); ++b) {
        const auto p = world.body_position(lane, static_cast<int>(b));
        const double out = std::max(std::abs(static_cast<double>(p.x)), std::abs(static_cast<double>(p.y))) - court;
        deepest = std::max(deepest, out);
        if (out > into_wall && p.z < 2 * height) ++inside;
      }
    }
    if (calls % 300 == 0)
      std::fprintf(stderr, "\r%.3g of %.3g steps, %.0f s, at most %.0f s left; %lld failed, %lld in walls ", steps, a.steps, seconds(),
                   seconds() * (a.steps / steps - 1), failed, inside);
  }
  std::fprintf(stderr, "\n");
  std::uint64_t hash = 1469598103934665603ull;  // FNV-1a over the bits of all states
  std::vector<float> state(static_cast<std::size_t>(world.state_size()));
  for (int lane = 0; lane < lanes; ++lane) {
    world.save(lane, state.data());
    for (const float x : state) {
      std::uint32_t bits;
      std::memcpy(&bits, &x, sizeof bits);
      hash = (hash ^ bits) * 1099511628211ull;
    }
  }
  nlohmann::ordered_json report{{"seed", a.seed},
                                {"width", a.width},
                                {"steps", steps},
                                {"wall_s", seconds()},
                                {"steps_per_s", steps / seconds()},
                                {"failed_lane_calls", failed},
                                {"bodies_in_walls", inside},
                                {"deepest_in_wall_m", deepest},
                                {"state_bytes_per_lane", state.size() * sizeof(float)},
                                {"state_hash", hash}};
  std::printf("%s\n", report.dump(2).c_str());
  if (!a.report.empty()) io::write_atomically(a.report, report.dump(2) + "\n");
  return failed || inside ? 1 : 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const Arguments a = read(argc, argv);
    if (a.width == 4) return run<core::Pack<float, 4>>(a);
    if (a.width == 8) return run<core::Pack<float, 8>>(a);
    if (a.width == 16) return run<core::Pack<float, 16>>(a);
    throw Error("soak: --width: expected 4, 8 or 16");
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 2;
  }
}
