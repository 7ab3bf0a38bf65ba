#pragma once

#include <cstddef>
#include <cstring>
#include <type_traits>

#include <Eigen/Core>

#ifdef __FAST_MATH__
#error "kfstab studies rounding: -ffast-math lets the compiler change it. Build without it."
#endif

namespace kfstab {

using Index = Eigen::Index;
inline constexpr int Dynamic = Eigen::Dynamic;

template <class Scalar, int Rows = Dynamic, int Cols = Dynamic>
using Matrix = Eigen::Matrix<Scalar, Rows, Cols>;

template <class Scalar, int Rows = Dynamic>
using Vector = Eigen::Matrix<Scalar, Rows, 1>;

/// The three sizes of a model: n states, m process noises, p outputs. Each may be 0 where the maths allows.
struct Dimensions {
  Index n = 0;
  Index m = 0;
  Index p = 0;

  friend bool operator==(const Dimensions&, const Dimensions&) = default;
};

/// u, the unit roundoff: the largest relative error of one rounding, half the distance from 1 to the next number.
/// It is LAPACK's DLAMCH('E'); 2^-53 for double.
template <class Scalar>
Scalar unit_roundoff() {
  return Eigen::NumTraits<Scalar>::epsilon() / Scalar(2);
}

/// Neither infinite nor NaN, for any scalar: infinities and NaN are the numbers whose difference with themselves is not 0.
template <class Scalar>
bool is_finite(const Scalar& x) {
  return x - x == Scalar(0);
}

template <class Derived>
bool all_finite(const Eigen::MatrixBase<Derived>& X) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      if (!is_finite(typename Derived::Scalar(X(i, j)))) return false;
  return true;
}

template <class Derived>
bool all_finite_lower(const Eigen::MatrixBase<Derived>& L) {
  for (Index j = 0; j < L.cols(); ++j)
    for (Index i = j; i < L.rows(); ++i)
      if (!is_finite(typename Derived::Scalar(L(i, j)))) return false;
  return true;
}

template <class Derived>
bool all_finite_upper(const Eigen::MatrixBase<Derived>& U) {
  for (Index j = 0; j < U.cols(); ++j)
    for (Index i = 0; i <= j; ++i)
      if (!is_finite(typename Derived::Scalar(U(i, j)))) return false;
  return true;
}

/// The same sizes and the same numbers, those of Y being finite. Whether a model is still the one that it was is asked in every
/// step, and nearly always it is, bit by bit. Where doubles are not, differences are summed up, several at a time: none but 0 has
/// the sum 0, for no difference underflows.
template <class XType, class YType>
bool equal(const XType& X, const YType& Y) {
  if (X.rows() != Y.rows() || X.cols() != Y.cols()) return false;
  if (X.size() == 0) return true;
  if constexpr (std::is_same_v<typename XType::Scalar, double>) {
    const auto gapless = [](const auto& Z) { return Z.cols() == 1 || Z.outerStride() == Z.rows(); };
    if (gapless(X) && gapless(Y) && std::memcmp(X.data(), Y.data(), sizeof(double) * static_cast<std::size_t>(X.size())) == 0)
      return true;
    return (X - Y).cwiseAbs().sum() == 0;
  } else {
    return X == Y;
  }
}

/// The same, of the lower triangles.
template <class XType, class YType>
bool equal_lower(const XType& X, const YType& Y) {
  if (X.rows() != Y.rows() || X.cols() != Y.cols()) return false;
  for (Index j = 0; j < X.cols(); ++j)
    if (!equal(X.col(j).tail(X.rows() - j), Y.col(j).tail(X.rows() - j))) return false;
  return true;
}

template <class XType, class YType>
bool equal_upper(const XType& X, const YType& Y) {
  if (X.rows() != Y.rows() || X.cols() != Y.cols()) return false;
  for (Index j = 0; j < X.cols(); ++j)
    if (!equal(X.col(j).head(j + 1), Y.col(j).head(j + 1))) return false;
  return true;
}

}  // namespace kfstab
