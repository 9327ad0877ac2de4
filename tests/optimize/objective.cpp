// SPDX-License-Identifier: MIT
#include <traceur/optimize/objective.hpp>

#include <cstdint>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

using namespace traceur::optimize;
using traceur::Error;
using traceur::core::RandomStream;
using traceur::core::SerialExecutor;
using traceur::core::ThreadExecutor;

namespace {

double weighted_norm(const Eigen::Ref<const Eigen::VectorXd>& x) {
  double sum = 0.0;
  for (Eigen::Index i = 0; i < x.size(); ++i) sum += static_cast<double>(i + 1) * x(i) * x(i);
  return sum;
}

struct WeightedNorm {
  double operator()(const Eigen::Ref<const Eigen::VectorXd>& x) const { return weighted_norm(x); }
};

struct WeightedNormBatch {
  void operator()(const Eigen::Ref<const Eigen::MatrixXd>& x, Eigen::Ref<Eigen::VectorXd> costs) const {
    for (Eigen::Index k = 0; k < x.cols(); ++k) costs(k) = weighted_norm(x.col(k));
  }
};

struct WeightedNormWithScratch {
  std::vector<Eigen::VectorXd> scratch;
  double operator()(const Eigen::Ref<const Eigen::VectorXd>& x, int worker) {
    Eigen::VectorXd& mine = scratch.at(static_cast<std::size_t>(worker));
    mine = x;
    return weighted_norm(mine);
  }
};

struct NoCost {
  void operator()(const Eigen::Ref<const Eigen::VectorXd>&) const {}
};

struct ReturnsBatch {
  Eigen::VectorXd operator()(const Eigen::Ref<const Eigen::MatrixXd>& x, Eigen::Ref<Eigen::VectorXd>) const {
    return x.row(0).transpose();
  }
};

using Lambda = decltype([](const Eigen::VectorXd& x) { return static_cast<float>(x(0)); });

static_assert(Objective<WeightedNorm> && Objective<Lambda> && Objective<Single<WeightedNormBatch>>);
static_assert(!Objective<NoCost> && !Objective<WeightedNormBatch> && !Objective<WeightedNormWithScratch>);
static_assert(WorkerObjective<WeightedNormWithScratch> && !WorkerObjective<WeightedNorm>);
static_assert(BatchObjective<WeightedNormBatch> && BatchObjective<Batched<WeightedNorm, SerialExecutor>>);
static_assert(BatchObjective<Batched<WeightedNormWithScratch, ThreadExecutor>>);
static_assert(!BatchObjective<ReturnsBatch> && !BatchObjective<WeightedNorm> && !AnyObjective<NoCost>);

class RandomSearch {
public:
  RandomSearch(Eigen::Index n, int generations) : candidates_(n, 6), best_(n), left_(generations) {}
  const Eigen::MatrixXd& ask() {
    RandomStream random(1, 0, static_cast<std::uint64_t>(left_));
    for (double& value : candidates_.reshaped()) value = random.uniform(-1.0, 1.0);
    return candidates_;
  }
  void tell(const Eigen::Ref<const Eigen::VectorXd>& costs) {
    Eigen::Index k = 0;
    const double cost = costs.minCoeff(&k);
    if (cost < best_cost_) {
      best_cost_ = cost;
      best_ = candidates_.col(k);
    }
    --left_;
  }
  bool finished() const { return left_ == 0; }
  const Eigen::VectorXd& best() const { return best_; }
  double best_cost() const { return best_cost_; }

private:
  Eigen::MatrixXd candidates_;
  Eigen::VectorXd best_;
  double best_cost_ = std::numeric_limits<double>::infinity();
  int left_;
};

struct AsksOnly {
  Eigen::MatrixXd candidates;
  const Eigen::MatrixXd& ask() { return candidates; }
};

static_assert(AskTellOptimizer<RandomSearch>);
static_assert(!AskTellOptimizer<AsksOnly>);

}  // namespace

TEST_SUITE("optimize/objective") {
  TEST_CASE("every kind of objective gives the same bits on every executor") {
    const Eigen::MatrixXd x = Eigen::MatrixXd::Random(5, 40);
    Eigen::VectorXd expected(40);
    for (Eigen::Index k = 0; k < 40; ++k) expected(k) = weighted_norm(x.col(k));
    const auto check = [&](auto& executor) {
      WeightedNorm plain;
      WeightedNormBatch batch;
      WeightedNormWithScratch scratch{std::vector<Eigen::VectorXd>(static_cast<std::size_t>(executor.concurrency()))};
      const auto same = [&](auto& objective) {
        Eigen::VectorXd costs = Eigen::VectorXd::Constant(40, -1.0);
        evaluate(objective, x, costs, executor);
        return (costs.array() == expected.array()).all();
      };
      CHECK(same(plain));
      CHECK(same(batch));
      CHECK(same(scratch));
      CHECK(same(weighted_norm));
      Batched there(scratch, executor);
      CHECK(same(there));
      Single back(there);
      CHECK(same(back));
    };
    SerialExecutor serial;
    check(serial);
    ThreadExecutor threads(3);
    check(threads);
  }

  TEST_CASE("a batch objective sees the batch once") {
    int calls = 0;
    auto objective = [&](const Eigen::Ref<const Eigen::MatrixXd>& x, Eigen::Ref<Eigen::VectorXd> costs) {
      ++calls;
      costs = x.row(0).transpose();
    };
    SerialExecutor serial;
    const Eigen::MatrixXd x = Eigen::MatrixXd::Random(2, 7);
    Eigen::VectorXd costs(7);
    evaluate(objective, x, costs, serial);
    CHECK(calls == 1);
    CHECK(costs == x.row(0).transpose());
  }

  TEST_CASE("room for the wrong number of costs is an error") {
    SerialExecutor serial;
    WeightedNorm objective;
    Eigen::VectorXd costs(3);
    CHECK_THROWS_WITH_AS(evaluate(objective, Eigen::MatrixXd::Zero(2, 4), costs, serial),
                         "evaluate: expected one cost for each of the 4 columns, got room for 3", Error);
  }

  TEST_CASE("minimize drives any ask-tell optimizer to its end") {
    SerialExecutor serial;
    ThreadExecutor threads(2);
    RandomSearch a(3, 200), b(3, 200);
    const double cost = minimize(WeightedNorm{}, a, serial);
    CHECK(cost == minimize(WeightedNormBatch{}, b, threads));
    CHECK(a.best() == b.best());
    CHECK(cost == weighted_norm(a.best()));
    CHECK(cost < 0.2);
  }

  TEST_CASE("what the objective throws comes out of minimize") {
    SerialExecutor serial;
    RandomSearch search(2, 5);
    CHECK_THROWS_AS(minimize([](const Eigen::VectorXd&) -> double { throw std::runtime_error("no"); }, search, serial),
                    std::runtime_error);
    CHECK_FALSE(search.finished());
  }
}
