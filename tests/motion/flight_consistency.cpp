// SPDX-License-Identifier: MIT
#include <traceur/motion/flight_consistency.hpp>

#include <doctest/doctest.h>

#include "figure.hpp"

using namespace traceur;
using namespace figure;
using motion::Clip;

namespace {

body::Character dumbbell() {
  body::Character c;
  c.name = "dumbbell";
  c.skeleton.add(joint("root", -1, JointType::free, {0, 0, 0}));
  c.inertias = {{2.0, {0.1, 0, 0}, {0.3, 0.4, 0.5, 0, 0, 0}}};
  c.actuators.resize(1);
  return c;
}

struct Throw {
  double gravity = 9.81;
  double sideways = 0;  ///< m/s^2
  double spin = 4;      ///< rad/s about the body's y axis
  double spin_up = 0;   ///< rad/s^2
};

/// The dumbbell thrown at time 0.2 s from where it stood, for 0.6 s, then held; the centre of mass is 0.1 m off the origin.
Clip thrown(const Throw& w, int keys = 601, bool cyclic = false) {
  Clip clip;
  clip.name = "thrown";
  clip.skeleton = dumbbell().skeleton;
  clip.cyclic = cyclic;
  clip.times = Vec::LinSpaced(keys, 0, 1);
  clip.poses.resize(7, keys);
  clip.contacts = Eigen::MatrixXd::Zero(1, keys);
  for (int k = 0; k < keys; ++k) {
    const double t = std::clamp(clip.times[k] - 0.2, 0.0, 0.6);
    clip.contacts(0, k) = t > 0 && t < 0.6 ? 0 : 1;
    const double angle = w.spin * t + 0.5 * w.spin_up * t * t;
    const auto turn = core::about_axis(Vector3<double>{0, 1, 0}, angle);
    const Vector3<double> center{1.5 * t, 0.5 * w.sideways * t * t, 1 + 3 * t - 0.5 * w.gravity * t * t};
    (center - turn.rotate({0.1, 0, 0})).store(clip.poses.col(k).data());
    turn.store(clip.poses.col(k).data() + 3);
  }
  return clip;
}

}  // namespace

TEST_CASE("a throw that obeys physics is found consistent") {
  const auto r = motion::check_flight(thrown({}), dumbbell());
  CHECK(r.flights == 1);
  CHECK(r.flight_s == doctest::Approx(0.6).epsilon(0.01));
  CHECK(r.horizontal_acceleration_max_m_s2 < 0.03);
  CHECK(r.vertical_acceleration_min_m_s2 == doctest::Approx(-9.81).epsilon(0.01));
  CHECK(r.vertical_acceleration_max_m_s2 == doctest::Approx(-9.81).epsilon(0.01));
  CHECK(r.vertical_error_rms_m_s2 < 0.05);
  CHECK(r.ballistic_error_max_m < 1e-4);
  CHECK(r.angular_momentum_min_kg_m2_s == doctest::Approx(0.4 * 4).epsilon(0.01));
  CHECK(r.angular_momentum_drift_kg_m2_s < 0.01);
}

