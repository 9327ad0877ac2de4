// SPDX-License-Identifier: MIT
// The bundled simulator beside MuJoCo: the same humanoid file, standing on a plane and waving its arms and trunk, 480
// steps a second, new targets 30 times a second, time in CPU seconds of one thread.
//
// Both follow the targets with the gains in the file: MuJoCo as passive springs, whose damping its Euler integrator
// treats implicitly. Bodies touch the floor only, not each other, and MuJoCo's friction and solver settings are its
// defaults, so it is asked for no more than we do. Both sides must stay upright all the time or the run fails.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include <mujoco/mujoco.h>
#include <traceur/io/mjcf.hpp>
#include <traceur/sim/world.hpp>

#include "../cpu_seconds.hpp"

namespace {

using traceur::body::JointType;
using Vector = traceur::core::Vector3<double>;

constexpr double dt = 1.0 / 480;
constexpr int steps_per_target = 16;
constexpr double upright = 0.75;  // least height of the pelvis, m
constexpr int rounds = 9;

struct Free {
  void operator()(mjModel* m) const { mj_deleteModel(m); }
  void operator()(mjData* d) const { mj_deleteData(d); }
};

/// Standing, leaning forward from the ankles a little.
Eigen::VectorXd standing(const traceur::body::Skeleton& s) {
  Eigen::VectorXd q = s.neutral_pose();
  q[2] = 0.8835;
  about_axis(Vector{0, 1, 0}, 0.045).store(q.data() + 3);
  for (const char* ankle : {"right_ankle", "left_ankle"})
    about_axis(Vector{0, 1, 0}, -0.045).store(q.data() + s[s.find(ankle)].q_index);
  return q;
}

/// Targets at a time: both arms swing, the trunk twists, one cycle in two seconds, begun gently.
class Wave {
public:
  explicit Wave(const traceur::body::Skeleton& s) : rest_(standing(s)) {
    for (const char* joint : {"abdomen", "left_shoulder", "right_shoulder"}) at_.push_back(s[s.find(joint)].q_index);
  }
  void operator()(double time, double phase, Eigen::VectorXd& q) const {
    q = rest_;
    const double a = std::min(1.0, time / 3) * std::sin(3.14159265358979 * (time + phase));
    exp_map(Vector{0.05 * a, 0, 0.2 * a}).store(q.data() + at_[0]);
    exp_map(Vector{-0.2 + 0.2 * a, 0.4 * a, 0}).store(q.data() + at_[1]);
    exp_map(Vector{0.2 + 0.2 * a, -0.4 * a, 0}).store(q.data() + at_[2]);
  }
  const Eigen::VectorXd& rest() const { return rest_; }

private:
  Eigen::VectorXd rest_;
  std::vector<int> at_;
};

/// Twenty boxes: a low platform that the humanoid stands on, and blocks and walls around it, some within reach.
traceur::sim::Scene obstacles() {
  const auto level = traceur::core::Quaternion<double>::identity();
  std::vector<traceur::terrain::Box> boxes{{{0, 0, 0.1}, {0.5, 0.5, 0.1}, level}};
  for (int i = 0; i < 19; ++i) {
    const double angle = 2.399963 * i, distance = 0.9 + 0.15 * i, height = 0.2 + 0.05 * (i % 7);
    boxes.push_back({{distance * std::cos(angle), distance * std::sin(angle), height},
                     {0.1, 0.1, height},
                     about_axis(Vector{0, 0, 1}, angle)});
  }
  return {traceur::sim::Ground<double>(), traceur::terrain::BoxScene(std::move(boxes))};
}
constexpr double platform = 0.2;  // m

/// A model file with the scene's boxes in its world.
std::string with_boxes(const std::string& path, const traceur::sim::Scene& scene) {
  std::ifstream file(path);
  std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  std::string geoms;
  for (const traceur::terrain::Box& b : scene.boxes.boxes()) {
    char line[300];
    std::snprintf(line, sizeof line,
                  "<geom type=\"box\" pos=\"%.9g %.9g %.9g\" size=\"%.9g %.9g %.9g\" quat=\"%.9g %.9g %.9g %.9g\"/>\n",
                  b.center.x, b.center.y, b.center.z, b.half_size.x, b.half_size.y, b.half_size.z, b.rotation.w,
                  b.rotation.x, b.rotation.y, b.rotation.z);
    geoms += line;
  }
  const auto at = text.rfind("</worldbody>");
  if (at == std::string::npos) throw traceur::Error(path + ": has no </worldbody>");
  return text.insert(at, geoms);
}

/// One side of the comparison: runs on from where it is and tells its steps (times lanes) per CPU second.
class Side {
public:
  explicit Side(std::string name) : name_(std::move(name)) {}
  virtual ~Side() = default;

