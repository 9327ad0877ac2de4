// SPDX-License-Identifier: MIT
#include <traceur/control/regulator_practice.hpp>

#include <Eigen/SVD>
#include <doctest/doctest.h>

#include "moving_gait.hpp"

using namespace figures;

namespace {

using S = core::Pack<float, 4>;

struct Nothing {
  template <class L>
  void operator()(L&, int) const noexcept {}
};

Eigen::MatrixXd any(core::RandomStream& random, int rows, int columns) {
  Eigen::MatrixXd m(rows, columns);
  for (double& x : m.reshaped()) x = random.uniform(-1.0, 1.0);
  return m;
}

/// The humanoid as it is held up by the ground, knees a little bent, by motors that know nothing of balance.
struct Standing {
  const Figure& f = humanoid();
  sim::Parameters parameters;
  sim::Ground<float> ground;
  control::SimulatedMotion motion;
  static constexpr int steps = 8;

  explicit Standing(int ticks) {
    Eigen::VectorXd q = f.skeleton().neutral_pose();
    sim::Lanes<S> lanes(f.model, parameters, ground);
    // What it comes to within a tenth of a second is where it is kept.
    put(lanes, 0, q, at_rest(f));
    lanes.refresh();
    motion.targets = q.replicate(1, ticks);
    motion.poses.resize(f.model.nq, ticks + 1);
    motion.velocities.resize(f.model.nv, ticks + 1);
    for (int t = -6; t <= ticks; ++t) {
      if (t >= 0) {
        for (int i = 0; i < f.model.nq; ++i) motion.poses(i, t) = core::lane_of(lanes.q()[i], 0);
        for (int i = 0; i < f.model.nv; ++i) motion.velocities(i, t) = core::lane_of(lanes.v()[i], 0);
        body::normalize(f.skeleton(), motion.poses.col(t).data());
      }
      for (int i = 7; i < f.model.nq; ++i) lanes.target()[i] = S(static_cast<float>(q[i]));
      lanes.step(steps);
    }
  }
  using Practice = control::RegulatorPractice<S, Nothing>;
  Practice practice(const control::PracticeSettings& settings) const {
    // Steps this large tell little of what small corrections do.
    control::RegulatorSettings regulator;
    regulator.pose_step = 0.3;
    regulator.velocity_step = 3;
    regulator.target_step = 0.75;
    return {f.model, f.roles, parameters, ground, {}, motion, motion.ticks(), steps, regulator, settings, {}};
  }
  /// The first pose, pushed along each axis by `push` m/s, more or less by `spread`.
  auto pushed(double push, double spread) const {
    return [this, push, spread](core::RandomStream& random) {
      control::PracticeStart s{{motion.poses.col(0), motion.velocities.col(0)}};
      for (int i = 0; i < 2; ++i) s.velocity[i] += push + spread * random.uniform(-1.0, 1.0);
      return s;
    };
  }
  control::PractisedRegulator practise(const control::PracticeSettings& settings, core::ThreadExecutor& executor, double push) const {
    return practice(settings).run(pushed(0, push), executor);
  }
};

}  // namespace

TEST_CASE("what is linear is found as it is, whatever was believed, and nothing seen leaves what was believed") {
  core::RandomStream random(4, 1);
  const control::LinearizedTick truth{any(random, 4, 4), any(random, 4, 2)}, belief{any(random, 4, 4), any(random, 4, 2)};
  const Eigen::VectorXd always = any(random, 4, 1);
  control::TickRegression r(belief, Eigen::VectorXd::Constant(6, 1e-6));
  CHECK((r.solve().a - belief.a).norm() == 0);
  for (int k = 0; k < 3; ++k) {
    const Eigen::MatrixXd x = any(random, 4, 20), u = any(random, 2, 20);
    r.add(x, u, (truth.a * x + truth.b * u).colwise() + always);
  }
  CHECK((r.solve().a - truth.a).norm() < 1e-5);
  CHECK((r.solve().b - truth.b).norm() < 1e-5);
  r.forget(0);
  CHECK((r.solve().b - belief.b).norm() == 0);
}

TEST_CASE("a belief counts for as many squares as its ridge has") {
  // Seen at x = 1 and -1, which a constant has no part in: a = (ridge a0 + 2 a1) / (ridge + 2).
  control::TickRegression r({Eigen::MatrixXd::Constant(1, 1, 3), Eigen::MatrixXd::Zero(1, 1)}, Eigen::Vector2d(6, 1));
  const Eigen::MatrixXd x = Eigen::RowVector2d(1, -1);
  r.add(x, Eigen::MatrixXd::Zero(1, 2), 7 * x);
  CHECK(r.solve().a(0, 0) == doctest::Approx((6.0 * 3 + 2 * 7) / (6 + 2)));
  // Half forgotten: as if seen once.
  r.forget(0.5);
  CHECK(r.solve().a(0, 0) == doctest::Approx((6.0 * 3 + 7) / (6 + 1)));
  CHECK_THROWS_AS(control::TickRegression({x, x}, Eigen::Vector2d(1, 1)), traceur::Error);
  CHECK_THROWS_AS(r.add(x, x, Eigen::MatrixXd::Zero(2, 2)), traceur::Error);
}

