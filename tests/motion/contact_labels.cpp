// SPDX-License-Identifier: MIT
#include <traceur/motion/contact_labels.hpp>

#include <doctest/doctest.h>

#include "figure.hpp"

using namespace traceur;
using namespace figure;
using motion::Clip;
using motion::ContactPoint;

namespace {

/// One free body that moves as `place(t)` says.
template <class F>
Clip mover(F place, double duration, int keys, bool cyclic = false) {
  Clip clip;
  clip.name = "mover";
  clip.skeleton.add(joint("root", -1, JointType::free, {0, 0, 0}));
  clip.times = Vec::LinSpaced(keys, 0, duration);
  clip.poses = Eigen::MatrixXd::Zero(7, keys);
  clip.cyclic = cyclic;
  for (int k = 0; k < keys; ++k) {
    const Vector3<double> p = place(clip.times[k]);
    clip.poses.col(k) << p.x, p.y, p.z, 0, 0, 0, 1;
  }
  return clip;
}

/// A ball of 0.1 m that rests for a second, hops in a parabola 0.5 m ahead for 0.4 s, and rests again.
Vector3<double> hop(double t) {
  const double u = std::clamp((t - 1) / 0.4, 0.0, 1.0);
  return {0.5 * u, 0, 0.1 + 0.5 * 9.81 * 0.4 * 0.4 * u * (1 - u)};
}

}  // namespace

TEST_CASE("a hop is in contact before and after, not during") {
  const Clip clip = mover(hop, 2.4, 145);
  const Clip out = motion::label_contacts(clip, {{0, {0, 0, 0}, 0.1}});
  CHECK_NOTHROW(out.check());
  for (int k = 0; k < clip.keys(); ++k) {
    const double t = clip.times[k];
    if (t < 0.96 || t > 1.44) CHECK(out.contacts(0, k) == 1);
    if (t > 1.02 && t < 1.38) CHECK(out.contacts(0, k) == 0);
  }
}

TEST_CASE("passing close to the ground at speed is no contact, and the ground may have any shape") {
  const Clip skim = mover([](double t) { return Vector3<double>{3 * t, 0, 0.01}; }, 1, 61);
  CHECK(motion::label_contacts(skim, {{0, {0, 0, 0}, 0}}).contacts.sum() == 0);
  const Clip climb = mover([](double t) { return Vector3<double>{0.2 * t, 0, 0.04 * t}; }, 2, 121);
  const auto slope = [](double x, double) { return 0.2 * x; };
  CHECK(motion::label_contacts(climb, {{0, {0, 0, 0}, 0}}, {}, slope).contacts.minCoeff() == 1);
  CHECK(motion::label_contacts(climb, {{0, {0, 0, 0}, 0}}).contacts(0, 120) == 0);
}

TEST_CASE("hysteresis holds a contact between its thresholds and blips are removed") {
  // Height swings between 2 and 4.5 cm: on at below 3, off only above 5.
  const Clip wobble = mover([](double t) { return Vector3<double>{0, 0, 0.0325 - 0.0125 * std::cos(10 * t)}; }, 2, 121);
  CHECK(motion::label_contacts(wobble, {{0, {0, 0, 0}, 0}}).contacts.minCoeff() == 1);
  motion::ContactDetection narrow;
  narrow.height_off = narrow.height_on;
  CHECK(motion::label_contacts(wobble, {{0, {0, 0, 0}, 0}}, narrow).contacts.minCoeff() == 0);
  // One key at the ground out of 121.
  const Clip blip = mover([](double t) { return Vector3<double>{0, 0, std::abs(t - 1) < 1e-6 ? 0.028 : 0.032}; }, 2, 121);
  CHECK(motion::label_contacts(blip, {{0, {0, 0, 0}, 0}}, narrow).contacts.sum() == 0);
  narrow.shortest = 0;
  CHECK(motion::label_contacts(blip, {{0, {0, 0, 0}, 0}}, narrow).contacts.sum() == 1);
}

