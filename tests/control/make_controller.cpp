// SPDX-License-Identifier: MIT
#include <traceur/control/make_controller.hpp>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace figures;
using control::Controller;
using control::FeedbackShape;
using control::OpenLoopRecord;

namespace {

// One scalar for the whole file, so that the simulator is compiled once.
struct Bench {
  const Figure& f = humanoid();
  sim::Parameters simulation;
  sim::Ground<double> ground;
  sim::Lanes<double> lanes{f.model, simulation, ground};
  control::SamplingParameters sampling;

  /// What sampling would return had it found that no offsets are needed.
  control::SampledControl unmoved(const control::TrackingReference& r) {
    control::SampledControl out;
    out.targets = control::led_targets(f.model, r, sampling.lead).leftCols(r.ticks);
    if (sampling.tied()) out.tied_offsets = Eigen::MatrixXd::Zero(f.model.nv, static_cast<Eigen::Index>(sampling.period_starts.size()));
    return out;
  }
  OpenLoopRecord record(const control::TrackingReference& r, const Eigen::MatrixXd& targets) {
    return control::record_open_loop(lanes, f.model, f.roles, r, targets, r.poses.col(0), r.velocities.col(0), 8);
  }
};

}  // namespace

TEST_CASE("the longest stretch without contact") {
  const auto longest = [](std::initializer_list<double> forces, int shortest) {
    Eigen::VectorXd f(static_cast<Eigen::Index>(forces.size()));
    std::copy(forces.begin(), forces.end(), f.data());
    return control::longest_flight(f, shortest);
  };
  CHECK(longest({500, 0, 0, 300, 0, 0, 0, 300, 0}, 1) == std::array<int, 2>{4, 6});
  CHECK(longest({500, 0, 0, 300, 0, 0, 0, 300, 0}, 4) == std::array<int, 2>{-1, -1});
  CHECK(longest({0, 0, 300}, 1) == std::array<int, 2>{0, 1});
  CHECK(longest({300, 0, 0.5}, 1) == std::array<int, 2>{1, 2});
  CHECK(longest({300, 300}, 1) == std::array<int, 2>{-1, -1});
}

TEST_CASE("a record of standing: sensors start at zero, both feet carry the weight") {
  Bench b;
  const control::TrackingReference r = reference_of(b.f, standing_clip(30), 0.5);
  const OpenLoopRecord record = b.record(r, r.poses.leftCols(30));
  CHECK(record.raw.col(0).norm() < 1e-12);
  CHECK(record.raw_left.col(0).norm() < 1e-12);
  CHECK(record.raw.col(20).norm() > 1e-6);
  CHECK(record.poses.cols() == 31);
  CHECK(record.poses.col(0) == r.poses.col(0));
  const double weight = b.f.model.total_mass * b.simulation.gravity;
  CHECK((record.foot_force.row(0) + record.foot_force.row(1)).tail(20).mean() == doctest::Approx(weight).epsilon(0.05));
  CHECK(record.body_force.tail(20).mean() == doctest::Approx(weight).epsilon(0.05));
  // Standing is symmetric, so the left foot's sensors see the mirror image of the same.
  CHECK((record.raw - record.raw_left).cwiseAbs().maxCoeff() < 1e-6);
}

TEST_CASE("a controller for a motion done once") {
  Bench b;
  const FeedbackShape shape{{.swing_foot = true, .root_spin = true, .ankles = true}, 3, 3};
  const auto make = [&](const motion::Clip& clip) {
    const control::TrackingReference r = reference_of(b.f, clip, clip.duration());
    return control::make_one_shot(b.lanes, b.f.model, b.simulation, b.f.roles, r, b.unmoved(r), b.sampling, shape);
  };
  SUBCASE("without flight: three thirds") {
    const Controller c = make(standing_clip(30));
    CHECK_FALSE(c.cyclic);
    CHECK(c.ticks() == 30);
    CHECK(c.law.size() == 297);
    CHECK(c.law.isZero());
    for (int t = 0; t < 30; ++t) {
      CHECK(c.phase[static_cast<std::size_t>(t)] == t / 10);
      CHECK(c.stance[static_cast<std::size_t>(t)] == 0);
    }
    // The open loop is what the sensors should read.
    const OpenLoopRecord record = b.record(c.reference, c.targets);
    CHECK(c.sensory == record.raw);
    CHECK(c.start_pose == c.reference.poses.col(0));
  }
  SUBCASE("with flight: before, during, after") {
    // Let go above the ground, feet up, after a moment of being held nowhere: flight, then landing.
    const Controller c = make(clip_of(b.f, "drop", 30, [](double) {
      Eigen::VectorXd q = standing_pose();
      q[2] += 0.2;
      return q;
    }));
    const int landing = static_cast<int>(std::floor(std::sqrt(2 * 0.2 / 9.81) * 60));
    CHECK(c.phase.front() == 1);
    CHECK(c.phase[static_cast<std::size_t>(landing - 1)] == 1);
    CHECK(c.phase[static_cast<std::size_t>(landing + 2)] == 2);
    CHECK(c.phase.back() == 2);
  }
}

