// SPDX-License-Identifier: MIT
// The same files read by MuJoCo and by us. Apart from tests/io/mjcf.cpp so that a build without MuJoCo keeps that one.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <random>
#include <string>

#include <doctest/doctest.h>
#include <mujoco/mujoco.h>

#include <traceur/body/kinematics.hpp>
#include <traceur/io/mjcf.hpp>

namespace {

using traceur::body::Character;
using traceur::body::JointType;
using Vector = traceur::core::Vector3<double>;
using Quaternion = traceur::core::Quaternion<double>;
namespace fs = std::filesystem;

struct Free {
  void operator()(mjModel* m) const { mj_deleteModel(m); }
  void operator()(mjData* d) const { mj_deleteData(d); }
};

Quaternion from_wxyz(const double* q) { return {q[1], q[2], q[3], q[0]}; }

/// The rotation that MuJoCo's joints of a body make of qpos.
Quaternion joint_rotation(const mjModel* m, const mjData* d, int body) {
  Quaternion q = Quaternion::identity();
  for (int k = 0; k < m->body_jntnum[body]; ++k) {
    const int j = m->body_jntadr[body] + k;
    const double* at = d->qpos + m->jnt_qposadr[j];
    if (m->jnt_type[j] == mjJNT_HINGE) q = q * traceur::core::about_axis(Vector::from(m->jnt_axis + 3 * j), at[0]);
    if (m->jnt_type[j] == mjJNT_BALL) q = q * from_wxyz(at);
  }
  return q;
}

/// Masses, centres of mass, inertias and joint places of both readings agree at random poses.
void compare(const fs::path& path) {
  CAPTURE(path.string());
  char error[1000] = "";
  const std::unique_ptr<mjModel, Free> m(mj_loadXML(path.string().c_str(), nullptr, error, sizeof error));
  REQUIRE_MESSAGE(m, std::string(error));
  const std::unique_ptr<mjData, Free> d(mj_makeData(m.get()));
  const Character c = traceur::io::read_mjcf(path);
  const traceur::body::Skeleton& s = c.skeleton;

  double total = 0;
  for (int b = 0; b < m->nbody; ++b) total += m->body_mass[b];
  CHECK(c.total_mass() == doctest::Approx(total).epsilon(1e-12));
  CHECK(s.nv() == m->nv);

  std::mt19937 generator(7);
  std::normal_distribution<double> normal;
  traceur::body::Frames<double> frames(s);
  for (int trial = 0; trial < 20; ++trial) {
    for (int i = 0; i < m->nq; ++i) d->qpos[i] = normal(generator);
    mj_normalizeQuat(m.get(), d->qpos);
    mj_kinematics(m.get(), d.get());

    Eigen::VectorXd q = s.neutral_pose();
    for (int i = 0; i < s.size(); ++i) {
      const int body = mj_name2id(m.get(), mjOBJ_BODY, s[i].body.c_str());
      const int joint = mj_name2id(m.get(), mjOBJ_JOINT, s[i].name.c_str());
      double* at = q.data() + s[i].q_index;
      if (s[i].type == JointType::hinge) at[0] = d->qpos[m->jnt_qposadr[joint]];
      if (s[i].type == JointType::ball) joint_rotation(m.get(), d.get(), body).store(at);
      if (s[i].type == JointType::free) {
        Vector::from(d->qpos).store(at);
        from_wxyz(d->qpos + 3).store(at + 3);
      }
    }
    traceur::body::forward_kinematics(s, q.data(), frames);

    for (int i = 0; i < s.size(); ++i) {
      const int body = mj_name2id(m.get(), mjOBJ_BODY, s[i].body.c_str());
      if (body <= 0) continue;
      CAPTURE(s[i].body);
      const auto k = static_cast<std::size_t>(i);
      const traceur::body::Inertia& in = c.inertias[k];
      CHECK(in.mass == doctest::Approx(m->body_mass[body]).epsilon(1e-12));
      CHECK(norm(frames.point(i, in.center) - Vector::from(d->xipos + 3 * body)) < 1e-9);
      const auto turned = traceur::core::rotated(in.about_center, frames.rotation[k].matrix()).full().eigen();
      const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> axes(d->ximat + 9 * body);
      const Eigen::Map<const Eigen::Vector3d> principal(m->body_inertia + 3 * body);
      const Eigen::Matrix3d theirs = axes * principal.asDiagonal() * axes.transpose();
      // MuJoCo stops its search for principal axes at about 1e-7.
      CHECK((turned - theirs).cwiseAbs().maxCoeff() < 1e-6 * theirs.norm());
      const Quaternion off = frames.rotation[k].conjugate() * from_wxyz(d->xquat + 4 * body);
      CHECK(norm(off.vec()) < 1e-9);
      if (m->body_jntnum[body] == 0) {
        CHECK(norm(frames.position[k] - Vector::from(d->xpos + 3 * body)) < 1e-9);
      } else if (s[i].type != JointType::free) {
        const int last = m->body_jntadr[body] + m->body_jntnum[body] - 1;
        CHECK(norm(frames.position[k] - Vector::from(d->xanchor + 3 * last)) < 1e-9);
      }
    }
  }
}

/// MuJoCo reads from files only.
void compare_text(const std::string& xml) {
  std::random_device entropy;
  const fs::path path = fs::temp_directory_path() / ("traceur-mjcf-" + std::to_string(entropy()) + ".xml");
  std::ofstream(path) << xml;
  compare(path);
  fs::remove(path);
}

}  // namespace

