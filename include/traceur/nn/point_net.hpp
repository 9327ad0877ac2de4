// SPDX-License-Identifier: MIT
#pragma once

#include <utility>

#include <traceur/nn/folded.hpp>
#include <traceur/nn/module.hpp>

namespace traceur::nn {

/// What a set of points looks like, whatever their order: one module M, usually an `Mlp`, maps every point by itself, and
/// each feature of the set is the largest over its points. Qi, Su, Mo and Guibas, "PointNet" (CVPR 2017), eq. 1, with the
/// maximum as the symmetric function.
///
/// A column is one cloud, its points one below the other: row `p * point_size() + i` is number i of point p. A cloud with
/// fewer points repeats one of them: the maximum does not notice. A feature's gradient goes to the first point that has its
/// maximum.
template <class M>
class PointNet {
public:
  template <class S>
  struct Workspace {
    typename Folded<M>::template Workspace<S> points;
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> features;  // of the points, a column a cloud
    Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic> gradients;
    Eigen::Matrix<int, Eigen::Dynamic, Eigen::Dynamic> winners;  // the point that has the maximum
  };

  /// Throws Error unless there is a point.
  PointNet(M module, Eigen::Index points) : points_(std::move(module), points) {}

  const M& module() const noexcept { return points_.module(); }
  Eigen::Index points() const noexcept { return points_.tokens(); }
  /// Numbers of a point.
  Eigen::Index point_size() const noexcept { return module().inputs(); }
  Eigen::Index inputs() const noexcept { return points_.inputs(); }
  Eigen::Index outputs() const noexcept { return module().outputs(); }
  Eigen::Index parameters() const noexcept { return module().parameters(); }

  template <class S>
  Workspace<S> workspace(Eigen::Index max_columns) const {
    return {points_.template workspace<S>(max_columns),
            {points_.outputs(), max_columns},
            {points_.outputs(), max_columns},
            {outputs(), max_columns}};
  }

  template <class S>
  void forward(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    points_.forward(theta, x, w.points, w.features.leftCols(x.cols()));
    pool(w, y);
  }

  template <class S>
  void infer(const S* theta, ConstMatrix<S> x, Workspace<S>& w, Matrix<S> y) const noexcept {
    points_.infer(theta, x, w.points, w.features.leftCols(x.cols()));
    pool(w, y);
  }

  template <class S>
  void backward(const S* theta, ConstMatrix<S> x, ConstMatrix<S> dy, Workspace<S>& w, S* dtheta,
                Matrix<S> dx) const noexcept {
    w.gradients.leftCols(x.cols()).setZero();
    for (Eigen::Index j = 0; j < dy.cols(); ++j) {
      for (Eigen::Index i = 0; i < outputs(); ++i) w.gradients(w.winners(i, j) * outputs() + i, j) = dy(i, j);
    }
    points_.backward(theta, x, w.gradients.leftCols(x.cols()), w.points, dtheta, dx);
  }

  template <class S>
  void initialize(S* theta, core::RandomStream& random) const {
    points_.initialize(theta, random);
  }

  template <class F>
  void for_each_parameter(F&& f) const {
    points_.for_each_parameter(f);
  }

private:
  template <class S>
  void pool(Workspace<S>& w, Matrix<S> y) const noexcept {
    const Eigen::Index n = outputs();
    for (Eigen::Index j = 0; j < y.cols(); ++j) {
      const S* feature = w.features.col(j).data();
      S* const best = y.col(j).data();
      int* const winner = w.winners.col(j).data();
      for (Eigen::Index i = 0; i < n; ++i) {
        best[i] = feature[i];
        winner[i] = 0;
      }
      for (int p = 1; p < static_cast<int>(points()); ++p) {
        feature += n;
        for (Eigen::Index i = 0; i < n; ++i) {
          const bool better = feature[i] > best[i];
          best[i] = better ? feature[i] : best[i];
          winner[i] = better ? p : winner[i];
        }
      }
    }
  }

  Folded<M> points_;
};

}  // namespace traceur::nn
