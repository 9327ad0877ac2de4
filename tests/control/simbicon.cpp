// SPDX-License-Identifier: MIT
#include <traceur/control/simbicon.hpp>

#include <doctest/doctest.h>

#include <array>

using namespace traceur::control;

TEST_CASE("the law of gains is the gains") {
  const FeedbackShape shape{{.swing_foot = true, .ankles = true}, 3, 1};
  SimbiconGains s;
  for (int i = 0; i < 12; ++i) s.data()[i] = 0.05 * (i - 5);
  const Eigen::VectorXd law = simbicon_law(shape, s);
  std::array<double, full_sensors> ds{};
  for (std::size_t i = 0; i < ds.size(); ++i) ds[i] = 0.03 * static_cast<double>(i) - 0.1;
  std::array<double, full_actions> da{};
  feedback(shape, FeedbackLimits{}, law.data(), ds.data(), da.data());
  Eigen::Matrix<double, 6, 1> seen;
  seen << ds[6], ds[7], ds[9], ds[10], ds[12], ds[13];
  const Eigen::Vector2d wanted = s * seen;
  CHECK(da[0] == doctest::Approx(wanted[0]));
  CHECK(da[1] == doctest::Approx(wanted[1]));
  for (std::size_t i = 2; i < 15; ++i) CHECK(da[i] == 0);
}

TEST_CASE("the swing leg steps to where the body is falling") {
  const FeedbackShape shape{{.swing_foot = true}, 3, 1};
  const Eigen::VectorXd law = simbicon_law(shape, simbicon_gains(0.2, 0.2));
  const auto act = [&](std::size_t sensor, double by) {
    std::array<double, full_sensors> ds{};
    std::array<double, full_actions> da{};
    ds[sensor] = by;
    feedback(shape, FeedbackLimits{}, law.data(), ds.data(), da.data());
    return da;
  };
  // Too fast ahead, or the stance foot too far behind: the leg swings forward, which is turning back about +y.
  CHECK(act(6, 0.5)[1] == doctest::Approx(-0.1));
  CHECK(act(9, -0.5)[1] == doctest::Approx(-0.1));
  CHECK(act(6, 0.5)[0] == 0);
  // Drifting to the left, which is the swing side: the leg swings outwards, which is turning about +x.
  CHECK(act(7, 0.5)[0] == doctest::Approx(0.1));
  CHECK(act(10, -0.5)[0] == doctest::Approx(0.1));
}

TEST_CASE("a law without the swing foot cannot hold the gains") {
  CHECK_THROWS_WITH(simbicon_law(FeedbackShape{}, simbicon_gains()), "simbicon: expected a law of rank 2 or more that senses the swing foot");
}
