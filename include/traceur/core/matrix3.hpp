// SPDX-License-Identifier: MIT
#pragma once

#include "traceur/core/vector3.hpp"

namespace traceur::core {

/// A 3x3 matrix by rows: a rotation, or the coupling block of a spatial inertia.
template <class S>
struct Matrix3 {
  S xx, xy, xz, yx, yy, yz, zx, zy, zz;

  [[gnu::always_inline]] static Matrix3 zero() {
    const S o(0.0);
    return {o, o, o, o, o, o, o, o, o};
  }
  [[gnu::always_inline]] static Matrix3 identity() {
    const S o(0.0), l(1.0);
    return {l, o, o, o, l, o, o, o, l};
  }
  /// The matrix [v]x with [v]x u = v x u.
  [[gnu::always_inline]] static Matrix3 skew(const Vector3<S>& v) {
    const S o(0.0);
    return {o, -v.z, v.y, v.z, o, -v.x, -v.y, v.x, o};
  }

  [[gnu::always_inline]] Vector3<S> row_x() const { return {xx, xy, xz}; }
  [[gnu::always_inline]] Vector3<S> row_y() const { return {yx, yy, yz}; }
  [[gnu::always_inline]] Vector3<S> row_z() const { return {zx, zy, zz}; }
  [[gnu::always_inline]] Vector3<S> column_x() const { return {xx, yx, zx}; }
  [[gnu::always_inline]] Vector3<S> column_y() const { return {xy, yy, zy}; }
  [[gnu::always_inline]] Vector3<S> column_z() const { return {xz, yz, zz}; }

  [[gnu::always_inline]] friend Matrix3 operator+(const Matrix3& a, const Matrix3& b) {
    return {a.xx + b.xx, a.xy + b.xy, a.xz + b.xz, a.yx + b.yx, a.yy + b.yy,
            a.yz + b.yz, a.zx + b.zx, a.zy + b.zy, a.zz + b.zz};
  }
  [[gnu::always_inline]] friend Matrix3 operator-(const Matrix3& a, const Matrix3& b) {
    return {a.xx - b.xx, a.xy - b.xy, a.xz - b.xz, a.yx - b.yx, a.yy - b.yy,
            a.yz - b.yz, a.zx - b.zx, a.zy - b.zy, a.zz - b.zz};
  }
  // Member by member: assigning whole packs of matrices becomes a call of memcpy.
  [[gnu::always_inline]] Matrix3& operator+=(const Matrix3& b) {
    xx += b.xx; xy += b.xy; xz += b.xz;
    yx += b.yx; yy += b.yy; yz += b.yz;
    zx += b.zx; zy += b.zy; zz += b.zz;
    return *this;
  }
  [[gnu::always_inline]] friend Vector3<S> operator*(const Matrix3& a, const Vector3<S>& v) {
    return {a.xx * v.x + a.xy * v.y + a.xz * v.z, a.yx * v.x + a.yy * v.y + a.yz * v.z,
            a.zx * v.x + a.zy * v.y + a.zz * v.z};
  }
  /// a^T v.
  [[gnu::always_inline]] friend Vector3<S> transpose_times(const Matrix3& a, const Vector3<S>& v) {
    return {a.xx * v.x + a.yx * v.y + a.zx * v.z, a.xy * v.x + a.yy * v.y + a.zy * v.z,
            a.xz * v.x + a.yz * v.y + a.zz * v.z};
  }
  [[gnu::always_inline]] friend Matrix3 operator*(const Matrix3& a, const Matrix3& b) {
    const Vector3<S> cx = a * b.column_x(), cy = a * b.column_y(), cz = a * b.column_z();
    return {cx.x, cy.x, cz.x, cx.y, cy.y, cz.y, cx.z, cy.z, cz.z};
  }
  [[gnu::always_inline]] friend Matrix3 operator*(const S& s, const Matrix3& a) {
    return {s * a.xx, s * a.xy, s * a.xz, s * a.yx, s * a.yy, s * a.yz, s * a.zx, s * a.zy, s * a.zz};
  }
  [[gnu::always_inline]] Matrix3 transpose() const { return {xx, yx, zx, xy, yy, zy, xz, yz, zz}; }

  [[gnu::always_inline]] Eigen::Matrix<S, 3, 3> eigen() const {
    Eigen::Matrix<S, 3, 3> m;
    m << xx, xy, xz, yx, yy, yz, zx, zy, zz;
    return m;
  }
};

/// A symmetric 3x3 matrix, six numbers: an inertia, a mass block, a contact's resistance.
template <class S>
struct Symmetric3 {
  S xx, yy, zz, xy, xz, yz;

