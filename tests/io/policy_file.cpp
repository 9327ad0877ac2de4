// SPDX-License-Identifier: MIT
#include <traceur/io/policy_file.hpp>

#include <filesystem>

#include <doctest/doctest.h>

using namespace traceur;

namespace {

learn::Policy<float> sample() {
  nn::Mlp<> network({4, 6, 5, 2});
  core::RandomStream random(8);
  Eigen::VectorXf theta(network.parameters());
  network.initialize(theta.data(), random);
  nn::Normalizer normalizer(4);
  Eigen::MatrixXf x(4, 50);
  for (float* at = x.data(); at != x.data() + x.size(); ++at) *at = static_cast<float>(random.normal());
  normalizer.observe<float>(x);
  return {network, theta, normalizer};
}

}  // namespace

TEST_CASE("a policy that was written acts as before") {
  const auto path = std::filesystem::temp_directory_path() / "traceur-policy.safetensors";
  learn::Policy<float> written = sample();
  io::write_policy(path, written, {{"arguments", "{}"}});
  learn::Policy<float> read = io::read_policy(path);
  CHECK(read.network().widths() == written.network().widths());
  CHECK(read.parameters() == written.parameters());
  CHECK(read.normalizer().state() == written.normalizer().state());
  Eigen::MatrixXf x = Eigen::MatrixXf::Random(4, 7), a(2, 7), b(2, 7);
  written.act(x, a);
  read.act(x, b);
  CHECK(a == b);
  CHECK(io::read_safetensors(path).metadata.at("arguments") == "{}");
  std::filesystem::remove(path);
}

TEST_CASE("files that hold no policy are refused") {
  CHECK_THROWS_AS(io::read_policy("/nonexistent/policy.safetensors"), Error);
  const learn::Policy<float> policy = sample();
  io::Safetensors empty("empty");
  CHECK_THROWS_WITH_AS(io::get_policy(empty), "empty: tensor 'widths': missing", Error);
  for (const std::vector<std::int64_t>& widths :
       {std::vector<std::int64_t>{4}, std::vector<std::int64_t>{4, 0, 2}, std::vector<std::int64_t>{4, std::int64_t{1} << 40, 2},
        std::vector<std::int64_t>{4, 6, 2}, std::vector<std::int64_t>(1000, std::int64_t{1} << 20)}) {
    io::Safetensors whole("file"), changed("file");
    io::add_policy(whole, policy);
    for (const io::Tensor& t : whole.tensors())
      if (t.name != "widths") changed.add(t);
    changed.add<std::int64_t>("widths", {widths.size()}, widths);
    CHECK_THROWS_AS(io::get_policy(changed), Error);
  }
}
