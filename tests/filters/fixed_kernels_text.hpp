#pragma once

#include <kfstab/filters/kernels/array_kernel.hpp>
#include <kfstab/filters/kernels/batch_covariance_kernel.hpp>

#include "filters/fixed_kernels.hpp"

namespace kfstab::test::KFSTAB_KERNELS {

using namespace kernels::KFSTAB_KERNELS;
using kernels::Index;

inline bool fixed_array(const kernels::ArrayStep& step) {
  if constexpr (width == 8)
    if (step.n == 9) return fixed_array_step<9, 1, 9, false, false>(step);
  return step.transposed ? fixed_array_step<3, 1, 2, true, true>(step) : fixed_array_step<4, 2, 2, false, false>(step);
}

/// What has no room for two vectors at once.
inline constexpr int N = width == 8 ? 5 : 3, M = width == 8 ? 3 : 1, P = 2;

inline void fixed_batch_array(const kernels::BatchArrayStep& step) {
  if (step.information)
    step.n == 2 ? fixed_batch_array_step<2, 1, 1, true>(step) : fixed_batch_array_step<N, M, P, true>(step);
  else
    step.n == 2 ? fixed_batch_array_step<2, 1, 1, false>(step) : fixed_batch_array_step<N, M, P, false>(step);
}

inline void fixed_batch_covariance(const kernels::BatchCovarianceStep& step) {
  step.n == 2 ? fixed_batch_covariance_step<2, 1, 1>(step) : fixed_batch_covariance_step<N, M, P>(step);
}

struct PackedTriangle {
  V rows[packed_size(most_divided)];
  PackedTriangle(const double* L, Index K) { pack_lower({false}, {L, K}, K, rows); }
};

inline bool divide_one_row(double* x, const double* L, Index K, bool transposed, bool by_blocks) {
  const PackedTriangle packed(L, K);
  V row[strips_of(most_divided)] = {}, work[2 * width * strips_of(most_divided)];
  for (Index k = 0; k < K; ++k) row[k / width][k % width] = x[k];
  if (!by_blocks) {
    divide_row(row, packed.rows, K);
  } else {
    const DiagonalInverses inverses(packed.rows, K, work);
    transposed ? solve_row_transposed(row, packed.rows, K, inverses) : solve_row(row, packed.rows, K, inverses);
  }
  bool zero_behind = true;
  for (Index k = 0; k < strips_of(K) * width; ++k) {
    const double entry = row[k / width][k % width];
    if (k < K)
      x[k] = entry;
    else
      zero_behind = zero_behind && entry == 0;
  }
  return zero_behind;
}

inline double estimate(const double* L, Index K, bool transposed) {
  const PackedTriangle packed(L, K);
  V work[(3 + 2 * width) * strips_of(most_divided)];
  return estimate_of_inverse(packed.rows, K, transposed ? Of::transpose : Of::triangle, work);
}

#define KFSTAB_NAME_OF(isa) #isa
#define KFSTAB_NAME(isa) KFSTAB_NAME_OF(isa)
inline constexpr FixedKernels fixed = {KFSTAB_NAME(KFSTAB_KERNELS), width, fixed_array, fixed_batch_array,
                                       fixed_batch_covariance, divide_one_row, estimate};

}  // namespace kfstab::test::KFSTAB_KERNELS
