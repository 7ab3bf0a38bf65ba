#pragma once

#include <algorithm>
#include <type_traits>

#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/structured_lq.hpp>

/// Condensed forms of a time-invariant system, and the arrays that keep them: a state-space transformation, done once,
/// puts zeros into A and C (or A and B) that every later step leaves alone, for 1/6 n^3 operations a step where the
/// dense arrays take 7/6 n^3. As structured_lq.hpp, all of it reads and writes entries X(i, j) alone, never one outside
/// the pattern, and allocates nothing.
namespace kfstab {

/// Controller-Hessenberg form of the pair (A, B): A := U'AU, B := U'B for an orthogonal U, with zeros
///
///     upper:  B(i, j), i > j          and  A(i, j), i > j + m
///     lower:  B(i, j), j > i + m - n  and  A(i, j), j > i + m
///
/// so that [B A], or [A B], is trapezoidal. Where m >= n, A is full and B alone has zeros; where m = 0 there is nothing
/// to start from, and A stays what it is. Unique up to the signs of the columns of U if (A, B) is controllable.
///
/// @param A  n x n
/// @param B  n x m. The entries that are annihilated, here and in A, are exact zeros.
/// @param X  any number of rows, n columns. X := X U. So the identity becomes U, a change of coordinates goes on, and a
///           matrix without rows, or none at all, asks for nothing.
///
/// n, m >= 0. Backward stable. Source: SLICOT TB01MD; Van Dooren, Verhaegen, Contemporary Mathematics 47 (1985).
template <class AType, class BType, class XType>
void controller_hessenberg(Triangle triangle, AType&& A, BType&& B, XType&& X);

/// Observer-Hessenberg form of the pair (A, C): A := U'AU, C := C U for an orthogonal U, with zeros
///
///     lower:  C(i, j), j > i          and  A(i, j), j > i + p
///     upper:  C(i, j), i > j + p - n  and  A(i, j), i > j + p
///
/// the mirror of controller_hessenberg: that of (A', C'), transposed.
///
/// @param A  n x n    @param C  p x n    @param X  any number of rows, n columns: X := X U.
///
/// n, p >= 0. Backward stable. Source: SLICOT TB01ND.
template <class AType, class CType, class XType>
void observer_hessenberg(Triangle triangle, AType&& A, CType&& C, XType&& X);

/// The four forms are one: the upper controller form of [b a], b n x m, a n x n, x `rows` x n, where b(i, j) ... is
/// that entry of B or C, seen transposed, or from the last row and column backwards.
template <class Scalar, class BEntry, class AEntry, class XEntry>
void reduce_to_hessenberg(Index n, Index m, Index rows, BEntry&& b, AEntry&& a, XEntry&& x) {
  if (m == 0) return;
  const auto entry = [&](Index i, Index j) -> Scalar& { return j < m ? b(i, j) : a(i, j - m); };
  // Reflector k acts on rows k ... n-1, then on these columns of a, which are right of column k of [b a]: that column
  // is finished, and holds the reflector meanwhile.
  for (Index k = 0; k + 1 < n; ++k) {
    const Index length = n - k - 1;
    const auto v = [&](Index i) -> Scalar& { return entry(k + 1 + i, k); };
    const auto reflector = make_reflector(Scalar(entry(k, k)), length, v);
    const auto apply = [&](Scalar& head, auto&& rest) {
      Scalar w = head;
      for (Index i = 0; i < length; ++i) w += v(i) * rest(i);
      w *= reflector.tau;
      head -= w;
      for (Index i = 0; i < length; ++i) rest(i) -= w * v(i);
    };
    if (reflector.tau != Scalar(0)) {
      for (Index j = k + 1; j < m + n; ++j) apply(entry(k, j), [&](Index i) -> Scalar& { return entry(k + 1 + i, j); });
      for (Index r = 0; r < n; ++r) apply(a(r, k), [&](Index i) -> Scalar& { return a(r, k + 1 + i); });
      for (Index r = 0; r < rows; ++r) apply(x(r, k), [&](Index i) -> Scalar& { return x(r, k + 1 + i); });
    }
    entry(k, k) = reflector.beta;
    for (Index i = 0; i < length; ++i) v(i) = Scalar(0);
  }
}

template <class AType, class BType, class XType>
void controller_hessenberg(Triangle triangle, AType&& A, BType&& B, XType&& X) {
  using Scalar = typename std::decay_t<AType>::Scalar;
  const Index n = B.rows(), m = B.cols();
  const bool upper = triangle == Triangle::upper;
  const auto at = [&](Index i, Index size) { return upper ? i : size - 1 - i; };
  reduce_to_hessenberg<Scalar>(
      n, m, X.rows(), [&](Index i, Index j) -> Scalar& { return B(at(i, n), at(j, m)); },
      [&](Index i, Index j) -> Scalar& { return A(at(i, n), at(j, n)); },
      [&](Index i, Index j) -> Scalar& { return X(i, at(j, n)); });
}

template <class AType, class CType, class XType>
void observer_hessenberg(Triangle triangle, AType&& A, CType&& C, XType&& X) {
  using Scalar = typename std::decay_t<AType>::Scalar;
  const Index n = C.cols(), p = C.rows();
  const bool lower = triangle == Triangle::lower;
  const auto at = [&](Index i, Index size) { return lower ? i : size - 1 - i; };
  reduce_to_hessenberg<Scalar>(
      n, p, X.rows(), [&](Index i, Index j) -> Scalar& { return C(at(j, p), at(i, n)); },
      [&](Index i, Index j) -> Scalar& { return A(at(j, n), at(i, n)); },
      [&](Index i, Index j) -> Scalar& { return X(i, at(j, n)); });
}

template <class AType, class BType>
void controller_hessenberg(Triangle triangle, AType&& A, BType&& B) {
  using Scalar = typename std::decay_t<AType>::Scalar;
  controller_hessenberg(triangle, A, B, Matrix<Scalar, 0, Dynamic>(0, B.rows()));
}

template <class AType, class CType>
void observer_hessenberg(Triangle triangle, AType&& A, CType&& C) {
  using Scalar = typename std::decay_t<AType>::Scalar;
  observer_hessenberg(triangle, A, C, Matrix<Scalar, 0, Dynamic>(0, C.cols()));
}

/// out = X L, L (n x n) lower triangular, X (r x n) with X(i, j) = 0 for j > i + band; so is out. Neither the zeros of
/// X and L nor those of out are touched. multiply_lower is the case band >= n.
/// Of (A, C) in lower observer-Hessenberg form A has band p and C band 0. Operations 1/6 n^3 + n^2 p/2 for A S, C S.
template <class XType, class LType, class OutType>
void multiply_hessenberg_lower(Index band, const XType& X, const LType& L, OutType&& out) {
  const Index n = L.rows(), r = X.rows();
  const auto first = [&](Index k) { return std::max<Index>(0, k - band); };
  for (Index j = 0; j < n; ++j) {
    for (Index i = first(j); i < r; ++i) out(i, j) = X(i, j) * L(j, j);
    for (Index k = j + 1; k < n; ++k) {
      const auto l = L(k, j);
      for (Index i = first(k); i < r; ++i) out(i, j) += X(i, k) * l;
    }
  }
}

/// out = U X, U (n x n) upper triangular, X (n x c) with X(i, j) = 0 for i > j + band; so is out. Neither the zeros of
/// U and X nor those of out are touched. multiply_upper is the case band >= n.
/// Of (A, B) in upper controller-Hessenberg form A has band m and B band 0. Operations 1/6 n^3 + n^2 m/2 for T A, T B.
template <class UType, class XType, class OutType>
void multiply_upper_hessenberg(Index band, const UType& U, const XType& X, OutType&& out) {
  const Index n = U.rows();
  for (Index j = 0; j < X.cols(); ++j) {
    const Index end = std::min(j + band + 1, n);
    for (Index i = 0; i < end; ++i) out(i, j) = U(i, i) * X(i, j);
    for (Index k = 1; k < end; ++k) {
      const auto x = X(k, j);
      for (Index i = 0; i < k; ++i) out(i, j) += U(i, k) * x;
    }
  }
}

/// LQ factorisation X = [L 0] Q of an r x c matrix, r <= c, with X(i, j) = 0 for j > i + width: these entries stay zero
/// and are never touched. lq is the case width >= c - 1.
///
/// With X = [B Q^{1/2}  A S], c = m + n, width m + p, it is the second half of the covariance array in lower
/// observer-Hessenberg form (the first is structured_lq with Shape::trapezoidal), n^2 (m + p) operations.
///
/// @param X  On exit the lower triangle holds L, the rest of the pattern the reflectors.
/// @param tau  r. Out the scalar factors of the reflectors.
///
/// Source: SLICOT FB01RD, METHOD; theory (2.8).
template <class XType, class Tau>
void hessenberg_lq(Index width, XType&& X, Tau&& tau) {
  using Scalar = typename std::decay_t<XType>::Scalar;
  const Index r = X.rows(), c = X.cols();
  for (Index i = 0; i < r; ++i) {
    const Index end = std::min(i + width + 1, c);
    const auto reflector =
        make_reflector(Scalar(X(i, i)), end - i - 1, [&](Index j) -> decltype(auto) { return X(i, i + 1 + j); });
    const Scalar t = reflector.tau;
    X(i, i) = reflector.beta;
    for (Index k = i + 1; k < r; ++k) tau(k) = X(k, i);
    for (Index j = i + 1; j < end; ++j) {
      const Scalar v = X(i, j);
      for (Index k = i + 1; k < r; ++k) tau(k) += X(k, j) * v;
    }
    for (Index k = i + 1; k < r; ++k) {
      tau(k) *= t;
      X(k, i) -= tau(k);
    }
    for (Index j = i + 1; j < end; ++j) {
      const Scalar v = X(i, j);
      for (Index k = i + 1; k < r; ++k) X(k, j) -= tau(k) * v;
    }
    tau(i) = t;
  }
}

/// QR factorisation X = Q [R; 0] of an r x c matrix, r >= c, with X(i, j) = 0 for i > j + width: these entries stay
/// zero and are never touched; with a right-hand side y (r) turned into Q'y. qr is the case width >= r - 1.
///
/// With X = [R^{-1/2}C; T A^{-1}], r = p + n, width p + m, it is the second half of the information array in upper
/// controller-Hessenberg form (the first is structured_qr with Shape::trapezoidal), n^2 (m + p) operations.
///
/// @param X  On exit the upper triangle holds R, the rest of the pattern the reflectors.
///
/// Source: SLICOT FB01TD, METHOD; theory (2.9).
template <class XType, class YType>
void hessenberg_qr(Index width, XType&& X, YType&& y) {
  using Scalar = typename std::decay_t<XType>::Scalar;
  const Index r = X.rows(), c = X.cols();
  for (Index j = 0; j < c; ++j) {
    const Index length = std::min(width, r - j - 1);
    const auto v = [&](Index i) -> decltype(auto) { return X(j + 1 + i, j); };
    const auto reflector = make_reflector(Scalar(X(j, j)), length, v);
    X(j, j) = reflector.beta;
    const auto apply = [&](auto&& column) {
      Scalar w = column(0);
      for (Index i = 0; i < length; ++i) w += v(i) * column(1 + i);
      w *= reflector.tau;
      column(0) -= w;
      for (Index i = 0; i < length; ++i) column(1 + i) -= w * v(i);
    };
    for (Index k = j + 1; k < c; ++k) apply([&](Index i) -> decltype(auto) { return X(j + i, k); });
    apply([&](Index i) -> decltype(auto) { return y(j + i); });
  }
}

}  // namespace kfstab