  void round() {
    const double begin = cpu_seconds();
    const double steps = advance();
    rates_.push_back(steps / (cpu_seconds() - begin));
  }
  double rate() const {
    std::vector<double> sorted = rates_;
    std::sort(sorted.begin(), sorted.end());
    return sorted[sorted.size() / 2];
  }
  const std::string& name() const { return name_; }
  bool fallen() const { return fallen_; }

protected:
  virtual double advance() = 0;
  bool fallen_ = false;

private:
  std::string name_;
  std::vector<double> rates_;
};

class MuJoCo : public Side {
public:
  MuJoCo(std::string name, const std::string& path, const traceur::body::Skeleton& s, bool pgs,
         const traceur::sim::Scene* scene = nullptr)
      : Side(std::move(name)), wave_(s), skeleton_(s), q_(wave_.rest()), raised_(scene ? platform : 0) {
    char error[1000] = "";
    if (scene) {
      const std::string text = with_boxes(path, *scene);
      const auto files = std::make_unique<mjVFS>();
      mj_defaultVFS(files.get());
      mj_makeEmptyFileVFS(files.get(), "scene.xml", static_cast<int>(text.size()));
      std::copy(text.begin(), text.end(), static_cast<char*>(files->filedata[files->nfile - 1]));
      model_.reset(mj_loadXML("scene.xml", files.get(), error, sizeof error));
      mj_deleteVFS(files.get());
    } else {
      model_.reset(mj_loadXML(path.c_str(), nullptr, error, sizeof error));
    }
    if (!model_) throw traceur::Error(error);
    model_->opt.timestep = dt;
    if (pgs) {
      model_->opt.solver = mjSOL_PGS;
      model_->opt.iterations = 4;
    }
    for (int g = 0; g < model_->ngeom; ++g) {
      const bool floor = model_->geom_bodyid[g] == 0;
      model_->geom_contype[g] = floor ? 0 : 1;
      model_->geom_conaffinity[g] = floor ? 1 : 0;
    }
    data_.reset(mj_makeData(model_.get()));
    for (const auto& j : s.joints()) {
      const int joint = mj_name2id(model_.get(), mjOBJ_JOINT, j.name.c_str());
      if (joint >= 0) joints_.push_back({&j, model_->jnt_qposadr[joint]});
    }
    write(q_, data_->qpos, true);
    data_->qpos[2] += raised_;
  }

protected:
  double advance() override {
    constexpr int targets = 300;
    for (int n = 0; n < targets; ++n) {
      wave_(data_->time, 0, q_);
      write(q_, model_->qpos_spring, false);
      for (int k = 0; k < steps_per_target; ++k) mj_step(model_.get(), data_.get());
      fallen_ = fallen_ || !(data_->qpos[2] > upright + raised_);
    }
    return targets * steps_per_target;
  }

private:
  struct Place {
    const traceur::body::Joint* joint;
    int at;
  };

  void write(const Eigen::VectorXd& q, double* out, bool root) const {
    for (const Place& p : joints_) {
      const double* from = q.data() + p.joint->q_index;
      double* to = out + p.at;
      const bool free = p.joint->type == JointType::free;
      if (free && !root) continue;
      if (p.joint->type == JointType::hinge) to[0] = from[0];
      if (free) std::copy_n(from, 3, to);
      if (free || p.joint->type == JointType::ball) {
        const double* r = from + (free ? 3 : 0);
        double* w = to + (free ? 3 : 0);
        w[0] = r[3];
        std::copy_n(r, 3, w + 1);
      }
    }
  }

  Wave wave_;
  traceur::body::Skeleton skeleton_;
  Eigen::VectorXd q_;
  std::unique_ptr<mjModel, Free> model_;
  std::unique_ptr<mjData, Free> data_;
  std::vector<Place> joints_;
  double raised_;
};

template <class S>
class Ours : public Side {
public:
  Ours(std::string name, const traceur::body::Character& character, int lanes, int targets,
       const traceur::sim::Scene& scene = {})
      : Side(std::move(name)),
        wave_(character.skeleton),
        world_(character, lanes, parameters(), scene),
        q_(wave_.rest()),
        targets_(targets),
        raised_(scene.boxes.empty() ? 0 : platform) {
    q_[2] += raised_;
    for (int l = 0; l < lanes; ++l) world_.reset(l, q_, Eigen::VectorXd::Zero(character.skeleton.nv()));
  }

protected:
  double advance() override {
    for (int n = 0; n < targets_; ++n) {
      for (int l = 0; l < world_.lanes(); ++l) {
        wave_(time_, 0.11 * l, q_);
        world_.set_target(l, q_);
      }
      world_.step(steps_per_target);
      time_ += steps_per_target * dt;
      for (int l = 0; l < world_.lanes(); ++l)
        fallen_ = fallen_ || world_.failed(l) || !(world_.body_position(l, 0).z > upright + raised_);
    }
    return static_cast<double>(targets_) * steps_per_target * world_.lanes();
  }

private:
  static traceur::sim::Parameters parameters() {
    traceur::sim::Parameters p;
    p.dt = dt;
    return p;
  }

