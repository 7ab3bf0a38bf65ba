#include <kfstab/reference/closed_forms.hpp>

#include <utility>

#include <kfstab/reference/detail/elimination.hpp>
#include <kfstab/reference/error.hpp>

namespace kfstab::reference {
namespace {

using detail::sandwich;
using detail::sum_of;
using detail::times;
using detail::transpose_of;

Matrix<Rational> one(const Rational& x) {
  Matrix<Rational> X(1, 1);
  X(0, 0) = x;
  return X;
}

bool solved(const Matrix<Rational>& X, Matrix<Rational>& Y) {
  Rational determinant;
  return detail::solve(
      X, Y, determinant, [](const Rational& x) { return x != 0; }, false);
}

}  // namespace

DyerMcReynolds::DyerMcReynolds(Rational d) : d_(std::move(d)) {}

ExactProblem DyerMcReynolds::problem() const {
  CovarianceModel<Rational> model;
  model.A = detail::unit<Rational>(3);
  model.B = Matrix<Rational>(3, 0);
  model.Q = Matrix<Rational>(0, 0);
  model.D = Matrix<Rational>(3, 0);
  model.C = Matrix<Rational>(2, 3);
  for (Index j = 0; j < 3; ++j) model.C(0, j) = model.C(1, j) = 1;
  model.C(1, 2) += d_;
  model.R = detail::unit<Rational>(2);
  model.R(0, 0) = model.R(1, 1) = d_ * d_;
  Vector<Rational> x0(3);
  for (Index i = 0; i < 3; ++i) x0(i) = 0;
  return {{{model}, detail::unit<Rational>(3), x0}};
}

Matrix<Rational> DyerMcReynolds::P() const {
  const Rational t = 2 * d_ * (1 + d_), scale = 8 + t;
  Matrix<Rational> P(3, 3);
  P(0, 0) = P(1, 1) = (5 + t) / scale;
  P(0, 1) = P(1, 0) = -3 / scale;
  P(0, 2) = P(2, 0) = P(1, 2) = P(2, 1) = (-2 - d_) / scale;
  P(2, 2) = (4 + d_ * d_) / scale;
  return P;
}

Matrix<Rational> DyerMcReynolds::gain() const {
  const Rational scale = 2 * d_ * (d_ * d_ + d_ + 4);
  Matrix<Rational> K(3, 2);
  K(0, 0) = K(1, 0) = (2 * d_ + 1) / scale;
  K(0, 1) = K(1, 1) = (d_ - 1) / scale;
  K(2, 0) = (d_ - 2) / scale;
  K(2, 1) = (d_ * d_ + d_ + 2) / scale;
  return K;
}

Matrix<Rational> DyerMcReynolds::P(std::int64_t k) const {
  // With s = k / d^2: [1 + 2s, 2s, (2+d)s; 2s, 1 + 2s, (2+d)s; (2+d)s, (2+d)s, 1 + (2+2d+d^2)s]^{-1}. Along [1; -1; 0]
  // nothing is measured; what is left are [1; 1; 0]/2^{1/2} and [0; 0; 1], two by two.
  const Rational s = Rational(k) / (d_ * d_);
  const Rational sum = 1 + 4 * s, last = 1 + (2 + 2 * d_ + d_ * d_) * s, across = (2 + d_) * s;
  const Rational determinant = sum * last - 2 * across * across;
  const Rational common = last / determinant / 2, mixed = -across / determinant;
  Matrix<Rational> P(3, 3);
  P(0, 0) = P(1, 1) = common + Rational(1, 2);
  P(0, 1) = P(1, 0) = common - Rational(1, 2);
  P(0, 2) = P(2, 0) = P(1, 2) = P(2, 1) = mixed;
  P(2, 2) = sum / determinant;
  return P;
}

Rational DyerMcReynolds::innovation_determinant() const { return d_ * d_ * (8 + 2 * d_ * (1 + d_)); }

ExactProblem OneState::problem(const Rational& P0) const {
  CovarianceModel<Rational> model;
  model.A = one(a);
  model.B = one(1);
  model.Q = one(q);
  model.C = one(c);
  model.R = one(r);
  model.D = Matrix<Rational>(1, 0);
  Vector<Rational> x0(1);
  x0(0) = 0;
  return {{{model}, one(P0), x0}};
}

Rational OneState::P(const Rational& P0, std::int64_t k) const {
  Matrix<Rational> step(2, 2), fraction(2, 1);
  step(0, 0) = a * a * r + c * c * q;
  step(0, 1) = q * r;
  step(1, 0) = c * c;
  step(1, 1) = r;
  fraction(0, 0) = P0;
  fraction(1, 0) = 1;
  // step^k by squaring
  for (std::int64_t left = k; left > 0; left /= 2) {
    if (left % 2 == 1) fraction = times(step, fraction);
    step = times(step, step);
  }
  return fraction(0, 0) / fraction(1, 0);
}

Matrix<Rational> noise_free_covariance(const ExactProblem& problem, std::int64_t k) {
  const CovarianceModel<Rational>& model = problem.models.front();
  const Index n = model.A.rows();
  Matrix<Rational> weighted = model.C;
  if (!solved(model.R, weighted)) throw ReferenceError("R is singular");
  const Matrix<Rational> CRC = times(transpose_of(model.C), weighted);
  Matrix<Rational> Phi = detail::unit<Rational>(n), M = detail::zero<Rational>(n, n);
  for (std::int64_t j = 0; j < k; ++j) {
    M = sum_of(M, sandwich(transpose_of(Phi), CRC));
    Phi = times(model.A, Phi);
  }
  // P0 (I + M P0)^{-1} = (I + P0 M)^{-1} P0
  Matrix<Rational> P = problem.initial;
  if (!solved(sum_of(detail::unit<Rational>(n), times(problem.initial, M)), P))
    throw ReferenceError("I + P0 M is singular: P0 or R is no covariance");
  return sandwich(Phi, P);
}

}  // namespace kfstab::reference
