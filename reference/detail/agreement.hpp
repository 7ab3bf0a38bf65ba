#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include <kfstab/reference/detail/dense.hpp>

/// How far two runs agree. It is asked of every quantity of every step, and asks for a few digits of a norm, so norms are
/// taken in double, of numbers scaled by a power of two.
namespace kfstab::reference::detail {

/// factor 2^exponent, factor >= 0; 0 for nothing. Any exponent fits.
struct Size {
  double factor = 0;
  long exponent = 0;

  bool is_zero() const { return factor == 0; }
  /// Its decimal logarithm; -infinity for 0.
  double log10() const { return std::log10(factor) + static_cast<double>(exponent) * std::log10(2.0); }
};

/// Sums up squares of numbers of any size.
class SumOfSquares {
 public:
  template <class T>
  void add(const T& x) {
    if (x == 0) return;
    long exponent = 0;
    const double d = mpfr_get_d_2exp(&exponent, x.backend().data(), MPFR_RNDN);
    if (exponent > exponent_ || sum_ == 0) {
      sum_ = sum_ == 0 ? 0 : std::ldexp(sum_, static_cast<int>(2 * std::max(exponent_ - exponent, -600L)));
      exponent_ = exponent;
    }
    const double scaled = std::ldexp(d, static_cast<int>(std::max(exponent - exponent_, -600L)));
    sum_ += scaled * scaled;
  }
  Size root() const { return {std::sqrt(sum_), exponent_}; }

 private:
  double sum_ = 0;
  long exponent_ = 0;
};

/// |x - y|, rounded once.
template <class T, class U>
Size distance(const T& x, const U& y) {
  Real<15> difference;
  mpfr_sub(difference.backend().data(), x.backend().data(), y.backend().data(), MPFR_RNDN);
  if (difference == 0) return {};
  Size size;
  size.factor = std::abs(mpfr_get_d_2exp(&size.exponent, difference.backend().data(), MPFR_RNDN));
  return size;
}

/// Whole decimal digits to which |error| / |value| vouches, from 0 to `most`: all where there is no error, none where
/// there is nothing but error.
inline int digits_of(const Size& error, const Size& value, int most) {
  if (error.is_zero()) return most;
  if (value.is_zero() || !std::isfinite(error.factor)) return 0;
  return std::clamp(static_cast<int>(std::floor(value.log10() - error.log10())), 0, most);
}

/// Of ||X - Y||_F / ||X||_F, Y the less precise. Of symmetric matrices one triangle is looked at: its norm is the
/// whole one's up to 2^{1/2}.
template <class T, class U, int Cols>
int agreement(const Matrix<T, Dynamic, Cols>& X, const Matrix<U, Dynamic, Cols>& Y, bool symmetric, int most) {
  SumOfSquares error, value;
  Real<15> difference;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = symmetric ? j : 0; i < X.rows(); ++i) {
      mpfr_sub(difference.backend().data(), X(i, j).backend().data(), Y(i, j).backend().data(), MPFR_RNDN);
      error.add(difference);
      value.add(X(i, j));
    }
  return digits_of(error.root(), value.root(), most);
}

}  // namespace kfstab::reference::detail
