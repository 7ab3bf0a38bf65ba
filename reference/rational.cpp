#include <kfstab/reference/rational.hpp>

#include <kfstab/reference/error.hpp>
#include <kfstab/reference/high_precision.hpp>

namespace kfstab::reference {

double round_to_double(const Rational& x) {
  if (x == 0) return 0;
  const Integer n = abs(numerator(x)), d = denominator(x);
  // The quotient to 66 bits or 67, the last of them set if anything is left: enough to round it once more, rightly.
  const long shift = 66 - static_cast<long>(msb(n)) + static_cast<long>(msb(d));
  const Integer scaled_n = shift > 0 ? Integer(n << static_cast<unsigned>(shift)) : n;
  const Integer scaled_d = shift < 0 ? Integer(d << static_cast<unsigned>(-shift)) : d;
  Integer quotient, rest;
  divide_qr(scaled_n, scaled_d, quotient, rest);
  if (rest != 0) bit_set(quotient, 0);
  const HighPrecision rounded = ldexp(HighPrecision(quotient), static_cast<int>(-shift));
  return round_to_double(x < 0 ? HighPrecision(-rounded) : rounded);
}

Matrix<Rational> rational(const Matrix<double>& X) {
  Matrix<Rational> Y(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) {
      if (!is_finite(X(i, j))) throw ReferenceError("a number that is not finite");
      Y(i, j) = X(i, j);
    }
  return Y;
}

Matrix<Rational> product(const Matrix<Rational>& X, const Matrix<Rational>& Y) {
  Matrix<Rational> Z(X.rows(), Y.cols());
  for (Index j = 0; j < Y.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      for (Index l = 0; l < X.cols(); ++l)
        if (!X(i, l).is_zero() && !Y(l, j).is_zero()) Z(i, j) += X(i, l) * Y(l, j);
  return Z;
}

Matrix<Rational> product_of_root(const Matrix<Rational>& L) {
  Matrix<Rational> X(L.rows(), L.rows());
  for (Index j = 0; j < L.rows(); ++j)
    for (Index i = j; i < L.rows(); ++i) {
      for (Index l = 0; l <= j; ++l)
        if (!L(i, l).is_zero() && !L(j, l).is_zero()) X(i, j) += L(i, l) * L(j, l);
      X(j, i) = X(i, j);
    }
  return X;
}

bool no_negative_eigenvalue(const Matrix<Rational>& X) {
  const Index n = X.rows();
  Matrix<Rational> rest = X;  // the Schur complement that is left
  for (Index k = 0; k < n; ++k) {
    if (rest(k, k) < 0) return false;
    if (rest(k, k).is_zero()) {
      // A zero pivot of a semidefinite matrix has nothing below it.
      for (Index i = k + 1; i < n; ++i)
        if (!rest(i, k).is_zero()) return false;
      continue;
    }
    for (Index j = k + 1; j < n; ++j) {
      if (rest(j, k).is_zero()) continue;
      const Rational factor = rest(j, k) / rest(k, k);
      for (Index i = j; i < n; ++i)
        if (!rest(i, k).is_zero()) rest(i, j) -= factor * rest(i, k);
    }
  }
  return true;
}

}  // namespace kfstab::reference
