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

/// Gains ship as bytes: each column of the left and each half of the rows of the right factors (poses, velocities) in units of
/// its own.
constexpr float most_of_byte = 127;

template <class Block>
float pack(const Block& block, std::vector<std::int8_t>& out) {
  const float unit = block.cwiseAbs().maxCoeff() / most_of_byte;
  for (Eigen::Index j = 0; j < block.cols(); ++j)
    for (Eigen::Index i = 0; i < block.rows(); ++i) out.push_back(static_cast<std::int8_t>(unit > 0 ? std::lround(block(i, j) / unit) : 0));
  return unit;
}

template <class Block>
void unpack(Block&& block, float unit, const std::int8_t*& from) {
  for (Eigen::Index j = 0; j < block.cols(); ++j)
    for (Eigen::Index i = 0; i < block.rows(); ++i) block(i, j) = unit * static_cast<float>(*from++);
}

void add_gains(io::Safetensors& file, const MotionFamily& f) {
  const control::Gain& like = f.gains.at(0).at(0);
  const Eigen::Index rank = like.right.rows(), half = like.right.cols() / 2;
  std::vector<std::int8_t> left, right;
  std::vector<float> units;
  for (const auto& of_height : f.gains)
    for (const control::Gain& g : of_height)
      for (Eigen::Index r = 0; r < rank; ++r) {
        units.push_back(pack(g.left.col(r), left));
        for (const Eigen::Index from : {Eigen::Index{0}, half}) units.push_back(pack(g.right.row(r).segment(from, half), right));
      }
  const auto size = [](Eigen::Index n) { return static_cast<std::size_t>(n); };
  const std::size_t heights = f.gains.size(), ticks = f.gains[0].size();
  file.add<std::int8_t>("gains.left", {heights, ticks, size(rank), size(like.left.rows())}, left);
  file.add<std::int8_t>("gains.right", {heights, ticks, size(rank), size(2 * half)}, right);
  file.add<float>("gains.units", {heights, ticks, size(rank), 3}, units);
}

void read_gains(const io::Safetensors& file, const sim::Model& model, MotionFamily& f) {
  const auto heights = f.heights.size(), ticks = static_cast<std::size_t>(f.end);
  const auto rank = static_cast<std::size_t>(file.at("gains.units").size()) / (3 * heights * ticks);
  const auto joints = static_cast<std::size_t>(model.nv) - 6, half = static_cast<std::size_t>(model.nv);
  if (rank < 1 || rank > joints) throw Error(file.where() + ": tensor 'gains.units': expected 1 to " + std::to_string(joints) + " ranks of each height and tick");
  const auto bytes = [&](const char* name, std::size_t of_rank) {
    std::vector<std::int8_t> out(file.at(name).size());
    if (out.size() != heights * ticks * rank * of_rank)
      throw Error(file.where() + ": tensor '" + name + "': expected " + std::to_string(heights * ticks * rank * of_rank) + " numbers");
    file.read<std::int8_t>(name, out);
    return out;
  };
  const std::vector<std::int8_t> left = bytes("gains.left", joints), right = bytes("gains.right", 2 * half);
  std::vector<float> units(heights * ticks * rank * 3);
  file.read<float>("gains.units", units);
  for (const float u : units)
    if (!std::isfinite(u)) throw Error(file.where() + ": tensor 'gains.units': expected finite numbers");
  const std::int8_t *of_left = left.data(), *of_right = right.data();
  const float* unit = units.data();
  const auto size = [](std::size_t n) { return static_cast<Eigen::Index>(n); };
  f.gains.assign(heights, {});
  for (auto& of_height : f.gains)
    for (std::size_t t = 0; t < ticks; ++t) {
      control::Gain g{Eigen::MatrixXf(size(joints), size(rank)), Eigen::MatrixXf(size(rank), size(2 * half))};
      for (Eigen::Index r = 0; r < size(rank); ++r) {
        unpack(g.left.col(r), *unit++, of_left);
        for (const std::size_t from : {std::size_t{0}, half}) unpack(g.right.row(r).segment(size(from), size(half)), *unit++, of_right);
      }
      of_height.push_back(std::move(g));
    }
}

Eigen::MatrixXd matrix(const io::Safetensors& file, const std::string& name) {
  const io::Tensor& t = file.at(name);
  if (t.shape.size() != 2) throw Error(file.where() + ": tensor '" + name + "': expected a matrix");
  Eigen::MatrixXd out(static_cast<Eigen::Index>(t.shape[1]), static_cast<Eigen::Index>(t.shape[0]));
  file.read<double>(name, std::span<double>(out.data(), t.size()));
  if (!out.allFinite()) throw Error(file.where() + ": tensor '" + name + "': expected finite numbers");
  return out;
}

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
  read_gains(file, model, f);
  if (file.find("offsets")) {
    f.plan_offsets = matrix(file, "offsets");
    file.read<double>("offsets.distance", std::span<double>(&f.plan_distance, 1));
    if (!std::isfinite(f.plan_distance)) throw Error(path.string() + ": tensor 'offsets.distance': expected a finite number");
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
  add_gains(file, f);
  if (f.plan_offsets.size() > 0) {
    file.add<double>("offsets.distance", {1}, std::span<const double>(&f.plan_distance, 1));
    file.add<double>("offsets", {static_cast<std::size_t>(f.plan_offsets.cols()), static_cast<std::size_t>(f.plan_offsets.rows())},
                     std::span<const double>(f.plan_offsets.data(), static_cast<std::size_t>(f.plan_offsets.size())));
  }
  io::write_safetensors(path, file);
}

}  // namespace terrain_runner
