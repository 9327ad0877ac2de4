// SPDX-License-Identifier: MIT
#include <traceur/sim/scene.hpp>

#include <cmath>
#include <memory>
#include <vector>

#include <doctest/doctest.h>

#include "support.hpp"
#include <traceur/core/error.hpp>

namespace {

using namespace traceur::sim;
using scene::Quaternion;
using scene::Vector;
using traceur::Error;
using traceur::terrain::Box;
using traceur::terrain::BoxScene;
using Kind = ObjectShape::Kind;

Quaternion level() { return Quaternion::identity(); }

Scene boxes(std::vector<Box> list) { return {Ground<double>(), BoxScene(std::move(list))}; }

/// How far any part of the character reaches into the scene's boxes, m.
double penetration(const World<double>& w, const Scene& scene) {
  double most = 0;
  for (std::size_t b = 0; b < w.model().bodies.size(); ++b) {
    const auto& m = w.model().bodies[b];
    for (int f = m.first_feature; f < m.first_feature + m.features; ++f) {
      const TouchingFeature& feature = w.model().features[static_cast<std::size_t>(f)];
      for (double t = -1; t <= 1; t += 0.1) {
        const Vector at = w.body_position(0, static_cast<int>(b)) +
                          w.body_rotation(0, static_cast<int>(b)) * (feature.center + t * feature.half_axis);
        most = std::max(most, feature.radius - scene.boxes.sample(at).distance);
      }
    }
  }
  return most;
}

double vertical_force(const World<double>& w) {
  double force = 0;
  for (std::size_t b = 0; b < w.model().bodies.size(); ++b) force += w.contact_force(0, static_cast<int>(b)).z;
  return force;
}

}  // namespace

TEST_CASE("a humanoid stands on a box as on the ground") {
  const Scene scene = boxes({{{0, 0, 0.15}, {0.6, 0.6, 0.15}, level()}});
  World<double> world(scene::humanoid(), 1, {}, scene);
  Eigen::VectorXd q = scene::standing_pose();
  q[2] += 0.3;
  world.reset(0, q, scene::at_rest());
  world.step(960);
  const int foot = world.model().moving_of_joint[static_cast<std::size_t>(scene::humanoid().skeleton.find("right_ankle"))];
  const Vector at = world.body_position(0, foot);
  CHECK(world.pose(0)[2] > 1.16);
  CHECK(vertical_force(world) == doctest::Approx(world.model().total_mass * world.parameters().gravity).epsilon(0.02));
  CHECK(penetration(world, scene) < 0.005);
  world.step(4800);
  CHECK(norm(world.body_position(0, foot) - at) < 1e-3);
}

TEST_CASE("lanes of one pack may stand in scenes of their own") {
  using S = traceur::core::Pack<float, 4>;
  Extras extras;
  extras.obstacles = true;
  World<S> world(scene::humanoid(), 4, {}, Ground<float>(), extras);
  for (int lane = 0; lane < 4; ++lane) {
    const double height = 0.2 * lane;
    if (lane > 0)
      world.set_scene(lane, std::make_shared<const Scene>(boxes({{{0, 0, 0.5 * height}, {0.6, 0.6, 0.5 * height}, level()}})));
    if (lane == 2)  // a terrain of that height does as well
      world.set_scene(lane, std::make_shared<const Scene>(Scene{Ground<double>(traceur::terrain::HeightGrid::flat(height)), {}}));
    Eigen::VectorXd q = scene::standing_pose();
    q[2] += height;
    world.reset(lane, q, scene::at_rest());
  }
  world.step(480);
  for (int lane = 0; lane < 4; ++lane) CHECK(world.pose(lane)[2] == doctest::Approx(0.2 * lane + 0.88).epsilon(0.02));
}

TEST_CASE("gravity and friction may differ between lanes") {
  using S = traceur::core::Pack<double, 4>;
  Parameters p;
  p.gravity = 9.81;
  World<S> world(scene::box({0.2, 0.2, 0.1}, 10), 3, p, Ground<double>::plane({0, 0, 1}, 0));
  const double gravities[] = {0.2 * 9.81, 9.81, 1.65 * 9.81};
  Eigen::VectorXd q = world.character().skeleton.neutral_pose();
  Eigen::VectorXd v = Eigen::VectorXd::Zero(6);
  for (int lane = 0; lane < 3; ++lane) {
    world.set_gravity(lane, gravities[lane]);
    world.set_friction(lane, 0.2 + 0.3 * lane);
    q[2] = 50;
    world.reset(lane, q, v);
  }
  world.step(480);
  for (int lane = 0; lane < 3; ++lane) CHECK(world.velocity(lane)[2] == doctest::Approx(-gravities[lane]).epsilon(1e-9));
  for (int lane = 0; lane < 3; ++lane) {
    q[2] = 0.1;
    v.setZero();
    v[0] = 1;
    world.reset(lane, q, v);
  }
  world.step(960);
  for (int lane = 0; lane < 3; ++lane)
    CHECK(world.pose(lane)[0] == doctest::Approx(1 / (2 * (0.2 + 0.3 * lane) * gravities[lane])).epsilon(0.05));
}

