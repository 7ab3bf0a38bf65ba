#pragma once

#include <cmath>
#include <type_traits>
#include <utility>

#include <kfstab/filters/matrix.hpp>

/// Factorisations and solves for what a filter must invert: triangular roots, Re by Cholesky, Re by LU. None of them
/// allocates, at any size, and none calls a blocked kernel that would. Right-hand sides are solved from the right,
/// X M = Y, as gains want it: K Re = P C'.
namespace kfstab {

/// Which triangle holds the matrix; the other is never read.
enum class Triangle { lower, upper };

/// X L = Y or X L' = Y for a triangular L (p x p): Y (n x p) is overwritten with X. Where L has a zero on its diagonal
/// the result is not finite.
template <Triangle triangle, bool transposed, class LType, class YType>
void solve_triangular_right(const LType& L, YType& Y) {
  using Scalar = typename YType::Scalar;
  const Index p = L.rows();
  // Column j of X L = Y: sum over i of X(:, i) L(i, j); L(i, j) with i >= j for a lower L, i <= j for its transpose.
  constexpr bool from_the_end = (triangle == Triangle::lower) != transposed;
  for (Index step = 0; step < p; ++step) {
    const Index j = from_the_end ? p - 1 - step : step;
    const Index first = from_the_end ? j + 1 : 0, last = from_the_end ? p : j;
    for (Index i = first; i < last; ++i) {
      const Scalar l = transposed ? L(j, i) : L(i, j);
      for (Index r = 0; r < Y.rows(); ++r) Y(r, j) -= Y(r, i) * l;
    }
    const Scalar d = L(j, j);
    for (Index r = 0; r < Y.rows(); ++r) Y(r, j) /= d;
  }
}

/// L x = y or L' x = y for a triangular L (n x n): y is overwritten with x.
template <Triangle triangle, bool transposed, class LType, class YType>
void solve_triangular(const LType& L, YType& y) {
  using Scalar = typename YType::Scalar;
  const Index n = L.rows();
  constexpr bool from_the_end = (triangle == Triangle::upper) != transposed;
  for (Index step = 0; step < n; ++step) {
    const Index i = from_the_end ? n - 1 - step : step;
    const Index first = from_the_end ? i + 1 : 0, last = from_the_end ? n : i;
    Scalar s = y(i);
    for (Index j = first; j < last; ++j) s -= (transposed ? L(j, i) : L(i, j)) * y(j);
    y(i) = s / L(i, i);
  }
}

/// Cholesky factorisation M = V'V of a symmetric matrix, V upper, from and into its upper triangle; the strict lower
/// triangle is never touched.
/// @return 0, or the order k of the first leading minor that is not positive (columns k, k+1 ... are then unfinished).
/// Source: LAPACK DPOTF2.
template <class MType>
Index cholesky_upper(MType& M) {
  using std::sqrt;
  using Scalar = typename MType::Scalar;
  const Index n = M.rows();
  for (Index j = 0; j < n; ++j) {
    for (Index i = 0; i < j; ++i) {
      Scalar s = M(i, j);
      for (Index k = 0; k < i; ++k) s -= M(k, i) * M(k, j);
      M(i, j) = s / M(i, i);
    }
    Scalar d = M(j, j);
    for (Index k = 0; k < j; ++k) d -= M(k, j) * M(k, j);
    if (!(d > Scalar(0)) || !is_finite(d)) return j + 1;
    M(j, j) = sqrt(d);
  }
  return 0;
}

/// LU factorisation with partial pivoting of the *transpose* of a square matrix: M' = Pi' L U, stored so that X M = Y is
/// solved row by row of X. M need not be symmetric: this is how the unsymmetrised codings use Re, as computed.
/// @param M  p x p; overwritten with L and U of M'
/// @param pivots  p; row exchanges, as Scalar-free integers
/// @return whether every pivot is nonzero and finite.
template <class MType, class Pivots>
bool lu_transposed(MType& M, Pivots& pivots) {
  using std::abs;
  using Scalar = typename MType::Scalar;
  const Index p = M.rows();
  for (Index i = 0; i < p; ++i)
    for (Index j = 0; j < i; ++j) {
      const Scalar t = M(i, j);
      M(i, j) = M(j, i);
      M(j, i) = t;
    }
  bool regular = true;
  for (Index k = 0; k < p; ++k) {
    Index pivot = k;
    for (Index i = k + 1; i < p; ++i)
      if (abs(M(i, k)) > abs(M(pivot, k))) pivot = i;
    pivots(k) = static_cast<int>(pivot);
    if (pivot != k)
      for (Index j = 0; j < p; ++j) {
        const Scalar t = M(k, j);
        M(k, j) = M(pivot, j);
        M(pivot, j) = t;
      }
    if (!is_finite(Scalar(M(k, k))) || M(k, k) == Scalar(0)) {
      regular = false;
      continue;
    }
    for (Index i = k + 1; i < p; ++i) M(i, k) /= M(k, k);
    for (Index j = k + 1; j < p; ++j)
      for (Index i = k + 1; i < p; ++i) M(i, j) -= M(i, k) * M(k, j);
  }
  return regular;
}

/// X M = Y from lu_transposed(M): Y (n x p) is overwritten with X.
template <class MType, class Pivots, class YType>
void solve_lu_right(const MType& LU, const Pivots& pivots, YType&& Y) {
  using Scalar = typename std::decay_t<YType>::Scalar;
  const Index p = LU.rows();
  for (Index k = 0; k < p; ++k)
    if (pivots(k) != k)
      for (Index r = 0; r < Y.rows(); ++r) std::swap(Y(r, k), Y(r, pivots(k)));
  for (Index i = 0; i < p; ++i)
    for (Index j = 0; j < i; ++j) {
      const Scalar l = LU(i, j);
      for (Index r = 0; r < Y.rows(); ++r) Y(r, i) -= l * Y(r, j);
    }
  for (Index i = p - 1; i >= 0; --i) {
    for (Index j = i + 1; j < p; ++j) {
      const Scalar t = LU(i, j);
      for (Index r = 0; r < Y.rows(); ++r) Y(r, i) -= t * Y(r, j);
    }
    const Scalar d = LU(i, i);
    for (Index r = 0; r < Y.rows(); ++r) Y(r, i) /= d;
  }
}

/// M x = y from lu_transposed(M): y (p) is overwritten with x.
template <class MType, class Pivots, class YType>
void solve_lu(const MType& LU, const Pivots& pivots, YType& y) {
  const Index p = LU.rows();
  solve_triangular<Triangle::upper, true>(LU, y);
  for (Index i = p - 1; i >= 0; --i)
    for (Index j = i + 1; j < p; ++j) y(i) -= LU(j, i) * y(j);
  for (Index k = p - 1; k >= 0; --k)
    if (pivots(k) != k) std::swap(y(k), y(pivots(k)));
}

/// Largest column sum of absolute values; NaN if there is one among them.
template <class MType>
typename MType::Scalar one_norm(const MType& M) {
  using std::abs;
  using Scalar = typename MType::Scalar;
  Scalar norm(0);
  for (Index j = 0; j < M.cols(); ++j) {
    Scalar sum(0);
    for (Index i = 0; i < M.rows(); ++i) sum += abs(M(i, j));
    if (sum > norm || !(sum == sum)) norm = sum;
  }
  return norm;
}

/// Largest column sum of the triangle.
template <Triangle triangle, class MType>
typename MType::Scalar one_norm_triangular(const MType& M) {
  using std::abs;
  using Scalar = typename MType::Scalar;
  Scalar norm(0);
  for (Index j = 0; j < M.cols(); ++j) {
    Scalar sum(0);
    const Index first = triangle == Triangle::lower ? j : 0, last = triangle == Triangle::lower ? M.rows() : j + 1;
    for (Index i = first; i < last; ++i) sum += abs(M(i, j));
    if (sum > norm || !(sum == sum)) norm = sum;
  }
  return norm;
}

/// Largest column sum of the symmetric matrix whose upper triangle M holds.
template <class MType>
typename MType::Scalar one_norm_symmetric_upper(const MType& M) {
  using std::abs;
  using Scalar = typename MType::Scalar;
  Scalar norm(0);
  for (Index j = 0; j < M.cols(); ++j) {
    Scalar sum(0);
    for (Index i = 0; i < M.rows(); ++i) sum += i <= j ? abs(M(i, j)) : abs(M(j, i));
    if (sum > norm || !(sum == sum)) norm = sum;
  }
  return norm;
}

/// Reciprocal condition number in the 1-norm, 1 / (|M| |M^{-1}|), where |M^{-1}| is estimated from a few solves: a lower
/// bound of it, so rcond is never too small by much and seldom too large by more than a factor 3.
/// Source: Higham, FORTRAN codes for estimating the one-norm, ACM TOMS 14 (1988), as in LAPACK DLACN2.
///
/// @param norm  |M|_1
/// @param x, sign  work, n each
/// @param solve  x := M^{-1} x;  @param solve_transposed  x := M'^{-1} x
/// @return 1 for n = 0; 0 where M is singular to the point of overflow, or |M| is 0 or not finite.
template <class Scalar, class XType, class SignType, class Solve, class SolveTransposed>
Scalar reciprocal_condition(const Scalar& norm, XType& x, SignType& sign, Solve&& solve, SolveTransposed&& solve_transposed) {
  using std::abs;
  const Index n = x.size();
  if (n == 0) return Scalar(1);
  if (!(norm > Scalar(0)) || !is_finite(norm)) return Scalar(0);

  const auto sum = [&] {
    Scalar s(0);
    for (Index i = 0; i < n; ++i) s += abs(x(i));
    return s;
  };
  const auto signs = [&] {
    bool same = true;
    for (Index i = 0; i < n; ++i) {
      const Scalar s = x(i) < Scalar(0) ? Scalar(-1) : Scalar(1);
      same = same && s == sign(i);
      sign(i) = s;
    }
    return same;
  };
  const auto largest = [&] {
    Index k = 0;
    for (Index i = 1; i < n; ++i)
      if (abs(x(i)) > abs(x(k))) k = i;
    return k;
  };

  for (Index i = 0; i < n; ++i) x(i) = Scalar(1) / Scalar(static_cast<int>(n));
  solve(x);
  Scalar estimate = sum();
  if (n > 1) {
    for (Index i = 0; i < n; ++i) sign(i) = Scalar(0);
    signs();
    for (Index i = 0; i < n; ++i) x(i) = sign(i);
    solve_transposed(x);
    Index k = largest();
    for (int round = 0; round < 5; ++round) {
      for (Index i = 0; i < n; ++i) x(i) = Scalar(0);
      x(k) = Scalar(1);
      solve(x);
      const Scalar before = estimate;
      const Scalar now = sum();
      if (!(now <= estimate)) estimate = now;
      if (signs() || !(now > before)) break;
      for (Index i = 0; i < n; ++i) x(i) = sign(i);
      solve_transposed(x);
      const Index next = largest();
      if (!(abs(x(next)) > abs(x(k)))) break;
      k = next;
    }
    // The alternating vector, which the iteration can miss.
    Scalar s(1);
    for (Index i = 0; i < n; ++i) {
      x(i) = s * (Scalar(1) + Scalar(static_cast<int>(i)) / Scalar(static_cast<int>(n - 1)));
      s = -s;
    }
    solve(x);
    const Scalar alternative = Scalar(2) * sum() / Scalar(static_cast<int>(3 * n));
    if (!(alternative <= estimate)) estimate = alternative;
  }
  if (!is_finite(estimate)) return Scalar(0);
  return Scalar(1) / norm / estimate;
}

/// reciprocal_condition of a triangular matrix.
template <Triangle triangle, class LType, class XType>
typename LType::Scalar reciprocal_condition_triangular(const LType& L, XType& x, XType& sign) {
  return reciprocal_condition<typename LType::Scalar>(
      one_norm_triangular<triangle>(L), x, sign, [&](XType& b) { solve_triangular<triangle, false>(L, b); },
      [&](XType& b) { solve_triangular<triangle, true>(L, b); });
}

/// The least rcond that a matrix of order n may have and still count as regular: n^2 u. Source: the default tolerance of
/// SLICOT's FB01QD (p), FB01SD (n) and FB01VD (p).
template <class Scalar>
Scalar default_tolerance(Index n) {
  return Scalar(static_cast<int>(n * n)) * unit_roundoff<Scalar>();
}

}  // namespace kfstab
