#pragma once

#include <cmath>
#include <limits>
#include <utility>

#include <kfstab/filters/structured_lq.hpp>

namespace kfstab {

/// Euclidean norm of column j of X, whose entries are at most near 1: divided by the largest before they are squared
/// where the squares would underflow.
template <class XType>
typename XType::Scalar column_norm(const XType& X, Index j) {
  using std::abs;
  using std::sqrt;
  using Scalar = typename XType::Scalar;
  static const Scalar small = sqrt(sqrt((std::numeric_limits<Scalar>::min)()));
  Scalar sum(0);
  for (Index i = 0; i < X.rows(); ++i) sum += X(i, j) * X(i, j);
  if (sum >= small) return sqrt(sum);
  Scalar largest(0);
  for (Index i = 0; i < X.rows(); ++i)
    if (abs(X(i, j)) > largest) largest = abs(X(i, j));
  if (largest == Scalar(0)) return largest;
  sum = Scalar(0);
  for (Index i = 0; i < X.rows(); ++i) {
    const Scalar x = X(i, j) / largest;
    sum += x * x;
  }
  return largest * Scalar(sqrt(sum));
}

/// Singular values and right singular vectors of a tall matrix X = W Sigma V', as F = V Sigma, by one-sided Jacobi:
///
///     X Pi = Q R  (QR with pivoting),    F := Pi R' J,   J rotations that make the columns of F orthogonal.
///
/// So X'X = F F' holds however far the rotations have come, and column j of V is that of F divided by sigma_j, where
/// sigma_j > 0; of sigma_j = 0 there is no need. R' rather than X is what is rotated: pivoting makes its columns nearly
/// orthogonal to start with, and a deficient rank leaves columns of exact zeros, or of rounding that is rotated as
/// numbers of their own right.
///
/// @param X  r x c, r >= c; destroyed
/// @param F  c x c. Out V Sigma    @param sigma  c. Out the singular values, in decreasing order
/// @param pivots  c, integers; work
/// @param most_sweeps  A sweep rotates every pair of columns with |f_i'f_j| > (2r + 12) u |f_i| |f_j|. One more follows
///         the first that finds none, and rotates down to u: V is used as if it were orthogonal
/// @return whether a sweep found no such pair. No finite matrix is known to need more than a dozen sweeps (every
///         rotation lowers the product of the columns' norms, which det R bounds from below, and convergence is
///         quadratic in the end), but nobody has proved a bound: after most_sweeps it returns false, and so it does
///         for NaN or infinity, of which F and sigma are then full.
///
/// Columns of very different sizes keep their relative accuracy: if X = B D with a diagonal D, each singular value is
/// right to about u k(B). Never overflows where the result need not; what is left of X below the smallest normal number
/// by u^2, of its largest entry, counts as 0.
///
/// Source: Hestenes 1958; Demmel, Veselic, SIAM J. Matrix Anal. Appl. 13 (1992); Drmac, Veselic, ibid. 29 (2008) and
/// LAPACK's DGEJSV. Operations r c^2 - c^3/3, and at most 7/2 c^3 a sweep.
template <class XType, class FType, class SigmaType, class Pivots>
bool singular_values(XType& X, FType& F, SigmaType& sigma, Pivots& pivots, int most_sweeps = 60) {
  using std::abs;
  using std::frexp;
  using std::ldexp;
  using std::sqrt;
  using Scalar = typename XType::Scalar;
  const Index r = X.rows(), c = X.cols();
  static const Scalar small = sqrt(sqrt((std::numeric_limits<Scalar>::min)()));
  const Scalar u = unit_roundoff<Scalar>();
  // Below this, of a largest entry near 1, numbers have no relative accuracy left to be rotated with.
  const Scalar nothing = (std::numeric_limits<Scalar>::min)() / u / u;

  // Near 1 by a power of two, which rounds nothing, before anything is squared.
  Scalar largest(0);
  for (Index j = 0; j < c; ++j)
    for (Index i = 0; i < r; ++i) {
      const Scalar a = abs(Scalar(X(i, j)));
      if (a > largest || !(a == a)) largest = a;
    }
  if (!is_finite(largest)) {
    for (Index j = 0; j < c; ++j) {
      sigma(j) = largest;
      for (Index i = 0; i < c; ++i) F(i, j) = largest;
    }
    return false;
  }
  int exponent = 0;
  frexp(largest, &exponent);
  if (exponent != 0)
    for (Index j = 0; j < c; ++j)
      for (Index i = 0; i < r; ++i) X(i, j) = ldexp(Scalar(X(i, j)), -exponent);

  for (Index j = 0; j < c; ++j) {
    // The pivot is the column with the largest entry: within sqrt(r) of the largest norm.
    Index pivot = j;
    Scalar most(0);
    for (Index k = j; k < c; ++k)
      for (Index i = j; i < r; ++i)
        if (abs(Scalar(X(i, k))) > most) {
          most = abs(Scalar(X(i, k)));
          pivot = k;
        }
    if (most < nothing) {
      for (Index k = j; k < c; ++k) {
        pivots(k) = static_cast<int>(k);
        for (Index i = j; i <= k; ++i) X(i, k) = Scalar(0);
      }
      break;
    }
    pivots(j) = static_cast<int>(pivot);
    if (pivot != j)
      for (Index i = 0; i < r; ++i) std::swap(X(i, j), X(i, pivot));
    const Index length = r - j - 1;
    const auto reflector =
        make_reflector(Scalar(X(j, j)), length, [&](Index i) -> decltype(auto) { return X(j + 1 + i, j); });
    X(j, j) = reflector.beta;
    for (Index k = j + 1; k < c; ++k) {
      Scalar w = X(j, k);
      for (Index i = j + 1; i < r; ++i) w += X(i, j) * X(i, k);
      w *= reflector.tau;
      X(j, k) -= w;
      for (Index i = j + 1; i < r; ++i) X(i, k) -= w * X(i, j);
    }
  }
  for (Index j = 0; j < c; ++j)
    for (Index i = 0; i < c; ++i) F(i, j) = i >= j ? Scalar(X(j, i)) : Scalar(0);
  for (Index j = 0; j < c; ++j) sigma(j) = column_norm(F, j);

  // r u from the inner product that says how to turn, r u from the one that tests, and at most 6 u in each column from
  // turning it: a test that asked for less could turn two columns for ever. The last sweep asks once.
  const Scalar orthogonal = Scalar(static_cast<int>(2 * r + 12)) * u;
  bool converged = false, last = false;
  for (int sweep = 0; !last && sweep <= most_sweeps; ++sweep) {
    last = converged;
    converged = true;
    for (Index p = 0; p < c; ++p)
      for (Index q = p + 1; q < c; ++q) {
        const Scalar x = sigma(p), y = sigma(q);
        if (x == Scalar(0) || y == Scalar(0)) continue;
        Scalar cosine(0);
        if (x >= small && y >= small) {
          for (Index i = 0; i < c; ++i) cosine += F(i, p) * F(i, q);
          cosine /= x * y;
        } else {
          for (Index i = 0; i < c; ++i) cosine += (F(i, p) / x) * (F(i, q) / y);
        }
        if (abs(cosine) <= (last ? u : orthogonal)) continue;
        // t = tan of the smaller angle that makes the columns orthogonal; 1 + zeta^2 is zeta^2 where it could overflow.
        const Scalar zeta = (y / x - x / y) / (Scalar(2) * cosine), size = abs(zeta);
        Scalar t = size > Scalar(1) / u ? Scalar(Scalar(1) / (Scalar(2) * size))
                                        : Scalar(Scalar(1) / (size + Scalar(sqrt(Scalar(1) + size * size))));
        if (zeta < Scalar(0)) t = -t;
        converged = last;
        if (!last && sweep == most_sweeps) break;
        const Scalar cos = Scalar(1) / Scalar(sqrt(Scalar(1) + t * t)), sin = t * cos;
        for (Index i = 0; i < c; ++i) {
          const Scalar a = F(i, p), b = F(i, q);
          F(i, p) = cos * a - sin * b;
          F(i, q) = sin * a + cos * b;
        }
        sigma(p) = column_norm(F, p);
        sigma(q) = column_norm(F, q);
      }
  }

  for (Index j = 0; j < c; ++j) {
    Index next = j;
    for (Index k = j + 1; k < c; ++k)
      if (sigma(k) > sigma(next)) next = k;
    if (next == j) continue;
    std::swap(sigma(j), sigma(next));
    for (Index i = 0; i < c; ++i) std::swap(F(i, j), F(i, next));
  }
  for (Index j = c - 1; j >= 0; --j)
    if (pivots(j) != j)
      for (Index k = 0; k < c; ++k) std::swap(F(j, k), F(pivots(j), k));
  if (exponent != 0)
    for (Index j = 0; j < c; ++j) {
      sigma(j) = ldexp(Scalar(sigma(j)), exponent);
      for (Index i = 0; i < c; ++i) F(i, j) = ldexp(Scalar(F(i, j)), exponent);
    }
  return converged;
}

}  // namespace kfstab