TEST_CASE("a reduced gain is off by the singular values left out, and no other of its rank by less") {
  core::RandomStream random(5, 1);
  const Eigen::MatrixXd k = any(random, 6, 11);
  const Eigen::VectorXd values = Eigen::JacobiSVD<Eigen::MatrixXd>(k).singularValues();
  for (const int rank : {1, 3, 5}) {
    const control::Gain g = control::reduced_gain(k, rank);
    CHECK(g.left.cols() == rank);
    CHECK(g.inputs() == 11);
    CHECK((k - (g.left * g.right).cast<double>()).norm() == doctest::Approx(values.tail(6 - rank).norm()).epsilon(1e-5));
  }
  CHECK(control::reduced_gain(k, 0).right.size() == 0);
  CHECK((control::reduced_gain(k, 6).left.cast<double>() - k).norm() < 1e-5);
  CHECK_THROWS_AS(control::reduced_gain(k, -1), traceur::Error);
}

TEST_CASE("practice keeps a pushed figure on its motion from more starts than differences about it do, the same in any number of threads") {
  const Standing s(60);
  control::PracticeSettings settings;
  settings.rollouts = 256;
  settings.trials = 128;
  settings.rank = 0;
  settings.prior = 4;
  settings.most_sunk = 0.1;
  settings.most_tilt = 0.5;
  core::ThreadExecutor one(1), two(2);
  settings.rounds = 0;
  const auto before = s.practise(settings, two, 3);
  CHECK(before.round == 0);
  settings.rounds = 3;
  const auto after = s.practise(settings, two, 3), alone = s.practise(settings, one, 3);
  MESSAGE("kept from " << before.share << " of starts, after practice from " << after.share);
  CHECK(after.share > before.share + 0.1);
  CHECK(after.round > 0);
  REQUIRE(after.gains.size() == 60);
  CHECK(alone.share == after.share);
  CHECK(alone.gains.back().left == after.gains.back().left);
  CHECK(alone.gains.front().left == after.gains.front().left);
}

TEST_CASE("refined targets keep to its motion a figure that is always pushed one way, from starts that refinement did not see") {
  Standing s(60);
  control::PracticeSettings settings;
  settings.trials = 128;
  settings.rank = 0;
  settings.most_sunk = 0.1;
  settings.most_tilt = 0.5;
  settings.rounds = 0;
  core::ThreadExecutor one(1), two(2);
  const auto begin = s.pushed(2.5, 0.5);
  const auto practised = s.practice(settings).run(begin, two);
  control::RefinementSettings refinement;
  refinement.population = 24;
  refinement.starts = 16;
  refinement.knots = 3;
  refinement.generations = 30;
  const auto refined = s.practice(settings).refine(practised.gains, refinement, begin, two);
  CHECK(refined.generation > 0);
  refinement.generations = 5;
  const auto shorter = s.practice(settings).refine(practised.gains, refinement, begin, two), alone = s.practice(settings).refine(practised.gains, refinement, begin, one);
  CHECK(shorter.share == alone.share);
  CHECK(shorter.targets == alone.targets);
  // Others judge, and nothing is refined.
  settings.seed = 2;
  refinement.generations = 0;
  const auto before = s.practice(settings).refine(practised.gains, refinement, begin, two);
  CHECK(before.targets == s.motion.targets);
  s.motion.targets = refined.targets;
  const auto after = s.practice(settings).refine(practised.gains, refinement, begin, two);
  MESSAGE("kept from " << before.share << " of starts, with refined targets from " << after.share);
  CHECK(after.share > before.share + 0.2);
  for (const auto spoil : {+[](control::RefinementSettings& r) { r.knots = 1; }, +[](control::RefinementSettings& r) { r.population = 1; },
                           +[](control::RefinementSettings& r) { r.starts = 0; }, +[](control::RefinementSettings& r) { r.sigma = 0; }}) {
    control::RefinementSettings r = refinement;
    spoil(r);
    CHECK_THROWS_AS(s.practice(settings).refine(practised.gains, r, begin, one), traceur::Error);
  }
}

TEST_CASE("practice of nothing is refused") {
  const Standing s(3);
  core::ThreadExecutor one(1);
  control::PracticeSettings settings;
  for (const auto spoil : {+[](control::PracticeSettings& p) { p.rollouts = 0; }, +[](control::PracticeSettings& p) { p.trials = 0; },
                           +[](control::PracticeSettings& p) { p.noise = 0; }, +[](control::PracticeSettings& p) { p.prior = 0; }}) {
    control::PracticeSettings p = settings;
    spoil(p);
    CHECK_THROWS_AS(s.practise(p, one, 0), traceur::Error);
  }
  const control::RegulatorSettings regulator;
  CHECK_THROWS_WITH((control::RegulatorPractice<S, Nothing>(s.f.model, s.f.roles, s.parameters, s.ground, {}, s.motion, 4, 8, regulator, settings, {})),
                    "practice: expected 1 to 3 ticks");
}
