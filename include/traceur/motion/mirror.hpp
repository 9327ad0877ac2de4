// SPDX-License-Identifier: MIT
#pragma once

#include <cctype>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "traceur/motion/clip.hpp"

namespace traceur::motion {

/// How joints are paired for mirroring.
struct MirrorOptions {
  /// Joint names that belong together, either way round; a joint mapped to itself is central. What is not listed is paired
  /// by name.
  std::map<std::string, std::string> pairs;
  /// Unit vector in the root's frame from right to left. By default the mean direction from the right to the left joint of
  /// each pair in the neutral pose, taken as a coordinate axis if within 15 degrees of one; +y if there are no pairs.
  std::optional<core::Vector3<double>> lateral;
};

namespace detail {

inline char lower(char c) { return static_cast<char>(std::tolower(static_cast<unsigned char>(c))); }
inline bool is_letter(char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0; }
inline bool is_upper(char c) { return std::isupper(static_cast<unsigned char>(c)) != 0; }

/// `word` with the letter case of `like`.
inline std::string in_case_of(std::string_view word, std::string_view like) {
  std::string out;
  for (std::size_t i = 0; i < word.size(); ++i) {
    const bool upper = is_upper(like[i < like.size() ? i : like.size() - 1]);
    out += upper ? static_cast<char>(std::toupper(static_cast<unsigned char>(word[i]))) : word[i];
  }
  return out;
}

/// The name of a joint's counterpart on the other side and whether the name leaves no doubt that it has one. "" if the name
/// speaks of no side.
struct OtherSide {
  std::string name;
  bool certain = false;
};
inline OtherSide other_side(const std::string& name) {
  const auto word_begins = [&](std::size_t i) { return i == 0 || !is_letter(name[i - 1]) || (is_upper(name[i]) && !is_upper(name[i - 1])); };
  const auto matches = [&](std::size_t i, std::string_view word) {
    if (i + word.size() > name.size()) return false;
    for (std::size_t k = 0; k < word.size(); ++k)
      if (lower(name[i + k]) != word[k]) return false;
    return true;
  };
  for (std::size_t i = 0; i < name.size(); ++i) {
    if (!word_begins(i)) continue;
    for (const auto& [word, other] : {std::pair<std::string_view, std::string_view>{"left", "right"}, {"right", "left"}}) {
      if (!matches(i, word)) continue;
      const std::string replaced = in_case_of(other, std::string_view(name).substr(i, word.size()));
      return {name.substr(0, i) + replaced + name.substr(i + word.size()), true};
    }
  }
  const auto swapped = [&](std::size_t i) {
    std::string out = name;
    out[i] = name[i] == 'l' ? 'r' : name[i] == 'r' ? 'l' : name[i] == 'L' ? 'R' : 'L';
    return out;
  };
  for (std::size_t i = 0; i < name.size(); ++i) {
    if (lower(name[i]) != 'l' && lower(name[i]) != 'r') continue;
    const bool alone_before = i == 0 || !is_letter(name[i - 1]);
    const bool alone_after = i + 1 == name.size() || !is_letter(name[i + 1]);
    if (alone_before && alone_after) return {swapped(i), true};
  }
  if (name.size() < 2 || (lower(name[0]) != 'l' && lower(name[0]) != 'r')) return {};
  // "LHip" means a side; "lfemur" does and "lowerback" does not, which only the counterpart's existence tells.
  const bool capital = is_upper(name[1]) && name.size() > 2 && !is_upper(name[2]);
  return {swapped(0), capital};
}

}  // namespace detail

/// Swaps left and right: reflects motions across the world's x-z plane (y -> -y), so that a clip heading for +x still does.
///
/// A body i is taken to map onto its partner i' so that the neutral pose is its own mirror image: with F_i the neutral
/// rotation of body i in the root's frame and B_0 the reflection along the root's lateral axis, local points map by
/// B_i = F_i'^T B_0 F_i. Joint rotations map by J -> B_i J B_i^T, so rotation vectors by w -> -B_i w; the world's reflection
/// M maps the root by p -> M p, R -> M R B_0. A hinge maps its angle by the sign that carries its axis onto the partner's:
/// a' = sign(-B_i a . a'). Mirroring twice gives the pose back. Positions are reflected exactly on a skeleton whose offsets
/// are symmetric; see `asymmetry`.
class Mirror {
 public:
  /// Throws Error that names the joint if its name speaks of a side but the counterpart is missing, if partners differ in
  /// type or have parents that are not partners, if a hinge's axis is not its partner's mirror image, or if an option names
  /// a joint that does not exist.
  explicit Mirror(const body::Skeleton& skeleton, const MirrorOptions& options = {}) : skeleton_(skeleton) {
    pair_joints(options.pairs);
    const int n = skeleton_.size();
    neutral_.assign(static_cast<std::size_t>(n), core::Quaternion<double>::identity());
    std::vector<core::Vector3<double>> place(static_cast<std::size_t>(n), core::Vector3<double>{0, 0, 0});
    for (int i = 1; i < n; ++i) {
      const body::Joint& j = skeleton_[i];
      const auto k = static_cast<std::size_t>(i), p = static_cast<std::size_t>(j.parent);
      place[k] = place[p] + neutral_[p].rotate(j.offset);
      neutral_[k] = neutral_[p] * j.rest;
    }
    lateral_ = options.lateral ? *options.lateral : find_lateral(place);
    if (!(std::abs(norm(lateral_) - 1.0) < 1e-6)) throw Error("mirror: expected a lateral axis of unit length");
    signs_.assign(static_cast<std::size_t>(n), 1.0);
    for (int i = 0; i < n; ++i) {
      const body::Joint &j = skeleton_[i], &other = skeleton_[partner(i)];
      if (j.type != body::JointType::hinge) continue;
      const double along = -dot(reflected(i, j.axis), other.axis);
      if (std::abs(std::abs(along) - 1.0) > 1e-3)
        throw Error("mirror: joint '" + j.name + "': its hinge axis is not the mirror image of that of '" + other.name + "'");
      signs_[static_cast<std::size_t>(i)] = along > 0 ? 1.0 : -1.0;
    }
  }

