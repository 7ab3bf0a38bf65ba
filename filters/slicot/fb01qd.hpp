#pragma once

#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/slicot/arguments.hpp>
#include <kfstab/filters/structured_lq.hpp>

namespace kfstab::slicot {

/// The end of FB01QD and FB01RD: K = G Re^{-1/2} over the G in K, unless Re^{1/2} (lower) is singular.
/// @param tolerance  least reciprocal condition number that counts as regular; <= 0 means p^2 u
/// @param work  2p
/// @return info 1 where it is singular: K still holds G
template <class S>
Result<S> gain_from_root(const View<S>& Re_root, View<S>& K, const S& tolerance, S* work) {
  const Index p = Re_root.rows();
  if (p == 0) return {};  // whatever the tolerance
  VectorView<S> x(work, p), sign(work + p, p);
  const S rcond = reciprocal_condition_triangular<Triangle::lower>(Re_root, x, sign);
  if (!(rcond > (tolerance > S(0) ? tolerance : default_tolerance<S>(p)))) return {1, rcond};
  solve_triangular_right<Triangle::lower, false>(Re_root, K);
  return {0, rcond};
}

/// One combined step of the square-root covariance filter, theory (2.3), over the caller's arrays.
///
///     [ R^{1/2}  C S_  0         ]       [ Re^{1/2}  0   0 ]
///     [                          ] U  =  [                 ],    K = G Re^{-1/2}
///     [ 0        A S_  B Q^{1/2} ]       [ G         S+  0 ]
///
/// @param with_gain  K is wanted, not G
/// @param has_product  B holds B Q^{1/2}, and Q_root is not read
/// @param S_  n x n. Lower triangle: in S, out S+. The strict upper triangle is never touched.
/// @param A, B, C  n x n, n x m, p x n    @param Q_root  m x m, its lower triangle is read
/// @param R_root  p x p. Lower triangle: in R^{1/2}, out Re^{1/2}. The strict upper triangle is never touched.
/// @param K  n x p. Out K, or G = A P C' Re^{-T/2} where K is not wanted or does not exist.
/// @param tolerance  least reciprocal condition number of Re^{1/2} that counts as regular; <= 0 means p^2 u
/// @param work  n (n + max(m + 1, p)) + p, and no less than 2p
/// @return info 1 where Re^{1/2} is singular to working precision and K is wanted; all else has been computed
///
/// Source: SLICOT FB01QD. Operations, without the gain: 7/6 n^3 + n^2 (5p/2 + m) + n (p^2 + m^2/2).
template <class S>
Result<S> fb01qd(bool with_gain, bool has_product, View<S> S_, ConstView<S> A, ConstView<S> B, ConstView<S> Q_root,
                 ConstView<S> C, View<S> R_root, View<S> K, const S& tolerance, S* work) {
  const Index n = A.rows(), m = B.cols(), p = C.rows();
  auto AS_BQ = packed(work, n, n + m);
  auto AS = AS_BQ.leftCols(n);
  auto BQ = AS_BQ.rightCols(m);
  auto CS = packed(work + n * n, p, n);  // in the place of BQ, which is formed when this is done with
  multiply_lower(A, S_, AS);
  multiply_lower(C, S_, CS);
  structured_lq(Shape::full, R_root, CS, AS, K, VectorView<S>(work + n * (n + p), p));
  if (has_product)
    BQ = B;
  else
    multiply_lower(B, Q_root, BQ);
  lq(AS_BQ, VectorView<S>(work + n * (n + m), n));
  for (Index j = 0; j < n; ++j)
    for (Index i = j; i < n; ++i) S_(i, j) = AS(i, j);
  return with_gain ? gain_from_root(R_root, K, tolerance, work) : Result<S>{};
}

}  // namespace kfstab::slicot
