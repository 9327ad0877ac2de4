// SPDX-License-Identifier: MIT
#include <traceur/control/mirror.hpp>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace figures;

namespace {

/// Runs a law on both characters at a few random states.
template <class Law>
void everywhere(Law&& law) {
  for (const Figure* f : {&humanoid(), &small()})
    for (std::uint64_t k = 0; k < 5; ++k) {
      core::RandomStream random(7, k);
      const Eigen::VectorXd q = any_pose(*f, random, 1.5);
      const Eigen::VectorXd v = any_velocity(*f, random, 3);
      law(*f, q, v);
    }
}

}  // namespace

TEST_CASE("mirroring twice changes nothing, mirroring once does") {
  everywhere([](const Figure& f, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
    const Eigen::VectorXd mq = control::mirrored_pose(f.model, f.roles, q), mv = control::mirrored_tangent(f.model, f.roles, v);
    CHECK((mq - q).norm() > 0.1);
    CHECK((mv - v).norm() > 0.1);
    CHECK(control::mirrored_pose(f.model, f.roles, mq) == q);
    CHECK(control::mirrored_tangent(f.model, f.roles, mv) == v);
  });
}

TEST_CASE("the mirrored pose's bodies are where a mirror shows them") {
  everywhere([](const Figure& f, const Eigen::VectorXd& q, const Eigen::VectorXd&) {
    body::Frames<double> here(f.skeleton()), there(f.skeleton());
    body::forward_kinematics(f.skeleton(), q.data(), here);
    const Eigen::VectorXd mirrored = control::mirrored_pose(f.model, f.roles, q);
    body::forward_kinematics(f.skeleton(), mirrored.data(), there);
    for (std::size_t b = 0; b < f.model.bodies.size(); ++b) {
      const auto from = static_cast<std::size_t>(f.model.bodies[b].joint);
      const auto to = static_cast<std::size_t>(f.model.bodies[static_cast<std::size_t>(f.roles.mirror[b])].joint);
      CHECK(apart(there.position[to], control::mirrored_vector(here.position[from])) < 1e-12);
      for (const Vector axis : {Vector{1, 0, 0}, Vector{0, 1, 0}, Vector{0, 0, 1}})
        CHECK(apart(there.rotation[to].rotate(control::mirrored_vector(axis)),
                    control::mirrored_vector(here.rotation[from].rotate(axis))) < 1e-12);
    }
  });
}

TEST_CASE("the mirrored velocity has the mirrored momenta and the same energy") {
  everywhere([](const Figure& f, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
    const auto here = momentum_of(f, q, v);
    const auto there = momentum_of(f, control::mirrored_pose(f.model, f.roles, q),
                                          control::mirrored_tangent(f.model, f.roles, v));
    CHECK(apart(there.center_of_mass, control::mirrored_vector(here.center_of_mass)) < 1e-12);
    CHECK(apart(there.linear, control::mirrored_vector(here.linear)) < 1e-10);
    CHECK(apart(there.angular, control::mirrored_rotation(here.angular)) < 1e-10);
    CHECK(there.kinetic_energy == doctest::Approx(here.kinetic_energy).epsilon(1e-12));
  });
}

TEST_CASE("mirroring and displacing may change places") {
  everywhere([](const Figure& f, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
    const Eigen::VectorXd d = 0.3 * v;
    Eigen::VectorXd a(f.model.nq), b(f.model.nq);
    body::displace(f.skeleton(), q.data(), d.data(), a.data());
    const Eigen::VectorXd mq = control::mirrored_pose(f.model, f.roles, q), md = control::mirrored_tangent(f.model, f.roles, d);
    body::displace(f.skeleton(), mq.data(), md.data(), b.data());
    CHECK((control::mirrored_pose(f.model, f.roles, a) - b).cwiseAbs().maxCoeff() < 1e-12);
  });
}
