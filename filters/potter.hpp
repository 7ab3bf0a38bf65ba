#pragma once

#include <cmath>

#include <kfstab/filters/scalar_updates.hpp>
#include <kfstab/filters/structured_lq.hpp>

namespace kfstab {

/// Potter's update of a square root by one measurement phi' x + v, E v^2 = 1:
///
///     f = S' phi,   alpha = 1 + f'f,   k = S f / alpha,   S := S - k f' / (1 + alpha^{-1/2}),   P = S S'
///
/// @param phi  n    @param S  n x n, full; updated, and no triangle survives
/// @param f  n. Out f    @param k  n. Out the gain
/// @return alpha, the variance of the innovation. Where it is not finite, S and k are worthless.
///
/// Source: Potter 1963, in Battin, Astronautical Guidance (1964); Kaminski, Bryson, Schmidt, IEEE TAC 16 (1971).
/// Operations 3 n^2.
template <class PhiType, class SType, class WorkType>
typename SType::Scalar potter_update(const PhiType& phi, SType& S, WorkType& f, WorkType& k) {
  using std::sqrt;
  using Scalar = typename SType::Scalar;
  const Index n = S.rows();
  Scalar alpha(1);
  for (Index j = 0; j < n; ++j) {
    Scalar s(0);
    for (Index i = 0; i < n; ++i) s += S(i, j) * phi(i);
    f(j) = s;
    alpha += s * s;
  }
  for (Index i = 0; i < n; ++i) k(i) = Scalar(0);
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i < n; ++i) k(i) += S(i, j) * f(j);
  for (Index i = 0; i < n; ++i) k(i) /= alpha;
  const Scalar gamma = Scalar(1) / (Scalar(1) + Scalar(1) / Scalar(sqrt(alpha)));
  for (Index j = 0; j < n; ++j) {
    const Scalar g = gamma * f(j);
    for (Index i = 0; i < n; ++i) S(i, j) -= k(i) * g;
  }
  return alpha;
}

/// The form of PotterFilter: a root that is lower between steps and full inside of one.
struct PotterForm {
  template <class S0Type, class SType, class WType, class WorkType>
  static void start(const S0Type& S0, SType& S, WType&, WorkType&) {
    copy_lower(S0, S);
  }
  template <class PhiType, class SType, class WorkType>
  static typename SType::Scalar measure(const PhiType& phi, SType& S, WorkType& f, WorkType& k) {
    return potter_update(phi, S, f, k);
  }
  template <class SType, class WorkType>
  static void restore(SType& S, WorkType& tau) {
    lq(S, tau);
    copy_lower(S, S);
  }
  template <class AType, class SType, class OutType>
  static void multiply(const AType& A, const SType& S, OutType&& out) {
    out.noalias() = A.lazyProduct(S);
  }
  template <class WType, class SType, class WorkType>
  static void predict(WType& W, SType& S, WorkType& tau) {
    lq(W, tau);
    copy_lower(W, S);
  }
};

/// Potter's square-root covariance filter: it holds S, lower after each call, P = S S'; takes measurements in one at a
/// time by Potter's update and triangularises in the time update,
///
///     [ A S   B Q^{1/2} ] U = [ S+  0 ].
///
/// Measurements are whitened first, so R must be regular (scalar_updates.hpp, also for the gain and the statuses). As
/// stable as the square-root covariance filter where R^{1/2} is well conditioned.
///
/// Source: Potter, in Battin (1964); time update of Kaminski, Bryson, Schmidt, IEEE TAC 16 (1971) 727-736. Operations
/// 5/3 n^3 + n^2 (3p + m) + n (2p^2 + m^2/2).
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
class PotterFilter : public ScalarUpdatesFilter<PotterForm, S, N, M, P> {
 public:
  using ScalarUpdatesFilter<PotterForm, S, N, M, P>::ScalarUpdatesFilter;

  /// S, n x n, zero above the diagonal.
  const Matrix<S, N, N>& factor() const { return this->held(); }
};

}  // namespace kfstab
