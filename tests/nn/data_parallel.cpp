// SPDX-License-Identifier: MIT
#include <traceur/nn/data_parallel.hpp>

#include <stdexcept>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/executor.hpp>
#include <traceur/core/random.hpp>
#include <traceur/nn/mlp.hpp>

using namespace traceur::nn;
using Eigen::Index;
using Eigen::MatrixXf;
using Eigen::VectorXf;
using traceur::core::SerialExecutor;
using traceur::core::ThreadExecutor;

namespace {

struct Problem {
  Problem() : net({6, 40, 30, 2}), theta(net.parameters()), x(6, 301), goal(2, 301) {
    traceur::core::RandomStream random(4);
    net.initialize(theta.data(), random);
    for (MatrixXf* m : {&x, &goal}) {
      for (Index i = 0; i < m->size(); ++i) m->data()[i] = random.normal<float>();
    }
  }

  /// The gradient of half the squared error of the whole batch.
  template <class E>
  VectorXf gradient(E&& executor, int chunks) const {
    DataParallel<float> parallel(net.parameters(), chunks);
    auto w = parallel.workspaces(net, x.cols());
    MatrixXf y(2, x.cols());
    VectorXf total = VectorXf::Zero(net.parameters());
    parallel.run(executor, x.cols(), total, [&](int chunk, Index first, Index count, float* gradient) {
      auto& workspace = w[static_cast<std::size_t>(chunk)];
      auto out = y.middleCols(first, count);
      const auto in = x.middleCols(first, count);
      net.forward(theta.data(), in, workspace, out);
      out -= goal.middleCols(first, count);
      net.backward(theta.data(), in, out, workspace, gradient, no_gradient<float>());
    });
    return total;
  }

  Mlp<> net;
  VectorXf theta;
  MatrixXf x, goal;
};

}  // namespace

TEST_CASE("the same bits on any executor, and the gradient of the whole batch") {
  const Problem problem;
  const VectorXf whole = problem.gradient(SerialExecutor(), 1);
  for (const int chunks : {1, 3, 8}) {
    const VectorXf serial = problem.gradient(SerialExecutor(), chunks);
    for (const int threads : {1, 2, 3}) CHECK(problem.gradient(ThreadExecutor(threads), chunks) == serial);
    CHECK((serial - whole).norm() < 1e-5f * whole.norm());
  }
}

TEST_CASE("every sample is in one chunk, and chunks are even") {
  SerialExecutor executor;
  for (const int chunks : {1, 2, 7}) {
    const DataParallel<double> parallel(1, chunks);
    for (const Index samples : {0, 1, 5, 7, 100}) {
      std::vector<int> seen(static_cast<std::size_t>(samples), 0);
      parallel.run(executor, samples, [&](int, Index first, Index count) {
        CHECK(count > 0);
        CHECK(count <= parallel.largest(samples));
        CHECK(count >= parallel.largest(samples) - 1);
        for (Index i = first; i < first + count; ++i) ++seen[static_cast<std::size_t>(i)];
      });
      CHECK(seen == std::vector<int>(static_cast<std::size_t>(samples), 1));
    }
  }
}

TEST_CASE("gradients are added to what is there; a failure adds nothing") {
  SerialExecutor executor;
  DataParallel<double> parallel(5000, 4);
  Eigen::VectorXd total = Eigen::VectorXd::Constant(5000, 10.0);
  for (int round = 0; round < 2; ++round) {
    parallel.run(executor, 3, total, [](int, Index, Index count, double* g) {
      for (int i = 0; i < 5000; ++i) g[i] += i * static_cast<double>(count);
    });
  }
  CHECK(total[4999] == 10.0 + 2 * 3 * 4999.0);
  CHECK(total[1] == 16.0);
  CHECK_THROWS_AS(parallel.run(executor, 4, total,
                               [](int chunk, Index, Index, double* g) {
                                 g[1] = 1.0;
                                 if (chunk == 2) throw std::runtime_error("no");
                               }),
                  std::runtime_error);
  CHECK(total[1] == 16.0);
}

TEST_CASE("impossible sizes are refused") {
  CHECK_THROWS_WITH_AS(DataParallel<float>(0, 1), "data parallel: expected at least one parameter, got 0",
                       traceur::Error);
  CHECK_THROWS_WITH_AS(DataParallel<float>(1, 0), "data parallel: expected at least one chunk, got 0", traceur::Error);
}
