#pragma once

#include <kfstab/filters/kernels/array_step.hpp>

namespace kfstab::kernels {

/// One number of eight filters, side by side: as wide as the widest vector that there is.
struct alignas(64) Eight {
  double lane[8];
};

/// ArrayStep of eight filters of one shape at once, each matrix column by column without gaps, and nothing transposed; and
/// the state, x+ = A x + K (y - C x) + D u.
struct BatchStep {
  Index n = 0, m = 0, p = 0;
  const Eight *A = nullptr, *B = nullptr, *C = nullptr, *S = nullptr, *Q = nullptr, *R = nullptr;
  const Eight *x = nullptr, *y = nullptr, *Du = nullptr;  ///< n, p, n; null: no state is wanted
  Eight *S_next = nullptr, *Re = nullptr;                 ///< their lower triangles are written
  Eight* K = nullptr;                                     ///< null: no gain is wanted
  Eight* rcond = nullptr;                                 ///< of Re, 1 / (||Re||_1 ||Re^{-1}||_1), no estimate; null: not wanted
  Eight* x_next = nullptr;                                ///< n
  Eight* work = nullptr;                                  ///< batch_step_work(n, m, p) of them
};

constexpr Index batch_step_work(Index n, Index m, Index p) { return (n + p) * (n + m + p + 2) + 2 * p; }

}  // namespace kfstab::kernels