TEST_CASE("labels of a cycle do not depend on where it begins") {
  const auto bounce = [](double t) { return Vector3<double>{0.1 * t, 0, std::max(0.0, 0.2 * std::sin(2 * pi * t))}; };
  const Clip a = mover(bounce, 1, 61, true), b = mover([&](double t) { return bounce(t + 0.25); }, 1, 61, true);
  const auto la = motion::label_contacts(a, {{0, {0, 0, 0}, 0}}), lb = motion::label_contacts(b, {{0, {0, 0, 0}, 0}});
  CHECK(la.contacts.sum() > 20);
  CHECK(la.contacts(0, 0) == la.contacts(0, 60));
  for (int k = 0; k < 60; ++k) CHECK(lb.contacts(0, k) == la.contacts(0, (k + 15) % 60));
}

TEST_CASE("the ground is found under a stance, and by a percentile where nothing rests") {
  const auto sunk = [](double t) {
    const Vector3<double> p = hop(t);
    return Vector3<double>{p.x, p.y, p.z - 0.07};
  };
  const Clip clip = mover(sunk, 2.4, 145);
  const std::vector<ContactPoint> points{{0, {0, 0, 0}, 0.1}};
  const auto estimate = motion::estimate_ground(clip, points);
  CHECK(estimate.by_stance);
  CHECK(estimate.height == doctest::Approx(-0.07).epsilon(1e-6));
  const Clip fixed = motion::grounded(clip, points);
  CHECK(motion::estimate_ground(fixed, points).height == doctest::Approx(0.0).scale(1.0).epsilon(1e-9));
  CHECK((fixed.poses.row(2) - clip.poses.row(2)).minCoeff() == doctest::Approx(0.07));

  const Clip slide = mover([](double t) { return Vector3<double>{2 * t, 0, t}; }, 1, 101);
  const auto guess = motion::estimate_ground(slide, {{0, {0, 0, 0}, 0}});
  CHECK(!guess.by_stance);
  CHECK(guess.height == doctest::Approx(0.4));
}

TEST_CASE("points come from shapes, and errors name the culprit") {
  body::Character c;
  c.name = "figure";
  c.skeleton = biped();
  body::Shape ball{body::Shape::Kind::sphere, "head", 1, {0, 0, 0.3}, Quaternion<double>::identity(), {0.1, 0, 0}};
  body::Shape shin{body::Shape::Kind::capsule, "shin", 3, {0, 0, -0.2}, Quaternion<double>::identity(), {0.05, 0.2, 0}};
  body::Shape foot{body::Shape::Kind::box, "foot", 4, {0.05, 0, 0}, Quaternion<double>::identity(), {0.1, 0.04, 0.02}};
  c.shapes = {ball, shin, foot};
  const auto all = motion::contact_points(c);
  CHECK(all.size() == 11);
  CHECK(all[0].radius == 0.1);
  CHECK(all[1].local.z == doctest::Approx(-0.4));
  CHECK(all[2].local.z == doctest::Approx(0.0).scale(1.0));
  double lowest = 1;
  for (const auto& p : motion::contact_points(c, {"left_foot_body"})) {
    CHECK(p.body == 4);
    CHECK(p.radius == 0.0);
    lowest = std::min(lowest, p.local.z);
  }
  CHECK(lowest == doctest::Approx(-0.02));
  CHECK(fails_with([&] { motion::contact_points(c, {"tail"}); }, "character 'figure': contact points: no body named 'tail'"));
  const Clip clip = mover(hop, 2, 20);
  CHECK(fails_with([&] { motion::label_contacts(clip, {}); }, "clip 'mover': contacts: expected at least one"));
  CHECK(fails_with([&] { motion::label_contacts(clip, {{3, {0, 0, 0}, 0}}); }, "names body 3"));
}
