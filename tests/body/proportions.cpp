// SPDX-License-Identifier: MIT
#include <traceur/body/proportions.hpp>

#include <cmath>
#include <limits>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/body/momentum.hpp>
#include <traceur/core/error.hpp>
#include <traceur/io/mjcf.hpp>

namespace {

using namespace traceur::body;
using traceur::Error;
using Vector = traceur::core::Vector3<double>;
using Quaternion = traceur::core::Quaternion<double>;

/// A box on a free root, its longest side along x, and a box that hangs on it.
Character two_boxes(const Vector& half, double density) {
  Character c;
  c.name = "two boxes";
  c.skeleton.add({"root", "first", -1, JointType::free});
  Joint second{"hinge", "second", 0, JointType::hinge};
  second.offset = {2 * half.x, 0, 0};
  c.skeleton.add(second);
  c.actuators.resize(2);
  c.actuators[1].stiffness = 100;
  c.actuators[1].torque_limit = 50;
  for (int b = 0; b < 2; ++b) {
    Shape s;
    s.kind = Shape::Kind::box;
    s.name = b == 0 ? "a" : "b";
    s.body = b;
    s.position = {half.x, 0, 0};
    s.size = half;
    c.shapes.push_back(s);
    Inertia in = solid(s, density);
    in.center = s.position;
    c.inertias.push_back(in);
  }
  return c;
}

}  // namespace

TEST_CASE("a stretched box has the mass and inertia of a box of that size") {
  const Vector half{0.3, 0.05, 0.08};
  const Character c = with_proportions(two_boxes(half, 900), std::vector<SegmentScale>{{1.6, 0.7, 1}, {1, 1, 2}});
  const Character law = two_boxes({1.6 * half.x, 0.7 * half.y, 0.7 * half.z}, 900);
  CHECK(c.inertias[0].mass == doctest::Approx(law.inertias[0].mass).epsilon(1e-12));
  CHECK(norm(c.inertias[0].center - law.inertias[0].center) < 1e-12);
  const auto &a = c.inertias[0].about_center, &b = law.inertias[0].about_center;
  CHECK(a.xx == doctest::Approx(b.xx).epsilon(1e-12));
  CHECK(a.yy == doctest::Approx(b.yy).epsilon(1e-12));
  CHECK(a.zz == doctest::Approx(b.zz).epsilon(1e-12));
  CHECK(std::abs(a.xy) + std::abs(a.xz) + std::abs(a.yz) < 1e-12);
  CHECK(norm(c.shapes[0].size - law.shapes[0].size) < 1e-12);
  CHECK(c.skeleton[1].offset.x == doctest::Approx(law.skeleton[1].offset.x));
  // The other segment is as it was, but stronger.
  CHECK(c.inertias[1].mass == doctest::Approx(two_boxes(half, 900).inertias[1].mass));
  CHECK(c.actuators[1].stiffness == 200);
  CHECK(c.actuators[1].torque_limit == 100);
}

TEST_CASE("scales of one change nothing, and equal scales scale the whole") {
  const Character c = traceur::io::read_mjcf(TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml");
  const auto n = static_cast<std::size_t>(c.skeleton.size());
  const Character same = with_proportions(c, std::vector<SegmentScale>(n));
  for (std::size_t i = 0; i < n; ++i) {
    CHECK(same.inertias[i].mass == doctest::Approx(c.inertias[i].mass).epsilon(1e-12));
    CHECK(norm(same.skeleton[static_cast<int>(i)].offset - c.skeleton[static_cast<int>(i)].offset) < 1e-12);
  }
  const Character twice = with_proportions(c, std::vector<SegmentScale>(n, {2, 2, 1}));
  CHECK(twice.total_mass() == doctest::Approx(8 * c.total_mass()).epsilon(1e-12));
  for (std::size_t i = 0; i < n; ++i)
    CHECK(twice.inertias[i].about_center.xx == doctest::Approx(32 * c.inertias[i].about_center.xx).epsilon(1e-9));
  CHECK_NOTHROW(check_character(twice, "twice"));
}

TEST_CASE("longer limbs move the hands and feet out and weigh as length times radius squared") {
  const Character c = traceur::io::read_mjcf(TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml");
  std::vector<SegmentScale> scales(static_cast<std::size_t>(c.skeleton.size()));
  const int knee = c.skeleton.find("left_knee"), ankle = c.skeleton.find("left_ankle");
  scales[static_cast<std::size_t>(knee)] = {1.65, 1.6, 1};
  const Character longer = with_proportions(c, scales);
  CHECK(norm(longer.skeleton[ankle].offset) == doctest::Approx(1.65 * norm(c.skeleton[ankle].offset)).epsilon(1e-9));
  CHECK(longer.inertias[static_cast<std::size_t>(knee)].mass ==
        doctest::Approx(1.65 * 1.6 * 1.6 * c.inertias[static_cast<std::size_t>(knee)].mass).epsilon(1e-12));
}

TEST_CASE("proportions that cannot be are refused") {
  const Character c = two_boxes({0.3, 0.1, 0.1}, 1000);
  CHECK_THROWS_WITH_AS(with_proportions(c, std::vector<SegmentScale>(3)),
                       "proportions of 'two boxes': expected one scale for each of 2 joints", Error);
  CHECK_THROWS_WITH_AS(with_proportions(c, std::vector<SegmentScale>{{1, 1, 1}, {0, 1, 1}}),
                       "proportions of 'two boxes': body 'second': expected factors above zero", Error);
  CHECK_THROWS_AS(with_proportions(c, std::vector<SegmentScale>(2, {1, std::numeric_limits<double>::infinity(), 1})), Error);
}
