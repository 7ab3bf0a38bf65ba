#pragma once

#include <algorithm>

#include <kfstab/filters/condensed.hpp>
#include <kfstab/filters/slicot/fb01qd.hpp>

namespace kfstab::slicot {

/// fb01qd for (A, C) in lower observer-Hessenberg form, C(i, j) = 0 for j > i and A(i, j) = 0 for j > i + p: these
/// entries are not read. The columns stand in another order, in which the zeros last:
///
///     [ R^{1/2}  0          C S_ ]       [ Re^{1/2}  0   0 ]
///     [                          ] U  =  [                 ]
///     [ 0        B Q^{1/2}  A S_ ]       [ G         S+  0 ]
///
/// @param work  n (n + max(m + 1, p)) + p, and no less than 2p
///
/// All else as fb01qd. Source: SLICOT FB01RD. Operations, without the gain and B Q^{1/2}:
/// 1/6 n^3 + n^2 (3p/2 + m) + n p^2.
template <class S>
Result<S> fb01rd(bool with_gain, bool has_product, View<S> S_, ConstView<S> A, ConstView<S> B, ConstView<S> Q_root,
                 ConstView<S> C, View<S> R_root, View<S> K, const S& tolerance, S* work) {
  const Index n = A.rows(), m = B.cols(), p = C.rows();
  auto AS = packed(work, n, n);
  auto CS = packed(work + n * n, p, n);
  multiply_hessenberg_lower(p, A, S_, AS);
  multiply_hessenberg_lower(0, C, S_, CS);
  structured_lq(Shape::trapezoidal, R_root, CS, AS, K, VectorView<S>(work + n * (n + p), p));

  std::copy_backward(work, work + n * n, work + n * (m + n));
  auto BQ_AS = packed(work, n, m + n);
  auto BQ = BQ_AS.leftCols(m);
  if (has_product)
    BQ = B;
  else
    multiply_lower(B, Q_root, BQ);
  hessenberg_lq(m + p, BQ_AS, VectorView<S>(work + n * (m + n), n));
  for (Index j = 0; j < n; ++j)
    for (Index i = j; i < n; ++i) S_(i, j) = BQ_AS(i, j);
  return with_gain ? gain_from_root(R_root, K, tolerance, work) : Result<S>{};
}

}  // namespace kfstab::slicot
