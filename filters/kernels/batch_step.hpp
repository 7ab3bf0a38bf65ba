#pragma once

#include <kfstab/filters/kernels/array_step.hpp>

/// One step of many filters of one shape, each in a lane of its own.
namespace kfstab::kernels {

/// One number of eight filters, side by side: as wide as the widest vector that there is.
struct alignas(64) Eight {
  double lane[8];
};

/// What is known of many filters comes in groups of eight, of which there is an even number, as kernels may take two at once:
/// a matrix is column by column without gaps, those of the next group follow.
///
/// ArrayStep of many filters at once. The covariance form, theory (2.3), has the gain K = G Re^{-1} and, if x is not null, the
/// state x_next = A x + K (y - C x) + D u. The information form, theory (2.4), has its array transposed, as ArrayStep says,
///
///     its A^{-1}, A^{-1}B, C, T, R^{-1/2}, Q^{-1/2}, n, m, p      for      A, C, B, S, Q, R, n, p, m
///
/// and makes z = -Q^{-1/2} w and, for the x of the last row, x + A^{-1} D u by itself.
struct BatchArrayStep {
  Index groups = 0;
  Index n = 0, m = 0, p = 0;
  bool information = false;
  const Eight *A = nullptr, *B = nullptr, *C = nullptr;
  const Eight *S = nullptr, *Q = nullptr,
              *R = nullptr;                 ///< of each the lower triangle is read; as stored, the upper one of T
  const Eight* x = nullptr;                 ///< n; null: no state is wanted
  const Eight* y = nullptr;                 ///< as many as there are outputs
  const Eight *Du = nullptr, *w = nullptr;  ///< D u and, of the information form, the mean of w; null: 0
  Eight* S_next = nullptr;                  ///< its lower triangle is written
  Eight* Re = nullptr;                      ///< likewise; null: not wanted
  Eight* K = nullptr;                       ///< K or, of the information form, Kf; null: not wanted
  Eight* rcond = nullptr;   ///< of Re or T+, 1 / (|X| |X^{-1}|) in the 1-norm, no estimate; null: not wanted
  Eight* x_next = nullptr;  ///< n
  /// Of each group, as bits, which of the eight gave up: what was to be written for them is undefined.
  unsigned char* gave_up = nullptr;
  Eight* work = nullptr;  ///< batch_array_work(n, m, p) of them
};

/// As many as two groups at once need: the array, w and f, the inverse of a triangle with its diagonal and sums, the last row,
/// and the right-hand sides of the gain with the state's.
constexpr Index batch_array_work(Index n, Index m, Index p) {
  const Index end = n + p + 1, most = n > p ? n : p;
  return 2 * (end * (n + m + p + 2) + most * (most + 2) + n + p + n * (m + 1));
}

/// CovarianceStep, theory (2.1), of many filters at once, with the state x_next = A x_{k|k} + D u.
struct BatchCovarianceStep {
  Index groups = 0;
  Index n = 0, m = 0, p = 0;
  const Eight *A = nullptr, *B = nullptr, *C = nullptr;
  const Eight *P = nullptr, *Q = nullptr, *R = nullptr;  ///< symmetric; the upper triangle of R is read, of others both
  const Eight *x = nullptr, *y = nullptr, *Du = nullptr;  ///< n, p, n; x null: no state is wanted; Du null: 0
  Eight* P_next = nullptr;                                ///< symmetric to the last bit
  Eight* K = nullptr;                                     ///< Kf
  Eight* rcond = nullptr;                                 ///< of Re, as above
  Eight* x_next = nullptr;                                ///< n
  unsigned char* gave_up = nullptr;                       ///< as above; where Re is not positive definite, too
  Eight* work = nullptr;                                  ///< batch_covariance_work(n, m, p) of them
};

constexpr Index batch_covariance_work(Index n, Index m, Index p) {
  return 2 * (n * (2 * n + m + 2 * p + 1) + p * (2 * p + 4));
}

}  // namespace kfstab::kernels
