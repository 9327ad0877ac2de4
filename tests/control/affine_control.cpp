// SPDX-License-Identifier: MIT
#include <traceur/control/affine_control.hpp>

#include <doctest/doctest.h>

#include <array>
#include <vector>

#include <traceur/core/random.hpp>

using namespace traceur::control;

namespace {

Eigen::VectorXd any(Eigen::Index size, std::uint64_t seed) {
  traceur::core::RandomStream random(seed);
  Eigen::VectorXd x(size);
  for (double& k : x) k = random.uniform(-0.2, 0.2);
  return x;
}

}  // namespace

TEST_CASE("the paper's sizes come out") {
  // Running: {a_l, a_r, alpha, beta} has 20 numbers, with the law of rank 3 a control has 83.
  const AffineShape running{FeedbackShape{}, 2};
  CHECK(running.law.size() == 63);
  CHECK(running.size() - running.law.size() == 20);
  CHECK(running.size() == 83);
  // Jumping: one a_hat of 9, alpha and beta; u_h and v_h make it 13.
  const AffineShape jumping{FeedbackShape{{.swing_foot = true}, 3, 1}, 1};
  CHECK(jumping.law.size() == 72);
  CHECK(jumping.size() - jumping.law.size() + 2 == 13);
}

TEST_CASE("a mirrored control changes its two offsets and nothing else") {
  const AffineShape shape{FeedbackShape{}, 2};
  const Eigen::VectorXd x = any(shape.size(), 1), y = shape.mirrored(x);
  CHECK(shape.mirrored(y) == x);
  CHECK(y.head(63) == x.head(63));
  CHECK(y.tail(2) == x.tail(2));
  CHECK(y.segment(shape.offset(0), 9) == x.segment(shape.offset(1), 9));
  CHECK(shape.mirrored(shape.symmetric(x)).isApprox(shape.symmetric(x), 1e-15));
  CHECK(shape.symmetric(shape.symmetric(x)).isApprox(shape.symmetric(x), 1e-15));
  const Eigen::VectorXd neutral = shape.neutral(x.head(63));
  CHECK(shape.symmetric(neutral) == neutral);
  CHECK(neutral[shape.alpha()] == 1);
  CHECK(neutral[shape.beta()] == 1);
  CHECK(neutral.segment(shape.offset(0), 18).norm() == 0);
}

TEST_CASE("a widened law does what it did") {
  const std::vector<FeedbackSets> sets{{}, {.swing_foot = true}, {.root_spin = true, .knees = true}, {.ankles = true, .knees = true}};
  const FeedbackShape wide{{true, true, true, true}, 4, 1};
  for (std::size_t k = 0; k < sets.size(); ++k) {
    const FeedbackShape narrow{sets[k], 3, 1};
    const Eigen::VectorXd law = any(narrow.phase_size(), 2 + k), more = widened_law(narrow, wide, law), ds = any(full_sensors, 9);
    std::array<double, full_actions> da{}, wider{};
    feedback(narrow, FeedbackLimits{}, law.data(), ds.data(), da.data());
    feedback(wide, FeedbackLimits{}, more.data(), ds.data(), wider.data());
    int at = 0;
    for (int i = 0; i < 9; ++i) CHECK(wider[static_cast<std::size_t>(i)] == doctest::Approx(da[static_cast<std::size_t>(at++)]));
    for (int i = 9; i < 15; ++i) {
      const double expected = sets[k].ankles ? da[static_cast<std::size_t>(at++)] : 0.0;
      CHECK(wider[static_cast<std::size_t>(i)] == doctest::Approx(expected));
    }
    for (int i = 15; i < 17; ++i) {
      const double expected = sets[k].knees ? da[static_cast<std::size_t>(at++)] : 0.0;
      CHECK(wider[static_cast<std::size_t>(i)] == doctest::Approx(expected));
    }
  }
}

TEST_CASE("a widened control keeps offsets, amplitude and duration") {
  const AffineShape narrow{FeedbackShape{{.knees = true}, 3, 1}, 2}, wide{FeedbackShape{{true, false, true, true}, 3, 1}, 2};
  const Eigen::VectorXd x = any(narrow.size(), 5), y = widened(narrow, wide, x);
  for (int side = 0; side < 2; ++side) {
    CHECK(y.segment(wide.offset(side), 9) == x.segment(narrow.offset(side), 9));
    CHECK(y.segment(wide.offset(side) + 9, 6).norm() == 0);
    CHECK(y.segment(wide.offset(side) + 15, 2) == x.segment(narrow.offset(side) + 9, 2));
  }
  CHECK(y[wide.alpha()] == x[narrow.alpha()]);
  CHECK(y[wide.beta()] == x[narrow.beta()]);
  CHECK_THROWS_WITH(widened(wide, narrow, y), "affine control: expected a shape with all sensors and actions of the law");
  CHECK_THROWS_WITH(widened_law(narrow.law, wide.law, x), "affine control: expected a law of its shape's size and a rank as large");
}
