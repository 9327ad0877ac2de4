// SPDX-License-Identifier: MIT
// MuJoCo's forward dynamics as an independent reference for ours, on the same file.
#include <algorithm>
#include <memory>
#include <string>

#include <doctest/doctest.h>
#include <mujoco/mujoco.h>

#include "support.hpp"
#include <traceur/sim/dynamics.hpp>

namespace {

struct Free {
  void operator()(mjModel* m) const { mj_deleteModel(m); }
  void operator()(mjData* d) const { mj_deleteData(d); }
};

void to_wxyz(const double* q, double* out) {
  out[0] = q[3];
  out[1] = q[0];
  out[2] = q[1];
  out[3] = q[2];
}

/// Largest relative difference of joint and root accelerations over random states, torques and speeds.
double worst_difference(const traceur::body::Character& c, const std::string& path, double gravity, double speed,
                        double torque) {
  char error[1000] = "";
  const std::unique_ptr<mjModel, Free> m(mj_loadXML(path.c_str(), nullptr, error, sizeof error));
  REQUIRE_MESSAGE(m, std::string(error));
  m->opt.disableflags |= mjDSBL_CONTACT | mjDSBL_PASSIVE | mjDSBL_LIMIT | mjDSBL_ACTUATION | mjDSBL_CONSTRAINT;
  m->opt.gravity[2] = -gravity;
  const std::unique_ptr<mjData, Free> d(mj_makeData(m.get()));
  const traceur::body::Skeleton& s = c.skeleton;
  REQUIRE(m->nv == s.nv());
  const traceur::sim::Model model = traceur::sim::make_model(c);
  traceur::sim::DynamicsWork<double> work(model);
  traceur::core::RandomStream random(11);
  Eigen::VectorXd ours(s.nv()), theirs(s.nv());
  double worst = 0;
  for (int trial = 0; trial < 200; ++trial) {
    Eigen::VectorXd q = scene::random_pose(c, random, 3.0);
    for (int k = 0; k < 3; ++k) q[k] = random.normal();
    const Eigen::VectorXd v = scene::random_velocity(c, random, speed);
    const Eigen::VectorXd tau = scene::random_velocity(c, random, torque);
    mj_resetData(m.get(), d.get());
    for (const auto& j : s.joints()) {
      const int joint = mj_name2id(m.get(), mjOBJ_JOINT, j.name.c_str());
      if (j.type == traceur::body::JointType::fixed) continue;
      REQUIRE(joint >= 0);
      double* qpos = d->qpos + m->jnt_qposadr[joint];
      double* qvel = d->qvel + m->jnt_dofadr[joint];
      double* applied = d->qfrc_applied + m->jnt_dofadr[joint];
      const double* qj = q.data() + j.q_index;
      const double* vj = v.data() + j.v_index;
      if (j.type == traceur::body::JointType::free) {
        std::copy_n(qj, 3, qpos);
        to_wxyz(qj + 3, qpos + 3);
        std::copy_n(vj, 3, qvel);
        // MuJoCo's angular velocity of a free body is in the body's axes.
        scene::Quaternion::from(qj + 3).conjugate().rotate(scene::Vector::from(vj + 3)).store(qvel + 3);
      } else {
        if (j.type == traceur::body::JointType::ball)
          to_wxyz(qj, qpos);
        else
          qpos[0] = qj[0];
        std::copy_n(vj, velocity_size(j.type), qvel);
        std::copy_n(tau.data() + j.v_index, velocity_size(j.type), applied);
      }
    }
    mj_forward(m.get(), d.get());
    for (const auto& j : s.joints()) {
      if (j.type == traceur::body::JointType::fixed) continue;
      const int joint = mj_name2id(m.get(), mjOBJ_JOINT, j.name.c_str());
      const double* qacc = d->qacc + m->jnt_dofadr[joint];
      std::copy_n(qacc, velocity_size(j.type), theirs.data() + j.v_index);
      if (j.type == traceur::body::JointType::free)
        scene::Quaternion::from(q.data() + j.q_index + 3)
            .rotate(scene::Vector::from(qacc + 3))
            .store(theirs.data() + 3);
    }
    traceur::sim::forward_dynamics(model, q.data(), v.data(), tau.data(), gravity, work, ours.data());
    REQUIRE(theirs.allFinite());
    worst = std::max(worst, (ours - theirs).cwiseAbs().maxCoeff() / std::max(1.0, theirs.cwiseAbs().maxCoeff()));
  }
  return worst;
}

}  // namespace

TEST_CASE("forward dynamics of the humanoid is MuJoCo's") {
  const std::string path = TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml";
  const auto& c = scene::humanoid();
  // From states at rest without torque, which leave only weight, to everything at once.
  CHECK(worst_difference(c, path, 9.81, 0, 0) < 1e-6);
  CHECK(worst_difference(c, path, 0, 0, 50) < 1e-6);
  CHECK(worst_difference(c, path, 0, 10, 0) < 1e-6);
  CHECK(worst_difference(c, path, 9.81, 10, 50) < 1e-6);
  MESSAGE("largest relative difference " << worst_difference(c, path, 9.81, 10, 50));
}
