// SPDX-License-Identifier: MIT
#include <traceur/io/controller_file.hpp>

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include <doctest/doctest.h>

#include "../control/biped.hpp"
#include "motions.hpp"
#include <traceur/core/random.hpp>

using motions::contains;
using motions::error_of;
using namespace traceur;

namespace {

using Json = nlohmann::ordered_json;

struct Figure {
  sim::Model model = sim::make_model(figures::biped());
  control::Roles roles = control::find_roles(model);
};

const Figure& biped() {
  static const Figure figure;
  return figure;
}

/// A controller of five ticks, with numbers that need all their digits.
control::Controller example() {
  const sim::Model& m = biped().model;
  const body::Skeleton& s = m.character.skeleton;
  core::RandomStream random(61);
  const auto numbers = [&](Eigen::Index rows, Eigen::Index cols) {
    Eigen::MatrixXd out(rows, cols);
    for (double& x : out.reshaped()) x = random.normal();
    return out;
  };
  const auto poses = [&](Eigen::Index cols) {
    Eigen::MatrixXd out = numbers(m.nq, cols);
    for (Eigen::Index t = 0; t < cols; ++t) body::normalize(s, out.col(t).data());
    return out;
  };
  control::Controller c;
  c.clip = "a \"quoted\" name, \xC3\xA9";
  c.character = m.character.name;
  c.cyclic = true;
  c.simulation.dt = 1.0 / 700;
  c.steps_per_tick = 10;
  c.tick = c.steps_per_tick * c.simulation.dt;
  c.simulation.friction = 1.0 / 3;
  c.simulation.gravity = 1.62;
  c.simulation.contact_stiffness = 12345.678901234567;
  c.simulation.contact_damping = 500.1;
  c.simulation.damping_depth = 0.0031;
  c.simulation.spring_depth = 0.011;
  c.simulation.bristle_stiffness = 2e4 / 3;
  c.simulation.bristle_damping = 77.7;
  c.simulation.stop_stiffness = 1001.1;
  c.simulation.stop_damping = 13.3;
  c.simulation.joint_speed_limit = 41.5;
  c.simulation.conserve_momentum = false;
  c.shape = {{.swing_foot = true, .root_spin = false, .ankles = true}, 2, 3};
  c.limits = {0.1, 0.7, 0.2};
  c.law = numbers(c.shape.size(), 1);
  c.targets = poses(5);
  c.sensory = numbers(control::full_sensors, 5);
  c.sensory(0, 0) = -0.0;
  c.sensory(1, 0) = 5e-324;
  c.stance = {0, 1, 1, 0, 1};
  c.phase = {0, 0, 1, 2, 2};
  c.reference.poses = poses(6);
  c.reference.velocities = numbers(m.nv, 6);
  c.reference.dt = c.tick;
  control::measure_reference(m, biped().roles, control::tracked_points(m, biped().roles), c.reference);
  c.start_pose = poses(1).col(0);
  c.start_velocity = numbers(m.nv, 1).col(0);
  return c;
}

control::Controller parse(const std::string& text) { return io::parse_controller(text, "file", biped().model, biped().roles); }
std::string refusal(const std::string& text) {
  return error_of([&] { parse(text); });
}
std::string refusal(const Json& json) { return refusal(json.dump()); }

bool same(const control::Controller& a, const control::Controller& b) {
  const sim::Parameters &p = a.simulation, &o = b.simulation;
  const control::FeedbackSets &s = a.shape.sets, &t = b.shape.sets;
  const control::TrackingReference &r = a.reference, &q = b.reference;
  return a.clip == b.clip && a.character == b.character && a.cyclic == b.cyclic && a.tick == b.tick &&
         a.steps_per_tick == b.steps_per_tick && p.dt == o.dt && p.gravity == o.gravity && p.friction == o.friction &&
         p.contact_stiffness == o.contact_stiffness && p.contact_damping == o.contact_damping && p.damping_depth == o.damping_depth && p.spring_depth == o.spring_depth &&
         p.bristle_stiffness == o.bristle_stiffness && p.bristle_damping == o.bristle_damping && p.stop_stiffness == o.stop_stiffness &&
         p.stop_damping == o.stop_damping && p.joint_speed_limit == o.joint_speed_limit && p.conserve_momentum == o.conserve_momentum &&
         a.shape.rank == b.shape.rank && a.shape.phases == b.shape.phases && s.swing_foot == t.swing_foot && s.root_spin == t.root_spin &&
         s.ankles == t.ankles && a.limits.forward == b.limits.forward && a.limits.sideways == b.limits.sideways &&
         a.limits.action == b.limits.action && a.law == b.law && a.targets == b.targets && a.sensory == b.sensory && a.stance == b.stance &&
         a.phase == b.phase && a.start_pose == b.start_pose && a.start_velocity == b.start_velocity && r.dt == q.dt && r.ticks == q.ticks &&
         r.poses == q.poses && r.velocities == q.velocities && r.points == q.points && r.center_of_mass == q.center_of_mass &&
         r.center_velocity == q.center_velocity && r.feet == q.feet && r.heading == q.heading;
}

/// Every field by name, those inside objects with their object's name.
std::vector<std::vector<std::string>> fields(const Json& json) {
  std::vector<std::vector<std::string>> out;
  for (const auto& [name, value] : json.items()) {
    out.push_back({name});
    if (value.is_object())
      for (const auto& [inner, unused] : value.items()) out.push_back({name, inner});
  }
  return out;
}
Json& owner(Json& json, const std::vector<std::string>& path) { return path.size() == 1 ? json : json[path[0]]; }

}  // namespace