  [[gnu::always_inline]] static Symmetric3 zero() {
    const S o(0.0);
    return {o, o, o, o, o, o};
  }
  [[gnu::always_inline]] static Symmetric3 scalar(const S& d) {
    const S o(0.0);
    return {d, d, d, o, o, o};
  }
  /// s v v^T.
  [[gnu::always_inline]] static Symmetric3 outer(const S& s, const Vector3<S>& v) {
    const Vector3<S> w = s * v;
    return {w.x * v.x, w.y * v.y, w.z * v.z, w.x * v.y, w.x * v.z, w.y * v.z};
  }

  [[gnu::always_inline]] friend Symmetric3 operator+(const Symmetric3& a, const Symmetric3& b) {
    return {a.xx + b.xx, a.yy + b.yy, a.zz + b.zz, a.xy + b.xy, a.xz + b.xz, a.yz + b.yz};
  }
  [[gnu::always_inline]] friend Symmetric3 operator-(const Symmetric3& a, const Symmetric3& b) {
    return {a.xx - b.xx, a.yy - b.yy, a.zz - b.zz, a.xy - b.xy, a.xz - b.xz, a.yz - b.yz};
  }
  [[gnu::always_inline]] Symmetric3& operator+=(const Symmetric3& b) {
    xx += b.xx; yy += b.yy; zz += b.zz; xy += b.xy; xz += b.xz; yz += b.yz;
    return *this;
  }
  [[gnu::always_inline]] Symmetric3& operator-=(const Symmetric3& b) {
    xx -= b.xx; yy -= b.yy; zz -= b.zz; xy -= b.xy; xz -= b.xz; yz -= b.yz;
    return *this;
  }
  [[gnu::always_inline]] friend Symmetric3 operator*(const S& s, const Symmetric3& a) {
    return {s * a.xx, s * a.yy, s * a.zz, s * a.xy, s * a.xz, s * a.yz};
  }
  [[gnu::always_inline]] friend Vector3<S> operator*(const Symmetric3& a, const Vector3<S>& v) {
    return {a.xx * v.x + a.xy * v.y + a.xz * v.z, a.xy * v.x + a.yy * v.y + a.yz * v.z,
            a.xz * v.x + a.yz * v.y + a.zz * v.z};
  }
  [[gnu::always_inline]] friend Matrix3<S> operator*(const Symmetric3& a, const Matrix3<S>& b) {
    const Vector3<S> cx = a * b.column_x(), cy = a * b.column_y(), cz = a * b.column_z();
    return {cx.x, cy.x, cz.x, cx.y, cy.y, cz.y, cx.z, cy.z, cz.z};
  }
  [[gnu::always_inline]] Matrix3<S> full() const { return {xx, xy, xz, xy, yy, yz, xz, yz, zz}; }

  /// The inverse by cofactors; the matrix must be invertible (all uses here are positive definite).
  [[gnu::always_inline]] Symmetric3 inverse() const {
    const S cxx = yy * zz - yz * yz, cxy = xz * yz - xy * zz, cxz = xy * yz - xz * yy;
    const S d = S(1.0) / (xx * cxx + xy * cxy + xz * cxz);
    return {d * cxx, d * (xx * zz - xz * xz), d * (xx * yy - xy * xy), d * cxy, d * cxz, d * (xy * xz - xx * yz)};
  }

  template <class U>
  [[gnu::always_inline]] Symmetric3<U> cast() const {
    return {U(xx), U(yy), U(zz), U(xy), U(xz), U(yz)};
  }
};

/// R A R^T: a symmetric matrix seen from another frame.
template <class S>
[[gnu::always_inline]] inline Symmetric3<S> rotated(const Symmetric3<S>& a, const Matrix3<S>& r) {
  const Vector3<S> ax = a * r.row_x(), ay = a * r.row_y(), az = a * r.row_z();
  return {dot(r.row_x(), ax), dot(r.row_y(), ay), dot(r.row_z(), az),
          dot(r.row_x(), ay), dot(r.row_x(), az), dot(r.row_y(), az)};
}

/// The symmetric part of a product known to be symmetric, reading the upper triangle.
template <class S>
[[gnu::always_inline]] inline Symmetric3<S> upper(const Matrix3<S>& a) {
  return {a.xx, a.yy, a.zz, a.xy, a.xz, a.yz};
}

}  // namespace traceur::core
