#pragma once

#include <utility>

#include <kfstab/filters/matrix.hpp>

/// Dense linear algebra for the oracles, whose numbers are no Real: rationals, intervals. Plain loops over + - * /, so
/// that nothing is shared with detail/dense.hpp, which the oracles are there to judge.
namespace kfstab::reference::detail {

/// X Y
template <class T, int Cols>
Matrix<T, Dynamic, Cols> times(const Matrix<T>& X, const Matrix<T, Dynamic, Cols>& Y) {
  Matrix<T, Dynamic, Cols> Z(X.rows(), Y.cols());
  for (Index j = 0; j < Y.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) {
      T sum(0);
      for (Index l = 0; l < X.cols(); ++l) sum += T(X(i, l) * Y(l, j));
      Z(i, j) = sum;
    }
  return Z;
}

/// X + Y
template <class T, int Cols>
Matrix<T, Dynamic, Cols> sum_of(Matrix<T, Dynamic, Cols> X, const Matrix<T, Dynamic, Cols>& Y) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) X(i, j) += Y(i, j);
  return X;
}

/// X - Y
template <class T, int Cols>
Matrix<T, Dynamic, Cols> difference_of(Matrix<T, Dynamic, Cols> X, const Matrix<T, Dynamic, Cols>& Y) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) X(i, j) -= Y(i, j);
  return X;
}

/// X'
template <class T>
Matrix<T> transpose_of(const Matrix<T>& X) {
  Matrix<T> Y(X.cols(), X.rows());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(j, i) = X(i, j);
  return Y;
}

/// X Y X'
template <class T>
Matrix<T> sandwich(const Matrix<T>& X, const Matrix<T>& Y) {
  return times(times(X, Y), transpose_of(X));
}

template <class T>
Matrix<T> zero(Index rows, Index cols) {
  Matrix<T> X(rows, cols);
  for (Index j = 0; j < cols; ++j)
    for (Index i = 0; i < rows; ++i) X(i, j) = T(0);
  return X;
}

template <class T>
Matrix<T> unit(Index n) {
  Matrix<T> X = zero<T>(n, n);
  for (Index i = 0; i < n; ++i) X(i, i) = T(1);
  return X;
}

/// Y := X^{-1} Y by Gauss and Jordan. `usable` says whether a number may be divided by; the first that may be is the
/// pivot of its column, or with `in_place` the one on the diagonal and no other, as in an LDL' factorisation.
/// Returns false if there is none; `determinant` is that of X.
template <class T, class Usable>
bool solve(Matrix<T> X, Matrix<T>& Y, T& determinant, Usable usable, bool in_place) {
  const Index n = X.rows();
  determinant = T(1);
  for (Index k = 0; k < n; ++k) {
    Index pivot = k;
    while (pivot < n && !usable(X(pivot, k))) pivot = in_place ? n : pivot + 1;
    if (pivot == n) return false;
    if (pivot != k) {
      for (Index j = k; j < n; ++j) std::swap(X(k, j), X(pivot, j));
      for (Index j = 0; j < Y.cols(); ++j) std::swap(Y(k, j), Y(pivot, j));
      determinant = T(-determinant);
    }
    const T d = X(k, k);
    determinant *= d;
    for (Index j = k + 1; j < n; ++j) X(k, j) /= d;
    for (Index j = 0; j < Y.cols(); ++j) Y(k, j) /= d;
    for (Index i = 0; i < n; ++i) {
      if (i == k) continue;
      const T factor = X(i, k);
      for (Index j = k + 1; j < n; ++j) X(i, j) -= T(factor * X(k, j));
      for (Index j = 0; j < Y.cols(); ++j) Y(i, j) -= T(factor * Y(k, j));
    }
  }
  return true;
}

}  // namespace kfstab::reference::detail
