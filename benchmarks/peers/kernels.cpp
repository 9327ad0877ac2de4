// SPDX-License-Identifier: MIT
// Kernels beside what else there is, in one process on one thread. Times are CPU seconds of the thread, the least of
// several turns. Each ratio is the peer's time over ours, or the bar's: above 1 is better.
//
//   signed_distance_100, _16  a point's signed distance from a terrain of so many cells squared, one point at a time:
//                             150 and 4 times faster than the union of all columns in vector registers, outside the
//                             ground, up to 1.8 m above it and within its bounds
//   elite_insert_query        an insertion and five nearest of 100 000 elites in 4-D: 5 microseconds
//   nearest_nanoflann         the five nearest alone beside nanoflann's static tree, if it is installed
//   dtw                       300 x 300 frames x 100 features in float: 0.9 ms
//   rbf_*                     r basis, degree 1, two parameters, 40 outputs; 200 and 2000 centres; solve and 10 000
//                             values
//   cma_es_*                  ask and tell of a default population in so many dimensions
//
// The bars are the best known C++ programs on a machine of this kind. Ends with lines `ratio NAME VALUE`.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include <Eigen/Core>

#if __has_include(<nanoflann.hpp>)
#include <nanoflann.hpp>
#define TRACEUR_WITH_NANOFLANN
#endif

#include <traceur/core/pack.hpp>
#include <traceur/core/random.hpp>
#include <traceur/evaluate/dtw.hpp>
#include <traceur/optimize/cma_es.hpp>
#include <traceur/parameterize/elite_set.hpp>
#include <traceur/parameterize/rbf.hpp>
#include <traceur/terrain/generators.hpp>
#include <traceur/terrain/signed_distance.hpp>

#include "../cpu_seconds.hpp"

