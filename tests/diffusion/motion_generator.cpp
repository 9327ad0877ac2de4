// SPDX-License-Identifier: MIT
#include <traceur/diffusion/motion_generator.hpp>

#include <string>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/executor.hpp>
#include <traceur/diffusion/blended_denoiser.hpp>
#include <traceur/diffusion/ddim.hpp>
#include <traceur/diffusion/network_denoiser.hpp>

#include "network_laws.hpp"

using namespace traceur::diffusion;
using traceur::core::SerialExecutor;
using traceur::core::ThreadExecutor;

namespace {

MotionGenerator::Parameters small(traceur::nn::NormOrder norm = traceur::nn::NormOrder::before) {
  MotionGenerator::Parameters p;
  p.frame_features = 5;
  p.past = 2;
  p.future = 3;
  p.terrain = {.height = 5, .width = 5, .layers = {{3, 2}}, .patch = 2, .token = 8, .scale = 1.0 / 3};
  p.target_hidden = 6;
  p.hidden = 7;
  p.heads = 2;
  p.feed_forward = 9;
  p.layers = 2;
  p.norm = norm;
  return p;
}

}  // namespace

TEST_CASE("the published architecture") {
  const MotionGenerator net(MotionGenerator::Parameters{});
  CHECK(net.tokens() == 82);
  CHECK(net.features() == 15 * 105);
  CHECK(net.condition_features() == 31 * 31 + 2 + 2 * 105);
}

TEST_CASE("a motion generator obeys the laws of networks") {
  const std::vector<Parts> given{all_parts, terrain_part | target_part | past_seen, past_part | past_seen,
                                 terrain_part | target_part | past_part, 0};
  check_network(MotionGenerator(small()), given);
  check_network(MotionGenerator(small(traceur::nn::NormOrder::after)), given);
}

TEST_CASE("what is not given does not matter, what is given does") {
  const MotionGenerator net(small());
  Eigen::VectorXd theta(net.parameters());
  traceur::core::RandomStream random(1);
  net.initialize(theta.data(), random);
  auto w = net.workspace<double>(1);
  const Table<double> noisy = random_table<double>(net.features(), 1, 2);
  const Table<double> values = random_table<double>(net.condition_features(), 1, 3);
  const int step = 2;
  const auto estimate = [&](Parts given, const Table<double>& x, const Table<double>& c) {
    Table<double> y(net.features(), 1);
    net.forward(theta.data(), &step, x, {c, &given}, w, y);
    return y;
  };
  const auto other = [&](Eigen::Index row, Eigen::Index rows) {
    Table<double> c = values;
    c.middleRows(row, rows).array() += 1;
    return c;
  };
  const Eigen::Index future = 3 * 5, past = 2 * 5;
  const Table<double> full = estimate(all_parts, noisy, values);
  struct {
    Parts part;
    Eigen::Index row, rows;
  } const parts[] = {{terrain_part, 0, 25}, {target_part, net.target_row(), 2}, {past_part, net.past_row(), past}};
  for (const auto& p : parts) {
    CHECK(estimate(all_parts, noisy, other(p.row, p.rows)) != full);
    const Parts less = all_parts & ~p.part;
    CHECK(estimate(less, noisy, other(p.row, p.rows)) == estimate(less, noisy, values));
    CHECK(estimate(less, noisy, values) != full);
  }
  // A past that is given hides the noise in its place; unseen, it does not reach the frames to come.
  Table<double> changed = noisy;
  changed.topRows(past).array() += 1;
  CHECK(estimate(all_parts, changed, values) == full);
  const Parts unseen = all_parts & ~past_seen;
  CHECK(estimate(unseen, noisy, other(net.past_row(), past)).bottomRows(future) ==
        estimate(unseen, noisy, values).bottomRows(future));
  CHECK(estimate(all_parts & ~past_part, changed, values) != estimate(all_parts & ~past_part, noisy, values));
}

TEST_CASE("blended samples have the same bits on any threads, alone and in a batch") {
  const MotionGenerator net(small());
  Eigen::VectorXf theta(net.parameters());
  traceur::core::RandomStream random(1);
  net.initialize(theta.data(), random);
  const Eigen::Index n = 5;
  const Table<float> values = random_table<float>(net.condition_features(), n, 3);
  const Schedule schedule = Schedule::cosine(11);
  Ddim<float> ddim(schedule, 3, net.features(), n);
  Table<float> alone(net.features(), n);
  SerialExecutor serial;
  NetworkDenoiser<float, MotionGenerator, SerialExecutor> one(net, theta.data(), serial, 1);
  BlendedDenoiser<float, decltype(one)> one_blended(one, {past_seen, 0.65}, 1);
  draw_noise<float>(alone, 4);
  for (Eigen::Index j = 0; j < n; ++j) ddim.sample(one_blended, {values.col(j)}, alone.col(j));
  CHECK(alone.allFinite());
  for (const int threads : {1, 2}) {
    ThreadExecutor executor(threads);
    NetworkDenoiser<float, MotionGenerator, ThreadExecutor> all(net, theta.data(), executor, n, 2);
    BlendedDenoiser<float, decltype(all)> blended(all, {past_seen, 0.65}, n);
    Table<float> x(net.features(), n);
    draw_noise<float>(x, 4);
    ddim.sample(blended, {values}, x);
    CHECK(same_bits<float>(x, alone));
  }
}

TEST_CASE("a motion generator refuses shapes that do not fit") {
  MotionGenerator::Parameters p = small();
  p.heads = 3;
  CHECK_THROWS_AS(MotionGenerator{p}, traceur::Error);
  p = small();
  p.terrain.token = 9;
  CHECK_THROWS_AS(MotionGenerator{p}, traceur::Error);
  p = small();
  p.future = 0;
  CHECK_THROWS_AS(MotionGenerator{p}, traceur::Error);
  p = small();
  p.past = -1;
  CHECK_THROWS_AS(MotionGenerator{p}, traceur::Error);
}
