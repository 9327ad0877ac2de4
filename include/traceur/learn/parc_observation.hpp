// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "traceur/body/kinematics.hpp"
#include "traceur/core/error.hpp"
#include "traceur/terrain/local_map.hpp"

namespace traceur::learn {

/// What PARC's motion tracker sees (Xu et al. 2025, s6.1; sizes of the authors' code). For a body of 15 with 28 moving
/// joint axes, four key bodies, six future frames and the fan of 441 heights these are 1312 numbers:
///
///     own state         136   root rotation 6, root velocity 3, root angular velocity 3, joint rotations 6 x 14,
///                             joint velocities 28, key bodies 3 x 4
///     future frames 6 x 105   root place 3, root rotation 6, joint rotations 6 x 14, key bodies 3 x 4
///     future labels 6 x  15   contact labels of the reference
///     own labels         15   which bodies touch
///     heights           441   ground less root height
///
/// All is told in the heading frame of the character's own root. A rotation is the images of x and z, the root's seen from
/// that frame, a joint's from its parent's body, rest frame included. Velocities and places are along the frame's axes,
/// places relative to the character's own root, also those of future frames. Joint velocities are those of a velocity
/// vector. The root's height does not show, but for that of the ground under it.
template <class T = float>
class ParcObservation {
public:
  struct Settings {
    int future_frames = 6;                  ///< PARC: 1, 2, 3, 10, 20 and 30 frames ahead
    std::vector<std::string> key_bodies{"right_hand", "left_hand", "right_foot", "left_foot"};
    terrain::HeightFan fan;
  };

  /// A pose and what follows from it.
  struct Seen {
    std::span<const T> q;             ///< nq numbers
    const body::Frames<T>* frames;    ///< of that pose
    std::span<const T> labels;        ///< contact, a number for each body
  };

  /// Throws Error unless the root is free and every key body exists.
  explicit ParcObservation(const body::Skeleton& skeleton, const Settings& settings = {})
      : skeleton_(skeleton), future_(settings.future_frames), heights_(settings.fan) {
    if (!skeleton.free_root()) throw Error("PARC observation: expected a skeleton with a free root");
    if (settings.future_frames < 0) throw Error("PARC observation: expected no negative number of future frames");
    for (const std::string& name : settings.key_bodies) {
      keys_.push_back(skeleton.find_body(name));
      if (keys_.back() < 0) throw Error("PARC observation: no body named '" + name + "'");
    }
  }

  int bodies() const noexcept { return skeleton_.size(); }
  int future_frames() const noexcept { return future_; }
  /// Where the parts begin, and how long they are.
  int own_size() const noexcept { return 12 + 6 * (bodies() - 1) + skeleton_.nv() - 6 + 3 * keys(); }
  int future_size() const noexcept { return 9 + 6 * (bodies() - 1) + 3 * keys(); }
  int future_begin() const noexcept { return own_size(); }
  int future_labels_begin() const noexcept { return future_begin() + future_ * future_size(); }
  int own_labels_begin() const noexcept { return future_labels_begin() + future_ * bodies(); }
  int heights_begin() const noexcept { return own_labels_begin() + bodies(); }
  int size() const noexcept { return heights_begin() + heights_.size(); }

  /// The observation of a character with pose `own` and velocity `v` (nv numbers) that is to show the reference's `future`
  /// (future_frames() of them) on `ground`, into `out` (size() numbers). Allocates nothing.
  void observe(const Seen& own, std::span<const T> v, std::span<const Seen> future, const terrain::HeightGrid& ground,
               std::span<T> out) const noexcept {
    const auto frame = terrain::HeadingFrame<T>::of(own.frames->position[0], own.frames->rotation[0]);
    const core::Quaternion<T> back = core::heading(own.frames->rotation[0]).conjugate();
    T* o = out.data();
    o = put_rotation(back * own.frames->rotation[0], o);
    o = put(frame.direction_to_local(core::Vector3<T>::from(v.data())), o);
    o = put(frame.direction_to_local(core::Vector3<T>::from(v.data() + 3)), o);
    o = put_joints(own.q.data(), o);
    for (int i = 6; i < skeleton_.nv(); ++i) *o++ = v[static_cast<std::size_t>(i)];
    o = put_keys(frame, *own.frames, o);
    for (const Seen& later : future) {
      o = put(frame.to_local(later.frames->position[0]), o);
      o = put_rotation(back * later.frames->rotation[0], o);
      o = put_joints(later.q.data(), o);
      o = put_keys(frame, *later.frames, o);
    }
    for (const Seen& later : future) o = put_labels(later, o);
    o = put_labels(own, o);
    heights_.sample(ground, frame, std::span<T>(o, static_cast<std::size_t>(heights_.size())));
  }

private:
  int keys() const noexcept { return static_cast<int>(keys_.size()); }
  static T* put(const core::Vector3<T>& v, T* o) noexcept {
    v.store(o);
    return o + 3;
  }
  static T* put_rotation(const core::Quaternion<T>& q, T* o) noexcept {
    o = put(q.rotate({T(1), T(0), T(0)}), o);
    return put(q.rotate({T(0), T(0), T(1)}), o);
  }
  T* put_joints(const T* q, T* o) const noexcept {
    for (int i = 1; i < bodies(); ++i) {
      const body::Joint& j = skeleton_[i];
      o = put_rotation(j.rest.template cast<T>() * body::joint_rotation(j, q), o);
    }
    return o;
  }
  T* put_keys(const terrain::HeadingFrame<T>& frame, const body::Frames<T>& frames, T* o) const noexcept {
    for (const int b : keys_) o = put(frame.to_local(frames.position[static_cast<std::size_t>(b)]), o);
    return o;
  }
  T* put_labels(const Seen& seen, T* o) const noexcept {
    for (int b = 0; b < bodies(); ++b) *o++ = seen.labels[static_cast<std::size_t>(b)];
    return o;
  }

  body::Skeleton skeleton_;
  int future_;
  std::vector<int> keys_;
  terrain::LocalMap<T> heights_;
};

}  // namespace traceur::learn