namespace {

using namespace traceur;
using core::RandomStream;

/// Seconds of one call, the least of `turns`.
template <class F>
double least(int turns, F&& f) {
  double best = 1e30;
  for (int k = 0; k < turns; ++k) {
    const double start = cpu_seconds();
    f();
    best = std::min(best, cpu_seconds() - start);
  }
  return best;
}

std::vector<std::string> ratios;

void ratio(const std::string& name, double value) {
  char text[96];
  std::snprintf(text, sizeof text, "ratio %s %.2f", name.c_str(), value);
  ratios.push_back(text);
}

Eigen::MatrixXd uniform(Eigen::Index rows, Eigen::Index cols, std::uint64_t stream) {
  RandomStream random(1, stream);
  Eigen::MatrixXd x(rows, cols);
  for (Eigen::Index i = 0; i < x.size(); ++i) x.data()[i] = random.uniform();
  return x;
}

/// The least distance from any column of ground, 0 inside: every cell is looked at, a register of them at a time.
float brute_force(const terrain::HeightTable<float>& t, const std::vector<float>& middles, float x, float y, float z) {
  using P = core::Pack<float>;
  const float half = 0.5F * t.cell;
  P best(1e30F);
  for (int j = 0; j < t.ny; ++j) {
    const float dy = std::max(std::abs(y - (t.edge_y(j) + half)) - half, 0.0F);
    const float* const heights = t.heights.data() + static_cast<std::ptrdiff_t>(j) * t.nx;
    int i = 0;
    for (; i + P::width <= t.nx; i += P::width) {
      const P away = P(x) - P::load(middles.data() + i), back = P(0.0F) - away;
      const P dx = core::max(core::max(away, back) - P(half), P(0.0F));
      const P dz = core::max(P(z) - P::load(heights + i), P(0.0F));
      best = core::min(best, dx * dx + P(dy * dy) + dz * dz);
    }
    for (; i < t.nx; ++i) {
      const float dx = std::max(std::abs(x - middles[static_cast<std::size_t>(i)]) - half, 0.0F);
      const float dz = std::max(z - heights[i], 0.0F);
      best.set(0, std::min(best[0], dx * dx + dy * dy + dz * dz));
    }
  }
  float least = best[0];
  for (int l = 1; l < P::width; ++l) least = std::min(least, best[l]);
  return std::sqrt(least);
}

void signed_distance(int cells, double bar) {
  terrain::RandomBoxes p;
  p.nx = p.ny = cells;
  p.boxes = cells * cells / 25;
  RandomStream random(3);
  const terrain::HeightGrid grid = terrain::random_boxes(p, random);
  const terrain::HeightTable<float>& table = grid.table<float>();
  std::vector<float> middles;
  for (int i = 0; i < cells; ++i) middles.push_back(static_cast<float>(grid.center_x(i)));
  std::vector<core::Vector3<float>> points;
  const float side = static_cast<float>(cells * grid.cell());
  for (int k = 0; k < 4096; ++k) {
    const float x = table.x0 + side * random.uniform<float>(), y = table.y0 + side * random.uniform<float>();
    points.push_back({x, y, static_cast<float>(grid.height(double{x}, double{y})) + 1.8F * random.uniform<float>()});
  }
  using P = core::Pack<float>;
  std::vector<core::Vector3<P>> packs(points.size() / P::width);
  for (std::size_t k = 0; k < packs.size() * P::width; ++k) {
    core::Vector3<P>& pack = packs[k / P::width];
    const int lane = static_cast<int>(k % P::width);
    pack.x.set(lane, points[k].x);
    pack.y.set(lane, points[k].y);
    pack.z.set(lane, points[k].z);
  }
  float sum = 0, off = 0;
  const std::size_t few = cells > 50 ? 256 : 4096;
  const double peer = least(20,
                            [&] {
                              float all = 0;
                              for (std::size_t k = 0; k < few; ++k)
                                all += brute_force(table, middles, points[k].x, points[k].y, points[k].z);
                              sum += all;
                            }) /
                      static_cast<double>(few);
  const double ours = least(200,
                            [&] {
                              float all = 0;
                              for (const auto& q : points) all += terrain::signed_distance(grid, q);
                              sum += all;
                            }) /
                      static_cast<double>(points.size());
  const double together = least(200,
                                [&] {
                                  P all(0.0);
                                  for (const auto& q : packs) all += terrain::signed_distance(grid, q);
                                  sum += all[0];
                                }) /
                          static_cast<double>(packs.size() * P::width);
  for (std::size_t k = 0; k < few; ++k)
    off = std::max(off, std::abs(brute_force(table, middles, points[k].x, points[k].y, points[k].z) -
                                 terrain::signed_distance(grid, points[k])));
  std::printf(
      "signed_distance cells %d ours_ns %.1f in_packs_ns %.1f brute_force_ns %.1f times %.1f in_packs_times %.1f "
      "largest_difference_m %.1e (sum %.0f)\n",
      cells, 1e9 * ours, 1e9 * together, 1e9 * peer, peer / ours, peer / together, static_cast<double>(off),
      static_cast<double>(sum));
  ratio("signed_distance_" + std::to_string(cells), peer / ours / bar);
}

#ifdef TRACEUR_WITH_NANOFLANN
struct Points {
  const Eigen::MatrixXd& all;
  std::size_t kdtree_get_point_count() const { return static_cast<std::size_t>(all.cols()); }
  double kdtree_get_pt(std::size_t i, std::size_t d) const {
    return all(static_cast<Eigen::Index>(d), static_cast<Eigen::Index>(i));
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};
#endif

void elites() {
  using namespace parameterize;
  EliteSetParameters parameters;
  parameters.radius = 0.044;
  EliteSet<int> set(4, parameters);
  RandomStream random(1);
  Eigen::VectorXd a(4);
  const auto draw = [&] {
    for (Eigen::Index d = 0; d < 4; ++d) a(d) = random.uniform();
  };
  for (int i = 0; i < 4000000 && set.size() < 100000; ++i) {
    draw();
    set.insert(a, random.uniform(0.1, 1.0));
  }
  constexpr int calls = 20000;
  std::array<Neighbor, 5> found;
  const double ours = least(5,
                            [&] {
                              for (int k = 0; k < calls; ++k) {
                                draw();
                                set.insert(a, random.uniform(0.1, 1.0));
                                set.nearest(a, found);
                              }
                            }) /
                      calls;
  std::printf("elite_insert_query elites %d ours_us %.2f bar_us 5\n", set.size(), 1e6 * ours);
  ratio("elite_insert_query", 5e-6 / ours);
#ifdef TRACEUR_WITH_NANOFLANN
  Eigen::MatrixXd all(4, set.size());
  for (int i = 0; i < set.size(); ++i) all.col(i) = set.parameter(i);
  const Points points{all};
  nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Points>, Points, 4> tree(4, points, {10});
  double sum = 0;
  const double query = least(5,
                             [&] {
                               for (int k = 0; k < calls; ++k) {
                                 draw();
                                 set.nearest(a, found);
                                 sum += found[4].squared_distance;
                               }
                             }) /
                       calls;
  std::array<std::size_t, 5> index;
  std::array<double, 5> squared;
  const double peer = least(5,
                            [&] {
                              for (int k = 0; k < calls; ++k) {
                                draw();
                                nanoflann::KNNResultSet<double> result(5);
                                result.init(index.data(), squared.data());
                                tree.findNeighbors(result, a.data(), {});
                                sum += squared[4];
                              }
                            }) /
                      calls;
  std::printf("nearest ours_us %.2f nanoflann_us %.2f (sum %.0f)\n", 1e6 * query, 1e6 * peer, sum);
  ratio("nearest_nanoflann", peer / query);
#endif
}

void dtw() {
  Eigen::MatrixXf a(100, 300), b(100, 300);
  RandomStream random(1);
  for (Eigen::MatrixXf* m : {&a, &b})
    for (int k = 0; k < 100; ++k) {
      const double rate = random.uniform(1, 6), phase = random.uniform(0, 6.28), size = random.uniform(0.1, 1);
      for (int t = 0; t < 300; ++t) (*m)(k, t) = static_cast<float>(size * std::sin(rate * t / 30 + phase));
    }
  evaluate::Dtw<float> warp(300, 100);
  float sum = 0;
  const double ours = least(200, [&] { sum += warp.distance(a, b); });
  std::printf("dtw ours_ms %.3f bar_ms 0.9 (sum %.0f)\n", 1e3 * ours, static_cast<double>(sum));
  ratio("dtw", 0.9e-3 / ours);
}

void rbf(Eigen::Index size, double solve_bar, double evaluate_bar) {
  using parameterize::Rbf;
  const Eigen::MatrixXd centres = uniform(2, size, 0), given = uniform(40, size, 1), thetas = uniform(2, 10000, 2);
  Eigen::MatrixXd values(40, 10000);
  double residual = 0;
  const double solve = least(size > 1000 ? 8 : 300, [&] { residual = Rbf(centres, given).residual(); });
  const Rbf fitted(centres, given);
  const double evaluate = least(size > 1000 ? 8 : 50, [&] { fitted.evaluate(thetas, values); });
  std::printf("rbf centres %d solve_ms %.3f bar_ms %.2f residual %.1e evaluate_ms %.3f bar_ms %.1f\n",
              static_cast<int>(size), 1e3 * solve, 1e3 * solve_bar, residual, 1e3 * evaluate, 1e3 * evaluate_bar);
  ratio("rbf_solve_" + std::to_string(size), solve_bar / solve);
  ratio("rbf_evaluate_" + std::to_string(size), evaluate_bar / evaluate);
}

void cma_es(Eigen::Index n, double bar) {
  optimize::CmaEsParameters parameters;
  parameters.tolerance_cost = 0.0;
  parameters.tolerance_x = 0.0;
  const int generations = n > 50 ? 400 : 2000;
  double best = 1e30;
  for (int turn = 0; turn < 5; ++turn) {
    optimize::CmaEs cma(Eigen::VectorXd::Ones(n), parameters);
    Eigen::VectorXd costs(cma.population());
    double spent = 0;
    int done = 0;
    for (; done < generations && !cma.finished(); ++done) {
      double start = cpu_seconds();
      const Eigen::MatrixXd& x = cma.ask();
      spent += cpu_seconds() - start;
      for (Eigen::Index k = 0; k < x.cols(); ++k) costs(k) = x.col(k).squaredNorm();
      start = cpu_seconds();
      cma.tell(costs);
      spent += cpu_seconds() - start;
    }
    best = std::min(best, spent / done);
  }
  std::printf("cma_es dimension %d generation_us %.1f bar_us %.0f\n", static_cast<int>(n), 1e6 * best, 1e6 * bar);
  ratio("cma_es_" + std::to_string(n), bar / best);
}

}  // namespace

int main() try {
  signed_distance(100, 150);
  signed_distance(16, 4);
  elites();
  dtw();
  rbf(200, 0.35e-3, 3.9e-3);
  rbf(2000, 94e-3, 49e-3);
  cma_es(10, 7e-6);
  cma_es(40, 95e-6);
  cma_es(100, 440e-6);
  cma_es(250, 2900e-6);
  for (const std::string& line : ratios) std::puts(line.c_str());
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "kernels: %s\n", error.what());
  return 1;
}
