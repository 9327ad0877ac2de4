// SPDX-License-Identifier: MIT
// The signed distance in dual numbers. Apart from tests/terrain/signed_distance.cpp so that a build without Ceres keeps
// that one.
#include <random>

#include <ceres/jet.h>
#include <doctest/doctest.h>

#include <traceur/terrain/signed_distance.hpp>

using traceur::terrain::HeightGrid;
using traceur::terrain::surface;

TEST_CASE("signed distance: the derivative of dual numbers is the normal, and that of the normal its own") {
  using Jet = ceres::Jet<double, 3>;
  using Vector = traceur::core::Vector3<double>;
  std::mt19937 generator(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  Eigen::MatrixXd h(8, 8);
  for (int k = 0; k < 64; ++k) h.data()[k] = uniform(generator);
  const HeightGrid grids[] = {HeightGrid(h, 0.4), HeightGrid::flat(0.2)};
  const double e = 1e-7;
  int turned = 0;
  for (const HeightGrid& g : grids)
    for (int k = 0; k < 2000; ++k) {
      const Vector p{1.6 + 2 * uniform(generator), 1.6 + 2 * uniform(generator), 1.5 * uniform(generator)};
      const auto s = surface(g, p);
      const auto dual = surface(g, traceur::core::Vector3<Jet>{Jet(p.x, 0), Jet(p.y, 1), Jet(p.z, 2)});
      CHECK(dual.distance.a == doctest::Approx(s.distance).epsilon(1e-14));
      CHECK((dual.distance.v - s.normal.eigen()).norm() < 1e-12);
      CHECK(dual.normal.x.a == doctest::Approx(s.normal.x));
      const auto ahead = surface(g, p + Vector{e, 0, 0});
      // Near edges a small step may lead to another face.
      if (norm(ahead.normal - s.normal) > 1e-4) continue;
      turned += norm(ahead.normal - s.normal) > 0;
      CHECK(std::abs((ahead.normal.z - s.normal.z) / e - dual.normal.z.v[0]) <
            1e-3 * (1 + std::abs(dual.normal.z.v[0])));
    }
  CHECK(turned > 100);
}

TEST_CASE("signed distance: dual numbers stay finite on the surface") {
  using Jet = ceres::Jet<double, 3>;
  Eigen::MatrixXd h = Eigen::MatrixXd::Zero(3, 3);
  h(0, 1) = 1;
  const HeightGrid g(h, 1.0);
  for (const auto& p : {Eigen::Vector3d(1.5, 1.5, 0), Eigen::Vector3d(1.0, 1.5, 0.5), Eigen::Vector3d(1.0, 1.0, 0.5),
                        Eigen::Vector3d(1, 1, 0)}) {
    const auto s = surface(g, traceur::core::Vector3<Jet>{Jet(p[0], 0), Jet(p[1], 1), Jet(p[2], 2)});
    CHECK(std::abs(s.distance.a) < 1e-12);
    CHECK(s.distance.v.norm() == doctest::Approx(1.0));
  }
}
