// SPDX-License-Identifier: MIT
// The code of README.md, line by line.
#include <cstdio>
#include <traceur/io/mjcf.hpp>
#include <traceur/sim/world.hpp>

int stand_and_push(const char* mjcf) {
  using namespace traceur;
  const body::Character humanoid = io::read_mjcf(mjcf);
  sim::World<core::Pack<float>> world(humanoid, 16);
  Eigen::VectorXd q = humanoid.skeleton.neutral_pose();
  q[2] = 0.883;  // the root's height, m
  for (int lane = 0; lane < world.lanes(); ++lane) world.reset(lane, q, Eigen::VectorXd::Zero(humanoid.skeleton.nv()));
  for (int tick = 0; tick < 60; ++tick) {
    if (tick == 30)
      for (int lane = 0; lane < world.lanes(); ++lane) world.push(lane, 0, {20.0 * lane, 0, 0});  // N
    world.step(8);  // 1/60 s
  }
  int standing = 0;
  for (int lane = 0; lane < world.lanes(); ++lane) standing += world.pose(lane)[2] > 0.7;
  std::printf("%d of %d still stand\n", standing, world.lanes());
  return standing;
}

#include <doctest/doctest.h>

#include <fstream>
#include <sstream>
#include <string>

TEST_CASE("README.md: the snippet is this file's code and works") {
  CHECK(stand_and_push(TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml") == 16);
  const auto text = [](const char* path) {
    std::ifstream in(path);
    std::ostringstream out;
    out << in.rdbuf();
    return out.str();
  };
  const std::string mine = text(TRACEUR_SOURCE_DIR "/tests/sim/readme.cpp"), readme = text(TRACEUR_SOURCE_DIR "/README.md");
  const std::size_t begin = mine.find("#include <cstdio>"), end = mine.find("\n}\n", begin) + 3;
  CHECK(readme.find(mine.substr(begin, end - begin)) != std::string::npos);
}
