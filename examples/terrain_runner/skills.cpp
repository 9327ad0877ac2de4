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

std::string wider_name(int step) { return "wider_" + std::to_string(step + 1); }

Skills read_skills(const fs::path& folder, const sim::Model& model, const control::Roles& roles) {
  Skills s;
  s.gait = io::read_controller(folder / "gait.json", model, roles);
  s.running = read_stage(folder, "running");
  while (auto c = read_stage(folder, wider_name(static_cast<int>(s.wider.size())).c_str())) s.wider.push_back(std::move(*c));
  for (const Kind kind : kinds) {
    s.clearing[index_of(kind)] = read_stage(folder, name_of(kind));
    const fs::path motions = folder / (std::string(name_of(kind)) + ".safetensors");
    if (fs::exists(motions)) s.family[index_of(kind)] = read_family(motions, model);
  }
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

Eigen::VectorXd ManoeuvreNumbers::first(const Eigen::VectorXd& c) const {
  Eigen::VectorXd x = Eigen::VectorXd::Zero(size());
  const int law = shape.law.phase_size(), m = shape.actions();
  for (int p = 0; p < shape.law.phases; ++p) x.segment(p * law, law) = c.head(law);
  for (int k = 0; k < shape.offsets; ++k) x.segment(laws() + k * m, m) = c.segment(running.offset(0), m);
  x[beta()] = c[running.beta()];
  return x;
}

control::Manoeuvre ObstacleSkill::manoeuvre(const Eigen::VectorXd& x, double height, int side) const {
  const control::Skill& own = skill[static_cast<std::size_t>(side)];
  const control::AffineShape& shape = own.shape;
  const int kept = numbers.laws() + numbers.offsets();
  control::Manoeuvre m;
  m.skill = &own;
  m.control.resize(shape.size());
  m.control.head(kept) = x.head(kept);
  // The table is over the obstacle's height, which takes the amplitude's place.
  m.control[shape.alpha()] = height;
  m.control[shape.beta()] = std::clamp(x[numbers.beta()], 0.6, 1.5);
  m.distance = distance + x[numbers.distance()];
  m.speed_in = speed;
  m.speed_out = speed_out;
  m.rise = hurdle(height).rise;
  m.end = end;
  // A sampled motion begins with running as it is.
  m.blend_in = !regulator;
  if (regulator) m.steps_out = 2;
  m.slide = slide;
  m.regulator = regulator.get();
  m.size = height;
  m.in_mirror = side == 0;
  if (hold_to > hold_from) {
    // The hand on the side of the foot that takes off.
    m.hand = side == 1 ? 0 : 1;
    m.hold_from = hold_from;
    m.hold_to = hold_to;
  }
  m.recovery = Eigen::VectorXd::Zero(numbers.running.size());
  m.recovery.head(numbers.recoveries()) = x.segment(numbers.recovery(), numbers.recoveries());
  return m;
}

control::Hurdle ObstacleSkill::hurdle(double height) const { return hurdle_of(kind, height, depth); }

// What matters about a cliff is not to step over its edge.
double slide_of(Kind kind) { return kind == Kind::drop ? 0.4 : 0; }

control::Hurdle hurdle_of(Kind kind, double height, double depth) {
  if (kind == Kind::vault) return control::Hurdle::box(height, depth);
  if (kind == Kind::drop) return control::Hurdle::step(-height);
  return control::Hurdle::step(height);
}

sim::Ground<float> ground_of(const control::Hurdle& hurdle) {
  constexpr int cells = 150;
  constexpr double cell = 0.2;
  Eigen::MatrixXd h(cells, 1);
  for (int i = 0; i < cells; ++i) h(i, 0) = hurdle.floor(cell * (i - cells / 2 + 0.5));
  return terrain::HeightGrid(h, cell, -cell * cells / 2, 0);
}

Body::Body(const sim::Model& m, const control::Roles& r, const control::Controller& g) : model(&m), roles(r), gait(g) {
  const control::MotionTable table(m, r, g, gait_amplitudes);
  narrow = {table, {g.shape, 2}, g.limits};
  wide = {table, {{common_sets, g.shape.rank, 1}, 2}, g.limits};
  for (const Kind kind : kinds) skills[index_of(kind)].kind = kind;
}

void Body::add(Kind kind, const std::array<std::vector<control::Controller>, 2>& motions, const std::vector<double>& heights,
               const std::vector<int>& parts, int laws, int offsets) {
  ObstacleSkill& s = skills[index_of(kind)];
  s.skill.fill({{}, {{common_sets, gait.shape.rank, laws}, offsets}, gait.limits});
  for (std::size_t side = 0; side < 2; ++side) {
    s.skill[side].table = control::MotionTable(*model, roles, motions[side], heights);
    s.skill[side].table.divide(parts);
  }
  s.numbers = {s.skill[0].shape, wide.shape};
  s.speed = s.speed_out = wide.table.speed();
}

void Body::add_family(Kind kind, const MotionFamily& family) {
  std::array<std::vector<control::Controller>, 2> motions;
  for (std::size_t k = 0; k < family.heights.size(); ++k) {
    motions[1].push_back(family.controller(*model, roles, gait, k));
    motions[0].push_back(mirrored(*model, roles, motions[1].back()));
  }
  add(kind, motions, family.heights, family.parts, family.laws(), family.offsets());
  ObstacleSkill& s = skills[index_of(kind)];
  s.distance = -motions[1].front().reference.center_of_mass(0, 0);
  s.end = family.end;
  s.hold_from = family.hold_from;
  s.hold_to = family.hold_to;
  s.depth = family.depth;
  s.slide = slide_of(kind);
  if (!family.gains.empty()) s.regulator = std::make_shared<control::TrackingRegulator>(make_regulator(*model, roles, gait, family));
}

}  // namespace terrain_runner
