// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>

#include <traceur/nn/module.hpp>

namespace traceur::nn {

/// Modules one after the other: the output of each is the input of the next. Their tensors are named `0.weight`, `1.weight`
/// and so on, as PyTorch names them.
template <class... M>
class Sequential {
  static_assert(sizeof...(M) > 0, "a Sequential is made of modules");
  static constexpr std::size_t count = sizeof...(M);

public:
  template <class S>
  struct Workspace {
    std::tuple<WorkspaceOf<M, S>...> modules;
    std::array<Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>, count - 1> between;
    std::array<Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>, count - 1> gradients;
  };

  /// Throws Error unless every module takes as many rows as the one before it gives.
  explicit Sequential(M... modules) : modules_(std::move(modules)...) { check<1>(); }

  template <std::size_t I>
  const auto& get() const noexcept {
    return std::get<I>(modules_);
  }

  Eigen::Index inputs() const noexcept { return get<0>().inputs(); }
  Eigen::Index outputs() const noexcept { return get<count - 1>().outputs(); }
  Eigen::Index parameters() const noexcept {
    return std::apply([](const M&... m) { return (m.parameters() + ...); }, modules_);
  }

  template <class S>
  Workspace<S> workspace(Eigen::Index max_columns) const {
    Workspace<S> w{std::apply([&](const M&... m) { return std::make_tuple(m.template workspace<S>(max_columns)...); },
                              modules_),
                   {},
                   {}};
    reserve<0>(w, max_columns);
    return w;
  }

  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    forward_from<0, S>(theta, x, w, y);
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    infer_from<0, S>(theta, x, w, y);
  }

  template <class S>
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, Workspace<S>& w, S* dtheta,
                Matrix<S> dx) const noexcept {
    backward_from<0, S>(theta, x, dy, w, dtheta, dx);
  }

  template <class S>
  void initialize(S* theta, core::RandomStream& random) const {
    std::apply([&](const M&... m) { ((m.initialize(theta, random), theta += m.parameters()), ...); }, modules_);
  }

  template <class F>
  void for_each_parameter(F&& f) const {
    Eigen::Index offset = 0;
    int i = 0;
    const auto report = [&](const auto& module) {
      for_each_parameter_of(module, std::to_string(i++), offset, f);
      offset += module.parameters();
    };
    std::apply([&](const M&... m) { (report(m), ...); }, modules_);
  }

private:
  template <std::size_t I>
  void check() const {
    if constexpr (I < count) {
      if (get<I - 1>().outputs() != get<I>().inputs()) {
        throw Error("sequential: module " + std::to_string(I) + " takes " + std::to_string(get<I>().inputs()) +
                    " rows, module " + std::to_string(I - 1) + " gives " + std::to_string(get<I - 1>().outputs()));
      }
      check<I + 1>();
    }
  }

  template <std::size_t I, class S>
  void reserve(Workspace<S>& w, Eigen::Index max_columns) const {
    if constexpr (I + 1 < count) {
      w.between[I].resize(get<I>().outputs(), max_columns);
      w.gradients[I].resize(get<I>().outputs(), max_columns);
      reserve<I + 1>(w, max_columns);
    }
  }

  template <std::size_t I, class S>
  void forward_from(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    if constexpr (I + 1 == count) {
      get<I>().forward(theta, x, std::get<I>(w.modules), y);
    } else {
      Matrix<S> next = w.between[I].leftCols(x.cols());
      get<I>().forward(theta, x, std::get<I>(w.modules), next);
      forward_from<I + 1, S>(theta + get<I>().parameters(), next, w, y);
    }
  }

  template <std::size_t I, class S>
  void infer_from(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    if constexpr (I + 1 == count) {
      get<I>().infer(theta, x, std::get<I>(w.modules), y);
    } else {
      Matrix<S> next = w.between[I].leftCols(x.cols());
      get<I>().infer(theta, x, std::get<I>(w.modules), next);
      infer_from<I + 1, S>(theta + get<I>().parameters(), next, w, y);
    }
  }

  // From module I, whose input x is, to the end.
  template <std::size_t I, class S>
  void backward_from(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, Workspace<S>& w, S* dtheta,
                     Matrix<S> dx) const noexcept {
    if constexpr (I + 1 == count) {
      get<I>().backward(theta, x, dy, std::get<I>(w.modules), dtheta, dx);
    } else {
      const Eigen::Index own = get<I>().parameters();
      Matrix<S> next = w.gradients[I].leftCols(x.cols());
      backward_from<I + 1, S>(theta + own, w.between[I].leftCols(x.cols()), dy, w, dtheta + own, next);
      get<I>().backward(theta, x, next, std::get<I>(w.modules), dtheta, dx);
    }
  }

  std::tuple<M...> modules_;
};

}  // namespace traceur::nn
