// SPDX-License-Identifier: MIT
// Rotations per second: exponential map, logarithm, product and rotated vectors, in float, double and on packs, beside Eigen's
// AngleAxis and Quaternion. `rotations` counts lanes; `ratio` is packs of float over Eigen in float, both timed in turn in one run.
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <benchmark/benchmark.h>

#include "../in_turn.hpp"
#include <traceur/core/pack.hpp>
#include <traceur/core/random.hpp>
#include <traceur/core/rotation.hpp>

namespace {

using namespace traceur;

constexpr int count = 256;  // of each kind, so that all stay in the first cache

template <class S>
class Ours {
 public:
  using T = core::Element<S>;
  Ours() : vectors_(count), out_(count), turns_(count), others_(count) {
    core::RandomStream random(1);
    for (std::size_t k = 0; k < count; ++k) {
      for (S* x : {&vectors_[k].x, &vectors_[k].y, &vectors_[k].z})
        for (int lane = 0; lane < lanes; ++lane) core::set_lane(*x, lane, static_cast<T>(random.normal()));
      turns_[k] = core::exp_map(vectors_[k]);
      others_[k] = turns_[k];
    }
  }
  void exponential() {
    for (std::size_t k = 0; k < count; ++k) others_[k] = core::exp_map(vectors_[k]);
    benchmark::ClobberMemory();
  }
  void logarithm() {
    for (std::size_t k = 0; k < count; ++k) out_[k] = core::log_map(turns_[k]);
    benchmark::ClobberMemory();
  }
  void product() {
    for (std::size_t k = 0; k < count; ++k) others_[k] = turns_[k] * turns_[count - 1 - k];
    benchmark::ClobberMemory();
  }
  void rotate() {
    for (std::size_t k = 0; k < count; ++k) out_[k] = turns_[k].rotate(vectors_[k]);
    benchmark::ClobberMemory();
  }
  static constexpr int lanes = core::lane_count<S>;

 private:
  std::vector<core::Vector3<S>> vectors_, out_;
  std::vector<core::Quaternion<S>> turns_, others_;
};

template <class T>
class Peer {
 public:
  Peer() : vectors_(count), out_(count), turns_(count), others_(count) {
    core::RandomStream random(1);
    for (std::size_t k = 0; k < count; ++k) {
      for (T& x : vectors_[k]) x = static_cast<T>(random.normal());
      turns_[k] = Eigen::AngleAxis<T>(vectors_[k].norm(), vectors_[k].normalized());
    }
  }
  void exponential() {
    for (std::size_t k = 0; k < count; ++k) {
      const T angle = vectors_[k].norm();
      others_[k] = Eigen::AngleAxis<T>(angle, vectors_[k] / angle);
    }
    benchmark::ClobberMemory();
  }
  void logarithm() {
    for (std::size_t k = 0; k < count; ++k) {
      const Eigen::AngleAxis<T> turn(turns_[k]);
      out_[k] = turn.angle() * turn.axis();
    }
    benchmark::ClobberMemory();
  }
  void product() {
    for (std::size_t k = 0; k < count; ++k) others_[k] = turns_[k] * turns_[count - 1 - k];
    benchmark::ClobberMemory();
  }
  void rotate() {
    for (std::size_t k = 0; k < count; ++k) out_[k] = turns_[k] * vectors_[k];
    benchmark::ClobberMemory();
  }
  static constexpr int lanes = 1;

 private:
  using Vector = Eigen::Matrix<T, 3, 1>;
  std::vector<Vector> vectors_, out_;
  std::vector<Eigen::Quaternion<T>> turns_, others_;
};

template <class Side>
void rotations(benchmark::State& state, void (Side::*work)()) {
  Side side;
  for (auto _ : state) (side.*work)();
  state.counters["rotations"] =
      benchmark::Counter(static_cast<double>(state.iterations()) * count * Side::lanes, benchmark::Counter::kIsRate);
}

void against_eigen(benchmark::State& state, void (Ours<core::Pack<float>>::*mine)(), void (Peer<float>::*theirs)()) {
  Ours<core::Pack<float>> ours;
  Peer<float> peer;
  in_turn(state, 100, ours.lanes, [&] { (ours.*mine)(); }, [&] { (peer.*theirs)(); });
}

template <class Side>
void add(const char* side) {
  const auto one = [&](const char* what, void (Side::*work)()) {
    benchmark::RegisterBenchmark((std::string(what) + "/" + side).c_str(), [work](benchmark::State& s) { rotations<Side>(s, work); });
  };
  one("exponential", &Side::exponential);
  one("logarithm", &Side::logarithm);
  one("product", &Side::product);
  one("rotate", &Side::rotate);
}

[[maybe_unused]] const bool added = [] {
  using Pack = Ours<core::Pack<float>>;
  add<Pack>("pack_float");
  add<Ours<core::Pack<double>>>("pack_double");
  add<Ours<float>>("float");
  add<Ours<double>>("double");
  add<Peer<float>>("eigen_float");
  add<Peer<double>>("eigen_double");
  const auto one = [&](const char* what, void (Pack::*mine)(), void (Peer<float>::*theirs)()) {
    benchmark::RegisterBenchmark((std::string("against_eigen/") + what).c_str(),
                                 [mine, theirs](benchmark::State& s) { against_eigen(s, mine, theirs); });
  };
  one("exponential", &Pack::exponential, &Peer<float>::exponential);
  one("logarithm", &Pack::logarithm, &Peer<float>::logarithm);
  one("product", &Pack::product, &Peer<float>::product);
  one("rotate", &Pack::rotate, &Peer<float>::rotate);
  return true;
}();

}  // namespace