TEST_CASE("what carries a body, and how fast it slides on that, is read as well on a box as on the ground") {
  Parameters p;
  p.friction = 0.2;
  const double weight = 10 * p.gravity, mean_speed = 1 - 0.5 * p.friction * p.gravity * 0.25;
  const Scene scenes[] = {{Ground<double>::plane({0, 0, 1}, 0), BoxScene()}, boxes({{{0, 0, 0.5}, {2, 2, 0.5}, level()}})};
  for (const Scene& scene : scenes) {
    World<double> world(scene::box({0.2, 0.2, 0.1}, 10), 1, p, scene);
    Eigen::VectorXd q = world.character().skeleton.neutral_pose(), v = Eigen::VectorXd::Zero(6);
    q[2] = scene.boxes.empty() ? 0.0995 : 1.0995;
    v[0] = 0.6;
    v[1] = 0.8;
    world.reset(0, q, v);
    world.step(120);
    const traceur::sim::LoadedSlide<double> slide = world.contact_slide(0, 0);
    CHECK(slide.load == doctest::Approx(weight).epsilon(0.03));
    CHECK(slide.sum / slide.load == doctest::Approx(mean_speed).epsilon(0.03));
  }
}

TEST_CASE("a box slides over the seams of touching boxes as over one") {
  std::vector<Box> row;
  for (int i = 0; i < 8; ++i) row.push_back({{0.25 * i, 0, 0.2}, {0.125, 0.5, 0.2}, level()});
  Extras extras;
  extras.objects.push_back({Kind::box, {0.2, 0.2, 0.05}, 6, {0, 0, 0.45}});
  Parameters p;
  p.friction = 0.3;
  World<double> world(scene::humanoid(), 1, p, boxes(row), extras);
  Eigen::VectorXd q = scene::humanoid().skeleton.neutral_pose();
  q[2] = 1000;
  world.reset(0, q, scene::at_rest());
  world.step(240);
  const Vector from = world.object_position(0, 0);
  world.set_object(0, 0, from, world.object_rotation(0, 0), {2.2, 0, 0});
  double highest = 0, lowest = 1;
  for (int tick = 0; tick < 200; ++tick) {
    world.step(8);
    highest = std::max(highest, world.object_position(0, 0).z);
    lowest = std::min(lowest, world.object_position(0, 0).z);
  }
  const double law = 2.2 * 2.2 / (2 * 0.3 * p.gravity), slid = world.object_position(0, 0).x - from.x;
  MESSAGE("slid " << slid << " m, Coulomb " << law << ", height " << lowest << " to " << highest);
  // Edges take up boxes on the way and let go of them, and each little bounce costs some speed.
  CHECK(slid == doctest::Approx(law).epsilon(0.1));
  CHECK(highest < 0.4505);
  CHECK(lowest > 0.445);
}

TEST_CASE("a box lies across a bar that meets none of its corners") {
  Extras extras;
  extras.objects.push_back({Kind::box, {0.4, 0.15, 0.05}, 4, {0, 0, 1.06}});
  World<double> world(scene::humanoid(), 1, {}, boxes({{{0, 0, 0.98}, {0.05, 1, 0.02}, level()}}), extras);
  Eigen::VectorXd q = scene::humanoid().skeleton.neutral_pose();
  q[2] = 1000;
  world.reset(0, q, scene::at_rest());
  world.step(960);
  CHECK(world.object_position(0, 0).z == doctest::Approx(1.05).epsilon(0.005));
  CHECK(norm(world.object_velocity(0, 0)) < 1e-3);
}

TEST_CASE("landing at 5 m/s on a box sinks in less than 20 mm") {
  const Scene scene = boxes({{{0, 0, 0.25}, {1, 1, 0.25}, level()}});
  World<double> world(scene::humanoid(), 1, {}, scene);
  Eigen::VectorXd q = scene::standing_pose(), v = scene::at_rest();
  q[2] += 0.52;
  v[2] = -5;
  world.reset(0, q, v);
  double most = 0;
  for (int step = 0; step < 480; ++step) {
    world.step(1);
    most = std::max(most, penetration(world, scene));
  }
  MESSAGE("deepest " << 1000 * most << " mm");
  CHECK(most < 0.02);
  CHECK_FALSE(world.failed(0));
}

