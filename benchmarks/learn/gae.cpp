// SPDX-License-Identifier: MIT
// Advantages and returns of 256 environments x 32 steps, an episode's end in every fiftieth step: with the textbook's steps of
// length 1, and with steps of their own lengths and rewards that flow (Lee et al. 2021, Eq. 9), which costs two powers and an
// exponential a step. `samples` is steps a second.
#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include <traceur/core/random.hpp>
#include <traceur/learn/gae.hpp>

namespace {

using namespace traceur::learn;

struct Steps {
  static constexpr Eigen::Index steps = 32, environments = 256;
  Eigen::MatrixXf reward{steps, environments}, rate{steps, environments}, duration{steps, environments},
      value{steps, environments}, after{steps, environments}, last{1, environments}, out{steps, environments};
  Eigen::Matrix<End, Eigen::Dynamic, Eigen::Dynamic> end{steps, environments};

  Steps() {
    traceur::core::RandomStream random(1);
    for (Eigen::MatrixXf* m : {&reward, &rate, &value, &after, &last})
      for (float& x : m->reshaped()) x = random.normal<float>();
    for (float& x : duration.reshaped()) x = random.uniform<float>(0.5F, 2.0F);
    for (End& e : end.reshaped()) e = random.bernoulli(0.02) ? (random.bernoulli(0.5) ? End::terminated : End::timed_out) : End::running;
  }
  Trajectories<float> equal() const { return {reward, none<float>(), none<float>(), value, after, last, end}; }
  Trajectories<float> varying() const { return {reward, rate, duration, value, after, last, end}; }
};

template <Trajectories<float> (Steps::*make)() const, void (*estimate)(const Discount&, const Trajectories<float>&, Columns<float>)>
void run(benchmark::State& state) {
  Steps s;
  const Trajectories<float> steps = (s.*make)();
  for (auto _ : state) {
    estimate({}, steps, s.out);
    benchmark::ClobberMemory();
  }
  state.counters["samples"] =
      benchmark::Counter(static_cast<double>(state.iterations() * s.out.size()), benchmark::Counter::kIsRate);
}

void advantage(const Discount& d, const Trajectories<float>& t, Columns<float> out) { generalized_advantage<float>(d, t, out); }
void target(const Discount& d, const Trajectories<float>& t, Columns<float> out) { lambda_return<float>(d, t, out); }

}  // namespace

BENCHMARK(run<&Steps::equal, advantage>)->Name("generalized_advantage/equal_steps");
BENCHMARK(run<&Steps::varying, advantage>)->Name("generalized_advantage/varying_steps");
BENCHMARK(run<&Steps::equal, target>)->Name("lambda_return/equal_steps");
BENCHMARK(run<&Steps::varying, target>)->Name("lambda_return/varying_steps");
