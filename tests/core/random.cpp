// SPDX-License-Identifier: MIT
#include <traceur/core/random.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <random>
#include <set>
#include <vector>

#include <doctest/doctest.h>

using traceur::core::philox4x32;
using traceur::core::RandomStream;

static_assert(std::uniform_random_bit_generator<RandomStream>);

namespace {

using Block = std::array<std::uint32_t, 4>;

// Kolmogorov's statistic sqrt(n) sup |F_n - F| stays below 1.95 with probability 0.999.
template <class Cdf>
double kolmogorov(std::vector<double> values, Cdf cdf) {
  std::sort(values.begin(), values.end());
  const double n = static_cast<double>(values.size());
  double gap = 0.0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double f = cdf(values[i]);
    gap = std::max({gap, std::abs(f - static_cast<double>(i) / n), std::abs(static_cast<double>(i + 1) / n - f)});
  }
  return std::sqrt(n) * gap;
}

double normal_cdf(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }

double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  const double n = static_cast<double>(a.size());
  const double mean_a = std::accumulate(a.begin(), a.end(), 0.0) / n;
  const double mean_b = std::accumulate(b.begin(), b.end(), 0.0) / n;
  double ab = 0.0, aa = 0.0, bb = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    ab += (a[i] - mean_a) * (b[i] - mean_b);
    aa += (a[i] - mean_a) * (a[i] - mean_a);
    bb += (b[i] - mean_b) * (b[i] - mean_b);
  }
  return ab / std::sqrt(aa * bb);
}

}  // namespace

