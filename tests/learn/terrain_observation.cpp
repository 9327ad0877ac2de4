// SPDX-License-Identifier: MIT
#include <traceur/learn/terrain_observation.hpp>

#include <cmath>

#include <doctest/doctest.h>

using namespace traceur;
using namespace traceur::learn;
using core::Vector3;

namespace {

terrain::HeightGrid slope() {
  Eigen::MatrixXd h(40, 40);
  for (Eigen::Index i = 0; i < 40; ++i) h.row(i).setConstant(0.1 * static_cast<double>(i));
  return terrain::HeightGrid(h, 0.2, -4, -4);
}
terrain::PointCloud<float> posts() {
  terrain::PointCloud<float> cloud;
  for (int k = 0; k < 5; ++k) {
    const Vector3<float> p{static_cast<float>(k), 1, 0.5f};
    cloud.add_group(std::span(&p, 1));
  }
  return cloud;
}

}  // namespace

TEST_CASE("lanes see their own surroundings, ground first, then points") {
  using P = core::Pack<float>;
  constexpr int width = core::lane_count<P>;
  const terrain::HeightGrid ground = slope();
  const terrain::PointCloud<float> cloud = posts();
  const terrain::LocalMap<float> fan{terrain::HeightFan{}};
  TerrainObservation all(ground, fan, cloud, 2);
  CHECK(TerrainObservation().size() == 0);
  CHECK(TerrainObservation(ground, fan).size() == fan.size());
  CHECK(TerrainObservation(cloud, 7).size() == 21);
  CHECK(all.size() == fan.size() + 6);
  terrain::HeadingFrame<P> frame;
  frame.origin = {P(0.0), P(0.0), P(1.0)};
  for (int lane = 0; lane < width; ++lane) {
    frame.origin.x.set(lane, 0.2f * static_cast<float>(lane));
    frame.cosine.set(lane, std::cos(0.1f * static_cast<float>(lane)));
    frame.sine.set(lane, std::sin(0.1f * static_cast<float>(lane)));
  }
  Eigen::MatrixXf out = Eigen::MatrixXf::Constant(all.size() + 1, width, -9);
  FeatureWriter<P> to(out.data(), out.rows());
  to.skip(1);
  all.write(frame, to);
  CHECK(to.rows() == out.rows());
  terrain::NearestPoints<float> nearest(2);
  for (int lane = 0; lane < width; ++lane) {
    const auto own = terrain::HeadingFrame<float>{{frame.origin.x[lane], 0, 1}, frame.cosine[lane], frame.sine[lane]};
    Eigen::VectorXf heights(fan.size()), points(6);
    fan.sample(ground, own, std::span<float>(heights.data(), static_cast<std::size_t>(fan.size())));
    nearest.observe(cloud, own, std::span<float>(points.data(), 6));
    CHECK(out(0, lane) == -9);
    CHECK(out.col(lane).segment(1, fan.size()) == heights);
    CHECK(out.col(lane).tail(6) == points);
  }
}
