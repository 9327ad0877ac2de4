// SPDX-License-Identifier: MIT
#include <traceur/control/roles.hpp>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace figures;

namespace {

/// The character with joints and bodies of other names, and on request with left and right exchanged.
body::Character disguised(const body::Character& c, bool reflected) {
  body::Character out = c;
  out.skeleton = {};
  for (int i = 0; i < c.skeleton.size(); ++i) {
    body::Joint j = c.skeleton[i];
    j.name = "j" + std::to_string(97 * i % 101);
    j.body = "b" + std::to_string(89 * i % 101);
    if (reflected) j.offset = control::mirrored_vector(j.offset);
    out.skeleton.add(j);
  }
  return out;
}

/// The character without the bodies that `drop` picks and all that hangs on them.
template <class Drop>
body::Character without(const body::Character& c, Drop&& drop) {
  body::Character out;
  out.name = c.name;
  std::vector<int> place(static_cast<std::size_t>(c.skeleton.size()), -1);
  for (int i = 0; i < c.skeleton.size(); ++i) {
    body::Joint j = c.skeleton[i];
    if (drop(j.name) || (j.parent >= 0 && place[static_cast<std::size_t>(j.parent)] < 0)) continue;
    if (j.parent >= 0) j.parent = place[static_cast<std::size_t>(j.parent)];
    place[static_cast<std::size_t>(i)] = out.skeleton.add(j);
    out.inertias.push_back(c.inertias[static_cast<std::size_t>(i)]);
    out.actuators.push_back(c.actuators[static_cast<std::size_t>(i)]);
  }
  return out;
}

std::string refusal(const body::Character& c) {
  return error_of([&] { control::find_roles(sim::make_model(c)); });
}

}  // namespace

TEST_CASE("the humanoid's roles are the joints a reader of names would take") {
  const Figure& f = humanoid();
  const control::Roles& r = f.roles;
  CHECK(r.legs[0].hip == body_of(f, "right_hip"));
  CHECK(r.legs[0].knee == body_of(f, "right_knee"));
  CHECK(r.legs[0].foot == body_of(f, "right_ankle"));
  CHECK(r.legs[1].hip == body_of(f, "left_hip"));
  CHECK(r.legs[1].knee == body_of(f, "left_knee"));
  CHECK(r.legs[1].foot == body_of(f, "left_ankle"));
  CHECK(r.waist == body_of(f, "abdomen"));
  CHECK(r.upper_trunk.empty());
  CHECK(r.head == std::vector<int>{body_of(f, "neck")});
  REQUIRE(r.mirror.size() == f.model.bodies.size());
  CHECK(r.mirror[static_cast<std::size_t>(body_of(f, "abdomen"))] == body_of(f, "abdomen"));
  for (const char* joint : {"shoulder", "elbow", "hip", "knee", "ankle"}) {
    const int right = body_of(f, std::string("right_") + joint), left = body_of(f, std::string("left_") + joint);
    CHECK(r.mirror[static_cast<std::size_t>(right)] == left);
    CHECK(r.mirror[static_cast<std::size_t>(left)] == right);
    const bool leg = std::string(joint) != "shoulder" && std::string(joint) != "elbow";
    CHECK(r.is_leg(right) == leg);
    CHECK(r.is_leg(left) == leg);
  }
  CHECK_FALSE(r.is_leg(r.waist));
  CHECK_FALSE(r.is_leg(0));
}

TEST_CASE("roles follow the tree, not its names") {
  for (const body::Character& c : {humanoid().model.character, biped()}) {
    const control::Roles a = control::find_roles(sim::make_model(c));
    const control::Roles b = control::find_roles(sim::make_model(disguised(c, false)));
    const control::Roles m = control::find_roles(sim::make_model(disguised(c, true)));
    for (std::size_t side = 0; side < 2; ++side) {
      CHECK(b.legs[side].hip == a.legs[side].hip);
      CHECK(b.legs[side].knee == a.legs[side].knee);
      CHECK(b.legs[side].foot == a.legs[side].foot);
      CHECK(m.legs[1 - side].hip == a.legs[side].hip);
      CHECK(m.legs[1 - side].knee == a.legs[side].knee);
      CHECK(m.legs[1 - side].foot == a.legs[side].foot);
    }
    for (const control::Roles& r : {b, m}) {
      CHECK(r.waist == a.waist);
      CHECK(r.upper_trunk == a.upper_trunk);
      CHECK(r.head == a.head);
      CHECK(r.mirror == a.mirror);
    }
  }
}

TEST_CASE("a trunk of two joints ends where the arms begin; hands below the root are no feet") {
  const Figure& f = small();
  CHECK(f.roles.waist == body_of(f, "spine"));
  CHECK(f.roles.upper_trunk == std::vector<int>{body_of(f, "chest")});
  CHECK(f.roles.head == std::vector<int>{body_of(f, "neck")});
  CHECK(f.roles.legs[0].hip == body_of(f, "right hip"));
  CHECK(f.roles.legs[0].knee == body_of(f, "right knee"));
  CHECK(f.roles.legs[0].foot == body_of(f, "right ankle"));
  CHECK(f.roles.legs[1].foot == body_of(f, "left ankle"));
  CHECK(f.roles.mirror[static_cast<std::size_t>(body_of(f, "left wrist"))] == body_of(f, "right wrist"));
}

TEST_CASE("what is no biped is refused") {
  CHECK(contains(refusal(without(humanoid().model.character, [](const std::string& n) { return n != "root"; })), "character 'humanoid': expected two legs"));
  CHECK(contains(refusal(without(humanoid().model.character, [](const std::string& n) { return n == "left_hip"; })), "expected two legs"));
  CHECK(contains(refusal(without(humanoid().model.character, [](const std::string& n) { return n == "left_ankle"; })), "at least three joints"));
  CHECK(contains(refusal(without(humanoid().model.character, [](const std::string& n) { return n == "abdomen"; })), "expected a trunk"));
  CHECK(refusal(without(humanoid().model.character, [](const std::string&) { return false; })).empty());
  body::Character fixed;
  for (int i = 0; i < humanoid().model.character.skeleton.size(); ++i) {
    body::Joint j = humanoid().model.character.skeleton[i];
    if (i == 0) j.type = body::JointType::fixed;
    fixed.skeleton.add(j);
  }
  fixed.inertias = humanoid().model.character.inertias;
  fixed.actuators = humanoid().model.character.actuators;
  CHECK(contains(refusal(fixed), "expected a free root"));
}
