// SPDX-License-Identifier: MIT
#include <traceur/io/ppo_file.hpp>

#include <doctest/doctest.h>

using namespace traceur;

TEST_CASE("the state of a run comes back to the bit, also through the bytes of a file") {
  learn::PpoState<float> s;
  s.policy = Eigen::VectorXf::Random(7);
  s.value = Eigen::VectorXf::Random(5);
  s.policy_optimizer = Eigen::VectorXf::Random(14);
  s.value_optimizer = Eigen::VectorXf::Random(10);
  s.normalizer = Eigen::VectorXd::Random(9);
  s.policy_steps = 1234567890123;
  s.value_steps = 3;
  s.updates = 4;
  s.ticks = 5;
  s.policy_rate = 0.1;
  io::Safetensors file("run");
  io::add_ppo_state(file, s);
  const learn::PpoState<float> back = io::get_ppo_state(io::parse_safetensors(io::safetensors_bytes(file), "run"));
  CHECK(back.policy == s.policy);
  CHECK(back.value == s.value);
  CHECK(back.policy_optimizer == s.policy_optimizer);
  CHECK(back.value_optimizer == s.value_optimizer);
  CHECK(back.normalizer == s.normalizer);
  CHECK(back.policy_steps == s.policy_steps);
  CHECK(back.value_steps == s.value_steps);
  CHECK(back.updates == s.updates);
  CHECK(back.ticks == s.ticks);
  CHECK(back.policy_rate == s.policy_rate);
  CHECK_THROWS_WITH_AS(io::get_ppo_state(io::Safetensors("empty")), "empty: tensor 'ppo.policy': missing", Error);
}
