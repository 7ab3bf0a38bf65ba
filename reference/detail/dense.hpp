#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <kfstab/reference/definiteness.hpp>
#include <kfstab/reference/detail/split_product.hpp>
#include <kfstab/reference/high_precision.hpp>

/// Dense linear algebra in high precision, by plain loops over sums of products with one rounding each: Eigen's
/// products and decompositions cost most of a minute a number type to compile, and round twice a term. Products of
/// matrices are detail/split_product.hpp's.
///
/// T is a Real<Digits>. Symmetric results are computed in one triangle and mirrored.
namespace kfstab::reference::detail {

/// sum += a b, by way of a scratch number: two roundings, no allocation, no copy.
template <class T>
void add_product(T& sum, const T& a, const T& b, T& scratch) {
  mpfr_mul(scratch.backend().data(), a.backend().data(), b.backend().data(), MPFR_RNDN);
  mpfr_add(sum.backend().data(), sum.backend().data(), scratch.backend().data(), MPFR_RNDN);
}

template <class T>
void subtract_product(T& sum, const T& a, const T& b, T& scratch) {
  mpfr_mul(scratch.backend().data(), a.backend().data(), b.backend().data(), MPFR_RNDN);
  mpfr_sub(sum.backend().data(), sum.backend().data(), scratch.backend().data(), MPFR_RNDN);
}

inline void add_product(double& sum, double a, double b, double&) { sum += a * b; }
inline void subtract_product(double& sum, double a, double b, double&) { sum -= a * b; }

template <class T>
Matrix<T> zeros(Index rows, Index cols) {
  Matrix<T> X(rows, cols);
  for (Index j = 0; j < cols; ++j)
    for (Index i = 0; i < rows; ++i) X(i, j) = 0;
  return X;
}

template <class T>
Matrix<T> identity(Index n) {
  Matrix<T> X = zeros<T>(n, n);
  for (Index i = 0; i < n; ++i) X(i, i) = 1;
  return X;
}

/// X as an operand of multiply; so is its transpose, without a copy.
template <class T, int Rows, int Cols>
Entries entries(const Matrix<T, Rows, Cols>& X) {
  constexpr auto size = static_cast<std::ptrdiff_t>(sizeof(T));
  return {X.size() > 0 ? X.data()->backend().data() : nullptr, size, X.rows() * size};
}

template <class T, int Rows, int Cols>
Results results(Matrix<T, Rows, Cols>& X) {
  constexpr auto size = static_cast<std::ptrdiff_t>(sizeof(T));
  return {X.size() > 0 ? X.data()->backend().data() : nullptr, size, X.rows() * size};
}

/// X Y
template <class T, int Cols>
Matrix<T, Dynamic, Cols> product(const Matrix<T>& X, const Matrix<T, Dynamic, Cols>& Y) {
  Matrix<T, Dynamic, Cols> Z(X.rows(), Y.cols());
  multiply(results(Z), Into::set, entries(X), entries(Y), {X.rows(), X.cols(), Y.cols()}, Structure::general);
  return Z;
}

/// X Y'
template <class T>
Matrix<T> product_transposed(const Matrix<T>& X, const Matrix<T>& Y) {
  Matrix<T> Z(X.rows(), Y.rows());
  multiply(results(Z), Into::set, entries(X), entries(Y).transposed(), {X.rows(), X.cols(), Y.rows()},
           Structure::general);
  return Z;
}

/// Z += X Y' where that is known to be symmetric: its lower triangle, mirrored.
template <class T>
void add_symmetric_product(Matrix<T>& Z, const Matrix<T>& X, const Matrix<T>& Y) {
  multiply(results(Z), Into::add, entries(X), entries(Y).transposed(), {X.rows(), X.cols(), Y.rows()},
           Structure::symmetric);
}

/// X Y' where that is known to be symmetric.
template <class T>
Matrix<T> symmetric_product(const Matrix<T>& X, const Matrix<T>& Y) {
  Matrix<T> Z(X.rows(), X.rows());
  multiply(results(Z), Into::set, entries(X), entries(Y).transposed(), {X.rows(), X.cols(), Y.rows()},
           Structure::symmetric);
  return Z;
}

/// X'
template <class T>
Matrix<T> transposed(const Matrix<T>& X) {
  Matrix<T> Y(X.cols(), X.rows());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(j, i) = X(i, j);
  return Y;
}

/// X P X' for symmetric P.
template <class T>
Matrix<T> congruence(const Matrix<T>& X, const Matrix<T>& P) {
  return symmetric_product(product(X, P), X);
}

/// Where and how a Cholesky factorisation ended.
template <class T>
struct CholeskyEnd {
  bool done = true;
  Index column = 0;  ///< of the pivot that was not positive
  T pivot = 0;       ///< that pivot
};

/// X = L L', from X's lower triangle; L has zeros above the diagonal.
template <class T>
CholeskyEnd<T> cholesky(const Matrix<T>& X, Matrix<T>& L) {
  const Index n = X.rows();
  L = zeros<T>(n, n);
  const Entries rows = entries(L);
  T sum;
  for (Index j = 0; j < n; ++j) {
    sum = X(j, j);
    fused_dot(*sum.backend().data(), Into::subtract, rows.row(j), rows.row(j), j);
    if (!(sum > 0)) return {false, j, sum};
    L(j, j) = sqrt(sum);
    for (Index i = j + 1; i < n; ++i) {
      sum = X(i, j);
      fused_dot(*sum.backend().data(), Into::subtract, rows.row(i), rows.row(j), j);
      L(i, j) = sum / L(j, j);
    }
  }
  return {};
}

/// L^{-1} for lower L with no zero on the diagonal.
template <class T>
Matrix<T> lower_inverse(const Matrix<T>& L) {
  const Index n = L.rows();
  Matrix<T> X = zeros<T>(n, n);
  const Entries rows = entries(L), columns = entries(X);
  T sum;
  for (Index j = 0; j < n; ++j) {
    X(j, j) = 1 / L(j, j);
    for (Index i = j + 1; i < n; ++i) {
      sum = 0;
      fused_dot(*sum.backend().data(), Into::subtract, rows.row(i, j), columns.column(j, j), i - j);
      X(i, j) = sum / L(i, i);
    }
  }
  return X;
}

/// (L L')^{-1} from L^{-1}.
template <class T>
Matrix<T> inverse_from_root_inverse(const Matrix<T>& L_inverse) {
  const Index n = L_inverse.rows();
  Matrix<T> X(n, n);
  multiply(results(X), Into::set, entries(L_inverse).transposed(), entries(L_inverse), {n, n, n}, Structure::symmetric);
  return X;
}

/// X^{-1} by Gaussian elimination with partial pivoting. False if a column has no pivot but zero.
template <class T>
bool invert(Matrix<T> X, Matrix<T>& inverse) {
  const Index n = X.rows();
  inverse = identity<T>(n);
  using std::abs;
  T scratch{}, factor{};
  for (Index k = 0; k < n; ++k) {
    Index pivot = k;
    for (Index i = k + 1; i < n; ++i)
      if (abs(X(i, k)) > abs(X(pivot, k))) pivot = i;
    if (X(pivot, k) == 0) return false;
    if (pivot != k)
      for (Index j = 0; j < n; ++j) {
        using std::swap;
        swap(X(k, j), X(pivot, j));
        swap(inverse(k, j), inverse(pivot, j));
      }
    for (Index i = 0; i < n; ++i) {
      if (i == k || X(i, k) == 0) continue;
      factor = X(i, k) / X(k, k);
      for (Index j = k; j < n; ++j) subtract_product(X(i, j), factor, X(k, j), scratch);
      for (Index j = 0; j < n; ++j) subtract_product(inverse(i, j), factor, inverse(k, j), scratch);
    }
  }
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < n; ++j) inverse(i, j) /= X(i, i);
  return true;
}

