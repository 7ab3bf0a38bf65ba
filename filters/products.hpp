#pragma once

#include <kfstab/filters/matrix.hpp>

/// The products that read or write one triangle alone, and those whose terms Eigen would sum in another order for each
/// scalar. They do not allocate, at any size: Eigen's own triangular products do, from 160 columns on.
namespace kfstab {

/// out = X L, L lower triangular (its strict upper triangle is not read).
template <class XType, class LType, class OutType>
void multiply_lower(const XType& X, const LType& L, OutType&& out) {
  for (Index j = 0; j < L.cols(); ++j) {
    for (Index i = 0; i < X.rows(); ++i) out(i, j) = X(i, j) * L(j, j);
    for (Index k = j + 1; k < L.rows(); ++k) {
      const auto l = L(k, j);
      for (Index i = 0; i < X.rows(); ++i) out(i, j) += X(i, k) * l;
    }
  }
}

/// out = U X, U upper triangular (its strict lower triangle is not read).
template <class UType, class XType, class OutType>
void multiply_upper(const UType& U, const XType& X, OutType&& out) {
  for (Index j = 0; j < X.cols(); ++j) {
    for (Index i = 0; i < U.rows(); ++i) out(i, j) = U(i, i) * X(i, j);
    for (Index k = 1; k < U.rows(); ++k) {
      const auto x = X(k, j);
      for (Index i = 0; i < k; ++i) out(i, j) += U(i, k) * x;
    }
  }
}

/// out = X' Y, the terms of each entry summed from the first to the last. Eigen sums them so for any scalar but those that
/// the machine has vectors of: there in an order of its own, and a filter of doubles would round differently from the
/// same text in 53 bits.
template <class XType, class YType, class OutType>
void multiply_transposed(const XType& X, const YType& Y, OutType&& out) {
  using Scalar = typename XType::Scalar;
  for (Index j = 0; j < Y.cols(); ++j)
    for (Index i = 0; i < X.cols(); ++i) {
      Scalar sum(0);
      for (Index k = 0; k < X.rows(); ++k) sum += X(k, i) * Y(k, j);
      out(i, j) = sum;
    }
}

/// Upper triangle of out += X Y', where the result is known to be symmetric; the strict lower triangle is not touched.
template <class OutType, class XType, class YType>
void add_product_upper(OutType& out, const XType& X, const YType& Y) {
  for (Index j = 0; j < out.cols(); ++j)
    for (Index k = 0; k < X.cols(); ++k) {
      const auto y = Y(j, k);
      for (Index i = 0; i <= j; ++i) out(i, j) += X(i, k) * y;
    }
}

/// Upper triangle of out -= X Y'.
template <class OutType, class XType, class YType>
void subtract_product_upper(OutType& out, const XType& X, const YType& Y) {
  for (Index j = 0; j < out.cols(); ++j)
    for (Index k = 0; k < X.cols(); ++k) {
      const auto y = Y(j, k);
      for (Index i = 0; i <= j; ++i) out(i, j) -= X(i, k) * y;
    }
}

/// The strict lower triangle becomes the mirror image of the upper one.
template <class OutType>
void mirror_upper(OutType& M) {
  for (Index j = 0; j < M.cols(); ++j)
    for (Index i = 0; i < j; ++i) M(j, i) = M(i, j);
}

/// out = the triangle of M on and above (upper) or below (lower) the diagonal, and zeros; the rest of M is not read.
template <class MType, class OutType>
void copy_upper(const MType& M, OutType&& out) {
  using Scalar = typename MType::Scalar;
  for (Index j = 0; j < M.cols(); ++j)
    for (Index i = 0; i < M.cols(); ++i) out(i, j) = i <= j ? Scalar(M(i, j)) : Scalar(0);
}

template <class MType, class OutType>
void copy_lower(const MType& M, OutType&& out) {
  using Scalar = typename MType::Scalar;
  for (Index j = 0; j < M.rows(); ++j)
    for (Index i = 0; i < M.rows(); ++i) out(i, j) = i >= j ? Scalar(M(i, j)) : Scalar(0);
}

}  // namespace kfstab