TEST_CASE("what is wrong with a throw is measured in its own units") {
  auto r = motion::check_flight(thrown({.gravity = 15}), dumbbell());
  CHECK(r.vertical_acceleration_min_m_s2 == doctest::Approx(-15).epsilon(0.01));
  CHECK(r.vertical_error_rms_m_s2 == doctest::Approx(15 - 9.81).epsilon(0.01));
  // The parabola that is left of t^2 (15 - 9.81) / 2 after the best line: its end is 2/3 of the sagitta away.
  CHECK(r.ballistic_error_max_m == doctest::Approx(2.0 / 3.0 * 0.5 * (15 - 9.81) * 0.3 * 0.3).epsilon(0.15));
  r = motion::check_flight(thrown({.sideways = 6}), dumbbell());
  CHECK(r.horizontal_acceleration_max_m_s2 == doctest::Approx(6).epsilon(0.01));
  CHECK(r.horizontal_acceleration_rms_m_s2 == doctest::Approx(6).epsilon(0.01));
  CHECK(r.vertical_error_rms_m_s2 < 0.05);
  r = motion::check_flight(thrown({.spin_up = 5}), dumbbell());
  CHECK(r.angular_momentum_max_kg_m2_s == doctest::Approx(0.4 * (4 + 5 * 0.58)).epsilon(0.02));
  CHECK(r.angular_momentum_drift_kg_m2_s == doctest::Approx(0.4 * 5 * 0.28).epsilon(0.05));
  CHECK(r.horizontal_acceleration_max_m_s2 < 0.05);
  // On the moon all is well with less gravity.
  motion::FlightCheck moon;
  moon.gravity = 1.62;
  CHECK(motion::check_flight(thrown({.gravity = 1.62}), dumbbell(), moon).vertical_error_rms_m_s2 < 0.05);
}

TEST_CASE("the fall tells by how much a clip plays too fast, to a power of two") {
  const Clip clip = thrown({});
  CHECK(motion::check_flight(clip, dumbbell()).fall_acceleration_m_s2 == doctest::Approx(-9.81).epsilon(0.01));
  CHECK(motion::check_flight(thrown({.gravity = 1.62}), dumbbell()).fall_acceleration_m_s2 ==
        doctest::Approx(-1.62).epsilon(0.01));
  for (const double times : {1.0, 1.6, 2.0, 2.6, 4.0}) {
    Clip fast = clip;
    fast.times /= times;
    const auto r = motion::check_flight(fast, dumbbell());
    CHECK(r.fall_acceleration_m_s2 == doctest::Approx(-9.81 * times * times).epsilon(0.03));
    CHECK(motion::played_too_fast(r) == (times < 1.7 ? 1 : times < 2.7 ? 2 : 4));
  }
  // Nothing is concluded from slow falls, rises and very short flights.
  CHECK(motion::played_too_fast(motion::check_flight(thrown({.gravity = 0.5}), dumbbell())) == 1);
  CHECK(motion::played_too_fast(motion::check_flight(thrown({.gravity = -60}), dumbbell())) == 1);
  motion::FlightConsistency brief;
  brief.fall_acceleration_m_s2 = -80;
  brief.flight_s = 0.05;
  CHECK(motion::played_too_fast(brief) == 1);
  CHECK(motion::played_too_fast(brief, 80) == 1);
}

TEST_CASE("without flight there is nothing to report, and labels and bodies are required") {
  Clip clip = thrown({});
  clip.contacts.setOnes();
  const auto r = motion::check_flight(clip, dumbbell());
  CHECK(r.flights == 0);
  CHECK(r.vertical_acceleration_min_m_s2 == 0);
  clip.contacts.resize(0, 0);
  CHECK(fails_with([&] { motion::check_flight(clip, dumbbell()); }, "clip 'thrown': check_flight: expected a clip with contact labels"));
  std::mt19937_64 rng(1);
  Clip other = random_clip(rng);
  other.contacts = Eigen::MatrixXd::Zero(other.skeleton.size(), other.keys());
  CHECK(fails_with([&] { motion::check_flight(other, dumbbell()); }, "the clip's joints"));
}

TEST_CASE("a flight across the seam of a cycle is one flight") {
  // The same throw with the cycle begun in mid-air.
  Clip clip = thrown({}, 601, true);
  clip.contacts.setZero();
  clip.contacts.middleCols(250, 60).setOnes();
  const auto r = motion::check_flight(clip, dumbbell());
  CHECK(r.flights == 1);
  CHECK(r.flight_s == doctest::Approx(1 - 61.0 / 600).epsilon(0.01));
}

TEST_CASE("keys further apart than the step are not measured between") {
  const auto r = motion::check_flight(thrown({}, 21), dumbbell());
  CHECK(r.flights == 1);
  CHECK(r.vertical_error_rms_m_s2 < 0.2);
}