TEST_SUITE("core/random") {
  TEST_CASE("Philox4x32-10 gives the known answers of the Random123 distribution") {
    static_assert(philox4x32({0, 0, 0, 0}, {0, 0}) == Block{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8});
    const std::uint32_t ones = 0xffffffff;
    CHECK(philox4x32({ones, ones, ones, ones}, {ones, ones}) == Block{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd});
    CHECK(philox4x32({0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}, {0xa4093822, 0x299f31d0}) ==
          Block{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1});
  }

  TEST_CASE("a stream counts up from the block of its stream and step") {
    const std::uint64_t seed = 0x0123456789abcdefu, stream = 0xfedcba9876543210u, step = 0x1122334455667788u;
    const std::array<std::uint32_t, 2> key{0x89abcdef, 0x01234567};
    Block counter = philox4x32({0x55667788, 0x11223344, 0x76543210, 0xfedcba98}, key);
    RandomStream random(seed, stream, step);
    for (int block = 0; block < 3; ++block) {
      for (const std::uint32_t word : philox4x32(counter, key)) CHECK(random.next_u32() == word);
      ++counter[0];
    }
  }

  TEST_CASE("every bit of seed, stream and step matters") {
    std::set<std::uint64_t> firsts{RandomStream(0, 0, 0).next_u64()};
    for (int bit = 0; bit < 64; ++bit) {
      const std::uint64_t one = std::uint64_t{1} << bit;
      firsts.insert(RandomStream(one, 0, 0).next_u64());
      firsts.insert(RandomStream(0, one, 0).next_u64());
      firsts.insert(RandomStream(0, 0, one).next_u64());
    }
    CHECK(firsts.size() == 3 * 64 + 1);
  }

  TEST_CASE("what a stream gives does not depend on the order in which streams are used") {
    const std::uint64_t count = 50;
    std::vector<double> forward(count), backward(count), interleaved(count);
    const auto third = [](std::uint64_t i) {
      RandomStream random(7, i, 3);
      random.normal();
      random.below(10);
      return random.uniform();
    };
    for (std::uint64_t i = 0; i < count; ++i) forward[i] = third(i);
    for (std::uint64_t i = count; i-- > 0;) backward[i] = third(i);
    std::vector<RandomStream> streams;
    for (std::uint64_t i = 0; i < count; ++i) streams.emplace_back(7, i, 3);
    for (RandomStream& random : streams) random.normal();
    for (RandomStream& random : streams) random.below(10);
    for (std::uint64_t i = 0; i < count; ++i) interleaved[i] = streams[i].uniform();
    CHECK(forward == backward);
    CHECK(forward == interleaved);
  }

  TEST_CASE_TEMPLATE("uniforms are uniform on [0, 1)", T, float, double) {
    RandomStream random(1, 2);
    std::vector<double> values(20000);
    for (double& value : values) {
      const T drawn = random.uniform<T>();
      REQUIRE(drawn >= T(0));
      REQUIRE(drawn < T(1));
      value = static_cast<double>(drawn);
    }
    CHECK(kolmogorov(values, [](double x) { return x; }) < 1.95);
    for (int i = 0; i < 1000; ++i) {
      const T drawn = random.uniform<T>(-2, 3);
      CHECK(drawn >= T(-2));
      CHECK(drawn <= T(3));
    }
  }

  TEST_CASE("normals are normal") {
    RandomStream random(3, 4, 5);
    std::vector<double> values(20000);
    random.fill_normal(std::span<double>(values));
    CHECK(kolmogorov(values, normal_cdf) < 1.95);
    double moments[4] = {};
    for (const double x : values) {
      for (int k = 0; k < 4; ++k) moments[k] += std::pow(x, k + 1) / static_cast<double>(values.size());
    }
    // Four standard errors each: the k-th sample moment has variance (E x^2k - (E x^k)^2) / n.
    const double error = 4.0 / std::sqrt(static_cast<double>(values.size()));
    CHECK(std::abs(moments[0]) < error * std::sqrt(1.0));
    CHECK(std::abs(moments[1] - 1.0) < error * std::sqrt(2.0));
    CHECK(std::abs(moments[2]) < error * std::sqrt(15.0));
    CHECK(std::abs(moments[3] - 3.0) < error * std::sqrt(96.0));
    CHECK(RandomStream(9).normal(10.0, 0.0) == 10.0);
  }

  TEST_CASE("the float normal is the double normal rounded") {
    RandomStream narrow(11), wide(11);
    for (int i = 0; i < 100; ++i) CHECK(narrow.normal<float>() == static_cast<float>(wide.normal()));
  }

  TEST_CASE("neighbouring seeds, streams, steps and draws are uncorrelated") {
    const std::size_t n = 10000;
    std::vector<double> base(n), next_seed(n), next_stream(n), next_step(n), next_draw(n);
    for (std::size_t i = 0; i < n; ++i) {
      RandomStream random(i, i, i);
      base[i] = random.uniform();
      next_draw[i] = random.uniform();
      next_seed[i] = RandomStream(i + 1, i, i).uniform();
      next_stream[i] = RandomStream(i, i + 1, i).uniform();
      next_step[i] = RandomStream(i, i, i + 1).uniform();
    }
    const double bound = 4.0 / std::sqrt(static_cast<double>(n));
    for (const auto* other : {&next_seed, &next_stream, &next_step, &next_draw}) {
      CHECK(std::abs(correlation(base, *other)) < bound);
    }
  }

  TEST_CASE("below stays below and hits every value equally often") {
    RandomStream random(5);
    CHECK(random.below(1) == 0);
    for (const std::uint32_t n : {2u, 3u, 10u, 64u}) {
      const int draws = 50000;
      std::vector<int> hits(n, 0);
      for (int i = 0; i < draws; ++i) {
        const std::uint32_t value = random.below(n);
        REQUIRE(value < n);
        ++hits[value];
      }
      double chi_square = 0.0;
      const double expected = static_cast<double>(draws) / n;
      for (const int count : hits) chi_square += (count - expected) * (count - expected) / expected;
      const double freedom = n - 1.0;
      CHECK(chi_square < freedom + 4.0 * std::sqrt(2.0 * freedom));
    }
    // For n = 3 * 2^30, taking the high word alone would give one third of the values twice the weight of the others.
    const std::uint32_t large = 0xC0000000u;
    int multiples = 0;
    const int draws = 30000;
    for (int i = 0; i < draws; ++i) multiples += random.below(large) % 3 == 0;
    CHECK(std::abs(multiples - draws / 3.0) < 4.0 * std::sqrt(draws * (1.0 / 3.0) * (2.0 / 3.0)));
  }

  TEST_CASE("bernoulli is certain at 0 and 1") {
    RandomStream random(6);
    int heads = 0;
    for (int i = 0; i < 10000; ++i) {
      CHECK_FALSE(random.bernoulli(0.0));
      CHECK(random.bernoulli(1.0));
      heads += random.bernoulli(0.3);
    }
    CHECK(std::abs(heads - 3000.0) < 4.0 * std::sqrt(10000 * 0.3 * 0.7));
  }

  TEST_CASE("shuffle gives all orders equally often") {
    std::array<int, 24> hits{};
    const int draws = 24000;
    RandomStream random(8);
    for (int i = 0; i < draws; ++i) {
      std::array<int, 4> order{0, 1, 2, 3};
      random.shuffle(std::span<int>(order));
      std::array<int, 4> candidate{0, 1, 2, 3};
      std::size_t rank = 0;
      while (candidate != order) {
        REQUIRE(std::next_permutation(candidate.begin(), candidate.end()));
        ++rank;
      }
      ++hits[rank];
    }
    double chi_square = 0.0;
    for (const int count : hits) chi_square += (count - 1000.0) * (count - 1000.0) / 1000.0;
    CHECK(chi_square < 23.0 + 4.0 * std::sqrt(46.0));
  }
}
