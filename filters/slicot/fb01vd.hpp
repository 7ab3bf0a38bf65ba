#pragma once

#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/slicot/arguments.hpp>

namespace kfstab::slicot {

/// out = X M, M symmetric, of which the upper triangle alone is read.
template <class XType, class MType, class OutType>
void multiply_symmetric_upper(const XType& X, const MType& M, OutType&& out) {
  using Scalar = typename MType::Scalar;
  for (Index j = 0; j < M.cols(); ++j) {
    for (Index i = 0; i < X.rows(); ++i) out(i, j) = Scalar(0);
    for (Index k = 0; k < M.cols(); ++k) {
      const Scalar s = k <= j ? M(k, j) : M(j, k);
      for (Index i = 0; i < X.rows(); ++i) out(i, j) += X(i, k) * s;
    }
  }
}

/// One combined step of the conventional filter, theory (2.1), over the caller's arrays.
///
///     Re = R + C P C' = V'V,   W = P C' V^{-1},   Kf = W V^{-T},   P+ = A (P - W W') A' + B Q B'
///
/// @param P  n x n. Upper triangle: in P, out P+; what it was where info > 0. The strict lower one is never touched.
/// @param A, B, C  n x n, n x m, p x n    @param Q  m x m, its upper triangle is read
/// @param R  p x p. Upper triangle: in R, out V where info is 0 or p + 1. The strict lower triangle is not read; where
///           info is 0 it is filled with zeros.
/// @param K  n x p. Out Kf, or P C' where info > 0.
/// @param tolerance  least reciprocal condition number of Re that counts as regular; <= 0 means p^2 u
/// @param work  the largest of 2p, n^2 and n m
/// @return info k where the leading minor of order k of Re is not positive (rcond says nothing then), p + 1 where Re is
///         singular to working precision
///
/// Source: SLICOT FB01VD. Operations 3/2 n^3 + n^2 (3p + m)/2.
template <class S>
Result<S> fb01vd(View<S> P, ConstView<S> A, ConstView<S> B, ConstView<S> C, ConstView<S> Q, View<S> R, View<S> K,
                 const S& tolerance, S* work) {
  const Index n = A.rows(), m = B.cols(), p = C.rows();
  multiply_symmetric_upper(C, P, K.transpose());
  add_product_upper(R, C, K.transpose());
  const S norm = one_norm_symmetric_upper(R);
  if (const Index minor = cholesky_upper(R); minor != 0) return {static_cast<int>(minor), S(0)};
  VectorView<S> x(work, p), sign(work + p, p);
  const auto solve = [&R](VectorView<S>& b) {
    solve_triangular<Triangle::upper, true>(R, b);
    solve_triangular<Triangle::upper, false>(R, b);
  };
  const S rcond = reciprocal_condition(norm, x, sign, solve, solve);
  if (!(rcond >= (tolerance > S(0) ? tolerance : default_tolerance<S>(p)))) return {static_cast<int>(p) + 1, rcond};
  for (Index j = 0; j < p; ++j)
    for (Index i = j + 1; i < p; ++i) R(i, j) = S(0);

  solve_triangular_right<Triangle::upper, false>(R, K);
  subtract_product_upper(P, K, K);
  solve_triangular_right<Triangle::upper, true>(R, K);

  auto AP = packed(work, n, n);
  multiply_symmetric_upper(A, P, AP);
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i <= j; ++i) P(i, j) = S(0);
  add_product_upper(P, AP, A);
  auto BQ = packed(work, n, m);
  multiply_symmetric_upper(B, Q, BQ);
  add_product_upper(P, BQ, B);
  return {0, rcond};
}

}  // namespace kfstab::slicot
