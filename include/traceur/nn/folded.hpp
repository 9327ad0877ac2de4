// SPDX-License-Identifier: MIT
#pragma once

#include <utility>

#include <traceur/nn/module.hpp>

namespace traceur::nn {

namespace detail {

/// Whether the columns of a matrix lie one after the other, so that it can be seen as columns of another length.
template <class M>
bool is_contiguous(const M& m) noexcept {
  return m.cols() <= 1 || m.outerStride() == m.rows();
}

/// The numbers of x, column after column; copied to `copy` if they are not contiguous.
template <class S>
const S* contiguous(ConstMatrix<S> x, Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>& copy) noexcept {
  if (is_contiguous(x)) return x.data();
  copy.leftCols(x.cols()) = x;
  return copy.data();
}

}  // namespace detail

/// A module of tokens seen as a module of samples: a column holds the `tokens` columns of one sample, one below the other.
/// What maps every token by itself (`Dense`, `Mlp`) is shared by all of them; a sequence module (`Transformer`, without
/// masks) with as many tokens becomes one whose columns do not depend on each other, fit to be split over threads. Nothing is
/// copied where the columns of a matrix are contiguous, as those of a whole matrix are.
template <class M>
class Folded {
public:
  template <class S>
  struct Workspace {
    WorkspaceOf<M, S> module;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> x;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> y;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> dx;
  };

  /// Throws Error unless there is a token.
  Folded(M module, Eigen::Index tokens) : module_(std::move(module)), tokens_(tokens) {
    detail::check_positive("folded", "token", tokens);
  }

  const M& module() const noexcept { return module_; }
  Eigen::Index tokens() const noexcept { return tokens_; }
  Eigen::Index inputs() const noexcept { return tokens_ * module_.inputs(); }
  Eigen::Index outputs() const noexcept { return tokens_ * module_.outputs(); }
  Eigen::Index parameters() const noexcept { return module_.parameters(); }

  template <class S>
  Workspace<S> workspace(Eigen::Index max_columns) const {
    return {module_.template workspace<S>(max_columns * tokens_),
            {inputs(), max_columns},
            {outputs(), max_columns},
            {inputs(), max_columns}};
  }

  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    run(x, w, y, [&](ConstMatrix<S> in, Matrix<S> out) { module_.forward(theta, in, w.module, out); });
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    run(x, w, y, [&](ConstMatrix<S> in, Matrix<S> out) { module_.infer(theta, in, w.module, out); });
  }

  template <class S>
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, Workspace<S>& w, S* dtheta,
                Matrix<S> dx) const noexcept {
    const Eigen::Index n = x.cols() * tokens_;
    const ConstView<S> in(detail::contiguous<S>(x, w.x), module_.inputs(), n);
    const ConstView<S> dout(detail::contiguous<S>(dy, w.y), module_.outputs(), n);
    if (dx.cols() == 0) {
      module_.backward(theta, in, dout, w.module, dtheta, no_gradient<S>());
      return;
    }
    S* const data = detail::is_contiguous(dx) ? dx.data() : w.dx.data();
    module_.backward(theta, in, dout, w.module, dtheta, View<S>(data, module_.inputs(), n));
    if (data != dx.data()) dx = w.dx.leftCols(dx.cols());
  }

  template <class S>
  void initialize(S* theta, core::RandomStream& random) const {
    module_.initialize(theta, random);
  }

  template <class F>
  void for_each_parameter(F&& f) const {
    module_.for_each_parameter(f);
  }

private:
  template <class S>
  using View = Eigen::Map<Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>>;
  template <class S>
  using ConstView = Eigen::Map<const Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>>;

  template <class S, class F>
  void run(ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y, F&& f) const noexcept {
    const Eigen::Index n = x.cols() * tokens_;
    S* const data = detail::is_contiguous(y) ? y.data() : w.y.data();
    f(ConstView<S>(detail::contiguous<S>(x, w.x), module_.inputs(), n), View<S>(data, module_.outputs(), n));
    if (data != y.data()) y = w.y.leftCols(y.cols());
  }

  M module_;
  Eigen::Index tokens_;
};

}  // namespace traceur::nn
