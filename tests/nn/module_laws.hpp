// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/random.hpp>
#include <traceur/nn/module.hpp>

/// The laws every module obeys, checked on numbers. What they do with the numbers is compiled once, in module_laws.cpp.
namespace laws {

using Eigen::Index;
using traceur::nn::ConstMatrix;
using traceur::nn::Matrix;

template <class S>
using Table = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;

struct Tensor {
  std::string name;
  Index offset, rows, cols;
};

/// A module with its workspace, whatever its type.
template <class S>
class Subject {
public:
  virtual ~Subject() = default;
  virtual void forward(const S* theta, ConstMatrix<S> x, Matrix<S> y) = 0;
  virtual void infer(const S* theta, ConstMatrix<S> x, Matrix<S> y) = 0;
  virtual void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, S* dtheta, Matrix<S> dx) = 0;
  virtual void initialize(S* theta, traceur::core::RandomStream& random) = 0;
  Index inputs = 0, outputs = 0, parameters = 0;
  std::vector<Tensor> tensors;
};

struct Nothing {};

template <class S, class M, class F>
class SubjectOf final : public Subject<S> {
  static_assert(traceur::nn::Module<M, S>);

public:
  SubjectOf(const M& module, Index columns, F forward)
      : module_(module), workspace_(module.template workspace<S>(columns)), forward_(std::move(forward)) {
    this->inputs = module.inputs();
    this->outputs = module.outputs();
    this->parameters = module.parameters();
    module.for_each_parameter([&](std::string_view name, Index offset, Index rows, Index cols) {
      this->tensors.push_back({std::string(name), offset, rows, cols});
    });
  }
  void forward(const S* theta, ConstMatrix<S> x, Matrix<S> y) override {
    if constexpr (std::is_same_v<F, Nothing>) {
      module_.forward(theta, x, workspace_, y);
    } else {
      forward_(theta, x, workspace_, y);
    }
  }
  void infer(const S* theta, ConstMatrix<S> x, Matrix<S> y) override { module_.infer(theta, x, workspace_, y); }
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, S* dtheta, Matrix<S> dx) override {
    module_.backward(theta, x, dy, workspace_, dtheta, dx);
  }
  void initialize(S* theta, traceur::core::RandomStream& random) override { module_.initialize(theta, random); }

private:
  M module_;
  traceur::nn::WorkspaceOf<M, S> workspace_;
  F forward_;
};

void check_gradient_of(Subject<double>& m, Index columns);
void check_laws_of(Subject<float>& m, Index tokens);
void check_laws_of(Subject<double>& m, Index tokens);
/// Standard normal numbers.
Table<double> random_table(Index rows, Index cols, unsigned seed);
Table<double> random_parameters_of(Subject<double>& m, unsigned seed);
/// Largest difference over the largest number expected: the error of a whole tensor.
double relative_error(ConstMatrix<double> found, ConstMatrix<double> expected);
bool equal(ConstMatrix<double> a, ConstMatrix<double> b);

/// Parameters near those a module starts with, none of them at a special value.
template <class M>
Table<double> random_parameters(const M& module, unsigned seed) {
  SubjectOf<double, M, Nothing> subject(module, 1, {});
  return random_parameters_of(subject, seed);
}

/// backward against central differences of a random weighting of the outputs, in double. `forward(theta, x, w, y)` may be
/// the module's with a mask.
template <class M, class F = Nothing>
void check_gradient(const M& module, Index columns, F forward = {}) {
  SubjectOf<double, M, F> subject(module, columns, std::move(forward));
  check_gradient_of(subject, columns);
}

/// All laws of the concept but the gradient, for a module whose samples are `tokens` columns each.
template <class S, class M>
void check_module(const M& module, Index tokens = 1) {
  SubjectOf<S, M, Nothing> subject(module, 3 * tokens, {});
  check_laws_of(subject, tokens);
}

/// What the module gives for x.
template <class M>
Table<double> output(const M& module, const Table<double>& theta, const Table<double>& x) {
  SubjectOf<double, M, Nothing> subject(module, x.cols(), {});
  Table<double> y(module.outputs(), x.cols());
  subject.forward(theta.data(), x, y);
  return y;
}

}  // namespace laws
