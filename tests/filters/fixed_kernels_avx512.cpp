#include <kfstab/filters/kernels/array_kernel.hpp>

#include "filters/fixed_kernels.hpp"

bool kfstab::test::fixed_avx512(const kernels::ArrayStep& step) {
  return step.transposed ? kernels::avx512::fixed_array_step<3, 1, 2, true, true>(step)
                         : kernels::avx512::fixed_array_step<4, 2, 2, false, false>(step);
}
