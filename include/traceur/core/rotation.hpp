// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Geometry>

#include "traceur/core/matrix3.hpp"
#include "traceur/core/pack.hpp"

namespace traceur::core {

/// A unit quaternion x i + y j + z k + w in Eigen's order. `a * b` applies b first; it rotates vectors by q v q*.
template <class S>
struct Quaternion {
  S x, y, z, w;

  [[gnu::always_inline]] static Quaternion identity() { return {S(0.0), S(0.0), S(0.0), S(1.0)}; }
  [[gnu::always_inline]] Vector3<S> vec() const { return {x, y, z}; }
  [[gnu::always_inline]] Quaternion conjugate() const { return {-x, -y, -z, w}; }

  [[gnu::always_inline]] friend Quaternion operator*(const Quaternion& a, const Quaternion& b) {
    return {a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z};
  }
  [[gnu::always_inline]] Quaternion operator-() const { return {-x, -y, -z, -w}; }

  /// The vector seen after the rotation.
  [[gnu::always_inline]] Vector3<S> rotate(const Vector3<S>& v) const {
    const Vector3<S> t = S(2.0) * cross(vec(), v);
    return v + w * t + cross(vec(), t);
  }
  [[gnu::always_inline]] Matrix3<S> matrix() const {
    const S x2 = x + x, y2 = y + y, z2 = z + z, one(1.0);
    const S xx = x * x2, yy = y * y2, zz = z * z2, xy = x * y2, xz = x * z2, yz = y * z2;
    const S wx = w * x2, wy = w * y2, wz = w * z2;
    return {one - (yy + zz), xy - wz, xz + wy, xy + wz, one - (xx + zz), yz - wx, xz - wy, yz + wx, one - (xx + yy)};
  }
  [[gnu::always_inline]] Quaternion normalized() const {
    using std::sqrt;
    const S s = S(1.0) / sqrt(x * x + y * y + z * z + w * w);
    return {s * x, s * y, s * z, s * w};
  }

