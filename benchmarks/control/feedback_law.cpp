// SPDX-License-Identifier: MIT
// Evaluations per second of the feedback law with 63 and 99 numbers, one law and one measurement for each lane: on packs,
// and as products of Eigen matrices in double and float, one lane after the other. `laws` counts lanes; `ratio` is ours over
// Eigen's in float, both timed in turn in one run.
#include <algorithm>
#include <vector>

#include <Eigen/Core>
#include <benchmark/benchmark.h>

#include "../in_turn.hpp"
#include <traceur/control/feedback_law.hpp>
#include <traceur/core/random.hpp>

namespace {

using namespace traceur;
using control::FeedbackLimits;
using control::FeedbackShape;

FeedbackShape shape_of(benchmark::State& state) {
  if (state.range(0) == 63) return {};
  return {{.swing_foot = true, .root_spin = true, .ankles = true}, 3, 1};
}

template <class S>
class Ours {
 public:
  explicit Ours(const FeedbackShape& shape) : shape_(shape), law_(static_cast<std::size_t>(shape.size())), ds_(control::full_sensors), da_(15) {
    core::RandomStream random(1);
    for (auto* numbers : {&law_, &ds_})
      for (S& x : *numbers)
        for (int lane = 0; lane < core::lane_count<S>; ++lane) core::set_lane(x, lane, static_cast<core::Element<S>>(0.1 * random.normal()));
  }
  void operator()() {
    control::feedback(shape_, FeedbackLimits{}, law_.data(), ds_.data(), da_.data());
    benchmark::DoNotOptimize(da_.data());
    benchmark::ClobberMemory();
  }
  static constexpr int lanes = core::lane_count<S>;

 private:
  FeedbackShape shape_;
  std::vector<S> law_, ds_, da_;
};

template <class T>
class Peer {
 public:
  explicit Peer(const FeedbackShape& shape)
      : ap_(Matrix::Random(shape.sets.actions(), shape.rank)),
        sp_(Matrix::Random(shape.rank, shape.sets.sensors())),
        ds_(Vector::Random(shape.sets.sensors())),
        reduced_(shape.rank),
        da_(shape.sets.actions()) {}
  void operator()() {
    ds_[3] = std::clamp(ds_[3], T(-0.3), T(0.3));
    for (const int k : {4, 5}) ds_[k] = std::clamp(ds_[k], T(-0.5), T(0.5));
    reduced_.noalias() = sp_ * ds_;
    da_.noalias() = ap_ * reduced_;
    for (T& x : da_) x = std::clamp(x, T(-0.6), T(0.6));
    benchmark::DoNotOptimize(da_.data());
    benchmark::ClobberMemory();
  }
  static constexpr int lanes = 1;

 private:
  using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;
  using Vector = Eigen::Matrix<T, Eigen::Dynamic, 1>;
  Matrix ap_, sp_;
  Vector ds_, reduced_, da_;
};

template <class Law>
void laws(benchmark::State& state) {
  Law law(shape_of(state));
  for (auto _ : state) law();
  state.counters["laws"] = benchmark::Counter(static_cast<double>(state.iterations()) * Law::lanes, benchmark::Counter::kIsRate);
}

void against_eigen(benchmark::State& state) {
  Ours<core::Pack<float>> ours(shape_of(state));
  Peer<float> peer(shape_of(state));
  in_turn(state, 1000, ours.lanes, [&] { ours(); }, [&] { peer(); });
}

}  // namespace

BENCHMARK(laws<Ours<core::Pack<float>>>)->Name("laws/pack_float")->Arg(63)->Arg(99);
BENCHMARK(laws<Ours<core::Pack<double>>>)->Name("laws/pack_double")->Arg(63)->Arg(99);
BENCHMARK(laws<Ours<double>>)->Name("laws/double")->Arg(63)->Arg(99);
BENCHMARK(laws<Peer<float>>)->Name("laws/eigen_float")->Arg(63)->Arg(99);
BENCHMARK(laws<Peer<double>>)->Name("laws/eigen_double")->Arg(63)->Arg(99);
BENCHMARK(against_eigen)->Arg(63)->Arg(99);
