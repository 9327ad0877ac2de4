// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include "traceur/core/scalar.hpp"

namespace traceur::core {

/// Three numbers: a point, a direction, a velocity, a force. Small enough that compilers keep it in registers for every
/// scalar, packs included, where an Eigen vector of packs needs inlining limits raised. Eigen stays at public boundaries.
template <class S>
struct Vector3 {
  S x, y, z;

  [[gnu::always_inline]] static Vector3 zero() { return {S(0.0), S(0.0), S(0.0)}; }

  [[gnu::always_inline]] Vector3& operator+=(const Vector3& o) { x += o.x; y += o.y; z += o.z; return *this; }
  [[gnu::always_inline]] Vector3& operator-=(const Vector3& o) { x -= o.x; y -= o.y; z -= o.z; return *this; }
  [[gnu::always_inline]] Vector3& operator*=(const S& s) { x *= s; y *= s; z *= s; return *this; }

  [[gnu::always_inline]] friend Vector3 operator+(const Vector3& a, const Vector3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  [[gnu::always_inline]] friend Vector3 operator-(const Vector3& a, const Vector3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  [[gnu::always_inline]] friend Vector3 operator-(const Vector3& a) { return {-a.x, -a.y, -a.z}; }
  [[gnu::always_inline]] friend Vector3 operator*(const S& s, const Vector3& a) { return {s * a.x, s * a.y, s * a.z}; }
  [[gnu::always_inline]] friend Vector3 operator*(const Vector3& a, const S& s) { return {a.x * s, a.y * s, a.z * s}; }

  [[gnu::always_inline]] friend S dot(const Vector3& a, const Vector3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
  [[gnu::always_inline]] friend Vector3 cross(const Vector3& a, const Vector3& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
  }
  [[gnu::always_inline]] friend S squared_norm(const Vector3& a) { return dot(a, a); }
  [[gnu::always_inline]] friend S norm(const Vector3& a) {
    using std::sqrt;
    return sqrt(dot(a, a));
  }

  /// Reads three numbers of any type that converts to the scalar.
  template <class U>
  [[gnu::always_inline]] static Vector3 from(const U* p) {
    return {S(p[0]), S(p[1]), S(p[2])};
  }
  template <class Derived>
  [[gnu::always_inline]] static Vector3 from(const Eigen::MatrixBase<Derived>& m) {
    return {S(m[0]), S(m[1]), S(m[2])};
  }
  /// The same vector in another scalar type.
  template <class U>
  [[gnu::always_inline]] Vector3<U> cast() const {
    return {U(x), U(y), U(z)};
  }
  [[gnu::always_inline]] void store(S* p) const { p[0] = x; p[1] = y; p[2] = z; }
  [[gnu::always_inline]] Eigen::Matrix<S, 3, 1> eigen() const { return Eigen::Matrix<S, 3, 1>(x, y, z); }
};

template <class S, class M>
  requires(!std::is_same_v<M, bool>)
[[gnu::always_inline]] inline Vector3<S> select(const M& mask, const Vector3<S>& a, const Vector3<S>& b) {
  return {select(mask, a.x, b.x), select(mask, a.y, b.y), select(mask, a.z, b.z)};
}

}  // namespace traceur::core
