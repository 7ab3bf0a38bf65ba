#pragma once

#include <cstdint>

#include <kfstab/reference/high_precision.hpp>
#include <kfstab/reference/rational.hpp>

/// Oracles: filters whose result is a formula.
namespace kfstab::reference {

/// Two nearly equal, accurate measurements of three states, after Dyer and McReynolds: P0 = I, A = I, B = 0,
/// C = [1 1 1; 1 1 1+d], R = d^2 I, d != 0.
class DyerMcReynolds {
 public:
  explicit DyerMcReynolds(Rational d);

  ExactProblem problem() const;
  /// P_{0|0} = P_{1|0}, theory (6.1).
  Matrix<Rational> P() const;
  /// K = Kf of the first step, 3 x 2, theory (6.1).
  Matrix<Rational> gain() const;
  /// (I + k C'C / d^2)^{-1}, P after k steps, theory (6.2), by the eigenvalues of C C'.
  Matrix<Rational> P(std::int64_t k) const;
  /// Of the first step, theory (6.3).
  Rational innovation_determinant() const;

 private:
  Rational d_;
};

/// One state, one measurement: x+ = a x + w, y = c x + v with variances q >= 0 and r > 0.
struct OneState {
  Rational a, q, c, r;

  ExactProblem problem(const Rational& P0) const;
  /// P_{k|k-1} from P_{0|-1} = P0 >= 0, theory (6.4).
  Rational P(const Rational& P0, std::int64_t k) const;
  /// Where P goes if q > 0 and c != 0, theory (6.5). Number is a Real.
  template <class Number>
  Number steady_state() const;
};

/// Without process noise: P_{k|k-1} = Phi P0 (I + M P0)^{-1} Phi' with Phi = A^k and M the sum of (A^j)' C'R^{-1}C A^j,
/// j = 0 ... k - 1, theory (6.6): no P but P0 enters. R regular, P0 any covariance, a time-invariant model with
/// B Q B' = 0, which is not looked at. Throws ReferenceError if R is singular.
Matrix<Rational> noise_free_covariance(const ExactProblem& problem, std::int64_t k);

template <class Number>
Number OneState::steady_state() const {
  // c^2 P^2 + (r - a^2 r - c^2 q) P - q r = 0, its positive root, by the formula that does not cancel
  const auto real = [](const Rational& x) { return Number(Number(numerator(x)) / Number(denominator(x))); };
  const Number square = real(Rational(c * c)), constant = real(Rational(q * r));
  const Number linear = real(Rational(r - Rational(a * a * r) - Rational(c * c * q)));
  const Number root = sqrt(Number(linear * linear + 4 * square * constant));
  return linear > 0 ? Number(2 * constant / (linear + root)) : Number((root - linear) / (2 * square));
}

}  // namespace kfstab::reference
