#pragma once

#include <cstddef>

/// One step of a square-root filter of doubles, as the kernels take it: numbers and places, no types of anybody's.
namespace kfstab::kernels {

using Index = std::ptrdiff_t;

/// A matrix stored column by column, columns `leading` apart.
struct Source {
  const double* data = nullptr;
  Index leading = 0;
};
struct Target {
  double* data = nullptr;
  Index leading = 0;
};

/// The array that all square-root filters have in common,
///
///     [ R   C S   0   ]         [ Re  0    0  ]
///     [ 0   A S   B Q ] U   =   [ G   S+   0  ],    K = G Re^{-1},
///     [ z'  x'S   y'Q ]         [ *   xi'  e' ]
///
/// with lower triangular R (p x p), S (n x n), Q (m x m) and U orthogonal. The last row is there if x is not null.
///
/// - srcf: as it stands, theory (2.3), without the last row.
/// - srif, theory (2.4): its array transposed, so with T' for S, A^{-T} for A, (A^{-1}B)' for C, Q^{-T/2} for R, C' for B,
///   R^{-T/2} for Q; the last row is the right-hand side. Here n, m, p are the filter's n, p, m, and `transposed` says that
///   all matrices, results too, are stored as the filter has them: entry (i, j) of A in the place of (j, i).
/// - The Hessenberg forms, theory (2.8), (2.9): the same with zeros, A(i, j) = 0 for j > i + A_band and C(i, j) = 0 for
///   j > i + C_band. n or more: there are none.
struct ArrayStep {
  Index n = 0, m = 0, p = 0;
  Index A_band = 0, C_band = 0;
  bool transposed = false;
  Source A = {}, B = {}, C = {};  ///< n x n, n x m, p x n
  Source S = {}, Q = {}, R = {};  ///< of each the lower triangle is read; Q null: B holds B Q
  /// U', n x n; if not null, A, B, C and S are in the coordinates U x, but x, and what is asked for of gain and state, not: for x
  /// stands U x, for K U' G Re^{-1}, for Kf' Kf' U, for x_next U' x_next.
  Source U_transposed = {};
  const double* x = nullptr;    ///< n
  const double* y = nullptr;    ///< m
  const double* z = nullptr;    ///< p
  Target S_next = {}, Re = {};  ///< their lower triangles are written
  Target K = {};                ///< n x p; null: neither K nor G is wanted
  bool divide = true;           ///< K, or else G
  double* xi = nullptr;         ///< n
  double* e = nullptr;          ///< m
  /// What an information filter makes of T+ = S+': the gain Kf' = Q (B Q)' T+^{-1} T+^{-T} and the state T+^{-1} xi, n.
  Source QQB = {};              ///< Q (B Q)', m x n, if the caller has it; null: it is formed
  Target Kf = {};               ///< m x n: the transpose of the gain; null: not wanted
  double* x_next = nullptr;     ///< null: not wanted
  /// Reciprocal condition numbers in the 1-norm, an estimate from some order on; null: not wanted.
  double* rcond_of_Re = nullptr;
  double* rcond_of_T = nullptr;  ///< of S+'
  double* work = nullptr;        ///< array_step_work(n, m, p) doubles
};

/// Room for a packed triangle, of whichever of the matrices, and its inverse beside it, in doubles.
constexpr Index packed_room(Index n, Index m, Index p) {
  const Index most = n > m ? (n > p ? n : p) : (m > p ? m : p);
  return 2 * (most + 8) / 8 * 8 * (most + 8);
}

/// How much workspace a step needs, whatever the instruction set: the array, a packed triangle with what is made of it, and the
/// gain of an information filter.
constexpr Index array_step_work(Index n, Index m, Index p) {
  const Index lanes = 8, strips = (p + lanes - 1) / lanes + (n + lanes) / lanes;
  return lanes * (strips * (n + m + p + lanes) + (m / lanes + 1) * n + 1) + packed_room(n, m, p);
}

}  // namespace kfstab::kernels