TEST_CASE("a controller comes back bit for bit") {
  const control::Controller c = example();
  const std::string text = io::controller_text(c);
  const control::Controller back = parse(text);
  CHECK(same(back, c));
  CHECK(std::signbit(back.sensory(0, 0)));
  CHECK((io::controller_text(back) == text));
}

TEST_CASE("a controller file is written and read") {
  const auto path = std::filesystem::temp_directory_path() / "traceur_controller_file_test.json";
  const control::Controller c = example();
  io::write_controller(path, c);
  CHECK(same(io::read_controller(path, biped().model, biped().roles), c));
  std::filesystem::remove(path);
  CHECK(contains(error_of([&] { io::read_controller(path, biped().model, biped().roles); }), path.string() + ": cannot be opened"));
}

TEST_CASE("every field that is missing or of the wrong kind is named") {
  const Json good = Json::parse(io::controller_text(example()));
  CHECK(refusal(good).empty());
  const auto all = fields(good);
  CHECK(all.size() == 16 + 13 + 9);
  for (const auto& path : all) {
    const std::string& name = path.back();
    CAPTURE(name);
    const std::string quoted = "field '" + name + "'";
    Json json = good;
    owner(json, path).erase(name);
    CHECK(contains(refusal(json), quoted + " is missing"));
    const Json was = owner(json = good, path)[name];
    for (const Json& wrong : {Json("text"), Json(0.5), Json(nullptr), Json(true), Json::array(), Json::object(), Json{{"a"}, {"b"}}}) {
      if (wrong.type() == was.type() && !was.is_array() && !was.is_object() && !(name == "format")) continue;
      if (was.is_number() && wrong.is_number() && was.is_number_float()) continue;
      owner(json = good, path)[name] = wrong;
      const std::string message = refusal(json);
      CAPTURE(wrong.dump());
      // Inside an object that is none, or is empty, the first inner field is what is missed.
      CHECK(contains(message, quoted));
      CHECK(contains(message, "file: "));
      CHECK(message.find('\n') == std::string::npos);
    }
  }
}

