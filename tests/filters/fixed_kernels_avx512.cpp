#include <kfstab/filters/kernels/array_kernel.hpp>
#include <kfstab/filters/kernels/batch_covariance_kernel.hpp>

#include "filters/fixed_kernels.hpp"

bool kfstab::test::fixed_avx512(const kernels::ArrayStep& step) {
  return step.n == 9       ? kernels::avx512::fixed_array_step<9, 1, 9, false, false>(step)
         : step.transposed ? kernels::avx512::fixed_array_step<3, 1, 2, true, true>(step)
                         : kernels::avx512::fixed_array_step<4, 2, 2, false, false>(step);
}

void kfstab::test::fixed_batch_avx512(const kernels::BatchArrayStep& step) {
  using namespace kernels::avx512;
  if (step.information)
    step.n == 2 ? fixed_batch_array_step<2, 1, 1, true>(step) : fixed_batch_array_step<5, 3, 2, true>(step);
  else
    step.n == 2 ? fixed_batch_array_step<2, 1, 1, false>(step) : fixed_batch_array_step<5, 3, 2, false>(step);
}

void kfstab::test::fixed_batch_avx512(const kernels::BatchCovarianceStep& step) {
  using namespace kernels::avx512;
  step.n == 2 ? fixed_batch_covariance_step<2, 1, 1>(step) : fixed_batch_covariance_step<5, 3, 2>(step);
}
