// SPDX-License-Identifier: MIT
#include <traceur/motion/mirror.hpp>

#include <doctest/doctest.h>

#include <traceur/body/kinematics.hpp>

#include "figure.hpp"

using namespace traceur;
using namespace figure;
using motion::Mirror;
using Q = Quaternion<double>;

namespace {

Eigen::Matrix3d matrix(const Q& q) { return q.matrix().eigen(); }

/// The biped with joint frames turned at will: each right-side frame is unrelated to its left one, and offsets and hinge
/// axes are given so that positions stay symmetric. `lateral` is the root-frame axis that points left.
Skeleton turned_biped(std::mt19937_64& rng, const Eigen::Vector3d& lateral) {
  const Skeleton plain = biped();
  // Brings +y to `lateral`.
  const Eigen::Matrix3d base = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitY(), lateral).toRotationMatrix();
  Skeleton out;
  std::vector<Eigen::Matrix3d> frame;
  for (int i = 0; i < plain.size(); ++i) {
    Joint j = plain[i];
    Eigen::Matrix3d parent = Eigen::Matrix3d::Identity();
    if (i > 0) {
      parent = frame[static_cast<std::size_t>(j.parent)];
      const Q turn = exp_map(random_vector(rng, 1.5));
      frame.push_back(parent * matrix(turn));
      j.rest = turn;
      j.offset = Vector3<double>::from((parent.transpose() * base * j.offset.eigen()).eval());
      // Half of the hinges get their axis the other way round.
      const double sign = i % 2 == 0 ? 1 : -1;
      j.axis = Vector3<double>::from((sign * frame.back().transpose() * base * Eigen::Vector3d(0, 0.6, 0.8 * (j.name[0] == 'l' ? 1 : -1))).eval());
    } else {
      frame.push_back(parent);
    }
    out.add(j);
  }
  return out;
}

void check_reflection(const Skeleton& s, const Mirror& mirror, std::mt19937_64& rng) {
  body::Frames<double> before(s), after(s);
  for (int trial = 0; trial < 10; ++trial) {
    const Vec q = random_pose(s, rng, 1.5), image = mirror.pose(q);
    CHECK_NOTHROW(body::check_pose(s, image, "image"));
    body::forward_kinematics(s, q.data(), before);
    body::forward_kinematics(s, image.data(), after);
    for (int i = 0; i < s.size(); ++i) {
      const Vector3<double> p = before.position[static_cast<std::size_t>(i)];
      CHECK(norm(after.position[static_cast<std::size_t>(mirror.partner(i))] - Vector3<double>{p.x, -p.y, p.z}) < 1e-10);
      // Points fixed to the bodies too, so orientations are right, not only places.
      const Vector3<double> local = random_vector(rng, 0.3), world = before.point(i, local);
      const Vector3<double> other = after.point(mirror.partner(i), mirror.reflected(i, local));
      CHECK(norm(other - Vector3<double>{world.x, -world.y, world.z}) < 1e-10);
    }
  }
}

}  // namespace

TEST_CASE("positions of the mirrored pose are the reflected positions") {
  std::mt19937_64 rng(71);
  const Mirror mirror(biped());
  CHECK(mirror.asymmetry() < 1e-12);
  CHECK(norm(mirror.lateral() - Vector3<double>{0, 1, 0}) < 1e-12);
  check_reflection(biped(), mirror, rng);
}

TEST_CASE("joint frames may be turned at will, and the root frame need not have x forward") {
  std::mt19937_64 rng(72);
  for (const Eigen::Vector3d& lateral : {Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 0, -1),
                                         Eigen::Vector3d(0.6, 0, 0.8)}) {
    const Skeleton s = turned_biped(rng, lateral);
    const Mirror mirror(s);
    CHECK((mirror.lateral().eigen() - lateral).norm() < 1e-9);
    CHECK(mirror.asymmetry() < 1e-9);
    check_reflection(s, mirror, rng);
  }
}

TEST_CASE("mirroring twice is doing nothing") {
  std::mt19937_64 rng(73);
  const Skeleton s = turned_biped(rng, {0, 1, 0});
  const Mirror mirror(s);
  const Vec q = random_pose(s, rng, 2);
  CHECK((mirror.pose(mirror.pose(q)) - q).norm() < 1e-12);
  Vec v(s.nv());
  for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = uniform(rng, -1, 1);
  CHECK((mirror.velocity(mirror.velocity(v)) - v).norm() < 1e-12);
  auto clip = random_clip(rng);
  clip.contacts = Eigen::MatrixXd::Random(clip.skeleton.size(), clip.keys()).cwiseAbs();
  const Mirror plain(clip.skeleton);
  const auto twice = plain.clip(plain.clip(clip));
  CHECK(largest_gap(twice, clip) < 1e-12);
  CHECK(twice.contacts == clip.contacts);
  const auto once = plain.clip(clip);
  CHECK(once.name == "random_mirrored");
  CHECK(once.contacts.row(clip.skeleton.find("left_foot")) == clip.contacts.row(clip.skeleton.find("right_foot")));
}

TEST_CASE("velocities mirror as differences of mirrored poses do") {
  std::mt19937_64 rng(74);
  const Skeleton s = turned_biped(rng, {0, 0, 1});
  const Mirror mirror(s);
  const Vec a = random_pose(s, rng), b = random_pose(s, rng), ma = mirror.pose(a), mb = mirror.pose(b);
  Vec d(s.nv()), md(s.nv());
  body::difference(s, a.data(), b.data(), d.data());
  body::difference(s, ma.data(), mb.data(), md.data());
  CHECK((mirror.velocity(d) - md).norm() < 1e-9);
}