  const body::Skeleton& skeleton() const { return skeleton_; }
  /// The joint on the other side; the joint itself if it is central.
  int partner(int joint) const { return partners_[static_cast<std::size_t>(joint)]; }
  /// Direction from right to left in the root's frame, unit.
  const core::Vector3<double>& lateral() const { return lateral_; }

  /// Place on the partner's body that corresponds to a place on body `joint`, both in their body's frame: B_i v.
  core::Vector3<double> reflected(int joint, const core::Vector3<double>& v) const {
    const auto k = static_cast<std::size_t>(joint), o = static_cast<std::size_t>(partner(joint));
    const core::Vector3<double> seen = neutral_[k].rotate(v);
    return neutral_[o].conjugate().rotate(seen - 2 * dot(lateral_, seen) * lateral_);
  }

  /// Largest distance (m) between a joint's offset and the mirror image of its partner's.
  double asymmetry() const {
    double worst = 0;
    for (int i = 1; i < skeleton_.size(); ++i) {
      const core::Vector3<double> image = reflected(skeleton_[i].parent, skeleton_[i].offset);
      worst = std::max(worst, norm(image - skeleton_[partner(i)].offset));
    }
    return worst;
  }

  /// The mirror image of pose q (nq numbers), which `out` must not overlap.
  template <class S>
  void pose(const S* q, S* out) const {
    using core::Quaternion;
    using core::Vector3;
    for (int i = 0; i < skeleton_.size(); ++i) {
      const body::Joint& j = skeleton_[i];
      const S* from = q + j.q_index;
      S* to = out + skeleton_[partner(i)].q_index;
      switch (j.type) {
        case body::JointType::fixed:
          break;
        case body::JointType::hinge:
          to[0] = S(signs_[static_cast<std::size_t>(i)]) * from[0];
          break;
        case body::JointType::ball: {
          const Vector3<S> v = reflected_as(i, Vector3<S>::from(from));
          (Quaternion<S>{-v.x, -v.y, -v.z, from[3]}).store(to);
          break;
        }
        case body::JointType::free: {
          to[0] = from[0];
          to[1] = -from[1];
          to[2] = from[2];
          // Each reflection is minus a half turn, and the two minus signs cancel.
          const Quaternion<S> y{S(0.0), S(1.0), S(0.0), S(0.0)};
          const Quaternion<S> n{S(lateral_.x), S(lateral_.y), S(lateral_.z), S(0.0)};
          const Quaternion<S> rest = j.rest.cast<S>();
          (rest.conjugate() * y * rest * Quaternion<S>::from(from + 3) * n.conjugate()).store(to + 3);
          break;
        }
      }
    }
  }
  Eigen::VectorXd pose(const Eigen::VectorXd& q) const {
    Eigen::VectorXd out(skeleton_.nq());
    pose(q.data(), out.data());
    return out;
  }

  /// The mirror image of a velocity or tangent vector (nv numbers), which `out` must not overlap.
  template <class S>
  void velocity(const S* v, S* out) const {
    using core::Vector3;
    for (int i = 0; i < skeleton_.size(); ++i) {
      const body::Joint& j = skeleton_[i];
      const S* from = v + j.v_index;
      S* to = out + skeleton_[partner(i)].v_index;
      if (j.type == body::JointType::hinge) to[0] = S(signs_[static_cast<std::size_t>(i)]) * from[0];
      if (j.type == body::JointType::ball) (-reflected_as(i, Vector3<S>::from(from))).store(to);
      if (j.type == body::JointType::free) {
        const S values[6] = {from[0], -from[1], from[2], -from[3], from[4], -from[5]};
        for (int k = 0; k < 6; ++k) to[k] = values[k];
      }
    }
  }
  Eigen::VectorXd velocity(const Eigen::VectorXd& v) const {
    Eigen::VectorXd out(skeleton_.nv());
    velocity(v.data(), out.data());
    return out;
  }

