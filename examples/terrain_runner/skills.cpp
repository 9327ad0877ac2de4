// SPDX-License-Identifier: MIT
#include "skills.hpp"

#include <cmath>
#include <fstream>
#include <numbers>
#include <sstream>

#include "traceur/core/error.hpp"
#include "traceur/io/atomic_file.hpp"
#include "traceur/io/controller_file.hpp"

namespace terrain_runner {

using namespace traceur;
namespace fs = std::filesystem;

namespace {

const std::vector<double> gait_amplitudes{0.5, 0.75, 1, 1.25, 1.5};
const std::vector<double> leap_heights{0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8};

std::optional<Measured> read_measured(const fs::path& path, int ticks) {
  if (!fs::exists(path)) return std::nullopt;
  std::ifstream in(path);
  const nlohmann::json json = nlohmann::json::parse(in, nullptr, false);
  const io::detail::FieldReader fields(json, path.string());
  const io::detail::FieldReader length(fields.at("step_length"), path.string() + ": field 'step_length'");
  Measured m;
  m.length.slope = length.number("slope_s");
  m.length.offset = length.number("offset_m");
  m.events.right_take_off = fields.integer("right_take_off_tick", 0, ticks - 1);
  m.events.left_landing = fields.integer("left_landing_tick", 0, ticks - 1);
  return m;
}

}  // namespace

std::optional<parameterize::Continuation> read_stage(const fs::path& folder, const char* name) {
  const fs::path path = folder / (std::string(name) + ".txt");
  if (!fs::exists(path)) return std::nullopt;
  std::ifstream in(path);
  try {
    return parameterize::Continuation::load(in);
  } catch (const Error& e) {
    throw Error(path.string() + ": " + e.what());
  }
}

Skills read_skills(const fs::path& folder, const sim::Model& model, const control::Roles& roles) {
  Skills s;
  s.gait = io::read_controller(folder / "gait.json", model, roles);
  s.running = read_stage(folder, "running");
  s.jump = read_stage(folder, "jump");
  s.measured = read_measured(folder / "measured.json", s.gait.ticks());
  return s;
}

void write_measured(const fs::path& folder, const Measured& m) {
  const nlohmann::ordered_json json{{"step_length", {{"slope_s", m.length.slope}, {"offset_m", m.length.offset}}},
                                    {"right_take_off_tick", m.events.right_take_off},
                                    {"left_landing_tick", m.events.left_landing}};
  io::write_atomically(folder / "measured.json", json.dump(2) + "\n");
}

void write_gait(const fs::path& folder, const control::Controller& gait) { io::write_controller(folder / "gait.json", gait); }

void write_stage(const fs::path& folder, const char* name, const parameterize::Continuation& c) {
  std::ostringstream text;
  c.save(text);
  io::write_atomically(folder / (std::string(name) + ".txt"), text.str());
}

RunningModel::RunningModel(const parameterize::Continuation& learned, const control::AffineShape& narrow, const control::AffineShape& wide)
    : rbf_(learned.model()), narrow_(narrow), wide_(wide) {}

Eigen::VectorXd RunningModel::operator()(const control::RunningTask& task) const {
  const double turn = task.turn * 180 / std::numbers::pi;
  Eigen::VectorXd c = rbf_(Eigen::Vector2d(std::abs(turn), task.speed));
  if (std::abs(turn) < 0.5) {
    // Between straight ahead, which is symmetric, and the first turn: no corner, whichever side.
    const double share = std::abs(turn) / 0.5;
    c = share * c + (1 - share) * narrow_.symmetric(c);
  }
  if (turn < 0) c = narrow_.mirrored(c);
  return control::widened(narrow_, wide_, c);
}

Eigen::VectorXd LeapNumbers::first(const Eigen::VectorXd& c) const {
  Eigen::VectorXd x = Eigen::VectorXd::Zero(size());
  const int law = shape.law.phase_size(), m = shape.actions();
  for (int p = 0; p < shape.law.phases; ++p) x.segment(p * law, law) = c.head(law);
  for (int k = 0; k < shape.offsets; ++k) x.segment(laws() + k * m, m) = c.segment(running.offset(0), m);
  x[beta()] = c[running.beta()];
  return x;
}

control::Manoeuvre Body::manoeuvre(const Eigen::VectorXd& x, double height, int side) const {
  const control::Skill& skill = leap[static_cast<std::size_t>(side)];
  const control::AffineShape& shape = skill.shape;
  const int kept = numbers.laws() + numbers.offsets();
  control::Manoeuvre m;
  m.skill = &skill;
  m.control.resize(shape.size());
  m.control.head(kept) = x.head(kept);
  // The leap's table is over the step's height, which takes the amplitude's place.
  m.control[shape.alpha()] = height;
  m.control[shape.beta()] = std::clamp(x[numbers.beta()], 0.6, 1.5);
  m.distance = leap_distance + x[numbers.distance()];
  m.speed_in = m.speed_out = leap_speed;
  m.rise = height;
  m.end = leap_end;
  m.recovery = Eigen::VectorXd::Zero(numbers.running.size());
  m.recovery.head(numbers.recoveries()) = x.segment(numbers.recovery(), numbers.recoveries());
  return m;
}

Body::Body(const sim::Model& m, const control::Roles& r, const control::Controller& g) : model(&m), roles(r), gait(g) {
  const control::MotionTable table(m, r, g, gait_amplitudes);
  narrow = {table, {g.shape, 2}, g.limits};
  wide = {table, {{common_sets, g.shape.rank, 1}, 2}, g.limits};
  leap.fill({{}, {{common_sets, g.shape.rank, 2}, leap_parts}, g.limits});
  numbers = {leap[0].shape, wide.shape};
}

void Body::add_leap(const GaitEvents& events) {
  std::array<std::vector<control::Controller>, 2> family;
  LeapShape shape;
  shape.speed = leap_speed;
  Leap last;
  for (const double h : leap_heights) {
    last = make_leap(*model, roles, gait, events, h, shape);
    family[0].push_back(mirrored(*model, roles, last).controller);
    family[1].push_back(last.controller);
  }
  for (std::size_t side = 0; side < 2; ++side) {
    leap[side].table = control::MotionTable(*model, roles, family[side], leap_heights);
    leap[side].table.divide(last.parts);
  }
  leap_distance = last.distance;
  leap_end = last.end;
}

}  // namespace terrain_runner