template <class Derived>
typename Derived::Scalar frobenius(const Eigen::MatrixBase<Derived>& X) {
  typename Derived::Scalar sum = 0, scratch;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) add_product(sum, X(i, j), X(i, j), scratch);
  return sqrt(sum);
}

/// ||X - Y||_F; Y may be of a lower precision, which converts exactly.
template <class T, class U, int Cols>
T frobenius_distance(const Matrix<T, Dynamic, Cols>& X, const Matrix<U, Dynamic, Cols>& Y) {
  T sum = 0, difference, scratch;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) {
      mpfr_sub(difference.backend().data(), X(i, j).backend().data(), Y(i, j).backend().data(), MPFR_RNDN);
      add_product(sum, difference, difference, scratch);
    }
  return sqrt(sum);
}

template <class T, int Cols>
Matrix<double, Dynamic, Cols> round_to_double(const Matrix<T, Dynamic, Cols>& X) {
  Matrix<double, Dynamic, Cols> Y(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(i, j) = reference::round_to_double(X(i, j));
  return Y;
}

/// ||X||_2, right to nearly all digits of a double: only the largest singular value is that robust against rounding X.
/// Scaled by a power of two, so any exponent will do.
template <class T>
T two_norm(const Matrix<T>& X) {
  mpfr_exp_t exponent = 0;
  bool any = false;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      if (X(i, j) != 0 && (!any || mpfr_get_exp(X(i, j).backend().data()) > exponent)) {
        exponent = mpfr_get_exp(X(i, j).backend().data());
        any = true;
      }
  if (!any) return T(0);
  Matrix<double> scaled(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      scaled(i, j) = reference::round_to_double(T(ldexp(X(i, j), -static_cast<int>(exponent))));
  return ldexp(T(reference::two_norm(scaled)), static_cast<int>(exponent));
}

/// k_2 of a matrix of which the inverse is at hand: ||X|| ||X^{-1}||, two robust norms. 1 for 0 x 0.
template <class T>
double condition(const Matrix<T>& X, const Matrix<T>& X_inverse) {
  if (X.size() == 0) return 1;
  const double k = reference::round_to_double(T(two_norm(X) * two_norm(X_inverse)));
  return k < 1 ? 1 : k;
}

/// e with ||X||_F <= 2^e, too large by a few units at most; -infinity for X = 0. Costs no arithmetic.
template <class Derived>
double magnitude(const Eigen::MatrixBase<Derived>& X) {
  double exponent = -std::numeric_limits<double>::infinity();
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      if (X(i, j) != 0) exponent = std::max(exponent, static_cast<double>(mpfr_get_exp(X(i, j).backend().data())));
  return exponent + std::log2(static_cast<double>(X.size() + 1)) / 2;
}

/// Whole decimal digits to which a relative error vouches: floor(-log10). Rounds to the pessimistic side.
template <class T>
int digits_of(const T& relative_error) {
  // |relative_error| < 2^exponent
  const double exponent = static_cast<double>(mpfr_get_exp(relative_error.backend().data()));
  return static_cast<int>(std::floor(-exponent * std::log10(2.0)));
}

/// 10^exponent
template <class T>
T power_of_ten(int exponent) {
  return pow(T(10), exponent);
}

}  // namespace kfstab::reference::detail
