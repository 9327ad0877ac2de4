// SPDX-License-Identifier: MIT
#include <traceur/control/skill_player.hpp>

#include <doctest/doctest.h>

#include <cmath>

#include "moving_gait.hpp"

using namespace figures;

namespace {

struct Play {
  const Figure& f = small();
  control::Controller running = any_controller(f, 20, true, 3, 1), leap = any_controller(f, 30, false, 3, 2, {{}, 3, 2});
  control::Skill gait{control::MotionTable(f.model, f.roles, running, {1.0}), {running.shape, 2}, running.limits};
  control::Skill once{control::MotionTable(f.model, f.roles, leap, {1.0}), {leap.shape, 2}, leap.limits};
  Eigen::VectorXd run = gait.shape.neutral(running.law), jump = once.shape.neutral(leap.law);
  control::SkillPlayer player;
  Play() { player.know(f.model); }

  Eigen::VectorXf moment() const {
    Eigen::VectorXf out(player.skill().table.layout().size());
    player.sample(out.data());
    return out;
  }
};

/// World place of the reference's centre of mass (x, y, z), and its velocity.
std::array<Vector, 2> world_center(const control::SkillPlayer& p, const Eigen::VectorXf& m) {
  const control::MomentLayout& l = p.skill().table.layout();
  const auto turned = [&](int row, double add) {
    const double x = m[row] + add, y = m[row + 1], c = std::cos(p.frame().heading), s = std::sin(p.frame().heading);
    return Vector{c * x - s * y, s * x + c * y, static_cast<double>(m[row + 2])};
  };
  return {turned(l.center(), 0) + Vector{p.frame().x, p.frame().y, p.frame().z}, turned(l.velocity(), p.speed())};
}

}  // namespace

TEST_CASE("a gait's frame runs along an arc at the speed it is steered with") {
  Play s;
  s.player.start(s.gait, s.run.data(), {0.3, 1, 2, 0.5});
  s.player.steer(3, 0.4);
  for (int t = 0; t < 600; ++t) s.player.advance(1.0 / 600);
  CHECK(s.player.phase() == doctest::Approx(60));
  CHECK(s.player.frame().heading == doctest::Approx(0.7));
  // One second of an arc of radius v / w.
  const double r = 3 / 0.4;
  CHECK(s.player.frame().x == doctest::Approx(1 + r * (std::sin(0.7) - std::sin(0.3))).epsilon(1e-5));
  CHECK(s.player.frame().y == doctest::Approx(2 - r * (std::cos(0.7) - std::cos(0.3))).epsilon(1e-5));
  CHECK(s.player.frame().z == 0.5);
}

TEST_CASE("beta stretches the clock") {
  Play s;
  s.run[s.gait.shape.beta()] = 1.25;
  s.player.start(s.gait, s.run.data(), {});
  for (int t = 0; t < 30; ++t) s.player.advance(1.0 / 60);
  CHECK(s.player.phase() == doctest::Approx(30 / 1.25));
}

TEST_CASE("law and offset in force are those of the phase and the stance") {
  Play s;
  s.player.start(s.gait, s.run.data(), {}, 4);
  Eigen::VectorXf out(s.gait.table.layout().size());
  CHECK(s.player.sample(out.data()).offset == s.run.data() + s.gait.shape.offset(0));
  s.player.start(s.gait, s.run.data(), {}, 14);
  CHECK(s.player.sample(out.data()).stance == 1);
  CHECK(s.player.sample(out.data()).offset == s.run.data() + s.gait.shape.offset(1));
  s.player.start(s.once, s.jump.data(), {}, 20);
  CHECK(s.player.sample(out.data()).law == s.jump.data() + s.once.shape.law.phase_size());
  CHECK_FALSE(s.player.ended());
  s.player.advance(0.2);
  CHECK(s.player.ended());
}

TEST_CASE("blending begins with the old reference, ends with the new one, and jumps nowhere") {
  Play s;
  s.player.start(s.gait, s.run.data(), {0.4, 1, 2, 0}, 3);
  s.player.steer(3, 0.2);
  const auto before = world_center(s.player, s.moment());
  const Eigen::VectorXf old = s.moment();
  s.player.pass_to(s.once, s.jump.data(), {0.9, 0.5, 2.5, 0.3}, 0, 0.2);
  // The same place and velocity in the world, though told in another frame; the same joints.
  const auto after = world_center(s.player, s.moment());
  CHECK(apart(before[0], after[0]) < 1e-5);
  CHECK(apart(before[1], after[1]) < 1e-5);
  const Eigen::VectorXf now = s.moment();
  CHECK((old.head(s.gait.table.layout().joints) - now.head(s.gait.table.layout().joints)).norm() < 1e-5f);
  Eigen::VectorXf last = now;
  for (int t = 0; t < 25; ++t) {
    s.player.advance(1.0 / 120);
    const Eigen::VectorXf m = s.moment();
    CHECK((m - last).cwiseAbs().maxCoeff() < 0.5f);
    last = m;
  }
  CHECK_FALSE(s.player.blending());
  Eigen::VectorXf alone(last.size());
  s.once.table.sample(1, 1, s.player.phase(), alone.data());
  CHECK(last == alone);
}

TEST_CASE("in the middle of a blend numbers are half of each") {
  Play s;
  s.player.start(s.once, s.jump.data(), {}, 0);
  s.player.pass_to(s.once, s.jump.data(), {}, 6, 0.2);
  for (int t = 0; t < 6; ++t) s.player.advance(1.0 / 60);
  Eigen::VectorXf a(s.once.table.layout().size()), b = a;
  s.once.table.sample(1, 1, 6, a.data());
  s.once.table.sample(1, 1, 12, b.data());
  const int from = s.once.table.layout().center();
  CHECK((s.moment() - 0.5f * (a + b)).segment(from, 12).norm() < 1e-5f);
}

TEST_CASE("without time to blend the change is at once") {
  Play s;
  s.player.start(s.gait, s.run.data(), {}, 3);
  s.player.pass_to(s.once, s.jump.data(), {}, 2, 0);
  Eigen::VectorXf alone(s.once.table.layout().size());
  s.once.table.sample(1, 1, 2, alone.data());
  CHECK(s.moment() == alone);
}

TEST_CASE("a frame is moved no farther than it must") {
  const control::FeedbackLimits limits;
  const control::SkillFrame f{0.5, 1, 2, 3};
  const auto at = [&](double ahead, double aside) {
    return control::near_frame(f, f.x + ahead * std::cos(0.5) - aside * std::sin(0.5), f.y + ahead * std::sin(0.5) + aside * std::cos(0.5), limits);
  };
  CHECK(at(0.2, -0.4).x == doctest::Approx(f.x));
  const control::SkillFrame moved = at(0.8, 0);
  CHECK(moved.x == doctest::Approx(f.x + 0.5 * std::cos(0.5)));
  CHECK(moved.y == doctest::Approx(f.y + 0.5 * std::sin(0.5)));
  CHECK(moved.heading == 0.5);
  CHECK(moved.z == 3);
  CHECK(at(0, -0.7).x == doctest::Approx(f.x + 0.2 * std::sin(0.5)));
}