TEST_CASE("a controller for a cyclic motion") {
  Bench b;
  const motion::Clip clip = sway_clip(48);
  b.sampling.period_starts = {0, 10};
  b.sampling.period_ticks = 24;
  b.sampling.mirrored = true;
  const control::TrackingReference r = reference_of(b.f, clip, 3 * clip.duration());
  control::SampledControl sampled = b.unmoved(r);
  core::RandomStream random(51);
  sampled.tied_offsets.bottomRows(b.f.model.nv - 6) = 0.01 * any_velocity(b.f, random).tail(b.f.model.nv - 6).replicate(1, 2);
  const Controller c = control::make_cyclic(b.lanes, b.f.model, b.simulation, b.f.roles, r, sampled, b.sampling, {});
  REQUIRE(c.cyclic);
  REQUIRE(c.ticks() == 48);
  CHECK(c.reference.ticks == 48);
  CHECK(c.reference.poses.cols() == 49);
  CHECK(c.law == control::step_placement_law({}));

  // One plan: the second half is the first one mirrored, in targets, stance and sensory reference.
  const Eigen::MatrixXd led = control::led_targets(b.f.model, c.reference, b.sampling.lead);
  Eigen::VectorXd first(b.f.model.nq);
  const Eigen::VectorXd offset = sampled.tied_offsets.col(1);
  body::displace(b.f.skeleton(), led.col(13).data(), offset.data(), first.data());
  CHECK((c.targets.col(13) - first).norm() < 1e-12);
  for (int t = 1; t < 24; ++t) {
    const Eigen::VectorXd mirrored = control::mirrored_pose(b.f.model, b.f.roles, c.targets.col(t));
    CHECK((mirrored - c.targets.col(t + 24)).cwiseAbs().maxCoeff() < 1e-6);
    CHECK(c.stance[static_cast<std::size_t>(t)] == 1 - c.stance[static_cast<std::size_t>(t + 24)]);
    CHECK(c.sensory.col(t) == c.sensory.col(t + 24));
  }
  // The stance foot is the one that carries more.
  const OpenLoopRecord record = b.record(r, sampled.targets);
  double more = 0;
  for (int t = 48; t < 144; ++t) {
    const int side = c.stance[static_cast<std::size_t>(t % 48)];
    more += record.foot_force(side, t) - record.foot_force(1 - side, t);
  }
  CHECK(more > 96 * 10.0);
  // It starts where the open loop is after a period, here close to where it began.
  CHECK((c.start_pose - record.poses.col(48)).norm() < 1e-9);
  CHECK((c.start_pose - r.poses.col(0)).norm() < 0.1);
  // The sensory reference is the mean of all cycles but the first, mirrored on the left foot.
  {
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(control::full_sensors);
    for (int t = 48 + 5; t < 144; t += 24)
      sum += c.stance[static_cast<std::size_t>(t % 48)] == 1 ? record.raw_left.col(t) : record.raw.col(t);
    CHECK((c.sensory.col(5) - sum / 4).norm() < 1e-12);
  }

  const auto refusal = [&](const control::TrackingReference& reference, const control::SampledControl& s, const control::SamplingParameters& p) {
    return error_of([&] { control::make_cyclic(b.lanes, b.f.model, b.simulation, b.f.roles, reference, s, p, {}); });
  };
  CHECK(contains(refusal(reference_of(b.f, clip, clip.duration()), sampled, b.sampling), "at least two periods"));
  CHECK(contains(refusal(r, sampled, {}), "tied windows"));
  control::SampledControl untied = sampled;
  untied.tied_offsets.resize(0, 0);
  CHECK(contains(refusal(r, untied, b.sampling), "tied windows"));
}

TEST_CASE("a cyclic start is moved back by one period") {
  Bench b;
  b.simulation.gravity = 0;
  // Gliding and turning in mid-air: the plan of one period fits all.
  const motion::Clip clip = clip_of(
      b.f, "glide", 12,
      [](double t) {
        Eigen::VectorXd q = standing_pose();
        const Quaternion turn = about_axis(Vector{0, 0, 1}, 1.5 * t);
        (Vector{0.5, 0.2, 50} + Vector{1.2 * t, 0.3 * t, 0}).store(q.data());
        (turn * Quaternion::from(q.data() + 3)).store(q.data() + 3);
        return q;
      },
      true);
  b.sampling.period_starts = {0};
  b.sampling.period_ticks = 12;
  const control::TrackingReference r = reference_of(b.f, clip, 3 * clip.duration());
  const Controller c = control::make_cyclic(b.lanes, b.f.model, b.simulation, b.f.roles, r, b.unmoved(r), b.sampling, {});
  const control::CycleCarry carry = control::CycleCarry::after(c.reference, 1);
  const OpenLoopRecord record = b.record(r, b.unmoved(r).targets);
  const Eigen::VectorXd q = record.poses.col(12), v = record.velocities.col(12);
  CHECK(apart(carry.apply(Vector::from(c.start_pose.data())), Vector::from(q.data())) < 1e-9);
  CHECK(apart(about_axis(Vector{0, 0, 1}, carry.turn) * Quaternion::from(c.start_pose.data() + 3), Quaternion::from(q.data() + 3)) < 1e-9);
  CHECK(apart(carry.rotate(Vector::from(c.start_velocity.data())), Vector::from(v.data())) < 1e-9);
  CHECK(apart(carry.rotate(Vector::from(c.start_velocity.data() + 3)), Vector::from(v.data() + 3)) < 1e-9);
  CHECK((c.start_pose.tail(b.f.model.nq - 7) - q.tail(b.f.model.nq - 7)).norm() == 0);
  CHECK(c.stance == std::vector<int>(12, 0));
}