  /// The mirror image of a clip, contact labels included; its name ends in "_mirrored". Throws Error if the clip's joints
  /// are not this skeleton's.
  Clip clip(const Clip& clip) const {
    bool same = clip.skeleton.size() == skeleton_.size() && clip.skeleton.nq() == skeleton_.nq();
    for (int i = 0; same && i < skeleton_.size(); ++i) same = clip.skeleton[i].name == skeleton_[i].name;
    if (!same) throw Error(detail::where(clip) + ": mirror: expected the joints of the mirror's skeleton");
    Clip out = clip;
    out.name += "_mirrored";
    for (int k = 0; k < clip.keys(); ++k) pose(clip.poses.col(k).data(), out.poses.col(k).data());
    for (int i = 0; clip.contacts.cols() != 0 && i < skeleton_.size(); ++i)
      out.contacts.row(partner(i)) = clip.contacts.row(i);
    return out;
  }

 private:
  template <class S>
  core::Vector3<S> reflected_as(int joint, const core::Vector3<S>& v) const {
    const auto k = static_cast<std::size_t>(joint), o = static_cast<std::size_t>(partner(joint));
    const core::Vector3<S> axis = lateral_.cast<S>(), seen = neutral_[k].cast<S>().rotate(v);
    return neutral_[o].conjugate().cast<S>().rotate(seen - S(2.0) * dot(axis, seen) * axis);
  }

  void pair_joints(const std::map<std::string, std::string>& pairs) {
    const int n = skeleton_.size();
    partners_.assign(static_cast<std::size_t>(n), -1);
    const auto joint = [&](const std::string& name) {
      const int i = skeleton_.find(name);
      if (i < 0) throw Error("mirror: expected a joint named '" + name + "'");
      return i;
    };
    for (const auto& [a, b] : pairs) {
      partners_[static_cast<std::size_t>(joint(a))] = joint(b);
      partners_[static_cast<std::size_t>(joint(b))] = joint(a);
    }
    for (int i = 0; i < n; ++i) {
      int& p = partners_[static_cast<std::size_t>(i)];
      if (p >= 0) continue;
      const detail::OtherSide other = detail::other_side(skeleton_[i].name);
      p = other.name.empty() ? i : skeleton_.find(other.name);
      if (p < 0 && other.certain)
        throw Error("mirror: joint '" + skeleton_[i].name + "': expected its counterpart '" + other.name + "'");
      if (p < 0) p = i;
    }
    for (int i = 0; i < n; ++i) {
      const body::Joint &j = skeleton_[i], &other = skeleton_[partner(i)];
      const std::string where = "mirror: joint '" + j.name + "': its partner '" + other.name + "' ";
      if (partner(partner(i)) != i) throw Error(where + "is already that of another joint");
      if (other.type != j.type) throw Error(where + "is of another type");
      if ((j.parent < 0) != (other.parent < 0) || (j.parent >= 0 && partner(j.parent) != other.parent))
        throw Error(where + "does not hang from the partner of its parent");
    }
  }

  core::Vector3<double> find_lateral(const std::vector<core::Vector3<double>>& place) const {
    core::Vector3<double> sum{0, 0, 0};
    for (int i = 0; i < skeleton_.size(); ++i) {
      const int o = partner(i);
      if (o == i || !is_left(skeleton_[i].name)) continue;
      sum += place[static_cast<std::size_t>(i)] - place[static_cast<std::size_t>(o)];
    }
    const double length = norm(sum);
    if (!(length > 1e-9)) return {0, 1, 0};
    sum *= 1 / length;
    const double close = std::cos(15.0 / 180.0 * 3.14159265358979323846);
    for (const core::Vector3<double>& axis : {core::Vector3<double>{1, 0, 0}, {0, 1, 0}, {0, 0, 1}})
      if (std::abs(dot(axis, sum)) > close) return dot(axis, sum) > 0 ? axis : -axis;
    return sum;
  }

  // Of two paired names, the left one has an l where the right one has an r; other pairs are ordered by name.
  bool is_left(const std::string& name) const {
    const std::string& other = skeleton_[partner(skeleton_.find(name))].name;
    std::size_t k = 0;
    while (k < name.size() && k < other.size() && detail::lower(name[k]) == detail::lower(other[k])) ++k;
    return k < name.size() && (k == other.size() || detail::lower(name[k]) < detail::lower(other[k]));
  }

  body::Skeleton skeleton_;
  std::vector<int> partners_;
  std::vector<core::Quaternion<double>> neutral_;
  core::Vector3<double> lateral_{0, 1, 0};
  std::vector<double> signs_;
};

}  // namespace traceur::motion