  template <class U>
  [[gnu::always_inline]] static Quaternion from(const U* p) {
    return {S(p[0]), S(p[1]), S(p[2]), S(p[3])};
  }
  [[gnu::always_inline]] static Quaternion from(const Eigen::Quaternion<S>& q) { return {q.x(), q.y(), q.z(), q.w()}; }
  template <class U>
  [[gnu::always_inline]] Quaternion<U> cast() const {
    return {U(x), U(y), U(z), U(w)};
  }
  [[gnu::always_inline]] void store(S* p) const { p[0] = x; p[1] = y; p[2] = z; p[3] = w; }
  [[gnu::always_inline]] Eigen::Quaternion<S> eigen() const { return Eigen::Quaternion<S>(w, x, y, z); }
};

template <class S, class M>
  requires(!std::is_same_v<M, bool>)
[[gnu::always_inline]] inline Quaternion<S> select(const M& mask, const Quaternion<S>& a, const Quaternion<S>& b) {
  return {select(mask, a.x, b.x), select(mask, a.y, b.y), select(mask, a.z, b.z), select(mask, a.w, b.w)};
}

template <class S>
[[gnu::always_inline]] inline S dot(const Quaternion<S>& a, const Quaternion<S>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w;
}

/// The rotation by |v| radians about v (exponential map). Smooth at zero for every scalar, dual numbers included.
template <class S>
inline Quaternion<S> exp_map(const Vector3<S>& v) {
  using std::cos;
  using std::sin;
  using std::sqrt;
  const S t2 = squared_norm(v);
  const auto small = t2 < S(1e-8);
  const S t = sqrt(select(small, S(1.0), t2));
  const S half = S(0.5) * t;
  const S s = select(small, S(0.5) - t2 * S(1.0 / 48.0), sin(half) / t);
  const S c = select(small, S(1.0) - t2 * S(0.125), cos(half));
  return {s * v.x, s * v.y, s * v.z, c};
}

/// exp_map by its series, for the small rotations of one time step: no root, no trigonometry. Relative error below 1e-9 of
/// the vector part for |v| <= 0.6 rad; the result is not renormalised.
template <class S>
[[gnu::always_inline]] inline Quaternion<S> exp_map_small(const Vector3<S>& v) {
  const S t = S(0.25) * squared_norm(v);
  const S s = S(0.5) * (S(1.0) + t * (S(-1.0 / 6) + t * (S(1.0 / 120) + t * (S(-1.0 / 5040) + t * S(1.0 / 362880)))));
  const S c = S(1.0) + t * (S(-0.5) + t * (S(1.0 / 24) + t * (S(-1.0 / 720) + t * S(1.0 / 40320))));
  return {s * v.x, s * v.y, s * v.z, c};
}

/// 2 acos(w) / sqrt(1 - w^2), the factor from a quaternion's vector part to its rotation vector, for w in [0, 1].
template <class S>
[[gnu::always_inline]] inline S log_factor(const S& w, const S& vector_norm_squared) {
  if constexpr (std::is_same_v<S, Element<S>>) {
    using std::atan2;
    using std::sqrt;
    const auto small = vector_norm_squared < S(1e-12);
    const S n = sqrt(select(small, S(1.0), vector_norm_squared));
    return select(small, S(2.0) / w, S(2.0) * atan2(n, w) / n);
  } else {
    // Chebyshev fit over u = 1 - w in [0, 1]; largest error 2e-10 before rounding. Packs have no cheap atan2.
    const S u = S(1.0) - w;
    return S(2.0) +
           u * (S(0.6666666359) +
                u * (S(0.2666683794) +
                     u * (S(0.1142485389) +
                          u * (S(0.05120994137) +
                               u * (S(0.02033686196) +
                                    u * (S(0.02220599079) +
                                         u * (S(-0.02708064306) +
                                              u * (S(0.06208829921) +
                                                   u * (S(-0.0732310332) +
                                                        u * (S(0.06014665074) +
                                                             u * (S(-0.02796543074) + u * S(0.006298462126))))))))))));
  }
}

/// The rotation vector of the shorter way round, |v| <= pi. Inverse of exp_map there.
template <class S>
[[gnu::always_inline]] inline Vector3<S> log_map(const Quaternion<S>& q) {
  const Quaternion<S> p = select(q.w < S(0.0), -q, q);
  return log_factor(p.w, squared_norm(p.vec())) * p.vec();
}

/// Rotation by `angle` radians about the unit vector `axis`.
template <class S>
[[gnu::always_inline]] inline Quaternion<S> about_axis(const Vector3<S>& axis, const S& angle) {
  using std::cos;
  using std::sin;
  const S half = S(0.5) * angle;
  const S s = sin(half);
  return {s * axis.x, s * axis.y, s * axis.z, cos(half)};
}

/// The angle in (-pi, pi] of the twist of `q` about the unit vector `axis`: what a hinge keeps of a ball joint's rotation.
template <class S>
inline S twist_angle(const Quaternion<S>& q, const Vector3<S>& axis) {
  using std::atan2;
  const S s = dot(q.vec(), axis);
  const auto flip = q.w < S(0.0);
  return S(2.0) * atan2(select(flip, -s, s), select(flip, -q.w, q.w));
}

/// Spherical interpolation the shorter way round; u = 0 gives a, u = 1 gives b (or -b).
template <class S>
inline Quaternion<S> slerp(const Quaternion<S>& a, const Quaternion<S>& b, const S& u) {
  return a * exp_map(u * log_map(a.conjugate() * b));
}

/// Rotation about +z by the heading of `q`: the direction of the rotated x axis in the horizontal plane. Where that axis is
/// vertical the heading is not defined and the result is the identity.
template <class S>
inline Quaternion<S> heading(const Quaternion<S>& q) {
  using std::atan2;
  const Vector3<S> forward = q.rotate(Vector3<S>{S(1.0), S(0.0), S(0.0)});
  const auto vertical = forward.x * forward.x + forward.y * forward.y < S(1e-12);
  const S x = select(vertical, S(1.0), forward.x), y = select(vertical, S(0.0), forward.y);
  return about_axis(Vector3<S>{S(0.0), S(0.0), S(1.0)}, S(atan2(y, x)));
}

}  // namespace traceur::core
