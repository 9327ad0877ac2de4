// SPDX-License-Identifier: MIT
// The snippets of docs/terrain.md, compiled and run. Keep the two alike.
#include <algorithm>
#include <cmath>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/terrain/augmentation.hpp>
#include <traceur/terrain/generators.hpp>
#include <traceur/terrain/local_map.hpp>
#include <traceur/terrain/obstacle_course.hpp>
#include <traceur/terrain/point_cloud.hpp>

using namespace traceur;

TEST_CASE("docs/terrain.md: a grid and a scene") {
  Eigen::MatrixXd h = Eigen::MatrixXd::Zero(16, 16);
  h.block(6, 4, 5, 8).setConstant(0.8);  // a platform
  const traceur::terrain::HeightGrid ground(h, 0.4, -3.2, -3.2);
  CHECK(ground.height(0, 0) == 0.8);

  const traceur::terrain::BoxScene scene({traceur::terrain::Box{{2, 0, 0.4}, {0.3, 1, 0.4}}});
  CHECK(scene.sample({2, 0, 1.0}).distance == doctest::Approx(0.2));
}

TEST_CASE("docs/terrain.md: generators") {
  core::RandomStream random(1);
  const terrain::HeightGrid training = terrain::random_boxes({}, random);
  const terrain::HeightGrid testing = terrain::random_walks({}, random);

  CHECK(training.nx() == 16);
  CHECK(testing.nx() == 32);
}

TEST_CASE("docs/terrain.md: augmentation") {
  core::RandomStream random(2);
  const terrain::HeightGrid ground = terrain::random_boxes({}, random);
  body::Character character;
  body::Joint root;
  root.name = root.body = "root";
  root.type = body::JointType::free;
  character.skeleton.add(root);
  character.shapes.push_back(
      {body::Shape::Kind::sphere, "ball", 0, {0, 0, 0}, core::Quaternion<double>::identity(), {0.2, 0, 0}});
  std::vector<body::Frames<double>> motion;
  for (double x = 0; x < 6; x += 0.1) {
    motion.emplace_back(character.skeleton);
    motion.back().position[0] = {x, 3, ground.height(x, 3) + 0.2};
    motion.back().rotation[0] = core::Quaternion<double>::identity();
  }

  terrain::HeightBounds bounds(ground);
  for (const body::Frames<double>& frames : motion) bounds.add(character, frames);
  const terrain::HeightGrid other = terrain::augmented(bounds, {}, random);

  for (const auto& frames : motion)
    CHECK(other.height(frames.position[0].x, 3) == ground.height(frames.position[0].x, 3));
}

TEST_CASE("docs/terrain.md: what a character sees") {
  core::RandomStream random(3);
  const terrain::HeightGrid ground = terrain::random_boxes({}, random);
  const terrain::BoxScene scene({terrain::Box{{2, 0, 0.4}, {0.3, 1, 0.4}}});
  const core::Vector3<float> root{3, 3, 1};
  const core::Quaternion<float> facing = core::Quaternion<float>::identity();

  const terrain::LocalMap<float> view;
  std::vector<float> heights(static_cast<std::size_t>(view.size()));  // 961, entry i + 31 j
  view.sample(ground, terrain::HeadingFrame<float>::of(root, facing), heights);

  CHECK(heights.size() == 961);
  CHECK(heights[10 + 31 * 15] == static_cast<float>(ground.height(3, 3)) - 1);

  const terrain::PointCloud<float> cloud(scene);
  terrain::NearestPoints<float> nearest(60);
  std::vector<float> points(180);
  nearest.observe(cloud, terrain::HeadingFrame<float>::of(root, facing), points);

  CHECK(std::hypot(points[0], points[1], points[2]) <= std::hypot(points[42], points[43], points[44]));
  CHECK(points[179] == points[2]);
}

TEST_CASE("docs/terrain.md: obstacle courses") {
  const std::vector<terrain::Obstacle> obstacles{{"wall", {terrain::Box{{0, 0, 0.5}, {0.1, 1, 0.5}}}},
                                                 {"block", {terrain::Box{{0, 0, 0.3}, {0.6, 0.8, 0.3}}}}};

  terrain::CourseParameters parameters;
  parameters.set_noise(0.03);
  const terrain::ObstacleCourse course = terrain::obstacle_course(obstacles, parameters, 11, 4);  // number 4 of seed 11

  CHECK(course.placements.size() == 5);
  CHECK(course.scene.size() == 5);
}
