// SPDX-License-Identifier: MIT
#include <traceur/control/tracking_regulator.hpp>

#include <doctest/doctest.h>

#include "moving_gait.hpp"

using namespace figures;

namespace {

using S = core::Pack<float, 4>;

struct Nothing {
  template <class L>
  void operator()(L&, int) const noexcept {}
};

/// The humanoid let fall without weight, joints held by its motors: every pose is in balance.
struct Floating {
  const Figure& f = humanoid();
  sim::Parameters parameters;
  sim::Ground<float> ground;
  int steps = 8;
  control::SimulatedMotion motion;

  explicit Floating(int ticks) {
    parameters.gravity = 0;
    // At rest knees and elbows are at their stops, which push one way only.
    Eigen::VectorXd q = f.skeleton().neutral_pose(), bend = Eigen::VectorXd::Constant(f.model.nv, 0.0);
    for (const sim::MovingBody& b : f.model.bodies)
      if (b.type == body::JointType::hinge) bend[b.v_index] = 0.6;
    body::displace(f.skeleton(), q.data(), bend.data(), q.data());
    q[2] = 5;
    motion.targets = q.replicate(1, ticks);
    motion.poses = q.replicate(1, ticks + 1);
    motion.velocities = Eigen::MatrixXd::Zero(f.model.nv, ticks + 1);
  }
  std::vector<control::LinearizedTick> linearized(const control::RegulatorSettings& settings = {}) const {
    sim::Lanes<S> lanes(f.model, parameters, ground);
    return control::linearize(lanes, f.model, motion, steps, settings, Nothing{});
  }
  std::vector<Eigen::MatrixXd> gains(const control::RegulatorSettings& settings = {}) const {
    return control::regulator_gains(linearized(settings), control::regulator_costs(f.model, settings, motion.ticks()), settings.effort);
  }
  control::TrackingRegulator regulator(const std::vector<Eigen::MatrixXd>& k) const { return {f.model, f.roles, {1}, {motion}, {k}}; }
};

}  // namespace

TEST_CASE("the gain of x' = x + u with unit costs comes to one over the golden ratio, and the last one to p / (1 + p)") {
  const control::LinearizedTick tick{Eigen::MatrixXd::Ones(1, 1), Eigen::MatrixXd::Ones(1, 1)};
  Eigen::MatrixXd costs = Eigen::MatrixXd::Ones(1, 61);
  costs(0, 60) = 3;
  const auto gains = control::regulator_gains(std::vector<control::LinearizedTick>(60, tick), costs, 1);
  CHECK(gains.front()(0, 0) == doctest::Approx(2 / (1 + std::sqrt(5.0))).epsilon(1e-12));
  CHECK(gains.back()(0, 0) == doctest::Approx(3.0 / 4));
}

TEST_CASE("gains cost no more than any gains near them") {
  core::RandomStream random(3, 1);
  const auto any = [&](int rows, int columns) {
    Eigen::MatrixXd m(rows, columns);
    for (double& x : m.reshaped()) x = random.uniform(-1.0, 1.0);
    return m;
  };
  std::vector<control::LinearizedTick> ticks;
  for (int t = 0; t < 5; ++t) ticks.push_back({any(4, 4), any(4, 2)});
  const Eigen::VectorXd costs = Eigen::Vector4d(1, 0.3, 2, 0.1);
  Eigen::MatrixXd of_ticks = costs.replicate(1, 6);
  of_ticks.col(2) *= 3;
  of_ticks.col(5) *= 2;
  const auto gains = control::regulator_gains(ticks, of_ticks, 0.5);
  const Eigen::VectorXd start = any(4, 1);
  const auto cost = [&](const std::vector<Eigen::MatrixXd>& k) {
    Eigen::VectorXd x = start;
    double sum = 0;
    for (std::size_t t = 0; t < ticks.size(); ++t) {
      const Eigen::VectorXd u = -k[t] * x;
      sum += x.dot(of_ticks.col(static_cast<Eigen::Index>(t)).cwiseProduct(x)) + 0.5 * u.squaredNorm();
      x = ticks[t].a * x + ticks[t].b * u;
    }
    return sum + x.dot(of_ticks.col(5).cwiseProduct(x));
  };
  const double least = cost(gains);
  for (int k = 0; k < 20; ++k) {
    auto other = gains;
    other[static_cast<std::size_t>(k % 5)] += 0.1 * any(2, 4);
    CHECK(cost(other) >= least - 1e-9 * least);
  }
}