TEST_CASE("a humanoid thrown at a wall, a post or a stair does not go through") {
  const Scene wall = boxes({{{1.2, 0, 1}, {0.1, 2, 1}, level()}}), post = boxes({{{1.2, 0, 1.5}, {0.05, 0.05, 1.5}, level()}});
  std::vector<Box> steps;
  for (int i = 0; i < 5; ++i) steps.push_back({{0.9 + 0.3 * i, 0, 0.1 * (i + 1)}, {0.15, 1, 0.1 * (i + 1)}, level()});
  const Scene stair = boxes(steps);
  for (const Scene* scene : {&wall, &post, &stair}) {
    traceur::core::RandomStream random(81);
    for (int trial = 0; trial < 4; ++trial) {
      World<double> world(scene::humanoid(), 1, {}, *scene);
      Eigen::VectorXd q = scene::random_pose(scene::humanoid(), random, 0.7), v = scene::random_velocity(scene::humanoid(), random, 2);
      q.head(3) << -0.6, 0, 1.2;
      v.head(3) << 7, 0, 0;
      world.reset(0, q, v);
      double most = 0;
      for (int step = 0; step < 960; ++step) {
        world.step(1);
        most = std::max(most, penetration(world, *scene));
      }
      MESSAGE("deepest " << 1000 * most << " mm");
      CHECK(most < 0.04);
      if (scene == &wall)
        for (std::size_t b = 0; b < world.model().bodies.size(); ++b) CHECK(world.body_position(0, static_cast<int>(b)).x < 1.1);
    }
  }
}

TEST_CASE("a lane restored among boxes and objects goes on to the same bits") {
  using S = traceur::core::Pack<float, 4>;
  Extras extras;
  extras.objects.push_back({Kind::box, {0.15, 0.15, 0.15}, 3, {0.5, 0, 0.65}});
  const Scene scene = boxes({{{0.4, 0, 0.25}, {0.5, 0.5, 0.25}, level()}, {{-0.6, 0, 0.1}, {0.4, 0.5, 0.1}, level()}});
  World<S> world(scene::humanoid(), 2, {}, scene, extras);
  Eigen::VectorXd q = scene::standing_pose(), v = scene::at_rest();
  q[2] += 0.6;
  v[0] = 1.5;
  for (int lane = 0; lane < 2; ++lane) world.reset(lane, q, v);
  world.step(300);
  std::vector<float> kept(static_cast<std::size_t>(world.state_size())), first = kept, again = kept;
  world.save(0, kept.data());
  world.step(240);
  world.save(0, first.data());
  world.step(777);
  world.restore(0, kept.data());
  world.step(240);
  world.save(0, again.data());
  CHECK(first == again);
  world.restore(1, kept.data());
  world.step(240);
  world.save(1, again.data());
  CHECK(first == again);
}

TEST_CASE("bodies that collide with each other push apart and keep the momentum") {
  const auto& skeleton = scene::humanoid().skeleton;
  Extras extras;
  extras.self_collisions.push_back({skeleton.find("right_hip"), skeleton.find("left_hip")});
  extras.self_collisions.push_back({skeleton.find("right_knee"), skeleton.find("left_knee")});
  // Both legs are told to cross.
  Eigen::VectorXd target = skeleton.neutral_pose();
  exp_map(Vector{0.5, 0, 0}).store(target.data() + skeleton[skeleton.find("right_hip")].q_index);
  exp_map(Vector{-0.5, 0, 0}).store(target.data() + skeleton[skeleton.find("left_hip")].q_index);
  const auto gap = [&](const Extras& e) {
    World<double> world(scene::humanoid(), 1, {}, Ground<double>(), e);
    Eigen::VectorXd q = skeleton.neutral_pose();
    q[2] = 100;
    world.reset(0, q, scene::at_rest());
    world.set_target(0, target);
    world.set_gravity(0, 0);
    world.step(288);
    CHECK(norm(world.linear_momentum(0)) < 1e-9);
    CHECK(norm(world.angular_momentum(0)) < 1e-9);
    const auto across = [&](const char* joint) {
      return world.body_position(0, world.model().moving_of_joint[static_cast<std::size_t>(skeleton.find(joint))]).y;
    };
    return across("left_knee") - across("right_knee");
  };
  const double colliding = gap(extras), passing = gap({});
  MESSAGE("left knee " << colliding << " m to the left of the right one, " << passing << " m without collision");
  CHECK(colliding > 0.1);
  CHECK(passing < -0.1);
}

TEST_CASE("scenes that cannot be are refused") {
  World<double> bare(scene::humanoid(), 1);
  const auto shared = std::make_shared<const Scene>(boxes({{{0, 0, 0.15}, {0.6, 0.6, 0.15}, level()}}));
  CHECK_THROWS_WITH_AS(bare.set_scene(0, shared), "simulator: boxes need Extras::obstacles", Error);
  CHECK_THROWS_AS(bare.set_scene(0, nullptr), Error);
  CHECK_THROWS_AS(bare.set_gravity(0, std::nan("")), Error);
  CHECK_THROWS_AS(bare.set_friction(0, -1), Error);
  Extras grips;
  grips.grips.push_back({99, {0, 0, 0}, -1});
  CHECK_THROWS_AS(World<double>(scene::humanoid(), 1, {}, Ground<double>(), grips), Error);
  Extras pairs;
  pairs.self_collisions.push_back({3, 3});
  CHECK_THROWS_AS(World<double>(scene::humanoid(), 1, {}, Ground<double>(), pairs), Error);
}
