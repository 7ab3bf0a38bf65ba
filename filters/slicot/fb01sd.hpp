#pragma once

#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/slicot/arguments.hpp>
#include <kfstab/filters/structured_lq.hpp>

namespace kfstab::slicot {

/// The end of FB01SD and FB01TD: x = T^{-1} xi over the xi in x, unless T (upper) is singular.
/// @param tolerance  least reciprocal condition number that counts as regular; <= 0 means n^2 u
/// @param work  2n
/// @return info 1 where it is singular: x still holds xi
template <class S>
Result<S> state_from_root(const View<S>& T, VectorView<S>& x, const S& tolerance, S* work) {
  const Index n = T.rows();
  if (n == 0) return {};  // whatever the tolerance
  VectorView<S> y(work, n), sign(work + n, n);
  const S rcond = reciprocal_condition_triangular<Triangle::upper>(T, y, sign);
  if (!(rcond > (tolerance > S(0) ? tolerance : default_tolerance<S>(n)))) return {1, rcond};
  solve_triangular<Triangle::upper, false>(T, x);
  return {0, rcond};
}

/// One combined step of the square-root information filter, theory (2.4), over the caller's arrays.
///
///       [ Q^{-1/2}    0         Q^{-1/2} z ]     [ Qe^{-1/2}  *   *  ]
///     U [ T A^{-1}B   T A^{-1}  T x        ]  =  [ 0          T+  xi ],    x+ = T+^{-1} xi
///       [ 0           R^{-1/2}C R^{-1/2} y ]     [ 0          0   e  ]
///
/// @param with_state  x+ is wanted, not xi
/// @param has_AB  B holds A^{-1} B    @param has_RC  C holds R^{-1/2} C, and R_inverse_root is not read
/// @param T  n x n. Upper triangle: in T, out T+. The strict lower triangle is never touched.
/// @param A_inverse, B, C  n x n, n x m, p x n    @param R_inverse_root  p x p, its upper triangle is read
/// @param Q_inverse_root  m x m. Upper triangle: in Q^{-1/2}, out Qe^{-1/2}. The strict lower one is never touched.
/// @param x  n. In x, out x+, or xi where x+ is not wanted or does not exist.
/// @param y  p. R^{-1/2} y    @param z  m. The mean of -w    @param e  p. Out the whitened residual.
/// @param tolerance  least reciprocal condition number of T+ that counts as regular; <= 0 means n^2 u
/// @param work  the larger of n (n + 2m) + 2m and (n + p) (n + 1), and no less than 2n
/// @return info 1 where T+ is singular to working precision and x+ is wanted; all else has been computed
///
/// Source: SLICOT FB01SD. Operations, without the state: 7/6 n^3 + n^2 (7m/2 + p) + n (p^2/2 + m^2).
template <class S>
Result<S> fb01sd(bool with_state, bool has_AB, bool has_RC, View<S> T, ConstView<S> A_inverse, ConstView<S> B,
                 ConstView<S> R_inverse_root, ConstView<S> C, View<S> Q_inverse_root, VectorView<S> x,
                 ConstVectorView<S> y, ConstVectorView<S> z, VectorView<S> e, const S& tolerance, S* work) {
  const Index n = A_inverse.rows(), m = B.cols(), p = C.rows(), rows = n + p;

  VectorView<S> xi(work, n);
  multiply_upper(T, x, xi);
  x = xi;

  auto TA = packed(work, n, n);
  auto TAB = packed(work + n * n, n, m);
  auto over = packed(work + n * (n + m), m, n);
  multiply_upper(T, A_inverse, TA);
  if (has_AB) {
    multiply_upper(T, B, TAB);
  } else {
    auto AB = packed(over.data(), n, m);  // what `over` will hold is of the same size, and made later
    AB.noalias() = A_inverse.lazyProduct(B);
    multiply_upper(T, AB, TAB);
  }
  VectorView<S> zeta(work + n * (n + 2 * m), m), tau(work + n * (n + 2 * m) + m, m);
  multiply_upper(Q_inverse_root, z, zeta);
  structured_qr(Shape::full, Q_inverse_root, TAB, TA, over, tau);
  for (Index j = 0; j < m; ++j) apply_reflector(S(tau(j)), TAB, j, n, zeta(j), x);

  // From here on T A^{-1} alone is needed. Its columns move apart, the last first, to let R^{-1/2} C in below them.
  auto stack = packed(work, rows, n);
  for (Index j = n - 1; j > 0; --j)
    for (Index i = n - 1; i >= 0; --i) stack(i, j) = TA(i, j);
  if (has_RC)
    stack.bottomRows(p) = C;
  else
    multiply_upper(R_inverse_root, C, stack.bottomRows(p));
  VectorView<S> right(work + rows * n, rows);
  right.head(n) = x;
  right.tail(p) = y;
  qr(stack, right);
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i <= j; ++i) T(i, j) = stack(i, j);
  x = right.head(n);
  e = right.tail(p);
  return with_state ? state_from_root(T, x, tolerance, work) : Result<S>{};
}

}  // namespace kfstab::slicot
