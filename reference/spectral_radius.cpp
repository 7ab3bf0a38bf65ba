#include <cmath>
#include <limits>

#include <kfstab/reference/detail/dense.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::reference {
namespace {

void scale_by_power(Matrix<double>& X, int exponent) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) X(i, j) = std::ldexp(X(i, j), exponent);
}

template <class T>
void scale_by_power(Matrix<T>& X, int exponent) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) X(i, j) = ldexp(X(i, j), exponent);
}

Matrix<double> square(const Matrix<double>& X) { return X.lazyProduct(X); }

template <class T>
Matrix<T> square(const Matrix<T>& X) {
  return detail::product(X, X);
}

/// ||X^N||^{1/N}, N = 2^60, by squaring, scaled back to size 1 each time. What a squaring gets wrong enters by its
/// root, so the first ones decide; |X|^{1/N} forgets constants and powers of N.
template <class T>
double by_squaring(Matrix<T> X) {
  constexpr int squarings = 60;
  HighPrecision log2_radius = 0;  // terms of both signs, far larger than their sum where X is far from normal
  for (int squaring = 0;; ++squaring) {
    const T size = detail::frobenius(X);
    if (size == 0) return 0;
    int exponent = 0;
    using std::frexp;
    const T mantissa = frexp(size, &exponent);
    log2_radius += ldexp(HighPrecision(exponent), -squaring);
    if (squaring == squarings) {
      log2_radius += ldexp(HighPrecision(std::log2(static_cast<double>(mantissa))), -squaring);
      return round_to_double(HighPrecision(pow(HighPrecision(2), log2_radius)));
    }
    scale_by_power(X, -exponent);
    X = square(X);
  }
}

}  // namespace

double spectral_radius(const Matrix<double>& X) {
  if (X.rows() != X.cols()) throw ReferenceError("spectral radius of a matrix that is not square");
  if (X.size() == 0) return 0;
  if (!all_finite(X)) return std::numeric_limits<double>::quiet_NaN();
  return X.rows() <= 32 ? by_squaring(exact<Real<50>>(X)) : by_squaring(X);
}

}  // namespace kfstab::reference
