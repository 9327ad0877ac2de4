// SPDX-License-Identifier: MIT
#include <traceur/nn/module.hpp>

#include <string>
#include <string_view>
#include <vector>

#include <doctest/doctest.h>

#include "module_laws.hpp"

using Eigen::Index;
using traceur::nn::ConstMatrix;
using traceur::nn::Matrix;
using traceur::nn::Module;
using traceur::nn::Parameterized;

namespace {

/// y = a x, with one a for each row: the least a module is.
class Scaling {
public:
  template <class S>
  struct Workspace {};

  explicit Scaling(Index width) : width_(width) { traceur::nn::detail::check_positive("scaling", "row", width); }
  Index inputs() const noexcept { return width_; }
  Index outputs() const noexcept { return width_; }
  Index parameters() const noexcept { return width_; }
  template <class S>
  Workspace<S> workspace(Index) const {
    return {};
  }
  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, Workspace<S>&, Matrix<S> y) const noexcept {
    for (Index j = 0; j < x.cols(); ++j) {
      for (Index i = 0; i < width_; ++i) y(i, j) = theta[i] * x(i, j);
    }
  }
  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    forward<S>(theta, x, w, y);
  }
  template <class S>
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, Workspace<S>& w, S* dtheta,
                Matrix<S> dx) const noexcept {
    for (Index j = 0; j < x.cols(); ++j) {
      for (Index i = 0; i < width_; ++i) dtheta[i] += dy(i, j) * x(i, j);
    }
    if (dx.cols() > 0) forward<S>(theta, dy, w, dx);
  }
  template <class S>
  void initialize(S* theta, traceur::core::RandomStream&) const {
    for (Index i = 0; i < width_; ++i) theta[i] = S(1);
  }
  template <class F>
  void for_each_parameter(F&& f) const {
    f(std::string_view("scale"), Index{0}, width_, Index{1});
  }

private:
  Index width_;
};

class TwoScalings {
public:
  template <class F>
  void for_each_parameter(F&& f) const {
    traceur::nn::for_each_parameter_of(Scaling(2), "first", 0, f);
    traceur::nn::for_each_parameter_of(Scaling(3), "second", 2, f);
  }
};

struct NoBackward {
  template <class S>
  struct Workspace {};
  Index inputs() const noexcept { return 1; }
  Index outputs() const noexcept { return 1; }
  Index parameters() const noexcept { return 0; }
  template <class S>
  Workspace<S> workspace(Index) const {
    return {};
  }
  template <class S>
  void forward(const S*, ConstMatrix<S>, Workspace<S>&, Matrix<S>) const noexcept {}
  template <class S>
  void infer(const S*, ConstMatrix<S>, Workspace<S>&, Matrix<S>) const noexcept {}
  template <class S>
  void initialize(S*, traceur::core::RandomStream&) const {}
  template <class F>
  void for_each_parameter(F&&) const {}
};

static_assert(Module<Scaling, float> && Module<Scaling, double>);
static_assert(!Module<NoBackward>);
static_assert(Parameterized<Scaling> && Parameterized<NoBackward>);
static_assert(!Parameterized<TwoScalings>);  // of how many parameters it does not say
static_assert(!Module<Scaling, int>);

}  // namespace

TEST_CASE("the least module obeys the laws") {
  laws::check_gradient(Scaling(4), 3);
  laws::check_module<float>(Scaling(4));
  laws::check_module<double>(Scaling(1));
  CHECK_THROWS_WITH_AS(Scaling(0), "scaling: expected at least one row, got 0", traceur::Error);
}

TEST_CASE("parts report their tensors under their own names") {
  std::vector<std::string> names;
  std::vector<Index> offsets;
  TwoScalings().for_each_parameter([&](std::string_view name, Index offset, Index, Index) {
    names.emplace_back(name);
    offsets.push_back(offset);
  });
  CHECK(names == std::vector<std::string>{"first.scale", "second.scale"});
  CHECK(offsets == std::vector<Index>{0, 2});
}

TEST_CASE("no gradient has no columns") { CHECK(traceur::nn::no_gradient<float>().cols() == 0); }
