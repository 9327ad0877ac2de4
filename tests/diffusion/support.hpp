// SPDX-License-Identifier: MIT
#pragma once

#include <cstring>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/random.hpp>
#include <traceur/diffusion/denoiser.hpp>
#include <traceur/nn/module.hpp>

template <class S>
using Table = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;

template <class S>
Table<S> random_table(Eigen::Index rows, Eigen::Index cols, std::uint64_t seed) {
  Table<S> m(rows, cols);
  traceur::diffusion::draw_noise<S>(m, seed);
  return m;
}

template <class S>
bool same_bits(const Table<S>& a, const Table<S>& b) {
  return a.rows() == b.rows() && a.cols() == b.cols() &&
         std::memcmp(a.data(), b.data(), static_cast<std::size_t>(a.size()) * sizeof(S)) == 0;
}

/// A denoiser made of `f(step, noisy, condition values, parts, clean)`, called column by column.
template <class S, class F>
class FunctionDenoiser {
public:
  FunctionDenoiser(Eigen::Index features, Eigen::Index condition, F f)
      : features_(features), condition_(condition), f_(std::move(f)) {}
  Eigen::Index features() const { return features_; }
  Eigen::Index condition_features() const { return condition_; }
  void begin(const traceur::diffusion::Condition<S>& c) {
    values_ = c.values;
    given_.clear();
    for (Eigen::Index j = 0; j < c.values.cols(); ++j) given_.push_back(c.parts(j));
  }
  void denoise(int step, traceur::nn::ConstMatrix<S> noisy, traceur::nn::Matrix<S> clean) {
    ++calls;
    for (Eigen::Index j = 0; j < noisy.cols(); ++j) {
      clean.col(j) = f_(step, Eigen::Matrix<S, Eigen::Dynamic, 1>(noisy.col(j)),
                        Eigen::Matrix<S, Eigen::Dynamic, 1>(values_.col(j)), given_[static_cast<std::size_t>(j)], j);
    }
  }
  int calls = 0;

private:
  Eigen::Index features_, condition_;
  F f_;
  Table<S> values_;
  std::vector<traceur::diffusion::Parts> given_;
};

template <class S, class F>
FunctionDenoiser<S, F> denoiser_of(Eigen::Index features, Eigen::Index condition, F f) {
  return {features, condition, std::move(f)};
}
