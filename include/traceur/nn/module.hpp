// SPDX-License-Identifier: MIT
#pragma once

#include <concepts>
#include <string>
#include <string_view>
#include <type_traits>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/random.hpp>

namespace traceur::nn {

/// Activations: one row a feature, one column a sample, column-major. A view, cheap to pass by value, onto any Eigen
/// matrix, map or block of columns whose rows lie next to each other in memory. A deduced `S` must come from another
/// argument.
template <class S>
using Matrix =
    std::type_identity_t<Eigen::Ref<Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>, 0, Eigen::OuterStride<>>>;

/// The same, read only. Give it what `Matrix` could view: an expression or a row-major matrix would be copied to the
/// heap.
template <class S>
using ConstMatrix =
    std::type_identity_t<Eigen::Ref<const Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>, 0, Eigen::OuterStride<>>>;

namespace detail {

struct AnyParameter {
  void operator()(std::string_view, Eigen::Index, Eigen::Index, Eigen::Index) const {}
};

}  // namespace detail

/// What a module keeps between forward and backward, and its scratch memory, for scalars S.
template <class M, class S>
using WorkspaceOf = typename M::template Workspace<S>;

/// Whatever has its parameters in one flat array of the caller's, of length `parameters()`, and names for them: modules, and
/// networks of other inputs and outputs.
///
/// `for_each_parameter` calls `f(name, offset, rows, cols)` in order of offset for tensors that fill the array, each
/// column-major. Names are unique: `layers.0.weight`.
template <class M>
concept Parameterized = requires(const M& m) {
  { m.parameters() } -> std::same_as<Eigen::Index>;
  m.for_each_parameter(detail::AnyParameter{});
};

/// A differentiable map from columns to columns: an immutable description of shapes that owns no parameters. Parameters
/// and gradients live in flat arrays of the caller's, of which a module is given its slice (`theta`, `dtheta`, of
/// length `parameters()`), so a whole network is one vector to an optimizer, a file or another thread. S is float or
/// double.
///
/// Laws the compiler cannot check:
/// - Shapes are checked in the constructor, which throws Error; nothing later throws for the shapes it allows, and
/// nothing
///   but `workspace`, `initialize` and `for_each_parameter` allocates. `forward`, `infer` and `backward` are noexcept;
///   the expressions below are not, since they copy Eigen's views.
/// - `forward` writes y (outputs() x n, for n up to the workspace's columns) and keeps in `w` what `backward` needs;
/// `infer`
///   writes the same y and keeps nothing.
/// - `backward` follows a `forward` of the same theta, x and w. It ADDS to `dtheta`, and writes dx (inputs() x n)
/// unless dx has
///   no columns, as `no_gradient` has.
/// - A workspace serves one thread at a time. The same inputs give the same bits, whatever was in it before.
/// - Where columns are samples of a batch they do not depend on each other; sequence modules say how they read columns.
template <class M, class S = float>
concept Module = (std::same_as<S, float> ||
                  std::same_as<S, double>)&&Parameterized<M>&&requires(const M& m, const S* theta, S* dtheta, ConstMatrix<S> x,
                                                     Matrix<S> y, WorkspaceOf<M, S>& w, core::RandomStream& random,
                                                     Eigen::Index columns) {
  { m.inputs() }
  noexcept->std::same_as<Eigen::Index>;
  { m.outputs() }
  noexcept->std::same_as<Eigen::Index>;
  { m.parameters() }
  noexcept->std::same_as<Eigen::Index>;
  { m.template workspace<S>(columns) } -> std::same_as<WorkspaceOf<M, S>>;
  { m.forward(theta, x, w, y) } -> std::same_as<void>;
  { m.infer(theta, x, w, y) } -> std::same_as<void>;
  { m.backward(theta, x, x, w, dtheta, y) } -> std::same_as<void>;
  { m.initialize(dtheta, random) } -> std::same_as<void>;
};

/// What to pass as `dx` when the gradient with respect to the input is not wanted.
template <class S>
Matrix<S> no_gradient() noexcept {
  return Matrix<S>(Eigen::Map<Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>>(nullptr, 0, 0));
}

/// Reports the tensors of a part of a module as `prefix.name`, at `offset` in the whole: for `for_each_parameter` of
/// modules made of others.
template <class M, class F>
void for_each_parameter_of(const M& part, std::string_view prefix, Eigen::Index offset, F&& f) {
  part.for_each_parameter([&](std::string_view name, Eigen::Index at, Eigen::Index rows, Eigen::Index cols) {
    f(std::string(prefix) + "." + std::string(name), offset + at, rows, cols);
  });
}

namespace detail {

/// Throws Error unless `value` is at least 1: `dense: expected at least one input, got 0`.
inline void check_positive(const char* module, const char* what, Eigen::Index value) {
  if (value < 1) {
    throw Error(std::string(module) + ": expected at least one " + what + ", got " + std::to_string(value));
  }
}

}  // namespace detail

}  // namespace traceur::nn
