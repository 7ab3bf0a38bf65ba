#pragma once

#include <algorithm>

#include <kfstab/filters/condensed.hpp>
#include <kfstab/filters/slicot/fb01sd.hpp>

namespace kfstab::slicot {

/// fb01sd for (A^{-1}, A^{-1}B) in upper controller-Hessenberg form, A^{-1}B(i, j) = 0 for i > j and A^{-1}(i, j) = 0
/// for i > j + m: these entries are not read. The rows stand in another order, in which the zeros last:
///
///       [ Q^{-1/2}    0         Q^{-1/2} z ]     [ Qe^{-1/2}  *   *  ]
///     U [ 0           R^{-1/2}C R^{-1/2} y ]  =  [ 0          T+  xi ],    x+ = T+^{-1} xi
///       [ T A^{-1}B   T A^{-1}  T x        ]     [ 0          0   e  ]
///
/// All else as fb01sd. Source: SLICOT FB01TD. Operations, without the state and R^{-1/2}C:
/// 1/6 n^3 + n^2 (3m/2 + p) + n m^2.
template <class S>
Result<S> fb01td(bool with_state, bool has_RC, View<S> T, ConstView<S> A_inverse, ConstView<S> A_inverse_B,
                 ConstView<S> R_inverse_root, ConstView<S> C, View<S> Q_inverse_root, VectorView<S> x,
                 ConstVectorView<S> y, ConstVectorView<S> z, VectorView<S> e, const S& tolerance, S* work) {
  const Index n = A_inverse.rows(), m = A_inverse_B.cols(), p = C.rows(), rows = p + n;

  VectorView<S> xi(work, n);
  multiply_upper(T, x, xi);
  x = xi;

  auto TA = packed(work, n, n);
  auto TAB = packed(work + n * n, n, m);
  auto over = packed(work + n * (n + m), m, n);
  VectorView<S> zeta(work + n * (n + 2 * m), m), tau(work + n * (n + 2 * m) + m, m);
  multiply_upper_hessenberg(m, T, A_inverse, TA);
  multiply_upper_hessenberg(0, T, A_inverse_B, TAB);
  multiply_upper(Q_inverse_root, z, zeta);
  structured_qr(Shape::trapezoidal, Q_inverse_root, TAB, TA, over, tau);
  for (Index j = 0; j < m; ++j) apply_reflector(S(tau(j)), TAB, j, std::min(j + 1, n), zeta(j), x);

  // From here on T A^{-1} alone is needed. Its columns move apart, the last first, to let R^{-1/2} C in above them.
  auto stack = packed(work, rows, n);
  for (Index j = n - 1; j >= 0; --j)
    for (Index i = std::min(j + m, n - 1); i >= 0; --i) stack(p + i, j) = TA(i, j);
  if (has_RC)
    stack.topRows(p) = C;
  else
    multiply_upper(R_inverse_root, C, stack.topRows(p));
  VectorView<S> right(work + rows * n, rows);
  right.head(p) = y;
  right.tail(n) = x;
  hessenberg_qr(p + m, stack, right);
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i <= j; ++i) T(i, j) = stack(i, j);
  x = right.head(n);
  e = right.tail(p);
  return with_state ? state_from_root(T, x, tolerance, work) : Result<S>{};
}

}  // namespace kfstab::slicot
