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
  Source U = {};  ///< n x n; if not null, the gain is wanted in the coordinates that U came from: U' G Re^{-1}
  const double* x = nullptr;    ///< n
  const double* y = nullptr;    ///< m
  const double* z = nullptr;    ///< p
  Target S_next = {}, Re = {};  ///< their lower triangles are written
  Target K = {};                ///< n x p; null: neither K nor G is wanted
  bool divide = true;           ///< K, or else G
  double* xi = nullptr;         ///< n
  double* e = nullptr;          ///< m
  double* work = nullptr;       ///< array_step_work(n, m, p) doubles
};

/// How much workspace a step needs, whatever the instruction set.
constexpr Index array_step_work(Index n, Index m, Index p) {
  const Index lanes = 8, strips = (p + lanes - 1) / lanes + (n + lanes) / lanes;
  const Index most = n > m ? (n > p ? n : p) : (m > p ? m : p);
  return lanes * (strips * (n + m + p + lanes) + (most / 2 + 1) * (most + 1) + 1);
}

}  // namespace kfstab::kernels
