#pragma once

#include <kfstab/filters/kernels/array_step.hpp>

/// One step of a filter of doubles that holds P, as the kernels take it.
namespace kfstab::kernels {

/// Theory (2.1), or Joseph's form (2.2),
///
///     Re = R + C P C' = V'V,   W = P C' V^{-1},   Kf = W V^{-T},   P+ = A P_{k|k} A' + B Q B',
///
/// P_{k|k} = P - W W' or (I - Kf C) P (I - Kf C)' + Kf R Kf'.
struct CovarianceStep {
  Index n = 0, m = 0, p = 0;
  bool joseph = false;
  Source A, B, C;           ///< n x n, n x m, p x n
  Source P, Q;              ///< symmetric; both triangles are read
  Source R;                 ///< symmetric; of Joseph's form both triangles are read, else the upper one
  Target P_next;            ///< n x n, symmetric to the last bit
  Target K;                 ///< n x p: Kf
  double* rcond = nullptr;  ///< reciprocal condition number of Re in the 1-norm, an estimate from some order on
  double* work = nullptr;   ///< covariance_step_work(n, m, p, joseph) doubles
};

/// How much workspace a step needs, whatever the instruction set.
constexpr Index covariance_step_work(Index n, Index m, Index p, bool joseph) {
  const auto rows = [](Index size) { return (size + 7) / 8 * 8; };  // of strips, of the widest vectors
  const Index more = m > p ? m : p, most = n > p ? n : p;
  return rows(n) * (3 * n + m + more + p) + rows(p) * (2 * n + p) + rows(m) * m +
         (joseph ? rows(n) * (n + p) + rows(most) * p : 0) + (p + 8) * (p + 1) + (rows(p) + 8) * p + 8;
}

}  // namespace kfstab::kernels
