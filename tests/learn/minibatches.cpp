// SPDX-License-Identifier: MIT
#include <traceur/learn/minibatches.hpp>

#include <algorithm>

#include <doctest/doctest.h>

using namespace traceur::learn;
using traceur::core::RandomStream;

TEST_CASE("every sample that did not fail is in exactly one batch, and sizes differ by one at most") {
  Rollout<float> r(1, 1, 7, 13);
  r.fail(3, 2);
  r.fail(12, 6);
  Minibatches batches(r.samples(), 16);
  batches.select(r);
  CHECK(batches.samples() == 89);
  CHECK(batches.count() == 6);
  for (std::uint64_t epoch = 0; epoch < 3; ++epoch) {
    RandomStream random(1, 0, epoch);
    batches.shuffle(random);
    std::vector<int> seen(91, 0);
    std::size_t least = 1000, most = 0;
    for (Eigen::Index k = 0; k < batches.count(); ++k) {
      least = std::min(least, batches[k].size());
      most = std::max(most, batches[k].size());
      for (const std::int32_t i : batches[k]) ++seen[static_cast<std::size_t>(i)];
    }
    CHECK(most <= 16);
    CHECK(most - least <= 1);
    for (Eigen::Index i = 0; i < 91; ++i)
      CHECK(seen[static_cast<std::size_t>(i)] == (i == r.sample(3, 2) || i == r.sample(12, 6) ? 0 : 1));
  }
}

TEST_CASE("the order is a function of the stream alone, and another for another epoch") {
  const Rollout<float> r(1, 1, 8, 8);
  const auto order = [&](std::uint64_t step) {
    Minibatches batches(64, 64);
    batches.select(r);
    RandomStream random(9, 2, step);
    batches.shuffle(random);
    return std::vector<std::int32_t>(batches.all().begin(), batches.all().end());
  };
  CHECK(order(0) == order(0));
  CHECK(order(0) != order(1));
}

TEST_CASE("a rollout in which everything failed has no batches") {
  Rollout<float> r(1, 1, 2, 2);
  for (Eigen::Index t = 0; t < 2; ++t)
    for (Eigen::Index e = 0; e < 2; ++e) r.fail(t, e);
  Minibatches batches(4, 2);
  batches.select(r);
  CHECK(batches.count() == 0);
}

TEST_CASE("gathered columns stand side by side in the order asked for") {
  Eigen::MatrixXf from = Eigen::MatrixXf::Random(3, 10), to = Eigen::MatrixXf::Zero(3, 4);
  const std::vector<std::int32_t> which{7, 0, 7};
  gather<float>(from, which, to);
  CHECK(to.col(0) == from.col(7));
  CHECK(to.col(1) == from.col(0));
  CHECK(to.col(2) == from.col(7));
  CHECK(to.col(3).norm() == 0);
}