TEST_CASE("a lateral hinge keeps its angle, one along the body changes sign") {
  Skeleton s;
  s.add(joint("root", -1, JointType::free, {0, 0, 0}));
  s.add(joint("lknee", 0, JointType::hinge, {0, 0.1, 0}, {0, 1, 0}));
  s.add(joint("rknee", 0, JointType::hinge, {0, -0.1, 0}, {0, 1, 0}));
  s.add(joint("ltwist", 0, JointType::hinge, {0, 0.1, 0}, {0, 0, 1}));
  s.add(joint("rtwist", 0, JointType::hinge, {0, -0.1, 0}, {0, 0, 1}));
  s.add(joint("lback", 0, JointType::hinge, {0, 0, 0.1}, {1, 0, 0}));
  Vec q = s.neutral_pose();
  q.tail(5) << 0.1, 0.2, 0.3, 0.4, 0.5;
  const Vec image = Mirror(s).pose(q);
  CHECK(image.tail(5).isApprox((Vec(5) << 0.2, 0.1, -0.4, -0.3, -0.5).finished()));
}

TEST_CASE("names of many conventions are paired") {
  using motion::detail::other_side;
  const auto pairs = {std::pair<std::string, std::string>{"left_hip", "right_hip"}, {"LeftUpLeg", "RightUpLeg"},
                      {"hip_left", "hip_right"}, {"Character1_LeftArm", "Character1_RightArm"}, {"LEFT_ARM", "RIGHT_ARM"},
                      {"l_hip", "r_hip"}, {"hip.L", "hip.R"}, {"LHip", "RHip"}, {"foot_l", "foot_r"}, {"leftHand", "rightHand"}};
  for (const auto& [left, right] : pairs) {
    CHECK(other_side(left).name == right);
    CHECK(other_side(right).name == left);
    CHECK(other_side(left).certain);
  }
  CHECK(other_side("lfemur").name == "rfemur");
  CHECK(!other_side("lfemur").certain);
  for (const char* central : {"neck", "Spine1", "torso", "Hips", "head"}) CHECK(other_side(central).name.empty());

  // CMU's names: an l or r that begins a word means a side only where the other side exists.
  Skeleton s;
  s.add(joint("root", -1, JointType::free, {0, 0, 0}));
  s.add(joint("lfemur", 0, JointType::ball, {0, 0.1, -0.1}));
  s.add(joint("rfemur", 0, JointType::ball, {0, -0.1, -0.1}));
  s.add(joint("lowerback", 0, JointType::ball, {0, 0, 0.1}));
  const Mirror mirror(s);
  CHECK(mirror.partner(0) == 0);
  CHECK(mirror.partner(1) == 2);
  CHECK(mirror.partner(3) == 3);
}

TEST_CASE("an explicit map stands in for names, and errors name the joint") {
  Skeleton s;
  s.add(joint("base", -1, JointType::free, {0, 0, 0}));
  s.add(joint("port", 0, JointType::ball, {0, 0.1, 0}));
  s.add(joint("starboard", 0, JointType::ball, {0, -0.1, 0}));
  CHECK(Mirror(s).partner(1) == 1);
  motion::MirrorOptions options;
  options.pairs = {{"port", "starboard"}};
  options.lateral = Vector3<double>{0, 1, 0};
  CHECK(Mirror(s, options).partner(1) == 2);
  CHECK(Mirror(s, options).asymmetry() < 1e-12);
  options.pairs = {{"port", "aft"}};
  CHECK(fails_with([&] { Mirror(s, options); }, "a joint named 'aft'"));

  Skeleton lonely;
  lonely.add(joint("root", -1, JointType::free, {0, 0, 0}));
  lonely.add(joint("left_hip", 0, JointType::ball, {0, 0.1, 0}));
  CHECK(fails_with([&] { Mirror{lonely}; }, "joint 'left_hip': expected its counterpart 'right_hip'"));
  motion::MirrorOptions central;
  central.pairs = {{"left_hip", "left_hip"}};
  CHECK(Mirror(lonely, central).partner(1) == 1);

  Skeleton uneven = lonely;
  uneven.add(joint("right_hip", 0, JointType::hinge, {0, -0.1, 0}));
  CHECK(fails_with([&] { Mirror{uneven}; }, "is of another type"));
  Skeleton skewed;
  skewed.add(joint("root", -1, JointType::free, {0, 0, 0}));
  skewed.add(joint("left_knee", 0, JointType::hinge, {0, 0.1, 0}, {0, 1, 0}));
  skewed.add(joint("right_knee", 0, JointType::hinge, {0, -0.1, 0}, {1, 0, 0}));
  CHECK(fails_with([&] { Mirror{skewed}; }, "joint 'left_knee': its hinge axis"));
  Skeleton hung;
  hung.add(joint("root", -1, JointType::free, {0, 0, 0}));
  hung.add(joint("neck", 0, JointType::ball, {0, 0, 0.1}));
  hung.add(joint("left_arm", 0, JointType::ball, {0, 0.1, 0}));
  hung.add(joint("right_arm", 1, JointType::ball, {0, -0.1, 0}));
  CHECK(fails_with([&] { Mirror{hung}; }, "parent"));
  std::mt19937_64 rng(75);
  const auto clip = random_clip(rng);
  CHECK(fails_with([&] { Mirror(s).clip(clip); }, "clip 'random': mirror"));
}

TEST_CASE("single and double precision agree") {
  std::mt19937_64 rng(76);
  const Mirror mirror(biped());
  const Vec q = random_pose(biped(), rng);
  const Eigen::VectorXf f = q.cast<float>();
  Eigen::VectorXf out(f.size());
  mirror.pose(f.data(), out.data());
  CHECK((out.cast<double>() - mirror.pose(q)).norm() < 1e-5);
}
