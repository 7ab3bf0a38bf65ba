#include <kfstab/reference/steady_state.hpp>

#include <algorithm>

#include <kfstab/reference/detail/check.hpp>
#include <kfstab/reference/detail/numbers.hpp>

namespace kfstab::reference {
namespace {

using detail::product;
using detail::symmetric_product;
using detail::transposed;

template <class T>
struct Solution {
  Matrix<T> P, K, F;
  T residual;
};

template <class T>
void add(Matrix<T>& X, const Matrix<T>& Y) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) X(i, j) += Y(i, j);
}

template <class T>
void subtract(Matrix<T>& X, const Matrix<T>& Y) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) X(i, j) -= Y(i, j);
}

/// Doubling (Anderson 1978; Chu, Fan, Lin, Wang 2004) for X = A X (I + G X)^{-1} A' + H, here with
/// G = C' R^{-1} C, H = B Q B': after j steps H is the Riccati iterate 2^j of the start 0.
template <class T>
Solution<T> double_up(const AnyProblem<double>& problem, int digits) {
  const detail::Numbers<T> m = detail::read<T>(problem, 0);
  const Index n = m.A.rows();
  Matrix<T> L;
  if (!detail::cholesky(m.R, L).done) throw ReferenceError("steady state: R is not positive definite");
  const Matrix<T> RC = product(detail::lower_inverse(L), m.C);

  Matrix<T> A = transposed(m.A);
  Matrix<T> G = symmetric_product(transposed(RC), transposed(RC));
  Matrix<T> H = m.BQB;
  const T tolerance = detail::power_of_ten<T>(10 - digits);
  bool converged = n == 0;
  // 2^64 steps: rho(F) up to 1 - 1e-17
  for (int step = 0; step < 64 && !converged; ++step) {
    Matrix<T> W = product(G, H);
    add(W, detail::identity<T>(n));
    Matrix<T> W_inverse;
    if (!detail::invert(W, W_inverse)) break;
    const Matrix<T> WA = product(W_inverse, A);
    // A' H (I + G H)^{-1} A and A (I + G H)^{-1} G A', both symmetric
    const Matrix<T> increment = symmetric_product(product(transposed(A), H), transposed(WA));
    const Matrix<T> WG = product(W_inverse, G);
    detail::add_symmetric_product(G, product(A, WG), A);
    A = product(A, WA);
    add(H, increment);
    const T change = detail::frobenius(increment), size = detail::frobenius(H);
    if (!is_finite(change)) break;
    converged = change <= T(tolerance * size);
  }
  if (!converged) throw ReferenceError("steady state: the doubling does not converge");

  Solution<T> s;
  s.P = H;
  const Matrix<T> PC = detail::product_transposed(s.P, m.C);
  Matrix<T> Re = m.R;
  detail::add_symmetric_product(Re, m.C, transposed(PC));
  if (!detail::cholesky(Re, L).done) throw ReferenceError("steady state: Re is not positive definite");
  s.K = product(product(m.A, PC), detail::inverse_from_root_inverse(detail::lower_inverse(L)));
  s.F = m.A;
  subtract(s.F, product(s.K, m.C));
  Matrix<T> difference = detail::congruence(s.F, s.P);
  detail::add_symmetric_product(difference, product(s.K, m.R), s.K);
  add(difference, m.BQB);
  subtract(difference, s.P);
  const T size = detail::frobenius(s.P);
  s.residual = size == 0 ? T(0) : T(detail::frobenius(difference) / size);
  return s;
}

template <class T>
struct Sum {
  Matrix<T> P;
  T residual;
};

/// P := A P A' + P, A := A^2 (Smith 1968).
template <class T>
Sum<T> square_up(const AnyProblem<double>& problem, int digits) {
  const detail::Numbers<T> m = detail::read<T>(problem, 0);
  Matrix<T> A = m.A, P = m.BQB;
  const T tolerance = detail::power_of_ten<T>(-digits);
  // rho(A) < 1 for doubles, so at most some 2^60 terms before they are below any precision here
  for (int step = 0; step < 70; ++step) {
    const Matrix<T> increment = detail::congruence(A, P);
    add(P, increment);
    A = product(A, A);
    const T change = detail::frobenius(increment), size = detail::frobenius(P);
    if (!is_finite(change)) break;
    // The terms to come are smaller yet only once A^(2^j) is a contraction.
    if (change > T(tolerance * size) || !(detail::frobenius(A) < 1)) continue;
    Matrix<T> difference = detail::congruence(m.A, P);
    add(difference, m.BQB);
    subtract(difference, P);
    return {P, size == 0 ? T(0) : T(detail::frobenius(difference) / size)};
  }
  throw ReferenceError("stationary covariance: the sum does not converge, rho(A) is too near 1");
}

/// Digits of a matrix to which two precisions agree.
template <class High, class Low>
int agreement(const Matrix<High>& high, const Matrix<Low>& low) {
  const High distance = detail::frobenius_distance(high, low), size = detail::frobenius(high);
  return distance == 0 ? 100 : std::clamp(detail::digits_of(High(distance / size)), 0, 100);
}

}  // namespace

StationaryCovariance stationary_covariance(const AnyProblem<double>& problem) {
  detail::check(detail::Source(&problem), false);
  if (!std::visit([](const auto& p) { return p.time_invariant(); }, problem))
    throw ReferenceError("stationary covariance: the problem is not time-invariant");
  StationaryCovariance s;
  s.spectral_radius = spectral_radius(detail::round_to_double(detail::read<Real<100>>(problem, 0).A));
  if (!(s.spectral_radius < 1))
    throw ReferenceError("stationary covariance: A is not stable, rho(A) = " + std::to_string(s.spectral_radius));
  const auto low = square_up<Real<100>>(problem, 100);
  const auto high = square_up<Real<200>>(problem, 200);
  s.P = detail::round_to_double(high.P);
  if (!all_finite(s.P)) throw ReferenceError("stationary covariance: does not fit a double (overflow)");
  s.residual = round_to_double(high.residual);
  s.certified_digits = agreement(high.P, low.P);
  if (s.certified_digits < 20)
    throw ReferenceError("stationary covariance: 100 and 200 digits agree to " + std::to_string(s.certified_digits) +
                         " only");
  return s;
}

SteadyState steady_state(const AnyProblem<double>& problem) {
  detail::check(detail::Source(&problem), false);
  if (!std::visit([](const auto& p) { return p.time_invariant(); }, problem))
    throw ReferenceError("steady state: the problem is not time-invariant");
  const auto low = double_up<Real<100>>(problem, 100);
  const auto high = double_up<Real<200>>(problem, 200);

  SteadyState s;
  s.P = detail::round_to_double(high.P);
  s.predictor_gain = detail::round_to_double(high.K);
  s.closed_loop = detail::round_to_double(high.F);
  if (!all_finite(s.P) || !all_finite(s.predictor_gain) || !all_finite(s.closed_loop))
    throw ReferenceError("steady state: does not fit a double (overflow)");
  s.spectral_radius = spectral_radius(s.closed_loop);
  if (!(s.spectral_radius < 1))
    throw ReferenceError("steady state: the solution is not stabilising, rho(F) = " +
                         std::to_string(s.spectral_radius));
  s.residual = round_to_double(high.residual);
  s.certified_digits = agreement(high.P, low.P);
  if (s.certified_digits < 20)
    throw ReferenceError("steady state: 100 and 200 digits agree to " + std::to_string(s.certified_digits) + " only");
  return s;
}

}  // namespace kfstab::reference
