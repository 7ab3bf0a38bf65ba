#pragma once

#include <kfstab/filters/kernels/array_kernel.hpp>
#include <kfstab/filters/kernels/batch_covariance_kernel.hpp>

#include "filters/fixed_kernels.hpp"

namespace kfstab::test::KFSTAB_KERNELS {

using namespace kernels::KFSTAB_KERNELS;

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

#define KFSTAB_NAME_OF(isa) #isa
#define KFSTAB_NAME(isa) KFSTAB_NAME_OF(isa)
inline constexpr FixedKernels fixed = {KFSTAB_NAME(KFSTAB_KERNELS), width, fixed_array, fixed_batch_array,
                                       fixed_batch_covariance};

}  // namespace kfstab::test::KFSTAB_KERNELS