TEST_CASE("mjcf: MuJoCo reads the humanoid as we do") {
  compare(TRACEUR_SOURCE_DIR "/examples/characters/humanoid.xml");
}

TEST_CASE("mjcf: MuJoCo reads a humanoid of hinges as we do") {
  const char* motions = std::getenv("TRACEUR_MOTIONS");
  const fs::path path = fs::path(motions ? motions : TRACEUR_SOURCE_DIR "/../shared/motions") / "parc/humanoid.xml";
  if (!fs::exists(path)) {
    MESSAGE("left out without " << path.string());
    return;
  }
  std::ifstream in(path);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  // The file names a material that another file holds.
  const std::string material = " material=\"grid\"";
  if (const auto at = text.find(material); at != std::string::npos) text.erase(at, material.size());
  compare_text(text);
}

TEST_CASE("mjcf: MuJoCo reads odd placements as we do") {
  compare_text(R"(<mujoco>
    <compiler eulerseq="zyx"/>
    <default>
      <geom density="300"/>
      <default class="box"><geom type="box" size="0.1 0.2 0.3" euler="10 20 30"/></default>
    </default>
    <worldbody>
      <geom type="plane" size="1 1 1"/>
      <body name="a" pos="1 2 3" euler="20 40 60" childclass="box">
        <freejoint/>
        <geom pos="0.1 0.2 0.3"/>
        <geom class="main" type="capsule" fromto="0 0 0 0.3 0.4 0.5" size="0.05"/>
        <geom class="main" type="capsule" size="0.05 0.3" axisangle="1 2 3 40" pos="0 1 0"/>
        <geom class="main" type="box" fromto="1 0 0 0 1 0.5" size="0.05"/>
        <geom class="main" type="sphere" size="0.2" mass="3" pos="0 0 -1"/>
        <body name="b" pos="0.5 0 0" quat="1 2 3 4">
          <joint name="b_ball" type="ball" pos="0.1 -0.2 0.3"/>
          <geom pos="0.3 0 0"/>
          <body name="c" pos="0 0.4 0" xyaxes="1 1 0 -1 1 0.5">
            <joint name="c1" axis="1 1 0" pos="0.1 0 0"/>
            <joint name="c2" axis="0 1 -1" pos="0 0.2 0"/>
            <geom/>
            <body name="d" pos="0 0 0.3" zaxis="1 -2 0.5">
              <geom type="sphere" size="0.1"/>
              <body name="e" pos="0.2 0 0">
                <joint name="e_z" axis="0 0 1" pos="0 0 0.3"/>
                <joint name="e_x" axis="-1 0 0" pos="0 0 0.3"/>
                <joint name="e_y" axis="0 2 0" pos="0 0 0.3"/>
                <inertial pos="0.1 0.2 0.3" mass="2" fullinertia="1 1.1 1.2 0.1 0.2 -0.1"/>
                <geom/>
                <body name="f" pos="0 0 1"><joint name="f" axis="0 1 0"/>
                  <inertial pos="0.1 0.2 0.3" mass="2" diaginertia="1 1.1 1.2" euler="30 0 10"/>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </worldbody>
  </mujoco>)");
  compare_text(R"(<mujoco><compiler angle="radian" inertiafromgeom="true"/><worldbody>
    <body name="a" pos="0 0 1" euler="0.1 0.2 0.3"><joint name="swing" axis="0 1 0" pos="0 0 0.5"/>
      <inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/><geom type="capsule" size="0.1 0.2"/>
      <body name="b" pos="0 0 -1"><joint name="wag" axis="1 0 0"/><geom type="sphere" size="0.1"/></body>
    </body>
    <body name="c" pos="3 0 0"><geom type="sphere" size="0.1"/></body>
  </worldbody></mujoco>)");
}
