#include <cmath>
#include <limits>

#include <kfstab/reference/detail/dense.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::reference {
namespace {

void scale(Matrix<double>& X, int exponent) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) X(i, j) = std::ldexp(X(i, j), exponent);
}

template <class T>
void scale(Matrix<T>& X, int exponent) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) X(i, j) = ldexp(X(i, j), exponent);
}

/// ||X^N||^{1/N}, N = 2^60, by squaring, scaled back to size 1 each time. What a squaring gets wrong enters by its
/// root, so the first ones decide; |X|^{1/N} forgets constants and powers of N.
template <class T>
double by_squaring(Matrix<T> X) {
  double log_radius = 0, weight = 1;
  for (int squaring = 0; squaring <= 60; ++squaring) {
    const T size = detail::frobenius(X);
    if (size == 0) return 0;
    int exponent = 0;
    using std::frexp;
    using std::log;
    const T mantissa = frexp(size, &exponent);
    log_radius += weight * exponent * std::log(2.0);
    scale(X, -exponent);
    weight /= 2;
    if (squaring == 60) log_radius += 2 * weight * std::log(static_cast<double>(mantissa));
    X = detail::product(X, X);
  }
  return std::exp(log_radius);
}

}  // namespace

double spectral_radius(const Matrix<double>& X) {
  if (X.rows() != X.cols()) throw ReferenceError("spectral radius of a matrix that is not square");
  if (X.size() == 0) return 0;
  if (!all_finite(X)) return std::numeric_limits<double>::quiet_NaN();
  return X.rows() <= 32 ? by_squaring(exact<Real<50>>(X)) : by_squaring(X);
}

}  // namespace kfstab::reference
