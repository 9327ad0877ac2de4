// SPDX-License-Identifier: MIT
#include <traceur/learn/reference_transitions.hpp>

#include <vector>

#include <doctest/doctest.h>

#include "tracking_support.hpp"

using namespace traceur;
using namespace traceur::learn;
using namespace learn_test;

namespace {

std::vector<ReferenceMotion> motions() {
  return {make_reference_motion(humanoid(), roles(), wave(false, 1), 30), make_reference_motion(humanoid(), roles(), wave(true, 1), 30)};
}
DiscriminatorFeatures features() { return DiscriminatorFeatures(humanoid().character.skeleton, end_effectors(humanoid(), roles())); }

/// The features of a tick, from the state itself.
Eigen::VectorXf at(const ReferenceMotion& m, int tick) {
  const DiscriminatorFeatures f = features();
  TrackingState<float> s(humanoid().character);
  s.q.assign(m.poses.col(tick).data(), m.poses.col(tick).data() + m.poses.rows());
  s.v.assign(m.velocities.col(tick).data(), m.velocities.col(tick).data() + m.velocities.rows());
  s.measure(humanoid().character);
  Eigen::VectorXf out(f.size());
  FeatureWriter<float> to(out.data(), 0);
  f.write(s, to);
  return out;
}

}  // namespace

TEST_CASE("a history is the steps up to a tick, the oldest first; a cycle has a past, what is done once has not") {
  const auto m = motions();
  const ReferenceTransitions all(humanoid().character, features(), m, 4);
  CHECK(all.size() == 4 * features().size());
  CHECK(all.first(0) == 3);
  CHECK(all.first(1) == 0);
  const auto step = [&](int motion, int tick, int k) {
    return Eigen::VectorXf(Eigen::Map<const Eigen::VectorXf>(all.history(motion, tick).data() + k * all.features(), all.features()));
  };
  for (int k = 0; k < 4; ++k) {
    CHECK((step(0, 10, k) - at(m[0], 7 + k)).cwiseAbs().maxCoeff() < 1e-4f);
    CHECK((step(1, 10, k) - at(m[1], 7 + k)).cwiseAbs().maxCoeff() < 1e-4f);
    CHECK((step(0, 1, k) - at(m[0], std::max(0, k - 2))).cwiseAbs().maxCoeff() < 1e-4f);
    CHECK((step(1, 1, k) - at(m[1], (30 + k - 2) % 30)).cwiseAbs().maxCoeff() < 1e-4f);
  }
}

TEST_CASE("drawn histories are whole and come from every motion alike") {
  const auto m = motions();
  const ReferenceTransitions all(humanoid().character, features(), m, 4);
  core::RandomStream random(6);
  int first = 0;
  for (int k = 0; k < 400; ++k) {
    const auto h = all.sample(random);
    CHECK(h.size() == static_cast<std::size_t>(all.size()));
    const float* begin = all.history(0, all.first(0)).data();
    if (h.data() >= begin && h.data() <= all.history(0, 29).data()) ++first;
  }
  CHECK(first > 150);
  CHECK(first < 250);
}

TEST_CASE("environments forget their oldest step") {
  FeatureHistory history(2, 3, 2);
  const std::vector<float> past{1, 2, 3, 4, 5, 6};
  history.fill(1, past);
  float* newest = history.push(1);
  newest[0] = 7;
  newest[1] = 8;
  Eigen::VectorXf expected(6);
  expected << 3, 4, 5, 6, 7, 8;
  CHECK(history.columns().col(1) == expected);
  CHECK(history.columns().col(0).norm() == 0);
}

TEST_CASE("histories that cannot be are refused") {
  CHECK_THROWS_WITH_AS(ReferenceTransitions(humanoid().character, features(), {}, 4), "reference transitions: expected a motion", Error);
  CHECK_THROWS_AS(ReferenceTransitions(humanoid().character, features(), motions(), 0), Error);
  auto other = motions();
  other[1].poses.resize(7, 31);
  CHECK_THROWS_WITH_AS(ReferenceTransitions(humanoid().character, features(), other, 2),
                       "reference transitions: motion 'wave' is of another character", Error);
  CHECK_THROWS_AS(FeatureHistory(1, 1, 0), Error);
}