  Wave wave_;
  traceur::sim::World<S> world_;
  Eigen::VectorXd q_;
  int targets_;
  double raised_;
  double time_ = 0;
};

/// Wall-clock gain of a second thread.
double two_threads(const traceur::body::Character& humanoid) {
  traceur::sim::World<traceur::core::Pack<float>> world(humanoid, 256);
  const Eigen::VectorXd q = standing(humanoid.skeleton);
  for (int l = 0; l < world.lanes(); ++l) world.reset(l, q, Eigen::VectorXd::Zero(humanoid.skeleton.nv()));
  traceur::core::ThreadExecutor one(1), two(2);
  const auto rate = [&](traceur::core::ThreadExecutor& executor) {
    const auto begin = std::chrono::steady_clock::now();
    for (int n = 0; n < 30; ++n) world.step(steps_per_target, executor);
    return 1 / std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  };
  std::vector<double> gains;
  for (int r = 0; r < rounds; ++r) {
    const double alone = rate(one);
    gains.push_back(rate(two) / alone);
  }
  std::sort(gains.begin(), gains.end());
  return gains[gains.size() / 2];
}

int run(const std::string& path) {
  using Pack = traceur::core::Pack<float>;
  const traceur::body::Character humanoid = traceur::io::read_mjcf(path);
  const std::string wide = "pack of " + std::to_string(Pack::width);
  const traceur::sim::Scene scene = obstacles();
  std::array<std::unique_ptr<Side>, 8> sides{
      std::make_unique<MuJoCo>("MuJoCo, Newton", path, humanoid.skeleton, false),
      std::make_unique<MuJoCo>("MuJoCo, PGS, 4 iterations", path, humanoid.skeleton, true),
      std::make_unique<Ours<double>>("traceur, double", humanoid, 1, 900),
      std::make_unique<Ours<float>>("traceur, float", humanoid, 1, 900),
      std::make_unique<Ours<Pack>>("traceur, " + wide, humanoid, Pack::width, 900),
      std::make_unique<Ours<Pack>>("traceur, " + wide + ", 256 lanes", humanoid, 256, 60),
      std::make_unique<MuJoCo>("MuJoCo, Newton, 20 boxes", path, humanoid.skeleton, false, &scene),
      std::make_unique<Ours<Pack>>("traceur, " + wide + ", 20 boxes", humanoid, Pack::width, 900, scene)};
  // In turn, so that a busy moment of the machine strikes all alike.
  for (int r = 0; r < rounds; ++r)
    for (auto& side : sides) side->round();
  bool fell = false;
  std::printf("humanoid of %d bodies, waving upright, thousand steps per CPU second (median of %d)\n",
              humanoid.skeleton.size(), rounds);
  for (const auto& side : sides) {
    std::printf("  %-32s %9.1f%s\n", side->name().c_str(), side->rate() / 1000, side->fallen() ? "  FELL" : "");
    fell = fell || side->fallen();
  }
  const double newton = sides[0]->rate(), pgs = sides[1]->rate();
  std::printf("ratio mujoco_newton_256 %.2f\n", sides[5]->rate() / newton);
  std::printf("ratio mujoco_newton %.2f\n", sides[4]->rate() / newton);
  std::printf("ratio mujoco_pgs4 %.2f\n", sides[4]->rate() / pgs);
  std::printf("ratio mujoco_boxes %.2f\n", sides[7]->rate() / sides[6]->rate());
  std::printf("ratio two_threads %.2f\n", two_threads(humanoid));
  std::printf("ratio mujoco_float %.2f\n", sides[3]->rate() / newton);
  return fell ? 1 : 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const auto here = std::filesystem::path(__FILE__).parent_path();
    return run(argc > 1 ? argv[1] : (here / "../../examples/characters/humanoid.xml").string());
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 2;
  }
}