TEST_CASE("values that make no controller are refused by name") {
  const Json good = Json::parse(io::controller_text(example()));
  const auto spoiled = [&](auto&& change) {
    Json json = good;
    change(json);
    return refusal(json);
  };
  CHECK(contains(spoiled([](Json& j) { j["format"] = "traceur controller 2"; }), "field 'format': expected 'traceur controller 1'"));
  CHECK(contains(spoiled([](Json& j) { j["tick_s"] = -1; }), "field 'tick_s'"));
  CHECK(contains(spoiled([](Json& j) { j["steps_per_tick"] = 11; }), "field 'tick_s': expected 'steps_per_tick' times 'dt_s'"));
  CHECK(contains(spoiled([](Json& j) { j["steps_per_tick"] = 0; }), "field 'steps_per_tick': expected a whole number from 1"));
  CHECK(contains(spoiled([](Json& j) { j["simulation"]["friction"] = -1; }), "'friction'"));
  CHECK(contains(spoiled([](Json& j) { j["law"]["rank"] = 3; }), "field 'law': field 'parameters', column 0: expected 270 numbers"));
  CHECK(contains(spoiled([](Json& j) { j["law"]["rank"] = 0; }), "field 'rank'"));
  CHECK(contains(spoiled([](Json& j) { j["law"]["limit_action_rad"] = -0.1; }), "field 'limit_action_rad': expected zero or more"));
  CHECK(contains(spoiled([](Json& j) { j["law"]["parameters"].push_back(j["law"]["parameters"][0]); }), "expected one column"));
  CHECK(contains(spoiled([](Json& j) { j["stance"][2] = 2; }), "field 'stance': expected whole numbers from 0 to 1"));
  CHECK(contains(spoiled([](Json& j) { j["phase"][2] = 3; }), "field 'phase': expected whole numbers from 0 to 2"));
  CHECK(contains(spoiled([](Json& j) { j["phase"][2] = 18446744073709551615u; }), "field 'phase'"));
  CHECK(contains(spoiled([](Json& j) { j["phase"].push_back(0); }), "field 'phase': expected 5 whole numbers"));
  CHECK(contains(spoiled([](Json& j) { j["targets"][1][0] = nullptr; }), "field 'targets', column 1: expected finite numbers"));
  CHECK(contains(spoiled([](Json& j) { j["targets"][1].push_back(0); }), "field 'targets', column 1"));
  CHECK(contains(spoiled([](Json& j) { j["targets"][3][6] = 7; }), "field 'targets', column 3: joint 'pelvis'"));
  CHECK(contains(spoiled([](Json& j) { j["reference_poses"][4][6] = 7; }), "field 'reference_poses', column 4"));
  CHECK(contains(spoiled([](Json& j) { j["start_pose"][0][6] = 7; }), "field 'start_pose'"));
  for (const char* name : {"sensory", "reference_poses", "reference_velocities", "start_pose", "start_velocity"})
    CHECK(contains(spoiled([&](Json& j) { j[name].push_back(j[name][0]); }), std::string("field '") + name + "': expected "));
  CHECK(contains(spoiled([](Json& j) { j["targets"] = Json::array(); }), "field 'targets': expected at least one tick"));
}

TEST_CASE("text that is no JSON, or ends early, is refused") {
  const std::string text = io::controller_text(example());
  for (std::size_t n = 0; n + 2 < text.size(); n += 1 + text.size() / 100) CHECK(contains(refusal(text.substr(0, n)), "file:1: not JSON"));
  std::string spoiled = text;
  spoiled.replace(text.find("1.62"), 4, "NaN");
  CHECK(contains(refusal(spoiled), "not JSON"));
  spoiled = text;
  spoiled.replace(text.find("1.62"), 4, "1e999");
  CHECK(contains(refusal(spoiled), "not JSON"));
  CHECK(contains(refusal(std::string("[1, 2]")), "file: expected an object"));
  CHECK(contains(refusal(text + std::string("\0{}", 3)), "not JSON: did not expect a null byte"));
}

TEST_CASE("a controller of another character is refused by the field that does not fit") {
  body::Character other = figures::biped();
  body::Joint hat;
  hat.name = hat.body = "hat";
  hat.parent = other.skeleton.find("neck");
  hat.offset = {0, 0, 0.2};
  other.skeleton.add(hat);
  other.inertias.push_back(other.inertias.back());
  other.actuators.emplace_back();
  const sim::Model model = sim::make_model(other);
  const control::Roles roles = control::find_roles(model);
  const std::string message = error_of([&] { io::parse_controller(io::controller_text(example()), "file", model, roles); });
  CHECK(contains(message, "file: field 'targets', column 0: expected " + std::to_string(model.nq) + " numbers"));
}

TEST_CASE("what could not be read again is not written") {
  control::Controller c = example();
  c.law[3] = std::nan("");
  CHECK(contains(error_of([&] { io::controller_text(c); }), "field 'parameters': expected finite numbers"));
  c = example();
  c.sensory(2, 2) = INFINITY;
  CHECK(contains(error_of([&] { io::controller_text(c); }), "field 'sensory'"));
  c = example();
  c.clip = "bytes \xff\xfe";
  CHECK(contains(parse(io::controller_text(c)).clip, "bytes "));
}