TEST_CASE("where it is done costs nothing from the tick on from which that is all one") {
  const Floating s(2);
  control::RegulatorSettings settings;
  settings.place_until = 3;
  const Eigen::MatrixXd costs = control::regulator_costs(s.f.model, settings, 6), all = control::regulator_costs(s.f.model, {}, 6);
  REQUIRE(costs.cols() == 7);
  CHECK(costs.leftCols(3) == all.leftCols(3));
  CHECK(costs.topRightCorner(2, 4).isZero(0));
  CHECK(costs.bottomRightCorner(costs.rows() - 2, 4) == all.bottomRightCorner(costs.rows() - 2, 4));
  CHECK(all.col(6) == settings.last * all.col(0));
  CHECK_THROWS_WITH(control::regulator_gains(s.linearized(), all.leftCols(2), 1), "regulator: expected costs of every tick and of the end");
}

TEST_CASE("linearized without weight or contact, the root's place and velocity go on as Newton has it") {
  const Floating s(2);
  const auto ticks = s.linearized();
  const double dt = s.steps * s.parameters.dt;
  const int nv = s.f.model.nv;
  for (const auto& t : ticks) {
    const Eigen::Matrix3d place = t.a.block(0, 0, 3, 3), by_velocity = t.a.block(0, nv, 3, 3), velocity = t.a.block(nv, nv, 3, 3);
    CHECK((place - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-3);
    CHECK((by_velocity - dt * Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-4);
    CHECK((velocity - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < 1e-3);
    // Motors cannot move the whole of it.
    CHECK(t.b.rows() == 2 * nv);
    CHECK(t.b.cols() == nv - 6);
    CHECK(t.b.cwiseAbs().maxCoeff() > 0.1);
  }
}

TEST_CASE("linearized, what follows a small step is what the simulator does") {
  const Floating s(1);
  control::RegulatorSettings settings;
  settings.pose_step = settings.target_step = 0.01;
  settings.velocity_step = 0.05;
  const auto tick = s.linearized(settings)[0];
  const int nv = s.f.model.nv;
  core::RandomStream random(5, 5);
  Eigen::VectorXd x(2 * nv), q = s.motion.poses.col(0), v(nv), d(nv);
  for (double& e : x) e = 0.01 * random.uniform(-1.0, 1.0);
  body::displace(s.f.skeleton(), q.data(), x.data(), q.data());
  v = x.tail(nv);
  sim::Lanes<S> lanes(s.f.model, s.parameters, s.ground);
  for (int l = 0; l < 4; ++l) put(lanes, l, q, v);
  lanes.refresh();
  for (int l = 0; l < 4; ++l)
    for (int i = 7; i < s.f.model.nq; ++i) core::set_lane(lanes.target()[i], l, static_cast<float>(s.motion.targets(i, 0)));
  lanes.step(s.steps);
  Eigen::VectorXd after(s.f.model.nq), spin(nv);
  for (int i = 0; i < s.f.model.nq; ++i) after[i] = core::lane_of(lanes.q()[i], 0);
  for (int i = 0; i < nv; ++i) spin[i] = core::lane_of(lanes.v()[i], 0);
  body::difference(s.f.skeleton(), s.motion.poses.col(1).data(), after.data(), d.data());
  Eigen::VectorXd found(2 * nv);
  found << d, spin;
  CHECK((found - tick.a * x).norm() < 0.05 * found.norm());
}

TEST_CASE("who is on the motion gets the targets as they are, who is off it is brought back") {
  const Floating s(30);
  const auto gains = s.gains();
  const control::TrackingRegulator regulator = s.regulator(gains);
  CHECK(regulator.ticks() == 30);
  auto scratch = control::TrackingRegulator::scratch(s.f.model);
  const Eigen::VectorXd rest = at_rest(s.f);
  Eigen::VectorXd off = Eigen::VectorXd::Zero(s.f.model.nv), bent = s.motion.poses.col(0);
  off[8] = 0.3;
  body::displace(s.f.skeleton(), bent.data(), off.data(), bent.data());
  const auto run = [&](bool regulated) {
    sim::Lanes<S> lanes(s.f.model, s.parameters, s.ground);
    for (int l = 0; l < 4; ++l) put(lanes, l, l == 0 ? Eigen::VectorXd(s.motion.poses.col(0)) : bent, rest);
    lanes.refresh();
    double cost = 0;
    const Eigen::VectorXd costs = control::regulator_costs(s.f.model, {}, 1).col(0);
    Eigen::VectorXd q(s.f.model.nq), d(s.f.model.nv), x(2 * s.f.model.nv);
    for (int t = 0; t < 30; ++t) {
      for (int l = 0; l < 4; ++l) {
        for (int i = 7; i < s.f.model.nq; ++i) core::set_lane(lanes.target()[i], l, static_cast<float>(s.motion.targets(i, t)));
        if (regulated) regulator.apply(lanes, l, 1, t, {}, false, scratch);
      }
      if (t == 0)
        for (int i = 7; i < s.f.model.nq; ++i) CHECK(core::lane_of(lanes.target()[i], 0) == doctest::Approx(s.motion.targets(i, 0)).epsilon(1e-4));
      lanes.step(s.steps);
      for (int i = 0; i < s.f.model.nq; ++i) q[i] = core::lane_of(lanes.q()[i], 1);
      body::difference(s.f.skeleton(), s.motion.poses.col(t + 1).data(), q.data(), d.data());
      for (int i = 0; i < s.f.model.nv; ++i) x[s.f.model.nv + i] = core::lane_of(lanes.v()[i], 1);
      x.head(s.f.model.nv) = d;
      cost += x.dot(costs.cwiseProduct(x));
    }
    return cost;
  };
  const double alone = run(false), held = run(true);
  CHECK(held < alone);
}

TEST_CASE("in the mirror and in another place, corrections are the mirrored and the same ones") {
  const Floating s(2);
  const auto gains = s.gains();
  const control::TrackingRegulator regulator = s.regulator(gains);
  auto scratch = control::TrackingRegulator::scratch(s.f.model);
  core::RandomStream random(9, 2);
  Eigen::VectorXd d(s.f.model.nv), v(s.f.model.nv), q = s.motion.poses.col(0);
  for (double& x : d) x = 0.1 * random.uniform(-1.0, 1.0);
  for (double& x : v) x = 0.3 * random.uniform(-1.0, 1.0);
  body::displace(s.f.skeleton(), q.data(), d.data(), q.data());
  sim::Lanes<S> lanes(s.f.model, s.parameters, s.ground);
  const auto targets = [&](const Eigen::VectorXd& pose, const Eigen::VectorXd& velocity, const control::SkillFrame& frame, bool mirror) {
    put(lanes, 0, pose, velocity);
    lanes.refresh();
    Eigen::VectorXd t = s.motion.targets.col(0);
    for (int i = 7; i < s.f.model.nq; ++i) core::set_lane(lanes.target()[i], 0, static_cast<float>(t[i]));
    regulator.apply(lanes, 0, 1, 0, frame, mirror, scratch);
    for (int i = 7; i < s.f.model.nq; ++i) t[i] = core::lane_of(lanes.target()[i], 0);
    return t;
  };
  const Eigen::VectorXd plain = targets(q, v, {}, false);
  CHECK((plain - s.motion.targets.col(0)).norm() > 0.02);
  const Eigen::VectorXd mirrored = targets(control::mirrored_pose(s.f.model, s.f.roles, q), control::mirrored_tangent(s.f.model, s.f.roles, v), {}, true);
  const Eigen::VectorXd back = control::mirrored_pose(s.f.model, s.f.roles, mirrored);
  CHECK((back - plain).tail(s.f.model.nq - 7).cwiseAbs().maxCoeff() < 1e-3);
  // Carried along, and turned about the vertical.
  const control::SkillFrame frame{0.7, 2, -1, 0.5};
  const auto turn = core::about_axis(Vector{0, 0, 1}, 0.7);
  Eigen::VectorXd moved = q, fast = v;
  (turn.rotate(Vector::from(q.data())) + Vector{2, -1, 0.5}).store(moved.data());
  (turn * Quaternion::from(q.data() + 3)).store(moved.data() + 3);
  turn.rotate(Vector::from(v.data())).store(fast.data());
  turn.rotate(Vector::from(v.data() + 3)).store(fast.data() + 3);
  CHECK((targets(moved, fast, frame, false) - plain).cwiseAbs().maxCoeff() < 1e-3);
  // No joint is turned by more than it may be.
  Eigen::VectorXd far = q;
  far[0] += 50;
  const Eigen::VectorXd most = targets(far, v, {}, false);
  Eigen::VectorXd turned(s.f.model.nv);
  body::difference(s.f.skeleton(), Eigen::VectorXd(s.motion.targets.col(0)).data(), most.data(), turned.data());
  CHECK(turned.tail(s.f.model.nv - 6).cwiseAbs().maxCoeff() < 0.6 * std::sqrt(3.0) + 1e-3);
}

TEST_CASE("a lane that is not finite and a tick that has no gains are left alone") {
  const Floating s(2);
  const control::TrackingRegulator regulator = s.regulator(s.gains());
  auto scratch = control::TrackingRegulator::scratch(s.f.model);
  sim::Lanes<S> lanes(s.f.model, s.parameters, s.ground);
  Eigen::VectorXd q = s.motion.poses.col(0), v = at_rest(s.f);
  v[10] = 1;
  put(lanes, 0, q, v);
  q[1] = std::nan("");
  put(lanes, 1, q, v);
  for (int i = 7; i < s.f.model.nq; ++i) lanes.target()[i] = S(0.25f);
  regulator.apply(lanes, 1, 1, 0, {}, false, scratch);
  regulator.apply(lanes, 0, 1, 2, {}, false, scratch);
  regulator.apply(lanes, 0, 1, -1, {}, false, scratch);
  for (int i = 7; i < s.f.model.nq; ++i)
    for (int l = 0; l < 2; ++l) CHECK(core::lane_of(lanes.target()[i], l) == 0.25f);
}

TEST_CASE("motions and gains that do not belong together are refused") {
  const Floating s(2);
  const auto gains = s.gains();
  const auto make = [&](std::vector<double> sizes, std::vector<control::SimulatedMotion> motions, std::vector<std::vector<Eigen::MatrixXd>> all) {
    return control::TrackingRegulator(s.f.model, s.f.roles, std::move(sizes), std::move(motions), all);
  };
  CHECK_NOTHROW(make({1, 2}, {s.motion, s.motion}, {gains, gains}));
  CHECK_THROWS_AS(make({}, {}, {}), traceur::Error);
  CHECK_THROWS_AS(make({2, 1}, {s.motion, s.motion}, {gains, gains}), traceur::Error);
  CHECK_THROWS_AS(make({1}, {s.motion, s.motion}, {gains, gains}), traceur::Error);
  CHECK_THROWS_AS(make({1, 2}, {s.motion, Floating(3).motion}, {gains, gains}), traceur::Error);
  control::SimulatedMotion cut = s.motion;
  cut.poses.conservativeResize(Eigen::NoChange, 2);
  sim::Lanes<S> lanes(s.f.model, s.parameters, s.ground);
  CHECK_THROWS_AS(control::linearize(lanes, s.f.model, cut, 8, {}, Nothing{}), traceur::Error);
  // x' = 10 x, out of reach.
  const control::LinearizedTick wild{10 * Eigen::MatrixXd::Ones(1, 1), Eigen::MatrixXd::Zero(1, 1)};
  CHECK_THROWS_AS(control::regulator_gains(std::vector<control::LinearizedTick>(20, wild), Eigen::MatrixXd::Ones(1, 21), 1), traceur::Error);
}
