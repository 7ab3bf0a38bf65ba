#pragma once

#include <kfstab/filters/scalar_updates.hpp>

namespace kfstab {

/// Bierman's update of P = U D U' by one measurement phi' x + v, E v^2 = 1. With f = U' phi, v = D f, alpha_0 = 1 and
/// k_0 = 0, column by column,
///
///     alpha_j = alpha_{j-1} + f_j v_j,   d_j := d_j alpha_{j-1} / alpha_j,
///     u_j := u_j - f_j / alpha_{j-1} k_{j-1},   k_j = k_{j-1} + v_j u_j (the old u_j),   in the end  k = k_n / alpha_n
///
/// There is no square root and, since d_j >= 0 and alpha_j >= 1, no d_j that turns negative or is divided by: 0 is
/// allowed.
///
/// @param phi  n
/// @param UD  n x n; D on the diagonal, U's strict upper triangle above it, updated; the strict lower triangle is never
///            touched
/// @param f  n. Out f    @param k  n. Out the gain
/// @return alpha_n, the variance of the innovation. Where it is not finite, UD and k are worthless.
///
/// Source: Bierman, Factorization Methods for Discrete Sequential Estimation (1977), V.3. Operations 3/2 n^2.
template <class PhiType, class UDType, class WorkType>
typename UDType::Scalar bierman_update(const PhiType& phi, UDType& UD, WorkType& f, WorkType& k) {
  using Scalar = typename UDType::Scalar;
  const Index n = UD.rows();
  for (Index j = 0; j < n; ++j) {
    Scalar s = phi(j);
    for (Index i = 0; i < j; ++i) s += UD(i, j) * phi(i);
    f(j) = s;
  }
  Scalar alpha(1);
  for (Index j = 0; j < n; ++j) {
    const Scalar v = UD(j, j) * f(j), before = alpha;
    alpha += f(j) * v;
    UD(j, j) *= before / alpha;
    const Scalar back = f(j) / before;
    for (Index i = 0; i < j; ++i) {
      const Scalar old = UD(i, j);
      UD(i, j) -= back * k(i);
      k(i) += v * old;
    }
    k(j) = v;
  }
  for (Index i = 0; i < n; ++i) k(i) /= alpha;
  return alpha;
}

/// Thornton's modified weighted Gram-Schmidt: W D W' = U D+ U'. The rows of W are made orthogonal in the weights D from
/// the last to the first, each taken out of all those above it as soon as it is final. A row that has nothing left,
/// d_j = 0, takes nothing out: its U(:, j) is set to 0.
///
/// @param W  n x c, c >= n; overwritten with the orthogonal rows
/// @param D  c, the weights, >= 0
/// @param UD  n x n. Out D+ on the diagonal, U's strict upper triangle above it, zeros below
///
/// Backward stable: each row of W is perturbed by a modest multiple of u its weighted norm. Source: Thornton,
/// Triangular Covariance Factorizations for Kalman Filtering (1976); Bierman (1977), VI.4. Operations n^2 c.
template <class WType, class DType, class UDType>
void weighted_gram_schmidt(WType& W, const DType& D, UDType& UD) {
  using Scalar = typename UDType::Scalar;
  const Index n = W.rows(), c = W.cols();
  for (Index j = n - 1; j >= 0; --j) {
    Scalar d(0);
    for (Index i = 0; i <= j; ++i) UD(i, j) = Scalar(0);
    for (Index l = 0; l < c; ++l) {
      const Scalar weighted = D(l) * W(j, l);
      d += weighted * W(j, l);
      for (Index i = 0; i < j; ++i) UD(i, j) += W(i, l) * weighted;
    }
    UD(j, j) = d;
    for (Index i = 0; i < j; ++i) {
      if (d == Scalar(0))
        UD(i, j) = Scalar(0);
      else
        UD(i, j) /= d;
      UD(j, i) = Scalar(0);
    }
    for (Index l = 0; l < c; ++l)
      for (Index i = 0; i < j; ++i) W(i, l) -= UD(i, j) * W(j, l);
  }
}

/// The form of UdFilter.
struct UdForm {
  template <class S0Type, class UDType, class WType, class WorkType>
  static void start(const S0Type& S0, UDType& UD, WType& W, WorkType& D) {
    copy_lower(S0, W.leftCols(S0.rows()));
    W.rightCols(W.cols() - S0.rows()).setZero();
    D.setOnes();
    weighted_gram_schmidt(W, D, UD);
  }
  template <class PhiType, class UDType, class WorkType>
  static typename UDType::Scalar measure(const PhiType& phi, UDType& UD, WorkType& f, WorkType& k) {
    return bierman_update(phi, UD, f, k);
  }
  template <class UDType, class WorkType>
  static void restore(UDType&, WorkType&) {}
  /// out = A U.
  template <class AType, class UDType, class OutType>
  static void multiply(const AType& A, const UDType& UD, OutType&& out) {
    for (Index j = 0; j < UD.cols(); ++j) {
      for (Index i = 0; i < A.rows(); ++i) out(i, j) = A(i, j);
      for (Index k = 0; k < j; ++k)
        for (Index i = 0; i < A.rows(); ++i) out(i, j) += A(i, k) * UD(k, j);
    }
  }
  /// Weights: D, which UD still has, and 1 for the columns of B Q^{1/2}.
  template <class WType, class UDType, class WorkType>
  static void predict(WType& W, UDType& UD, WorkType& D) {
    using Scalar = typename UDType::Scalar;
    for (Index j = 0; j < W.cols(); ++j) D(j) = j < UD.rows() ? Scalar(UD(j, j)) : Scalar(1);
    weighted_gram_schmidt(W, D, UD);
  }
};

/// The UD filter: it holds U, unit upper triangular, and D, diagonal, P = U D U'; takes measurements in one at a time
/// by Bierman's update, and goes on by Thornton's modified weighted Gram-Schmidt,
///
///     W = [ A U   B Q^{1/2} ],    W diag(D, I) W' = U+ D+ U+'.
///
/// A square root without square roots: D holds squares, which a square-root filter would not form, so its range is half
/// of theirs, but no digit is lost by that. Measurements are whitened first, so R must be regular (scalar_updates.hpp,
/// also for the gain and the statuses). P0 and Q may be singular: they are given by their roots, and U, D of P0 are the
/// weighted Gram-Schmidt of S0.
///
/// Source: Bierman (1977); Thornton (1976). Operations 3/2 n^3 + n^2 (3p/2 + m) + n (2p^2 + m^2/2).
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
class UdFilter : public ScalarUpdatesFilter<UdForm, S, N, M, P> {
 public:
  using ScalarUpdatesFilter<UdForm, S, N, M, P>::ScalarUpdatesFilter;

  /// n x n: D on the diagonal, U's strict upper triangle above it, zeros below.
  const Matrix<S, N, N>& ud_factors() const { return this->held(); }
};

}  // namespace kfstab
