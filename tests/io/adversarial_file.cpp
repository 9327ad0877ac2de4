// SPDX-License-Identifier: MIT
#include <traceur/io/adversarial_file.hpp>

#include <doctest/doctest.h>

using namespace traceur;

TEST_CASE("what is written of adversarial imitation is what is read") {
  learn::AdversarialState<float> s;
  s.discriminator = Eigen::VectorXf::LinSpaced(5, 0, 1);
  s.optimizer = Eigen::VectorXf::LinSpaced(10, 2, 3);
  s.steps = 7;
  s.updates = 8;
  s.normalizer = Eigen::VectorXd::LinSpaced(5, 4, 5);
  s.replay = Eigen::MatrixXf::Random(2, 3);
  s.replayed = 9;
  io::Safetensors file("memory");
  io::add_adversarial_state(file, s, "x.");
  const learn::AdversarialState<float> r = io::get_adversarial_state(file, "x.");
  CHECK(r.discriminator == s.discriminator);
  CHECK(r.optimizer == s.optimizer);
  CHECK(r.steps == 7);
  CHECK(r.updates == 8);
  CHECK(r.normalizer == s.normalizer);
  CHECK(r.replay == s.replay);
  CHECK(r.replayed == 9);
  CHECK_THROWS_AS(io::get_adversarial_state(file), Error);

  io::Safetensors wrong("memory");
  s.replay.resize(0, 0);
  io::add_adversarial_state(wrong, s);
  CHECK(io::get_adversarial_state(wrong).replay.size() == 0);
}
