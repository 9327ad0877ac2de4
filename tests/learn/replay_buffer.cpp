// SPDX-License-Identifier: MIT
#include <traceur/learn/replay_buffer.hpp>

#include <vector>

#include <doctest/doctest.h>

using namespace traceur;
using namespace traceur::learn;

TEST_CASE("the buffer holds the last samples, and draws them all alike") {
  ReplayBuffer<double> buffer(2, 4);
  CHECK(buffer.size() == 0);
  for (int k = 0; k < 10; ++k) {
    const double sample[2] = {static_cast<double>(k), -static_cast<double>(k)};
    buffer.add(sample);
    CHECK(buffer.size() == std::min(k + 1, 4));
  }
  CHECK(buffer.added() == 10);
  std::vector<int> seen(10, 0);
  core::RandomStream random(1);
  for (int k = 0; k < 4000; ++k) {
    const double* s = buffer.sample(random);
    CHECK(s[1] == -s[0]);
    ++seen[static_cast<std::size_t>(s[0])];
  }
  for (std::size_t k = 0; k < 10; ++k) CHECK((k < 6 ? seen[k] == 0 : seen[k] > 850));
}

TEST_CASE("a restored buffer goes on to the same samples") {
  ReplayBuffer<> a(1, 3), b(1, 3);
  const auto add = [](ReplayBuffer<>& to, float x) { to.add(&x); };
  for (int k = 0; k < 5; ++k) add(a, static_cast<float>(k));
  b.restore(a.state(), a.added());
  for (ReplayBuffer<>* r : {&a, &b}) add(*r, 9);
  CHECK(a.state() == b.state());
  CHECK(a.added() == b.added());
  Eigen::MatrixXf broken = Eigen::MatrixXf::Constant(1, 3, NAN);
  CHECK_THROWS_WITH_AS(b.restore(broken, 5), "replay buffer: a sample is not finite", Error);
  CHECK_THROWS_AS(b.restore(broken.leftCols(2), 5), Error);
  CHECK_THROWS_AS(b.restore(Eigen::MatrixXf::Zero(2, 3), 5), Error);
  CHECK_THROWS_AS(ReplayBuffer<>(0, 3), Error);
}
