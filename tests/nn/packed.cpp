// SPDX-License-Identifier: MIT
#include <traceur/nn/packed.hpp>

#include <vector>

#include <doctest/doctest.h>

#include <traceur/core/random.hpp>

using namespace traceur::nn;
using Eigen::Index;

namespace {

template <class S>
Eigen::Matrix<S, -1, -1> random_matrix(Index rows, Index cols, std::uint64_t seed) {
  Eigen::Matrix<S, -1, -1> m(rows, cols);
  traceur::core::RandomStream random(seed);
  for (Index i = 0; i < m.size(); ++i) m.data()[i] = random.normal<S>();
  return m;
}

}  // namespace

TEST_CASE_TEMPLATE("a packed product has the bits of a product", S, float, double) {
  using Table = Eigen::Matrix<S, -1, -1>;
  for (const Index rows : {5, 16, 33, 70}) {
    for (const Index cols : {1, 7, 130, 300}) {
      const Table w = random_matrix<S>(rows, cols, 1);
      const Table bias = random_matrix<S>(rows, 1, 2);
      PackedMatrix<S> packed(rows, cols);
      packed.pack(w);
      std::vector<S> scratch(static_cast<std::size_t>(product_scratch<S>(rows, cols)));
      for (const Index columns : {1, 2, 13, 200}) {
        const Table x = random_matrix<S>(cols, columns, 3);
        Table y(rows, columns), z = random_matrix<S>(rows, columns, 4);
        product<S>(w, x, y, scratch.data(), Into::set, bias.data());
        Index done = 0;
        Table got(rows, columns);
        packed.multiply(x, got, Into::set, bias.data(), [&](Index first, Index count) {
          CHECK(first == done);
          done += count;
          CHECK(got.leftCols(done) == y.leftCols(done));
        });
        CHECK(done == columns);
        Table sum = z;
        product<S>(w, x, z, scratch.data(), Into::add);
        packed.multiply(x, sum, Into::add);
        CHECK(sum == z);
      }
    }
  }
}

TEST_CASE("a packed matrix has rows and columns") {
  CHECK_THROWS_AS(PackedMatrix<float>(0, 3), traceur::Error);
  CHECK_THROWS_AS(PackedMatrix<float>(3, 0), traceur::Error);
}
