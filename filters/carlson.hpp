#pragma once

#include <cmath>

#include <kfstab/filters/scalar_updates.hpp>
#include <kfstab/filters/structured_lq.hpp>

namespace kfstab {

/// Carlson's update of a triangular root by one measurement phi' x + v, E v^2 = 1, here for a lower one: with
/// f = S' phi, alpha_{n+1} = 1 and e_{n+1} = 0, column by column from the last to the first,
///
///     alpha_i = alpha_{i+1} + f_i^2,   e_i = e_{i+1} + f_i s_i,
///     s_i := (s_i - f_i / alpha_{i+1} e_{i+1}) (alpha_{i+1} / alpha_i)^{1/2},           in the end  k = e_1 / alpha_1
///
/// Column i of S and e_{i+1} are zero above row i: so S stays lower. (Carlson's own root is upper, and he goes from the
/// first column to the last.) Nothing is subtracted but in the columns themselves.
///
/// @param phi  n    @param S  n x n; the lower triangle is updated, the strict upper one never touched
/// @param f  n. Out f    @param k  n. Out the gain
/// @return alpha_1, the variance of the innovation. Where it is not finite, S and k are worthless.
///
/// Source: Carlson, Fast triangular formulation of the square root filter, AIAA Journal 11 (1973) 1259-1265.
/// Operations 2 n^2.
template <class PhiType, class SType, class WorkType>
typename SType::Scalar carlson_update(const PhiType& phi, SType& S, WorkType& f, WorkType& k) {
  using std::sqrt;
  using Scalar = typename SType::Scalar;
  const Index n = S.rows();
  Scalar alpha(1);
  for (Index i = n - 1; i >= 0; --i) {
    Scalar s(0);
    for (Index r = i; r < n; ++r) s += S(r, i) * phi(r);
    f(i) = s;
    const Scalar before = alpha;
    alpha += s * s;
    const Scalar shrink = sqrt(Scalar(before / alpha)), back = shrink * (s / before);
    k(i) = Scalar(0);
    for (Index r = i; r < n; ++r) {
      const Scalar old = S(r, i);
      S(r, i) = shrink * old - back * k(r);
      k(r) += s * old;
    }
  }
  for (Index r = 0; r < n; ++r) k(r) /= alpha;
  return alpha;
}

/// The form of CarlsonFilter: a root that stays lower.
struct CarlsonForm {
  template <class S0Type, class SType, class WType, class WorkType>
  static void start(const S0Type& S0, SType& S, WType&, WorkType&) {
    copy_lower(S0, S);
  }
  template <class PhiType, class SType, class WorkType>
  static typename SType::Scalar measure(const PhiType& phi, SType& S, WorkType& f, WorkType& k) {
    return carlson_update(phi, S, f, k);
  }
  template <class SType, class WorkType>
  static void restore(SType&, WorkType&) {}
  template <class AType, class SType, class OutType>
  static void multiply(const AType& A, const SType& S, OutType&& out) {
    multiply_lower(A, S, out);
  }
  template <class WType, class SType, class WorkType>
  static void predict(WType& W, SType& S, WorkType& tau) {
    lq(W, tau);
    copy_lower(W, S);
  }
};

/// Carlson's square-root covariance filter: it holds S, lower, P = S S', takes measurements in one at a time by
/// Carlson's update, which keeps S lower, and triangularises in the time update,
///
///     [ A S   B Q^{1/2} ] U = [ S+  0 ].
///
/// Measurements are whitened first, so R must be regular (scalar_updates.hpp, also for the gain and the statuses). As
/// stable as the square-root covariance filter where R^{1/2} is well conditioned, and cheaper in the measurements.
///
/// Source: Carlson, AIAA Journal 11 (1973) 1259-1265. Operations 7/6 n^3 + n^2 (2p + m) + n (2p^2 + m^2/2).
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
class CarlsonFilter : public ScalarUpdatesFilter<CarlsonForm, S, N, M, P> {
 public:
  using ScalarUpdatesFilter<CarlsonForm, S, N, M, P>::ScalarUpdatesFilter;

  /// S, n x n, zero above the diagonal.
  const Matrix<S, N, N>& factor() const { return this->held(); }
};

}  // namespace kfstab
