// SPDX-License-Identifier: MIT
#pragma once

#include <concepts>
#include <string>
#include <utility>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/executor.hpp>

namespace traceur::optimize {

/// A cost to be minimised, R^n -> R: `f(x)`. Laws: the cost depends on x alone, and calls may overlap in time. A cost
/// that is not finite means that x could not be judged.
template <class F>
concept Objective = requires(F& f, const Eigen::Ref<const Eigen::VectorXd>& x) {
  { f(x) } -> std::convertible_to<double>;
};

/// An objective that needs memory it can write to, such as a simulator: `f(x, worker)`. Calls that overlap in time have
/// different workers; the cost must not depend on the worker.
template <class F>
concept WorkerObjective = requires(F& f, const Eigen::Ref<const Eigen::VectorXd>& x, int worker) {
  { f(x, worker) } -> std::convertible_to<double>;
};

/// An objective that judges the columns of x (n by batch) at once and writes one cost each: `f(x, costs)`. Law: each
/// cost depends on its column alone.
template <class F>
concept BatchObjective = requires(F& f, const Eigen::Ref<const Eigen::MatrixXd>& x, Eigen::Ref<Eigen::VectorXd> costs) {
  { f(x, costs) } -> std::same_as<void>;
};

template <class F>
concept AnyObjective = Objective<F> || WorkerObjective<F> || BatchObjective<F>;

/// Writes the cost of each column of `x` (n by batch) to `costs` (batch). A batch objective gets the whole batch in one
/// call, the others one job per column; the result is the same bits on every executor. Throws Error if the sizes
/// differ.
template <AnyObjective F, core::Executor E>
void evaluate(F& objective, const Eigen::Ref<const Eigen::MatrixXd>& x, Eigen::Ref<Eigen::VectorXd> costs,
              E& executor) {
  if (costs.size() != x.cols()) {
    throw Error("evaluate: expected one cost for each of the " + std::to_string(x.cols()) + " columns, got room for " +
                std::to_string(costs.size()));
  }
  if constexpr (BatchObjective<F>) {
    objective(x, costs);
  } else {
    executor.run(static_cast<int>(x.cols()), [&](int i, int worker) {
      if constexpr (WorkerObjective<F>) {
        costs(i) = objective(x.col(i), worker);
      } else {
        costs(i) = objective(x.col(i));
      }
    });
  }
}

/// A batch objective made of an objective of one column and the executor that runs the columns. Keeps a reference to
/// the executor.
template <class F, core::Executor E>
requires(Objective<F> || WorkerObjective<F>) class Batched {
public:
  Batched(F objective, E& executor) : objective_(std::move(objective)), executor_(&executor) {}

  void operator()(const Eigen::Ref<const Eigen::MatrixXd>& x, Eigen::Ref<Eigen::VectorXd> costs) {
    evaluate(objective_, x, costs, *executor_);
  }

private:
  F objective_;
  E* executor_;
};

/// An objective made of a batch objective, which it calls with one column. Its calls may overlap in time only if those
/// of the batch objective may.
template <BatchObjective F>
class Single {
public:
  explicit Single(F objective) : objective_(std::move(objective)) {}

  double operator()(const Eigen::Ref<const Eigen::VectorXd>& x) {
    Eigen::Matrix<double, 1, 1> cost;
    objective_(x, cost);
    return cost(0);
  }

private:
  F objective_;
};

/// An optimizer that proposes and is told, so that whoever owns the loop may evaluate wherever and log whatever. Laws:
/// `ask()` gives candidates as columns, the same ones until `tell(costs)` with one cost per column; `finished()` turns
/// true after finitely many rounds or never, as its parameters say.
template <class O>
concept AskTellOptimizer = requires(O& optimizer, const O& constant, const Eigen::Ref<const Eigen::VectorXd>& costs) {
  { optimizer.ask() } -> std::convertible_to<const Eigen::MatrixXd&>;
  optimizer.tell(costs);
  { constant.finished() } -> std::convertible_to<bool>;
  { constant.best() } -> std::convertible_to<const Eigen::VectorXd&>;
  { constant.best_cost() } -> std::convertible_to<double>;
};

/// Asks, evaluates and tells until the optimizer has finished. Returns the best cost. What the objective throws comes
/// out here and leaves the optimizer as it was before that generation's `tell`.
template <AnyObjective F, AskTellOptimizer O, core::Executor E>
double minimize(F&& objective, O& optimizer, E& executor) {
  Eigen::VectorXd costs;
  while (!optimizer.finished()) {
    const Eigen::MatrixXd& candidates = optimizer.ask();
    costs.resize(candidates.cols());
    evaluate(objective, candidates, costs, executor);
    optimizer.tell(costs);
  }
  return optimizer.best_cost();
}

}  // namespace traceur::optimize
