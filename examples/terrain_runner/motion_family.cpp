// SPDX-License-Identifier: MIT
#include "motion_family.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "traceur/control/mirror.hpp"
#include "traceur/core/error.hpp"
#include "traceur/io/safetensors.hpp"

namespace terrain_runner {

using namespace traceur;
namespace fs = std::filesystem;

namespace {

int most(const std::vector<int>& of_ticks) { return 1 + *std::max_element(of_ticks.begin(), of_ticks.end()); }

/// Files hold single precision: the motion was simulated in it.
void add(io::Safetensors& file, const std::string& name, const std::vector<Eigen::MatrixXd>& matrices) {
  const auto rows = static_cast<std::uint64_t>(matrices[0].rows()), columns = static_cast<std::uint64_t>(matrices[0].cols());
  std::vector<float> values;
  for (const Eigen::MatrixXd& m : matrices) values.insert(values.end(), m.data(), m.data() + m.size());
  file.add<float>(name, {matrices.size(), columns, rows}, values);
}

std::vector<Eigen::MatrixXd> matrices(const io::Safetensors& file, const std::string& name, std::size_t heights, Eigen::Index rows,
                                      Eigen::Index columns) {
  const io::Tensor& t = file.at(name);
  const std::vector<std::uint64_t> shape{heights, static_cast<std::uint64_t>(columns), static_cast<std::uint64_t>(rows)};
  if (t.shape != shape) throw Error(file.where() + ": tensor '" + name + "': expected " + std::to_string(heights) + " x " + std::to_string(columns) + " x " + std::to_string(rows) + " numbers");
  std::vector<float> values(t.size());
  file.read<float>(name, values);
  for (const float v : values)
    if (!std::isfinite(v)) throw Error(file.where() + ": tensor '" + name + "': expected finite numbers");
  std::vector<Eigen::MatrixXd> out;
  for (std::size_t k = 0; k < heights; ++k)
    out.emplace_back(Eigen::Map<const Eigen::MatrixXf>(values.data() + static_cast<Eigen::Index>(k) * rows * columns, rows, columns).cast<double>());
  return out;
}

void add(io::Safetensors& file, const std::string& name, const std::vector<int>& values) {
  const std::vector<std::int64_t> wide(values.begin(), values.end());
  file.add<std::int64_t>(name, {wide.size()}, wide);
}

std::vector<int> integers(const io::Safetensors& file, const std::string& name, int least, int most, std::size_t count) {
  const io::Tensor& t = file.at(name);
  if (count > 0 && t.size() != count) throw Error(file.where() + ": tensor '" + name + "': expected " + std::to_string(count) + " numbers");
  std::vector<std::int64_t> wide(t.size());
  file.read<std::int64_t>(name, wide);
  for (const std::int64_t v : wide)
    if (v < least || v > most)
      throw Error(file.where() + ": tensor '" + name + "': expected numbers from " + std::to_string(least) + " to " + std::to_string(most));
  return {wide.begin(), wide.end()};
}

constexpr int longest = 2000;  // ticks

}  // namespace

int MotionFamily::laws() const { return most(phase); }
int MotionFamily::offsets() const { return most(parts); }

control::Controller MotionFamily::controller(const sim::Model& model, const control::Roles& roles, const control::Controller& gait,
                                             std::size_t k) const {
  control::Controller c = gait;
  c.clip = gait.clip + ", manoeuvre";
  c.cyclic = false;
  c.targets = targets[k];
  c.sensory = Eigen::MatrixXd::Zero(control::full_sensors, ticks());
  c.stance = stance;
  c.phase = phase;
  control::TrackingReference& r = c.reference;
  r.dt = gait.tick;
  r.poses = poses[k];
  r.velocities = velocities[k];
  for (Eigen::Index t = 0; t < r.poses.cols(); ++t) body::normalize(model.character.skeleton, r.poses.col(t).data());
  for (Eigen::Index t = 0; t < c.targets.cols(); ++t) body::normalize(model.character.skeleton, c.targets.col(t).data());
  control::measure_reference(model, roles, {}, r);
  c.start_pose = r.poses.col(0);
  c.start_velocity = r.velocities.col(0);
  return c;
}

control::Controller mirrored(const sim::Model& model, const control::Roles& roles, control::Controller c) {
  const auto mirror_poses = [&](Eigen::MatrixXd& poses) {
    for (Eigen::Index t = 0; t < poses.cols(); ++t) poses.col(t) = control::mirrored_pose(model, roles, poses.col(t));
  };
  mirror_poses(c.targets);
  mirror_poses(c.reference.poses);
  for (Eigen::Index t = 0; t < c.reference.velocities.cols(); ++t)
    c.reference.velocities.col(t) = control::mirrored_tangent(model, roles, c.reference.velocities.col(t));
  control::measure_reference(model, roles, {}, c.reference);
  for (auto& side : c.stance) side = 1 - side;
  c.start_pose = c.reference.poses.col(0);
  c.start_velocity = c.reference.velocities.col(0);
  return c;
}

MotionFamily read_family(const fs::path& path, const sim::Model& model) {
  const io::Safetensors file = io::read_safetensors(path);
  MotionFamily f;
  f.heights.resize(file.at("heights").size());
  file.read<double>("heights", f.heights);
  if (f.heights.empty()) throw Error(path.string() + ": expected a height");
  for (std::size_t k = 0; k < f.heights.size(); ++k)
    if (!std::isfinite(f.heights[k]) || (k > 0 && !(f.heights[k] > f.heights[k - 1])))
      throw Error(path.string() + ": tensor 'heights': expected increasing numbers");
  const auto ticks = static_cast<Eigen::Index>(file.at("stance").size());
  if (ticks < 1 || ticks > longest) throw Error(path.string() + ": expected 1 to " + std::to_string(longest) + " ticks");
  const auto count = static_cast<std::size_t>(ticks);
  f.stance = integers(file, "stance", 0, 1, count);
  f.phase = integers(file, "phase", 0, 15, count);
  f.parts = integers(file, "parts", 0, 15, count);
  f.targets = matrices(file, "targets", f.heights.size(), model.nq, ticks);
  f.poses = matrices(file, "poses", f.heights.size(), model.nq, ticks + 1);
  f.velocities = matrices(file, "velocities", f.heights.size(), model.nv, ticks + 1);
  const std::vector<int> times = integers(file, "times", 0, static_cast<int>(ticks), 4);
  f.end = times[0];
  f.hold_from = times[1];
  f.hold_to = times[2];
  f.placed = times[3];
  if (f.end < 1) throw Error(path.string() + ": expected an end after the begin");
  if (file.find("effort")) {
    f.effort.resize(file.at("effort").size());
    file.read<double>("effort", f.effort);
    if (f.effort.size() != f.heights.size() || !std::ranges::all_of(f.effort, [](double e) { return e > 0 && std::isfinite(e); }))
      throw Error(path.string() + ": tensor 'effort': expected a number above zero for each height");
  }
  std::array<double, 1> depth{};
  file.read<double>("depth", depth);
  f.depth = depth[0];
  if (!(f.depth >= 0) || !std::isfinite(f.depth)) throw Error(path.string() + ": tensor 'depth': expected zero or more");
  return f;
}

void write_family(const fs::path& path, const MotionFamily& f) {
  io::Safetensors file;
  file.add<double>("heights", {f.heights.size()}, f.heights);
  add(file, "targets", f.targets);
  add(file, "poses", f.poses);
  add(file, "velocities", f.velocities);
  add(file, "stance", f.stance);
  add(file, "phase", f.phase);
  add(file, "parts", f.parts);
  add(file, "times", std::vector<int>{f.end, f.hold_from, f.hold_to, f.placed});
  const std::array<double, 1> depth{f.depth};
  file.add<double>("depth", {1}, depth);
  if (!f.effort.empty()) file.add<double>("effort", {f.effort.size()}, f.effort);
  io::write_safetensors(path, file);
}

}  // namespace terrain_runner
