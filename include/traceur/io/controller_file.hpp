// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

#include "traceur/control/controller.hpp"
#include "traceur/io/atomic_file.hpp"
#include "traceur/io/detail/json.hpp"

namespace traceur::io {

namespace detail {

/// A list of columns. Throws Error naming the field when a number is not finite: JSON has no such number.
inline nlohmann::ordered_json matrix_to_json(const char* field, const Eigen::MatrixXd& m) {
  if (!m.allFinite()) throw Error(std::string("controller: field '") + field + "': expected finite numbers");
  nlohmann::ordered_json columns = nlohmann::ordered_json::array();
  for (Eigen::Index c = 0; c < m.cols(); ++c) {
    nlohmann::ordered_json column = nlohmann::ordered_json::array();
    for (Eigen::Index r = 0; r < m.rows(); ++r) column.push_back(m(r, c));
    columns.push_back(std::move(column));
  }
  return columns;
}

/// Reads fields of one JSON object, naming file and field in every complaint.
class FieldReader {
 public:
  FieldReader(const nlohmann::json& object, std::string where) : object_(&object), where_(std::move(where)) {
    if (!object.is_object()) throw Error(where_ + ": expected an object");
  }
  const nlohmann::json& at(const char* name) const {
    const auto found = object_->find(name);
    if (found == object_->end()) throw Error(where_ + ": field '" + name + "' is missing");
    return *found;
  }
  double number(const char* name) const {
    const nlohmann::json& v = at(name);
    if (!v.is_number() || !std::isfinite(v.get<double>())) throw Error(where_ + ": field '" + name + "': expected a finite number");
    return v.get<double>();
  }
  double at_least_zero(const char* name) const {
    const double v = number(name);
    if (v < 0) throw Error(where_ + ": field '" + name + "': expected zero or more");
    return v;
  }
  int integer(const char* name, int low, int high) const {
    const double v = number(name);
    if (v != std::floor(v) || v < low || v > high)
      throw Error(where_ + ": field '" + name + "': expected a whole number from " + std::to_string(low) + " to " + std::to_string(high));
    return static_cast<int>(v);
  }
  bool flag(const char* name) const {
    const nlohmann::json& v = at(name);
    if (!v.is_boolean()) throw Error(where_ + ": field '" + name + "': expected true or false");
    return v.get<bool>();
  }
  std::string text(const char* name) const {
    const nlohmann::json& v = at(name);
    if (!v.is_string()) throw Error(where_ + ": field '" + name + "': expected a text");
    return v.get<std::string>();
  }
  Eigen::MatrixXd matrix(const char* name, Eigen::Index rows) const {
    const nlohmann::json& v = at(name);
    const std::string field = where_ + ": field '" + name + "'";
    if (!v.is_array() || v.size() > 10'000'000) throw Error(field + ": expected a list of columns");
    Eigen::MatrixXd m(rows, static_cast<Eigen::Index>(v.size()));
    for (std::size_t c = 0; c < v.size(); ++c) {
      if (!v[c].is_array() || v[c].size() != static_cast<std::size_t>(rows))
        throw Error(field + ", column " + std::to_string(c) + ": expected " + std::to_string(rows) + " numbers");
      for (std::size_t r = 0; r < v[c].size(); ++r) {
        if (!v[c][r].is_number() || !std::isfinite(v[c][r].get<double>()))
          throw Error(field + ", column " + std::to_string(c) + ": expected finite numbers");
        m(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c)) = v[c][r].get<double>();
      }
    }
    return m;
  }
  std::vector<int> integers(const char* name, std::size_t count, int low, int high) const {
    const nlohmann::json& v = at(name);
    const std::string field = where_ + ": field '" + name + "'";
    if (!v.is_array() || v.size() != count) throw Error(field + ": expected " + std::to_string(count) + " whole numbers");
    std::vector<int> out;
    for (const nlohmann::json& x : v) {
      if (!x.is_number_integer() || x.get<long>() < low || x.get<long>() > high)
        throw Error(field + ": expected whole numbers from " + std::to_string(low) + " to " + std::to_string(high));
      out.push_back(x.get<int>());
    }
    return out;
  }
  FieldReader object(const char* name) const { return FieldReader(at(name), where_ + ": field '" + name + "'"); }
  const std::string& where() const { return where_; }

