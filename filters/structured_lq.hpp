#pragma once

#include <algorithm>
#include <type_traits>

#include <kfstab/filters/householder.hpp>

/// The orthogonal factorisations that array filters are made of. They read and write entries X(i, j) alone, so that any
/// matrix type will do: an Eigen block, or one that throws when a forbidden triangle is touched.
namespace kfstab {

/// The pattern of the block that is annihilated.
enum class Shape {
  full,
  trapezoidal,  ///< lower for the LQ (zero above the diagonal), upper for the QR (zero below it): never touched there
};

/// LQ factorisation of the first block row of a structured matrix, applied to the second too:
///
///     [ L  A ]       [ L~  0 ]
///     [      ] Q  =  [       ]
///     [ 0  B ]       [ C   D ]
///
/// @param L  n x n. Lower triangle: in L, out L~. The strict upper triangle is never touched.
/// @param A  n x m. In A (for Shape::trapezoidal the entries on and below the diagonal alone), out the trailing parts v
///           of the reflectors, reflector i in row i.
/// @param B  r x m. In B, out D.
/// @param C  r x n. Out C; what it held is not read.
/// @param tau  n. Out the scalar factors of the reflectors.
///
/// n, m, r >= 0. Backward stable. Source: SLICOT MB04LD; theory (2.6).
template <class LType, class AType, class BType, class CType, class Tau>
void structured_lq(Shape shape, LType&& L, AType&& A, BType&& B, CType&& C, Tau&& tau) {
  using Scalar = typename std::decay_t<LType>::Scalar;
  const Index n = L.rows(), m = A.cols(), r = B.rows();
  for (Index i = 0; i < n; ++i) {
    const Index length = shape == Shape::trapezoidal ? std::min(i + 1, m) : m;
    const auto reflector =
        make_reflector(Scalar(L(i, i)), length, [&](Index j) -> decltype(auto) { return A(i, j); });
    const Scalar t = reflector.tau;
    L(i, i) = reflector.beta;

    // The rows below: w = [L A] u stands in the part of tau that is still free.
    for (Index k = i + 1; k < n; ++k) tau(k) = L(k, i);
    for (Index j = 0; j < length; ++j) {
      const Scalar v = A(i, j);
      for (Index k = i + 1; k < n; ++k) tau(k) += A(k, j) * v;
    }
    for (Index k = i + 1; k < n; ++k) {
      tau(k) *= t;
      L(k, i) -= tau(k);
    }
    for (Index j = 0; j < length; ++j) {
      const Scalar v = A(i, j);
      for (Index k = i + 1; k < n; ++k) A(k, j) -= tau(k) * v;
    }

    // The second block row: column i of C was zero, so w = B v, and C(:, i) = -tau w.
    for (Index k = 0; k < r; ++k) C(k, i) = Scalar(0);
    for (Index j = 0; j < length; ++j) {
      const Scalar v = A(i, j);
      for (Index k = 0; k < r; ++k) C(k, i) -= B(k, j) * v;
    }
    for (Index k = 0; k < r; ++k) C(k, i) *= t;
    for (Index j = 0; j < length; ++j) {
      const Scalar v = A(i, j);
      for (Index k = 0; k < r; ++k) B(k, j) += C(k, i) * v;
    }
    tau(i) = t;
  }
}

/// LQ factorisation X = [L 0] Q of an r x c matrix, r <= c. On exit the lower triangle of X holds L, the rest the
/// reflectors. tau: r. Source: LAPACK DGELQ2.
template <class XType, class Tau>
void lq(XType&& X, Tau&& tau) {
  using Scalar = typename std::decay_t<XType>::Scalar;
  const Index r = X.rows(), c = X.cols();
  for (Index i = 0; i < r; ++i) {
    const Index length = c - i - 1;
    const auto reflector =
        make_reflector(Scalar(X(i, i)), length, [&](Index j) -> decltype(auto) { return X(i, i + 1 + j); });
    const Scalar t = reflector.tau;
    X(i, i) = reflector.beta;
    for (Index k = i + 1; k < r; ++k) tau(k) = X(k, i);
    for (Index j = i + 1; j < c; ++j) {
      const Scalar v = X(i, j);
      for (Index k = i + 1; k < r; ++k) tau(k) += X(k, j) * v;
    }
    for (Index k = i + 1; k < r; ++k) {
      tau(k) *= t;
      X(k, i) -= tau(k);
    }
    for (Index j = i + 1; j < c; ++j) {
      const Scalar v = X(i, j);
      for (Index k = i + 1; k < r; ++k) X(k, j) -= tau(k) * v;
    }
    tau(i) = t;
  }
}

/// Applies the reflector (1; v) of a QR, v = V(:, j) (its first `length` entries), to one column (top; bottom):
/// what structured_qr does to its own columns, for a right-hand side.
template <class Scalar, class VType, class BottomType>
void apply_reflector(const Scalar& tau, const VType& V, Index j, Index length, Scalar& top, BottomType&& bottom) {
  Scalar w = top;
  for (Index i = 0; i < length; ++i) w += V(i, j) * bottom(i);
  w *= tau;
  top -= w;
  for (Index i = 0; i < length; ++i) bottom(i) -= w * V(i, j);
}

/// QR factorisation of the first block column of a structured matrix, applied to the second too:
///
///          [ R  0 ]     [ R~  C ]
///     Q'   [      ]  =  [       ]
///          [ A  B ]     [ 0   D ]
///
/// the mirror of structured_lq.
///
/// @param R  n x n. Upper triangle: in R, out R~. The strict lower triangle is never touched.
/// @param A  m x n. In A (for Shape::trapezoidal the entries on and above the diagonal alone), out the trailing parts v
///           of the reflectors, reflector j in column j.
/// @param B  m x c. In B, out D.
/// @param C  n x c. Out C; what it held is not read.
/// @param tau  n. Out the scalar factors of the reflectors.
///
/// n, m, c >= 0. Backward stable. Source: SLICOT MB04KD; theory (2.7).
template <class RType, class AType, class BType, class CType, class Tau>
void structured_qr(Shape shape, RType&& R, AType&& A, BType&& B, CType&& C, Tau&& tau) {
  using Scalar = typename std::decay_t<RType>::Scalar;
  const Index n = R.rows(), m = A.rows(), c = B.cols();
  for (Index j = 0; j < n; ++j) {
    const Index length = shape == Shape::trapezoidal ? std::min(j + 1, m) : m;
    const auto reflector =
        make_reflector(Scalar(R(j, j)), length, [&](Index i) -> decltype(auto) { return A(i, j); });
    const Scalar t = reflector.tau;
    R(j, j) = reflector.beta;
    tau(j) = t;
    for (Index k = j + 1; k < n; ++k) {
      Scalar w = R(j, k);
      for (Index i = 0; i < length; ++i) w += A(i, j) * A(i, k);
      w *= t;
      R(j, k) -= w;
      for (Index i = 0; i < length; ++i) A(i, k) -= w * A(i, j);
    }
    for (Index k = 0; k < c; ++k) {
      Scalar w(0);
      for (Index i = 0; i < length; ++i) w += A(i, j) * B(i, k);
      w *= t;
      C(j, k) = -w;
      for (Index i = 0; i < length; ++i) B(i, k) -= w * A(i, j);
    }
  }
}

/// QR factorisation X = Q [R; 0] of an r x c matrix, r >= c, with a right-hand side y (r) turned into Q'y. On exit the
/// upper triangle of X holds R, the rest the reflectors. Source: LAPACK DGEQR2.
template <class XType, class YType>
void qr(XType&& X, YType&& y) {
  using Scalar = typename std::decay_t<XType>::Scalar;
  const Index r = X.rows(), c = X.cols();
  for (Index j = 0; j < c; ++j) {
    const Index length = r - j - 1;
    const auto reflector =
        make_reflector(Scalar(X(j, j)), length, [&](Index i) -> decltype(auto) { return X(j + 1 + i, j); });
    const Scalar t = reflector.tau;
    X(j, j) = reflector.beta;
    for (Index k = j + 1; k < c; ++k) {
      Scalar w = X(j, k);
      for (Index i = j + 1; i < r; ++i) w += X(i, j) * X(i, k);
      w *= t;
      X(j, k) -= w;
      for (Index i = j + 1; i < r; ++i) X(i, k) -= w * X(i, j);
    }
    Scalar w = y(j);
    for (Index i = j + 1; i < r; ++i) w += X(i, j) * y(i);
    w *= t;
    y(j) -= w;
    for (Index i = j + 1; i < r; ++i) y(i) -= w * X(i, j);
  }
}

}  // namespace kfstab
