#pragma once

#include <boost/multiprecision/gmp.hpp>

#include <kfstab/filters/problem.hpp>
#include <kfstab/reference/high_precision.hpp>

/// Numbers without rounding: what a system's entries are where they were written exactly ("1/3", "1e-30"), and what the
/// oracles of the tests compute in.
namespace kfstab::reference {

using Integer = boost::multiprecision::number<boost::multiprecision::gmp_int, boost::multiprecision::et_off>;
using Rational = boost::multiprecision::number<boost::multiprecision::gmp_rational, boost::multiprecision::et_off>;

/// The nearest number of that precision: a third has none that is exact.
template <class Number>
Number nearest(const Rational& x) {
  Number y;
  mpfr_set_q(y.backend().data(), x.backend().data(), MPFR_RNDN);
  return y;
}

/// A problem in exact numbers. The covariance parametrisation serves for all: S0 S0' and (T'T)^{-1} are rational.
struct ExactProblem : Problem<CovarianceModel<Rational>> {};
/// Data in exact numbers.
struct ExactData : DataOf<Rational> {};

/// The nearest double, ties to even; infinite beyond the range of double, denormalised below it. (Rational's own
/// conversion cuts off.)
double round_to_double(const Rational& x);

/// Entry by entry; a double is rational. Throws ReferenceError for one that is not finite.
Matrix<Rational> rational(const Matrix<double>& X);

/// X Y, one entry after the other, without a rounding.
Matrix<Rational> product(const Matrix<Rational>& X, const Matrix<Rational>& Y);

/// L L' of a lower L; its strict upper triangle is not read.
Matrix<Rational> product_of_root(const Matrix<Rational>& L);

/// Whether no eigenvalue is negative, decided exactly by LDL' of the lower triangle.
bool no_negative_eigenvalue(const Matrix<Rational>& X);

}  // namespace kfstab::reference
