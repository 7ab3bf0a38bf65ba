#pragma once

#include <cmath>

#include <kfstab/filters/matrix.hpp>

namespace kfstab {

/// Eigenvalues and eigenvectors of a symmetric matrix by cyclic Jacobi rotations: X = V diag(lambda) V'.
///
/// @param X  n x n; both triangles are read and taken for symmetric, overwritten: lambda on the diagonal, unsorted
/// @param V  n x n. Out: the eigenvectors, orthonormal columns
/// @return whether the off-diagonal part fell below u |X|; false for NaN or infinity, and if 60 sweeps did not do, which
///         no finite matrix is known to need: convergence is quadratic.
///
/// Backward stable: each lambda is right to a modest multiple of u |X|. Source: Golub, Van Loan, Matrix Computations,
/// 8.5 (cyclic by rows, rotations by the smaller angle).
template <class XType, class VType>
bool symmetric_eigen(XType& X, VType& V) {
  using std::abs;
  using std::sqrt;
  using Scalar = typename XType::Scalar;
  const Index n = X.rows();
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i < n; ++i) V(i, j) = Scalar(i == j ? 1 : 0);
  Scalar largest(0);
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i < n; ++i) {
      const Scalar a = abs(Scalar(X(i, j)));
      if (!is_finite(a)) return false;
      if (a > largest) largest = a;
    }
  const Scalar negligible = unit_roundoff<Scalar>() * largest;
  for (int sweep = 0; sweep < 60; ++sweep) {
    bool rotated = false;
    for (Index p = 0; p < n; ++p)
      for (Index q = p + 1; q < n; ++q) {
        const Scalar off = X(p, q);
        if (abs(off) <= negligible) continue;
        rotated = true;
        // t = tan of the smaller angle that annihilates X(p, q).
        const Scalar theta = (X(q, q) - X(p, p)) / (Scalar(2) * off);
        const Scalar t = (theta < Scalar(0) ? Scalar(-1) : Scalar(1)) / (abs(theta) + Scalar(sqrt(Scalar(1) + theta * theta)));
        const Scalar c = Scalar(1) / Scalar(sqrt(Scalar(1) + t * t)), s = t * c;
        X(p, p) -= t * off;
        X(q, q) += t * off;
        X(p, q) = X(q, p) = Scalar(0);
        for (Index k = 0; k < n; ++k) {
          if (k != p && k != q) {
            const Scalar a = X(k, p), b = X(k, q);
            X(k, p) = X(p, k) = c * a - s * b;
            X(k, q) = X(q, k) = s * a + c * b;
          }
          const Scalar v = V(k, p), w = V(k, q);
          V(k, p) = c * v - s * w;
          V(k, q) = s * v + c * w;
        }
      }
    if (!rotated) return true;
  }
  return false;
}

}  // namespace kfstab