 private:
  const nlohmann::json* object_;
  std::string where_;
};

}  // namespace detail

/// A controller as text: one JSON object, every number exact; in names, bytes that are not UTF-8 are replaced. Throws Error
/// naming a field with a number that is not finite.
inline std::string controller_text(const control::Controller& c) {
  using Json = nlohmann::ordered_json;
  const sim::Parameters& s = c.simulation;
  Json j;
  j["format"] = "traceur controller 1";
  j["clip"] = c.clip;
  j["character"] = c.character;
  j["cyclic"] = c.cyclic;
  j["tick_s"] = c.tick;
  j["steps_per_tick"] = c.steps_per_tick;
  j["simulation"] = Json{{"dt_s", s.dt},
                         {"gravity_m_s2", s.gravity},
                         {"friction", s.friction},
                         {"contact_stiffness_N_m", s.contact_stiffness},
                         {"contact_damping_Ns_m", s.contact_damping},
                         {"damping_depth_m", s.damping_depth},
                         {"spring_depth_m", s.spring_depth},
                         {"bristle_stiffness_N_m", s.bristle_stiffness},
                         {"bristle_damping_Ns_m", s.bristle_damping},
                         {"stop_stiffness_Nm_rad", s.stop_stiffness},
                         {"stop_damping_Nms_rad", s.stop_damping},
                         {"joint_speed_limit_rad_s", s.joint_speed_limit},
                         {"conserve_momentum", s.conserve_momentum}};
  j["law"] = Json{{"rank", c.shape.rank},
                  {"phases", c.shape.phases},
                  {"swing_foot", c.shape.sets.swing_foot},
                  {"root_spin", c.shape.sets.root_spin},
                  {"ankles", c.shape.sets.ankles},
                  {"limit_forward_m", c.limits.forward},
                  {"limit_sideways_m", c.limits.sideways},
                  {"limit_action_rad", c.limits.action},
                  {"parameters", detail::matrix_to_json("parameters", Eigen::MatrixXd(c.law))}};
  j["stance"] = c.stance;
  j["phase"] = c.phase;
  j["start_pose"] = detail::matrix_to_json("start_pose", Eigen::MatrixXd(c.start_pose));
  j["start_velocity"] = detail::matrix_to_json("start_velocity", Eigen::MatrixXd(c.start_velocity));
  j["targets"] = detail::matrix_to_json("targets", c.targets);
  j["sensory"] = detail::matrix_to_json("sensory", c.sensory);
  j["reference_poses"] = detail::matrix_to_json("reference_poses", c.reference.poses);
  j["reference_velocities"] = detail::matrix_to_json("reference_velocities", c.reference.velocities);
  return j.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

/// Writes a controller atomically. Throws Error naming the path when it cannot be written.
inline void write_controller(const std::filesystem::path& path, const control::Controller& c) { write_atomically(path, controller_text(c)); }

/// Reads a controller for a character from text. Throws Error naming the field at fault, also when the controller belongs to
/// a character of other coordinates. `where` begins messages.
inline control::Controller parse_controller(const std::string& text, const std::string& where, const sim::Model& model, const control::Roles& roles) {
  const nlohmann::json json = detail::parse_json(text, where);
  const detail::FieldReader f(json, where);
  if (f.text("format") != "traceur controller 1") throw Error(where + ": field 'format': expected 'traceur controller 1'");
  control::Controller c;
  c.clip = f.text("clip");
  c.character = f.text("character");
  c.cyclic = f.flag("cyclic");
  c.tick = f.number("tick_s");
  c.steps_per_tick = f.integer("steps_per_tick", 1, 100000);
  if (!(c.tick > 0)) throw Error(where + ": field 'tick_s': expected a positive number");
  const detail::FieldReader s = f.object("simulation");
  sim::Parameters& p = c.simulation;
  p.dt = s.number("dt_s");
  p.gravity = s.number("gravity_m_s2");
  p.friction = s.number("friction");
  p.contact_stiffness = s.number("contact_stiffness_N_m");
  p.contact_damping = s.number("contact_damping_Ns_m");
  p.damping_depth = s.number("damping_depth_m");
  p.spring_depth = s.number("spring_depth_m");
  p.bristle_stiffness = s.number("bristle_stiffness_N_m");
  p.bristle_damping = s.number("bristle_damping_Ns_m");
  p.stop_stiffness = s.number("stop_stiffness_Nm_rad");
  p.stop_damping = s.number("stop_damping_Nms_rad");
  p.joint_speed_limit = s.number("joint_speed_limit_rad_s");
  p.conserve_momentum = s.flag("conserve_momentum");
  try {
    p.check();
  } catch (const Error& e) {
    throw Error(where + ": " + e.what());
  }
  if (!(std::abs(c.tick - c.steps_per_tick * p.dt) <= 1e-9 * c.tick))
    throw Error(where + ": field 'tick_s': expected 'steps_per_tick' times 'dt_s'");
  const detail::FieldReader l = f.object("law");
  c.shape.rank = l.integer("rank", 1, 100);
  c.shape.phases = l.integer("phases", 1, 100);
  c.shape.sets = {l.flag("swing_foot"), l.flag("root_spin"), l.flag("ankles")};
  c.limits = {l.at_least_zero("limit_forward_m"), l.at_least_zero("limit_sideways_m"), l.at_least_zero("limit_action_rad")};
  const Eigen::MatrixXd law = l.matrix("parameters", c.shape.size());
  if (law.cols() != 1) throw Error(l.where() + ": field 'parameters': expected one column");
  c.law = law.col(0);
  c.targets = f.matrix("targets", model.nq);
  const auto ticks = static_cast<std::size_t>(c.targets.cols());
  if (ticks == 0) throw Error(where + ": field 'targets': expected at least one tick");
  c.sensory = f.matrix("sensory", control::full_sensors);
  c.reference.poses = f.matrix("reference_poses", model.nq);
  c.reference.velocities = f.matrix("reference_velocities", model.nv);
  const Eigen::MatrixXd q = f.matrix("start_pose", model.nq), v = f.matrix("start_velocity", model.nv);
  const auto require_columns = [&](const char* name, const Eigen::MatrixXd& m, Eigen::Index count) {
    if (m.cols() != count)
      throw Error(where + ": field '" + name + "': expected " + std::to_string(count) + " columns, found " + std::to_string(m.cols()));
  };
  require_columns("sensory", c.sensory, c.targets.cols());
  require_columns("reference_poses", c.reference.poses, c.targets.cols() + 1);
  require_columns("reference_velocities", c.reference.velocities, c.targets.cols() + 1);
  require_columns("start_pose", q, 1);
  require_columns("start_velocity", v, 1);
  c.start_pose = q.col(0);
  c.start_velocity = v.col(0);
  body::check_pose(model.character.skeleton, c.start_pose, where + ": field 'start_pose'");
  for (Eigen::Index t = 0; t < c.targets.cols(); ++t)
    body::check_pose(model.character.skeleton, c.targets.col(t), where + ": field 'targets', column " + std::to_string(t));
  for (Eigen::Index t = 0; t < c.reference.poses.cols(); ++t)
    body::check_pose(model.character.skeleton, c.reference.poses.col(t), where + ": field 'reference_poses', column " + std::to_string(t));
  c.stance = f.integers("stance", ticks, 0, 1);
  c.phase = f.integers("phase", ticks, 0, c.shape.phases - 1);
  c.reference.dt = c.tick;
  control::measure_reference(model, roles, control::tracked_points(model, roles), c.reference);
  return c;
}

/// Reads a controller file. Throws Error naming path and field.
inline control::Controller read_controller(const std::filesystem::path& path, const sim::Model& model, const control::Roles& roles) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw Error(path.string() + ": cannot be opened");
  std::ostringstream text;
  text << in.rdbuf();
  return parse_controller(text.str(), path.string(), model, roles);
}

}  // namespace traceur::io
