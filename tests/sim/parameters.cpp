// SPDX-License-Identifier: MIT
#include <traceur/sim/parameters.hpp>

#include <cmath>
#include <limits>
#include <string>

#include <doctest/doctest.h>

using traceur::sim::Parameters;

TEST_CASE("parameters: the defaults are in range") { CHECK_NOTHROW(Parameters{}.check()); }

TEST_CASE("parameters: the message names the field at fault") {
  const auto refused = [](auto change, const std::string& name) {
    Parameters p;
    change(p);
    std::string what;
    try {
      p.check();
    } catch (const traceur::Error& e) {
      what = e.what();
    }
    CHECK_MESSAGE(what.find("'" + name + "'") != std::string::npos, what);
  };
  const double nan = std::nan(""), infinity = std::numeric_limits<double>::infinity();
  refused([&](Parameters& p) { p.dt = 0; }, "dt");
  refused([&](Parameters& p) { p.dt = nan; }, "dt");
  refused([&](Parameters& p) { p.gravity = -9.81; }, "gravity");
  refused([&](Parameters& p) { p.friction = -1; }, "friction");
  refused([&](Parameters& p) { p.contact_stiffness = infinity; }, "contact_stiffness");
  refused([&](Parameters& p) { p.contact_damping = nan; }, "contact_damping");
  refused([&](Parameters& p) { p.spring_depth = 0; }, "spring_depth");
  refused([&](Parameters& p) { p.damping_depth = 0; }, "damping_depth");
  refused([&](Parameters& p) { p.grip_stiffness = -1; }, "grip_stiffness");
  refused([&](Parameters& p) { p.grip_damping = nan; }, "grip_damping");
  refused([&](Parameters& p) { p.self_stiffness = -1; }, "self_stiffness");
  refused([&](Parameters& p) { p.self_damping = nan; }, "self_damping");
  refused([&](Parameters& p) { p.bristle_stiffness = -1; }, "bristle_stiffness");
  refused([&](Parameters& p) { p.bristle_damping = -1; }, "bristle_damping");
  refused([&](Parameters& p) { p.stop_stiffness = nan; }, "stop_stiffness");
  refused([&](Parameters& p) { p.stop_damping = -1; }, "stop_damping");
  refused([&](Parameters& p) { p.joint_speed_limit = 0; }, "joint_speed_limit");
}
