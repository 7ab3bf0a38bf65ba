#include <kfstab/filters/kernels/array_kernel.hpp>
#include <kfstab/filters/kernels/batch_covariance_kernel.hpp>

#include "filters/fixed_kernels.hpp"

bool kfstab::test::fixed_avx2(const kernels::ArrayStep& step) {
  return step.transposed ? kernels::avx2::fixed_array_step<3, 1, 2, true, true>(step)
                         : kernels::avx2::fixed_array_step<4, 2, 2, false, false>(step);
}

void kfstab::test::fixed_batch_avx2(const kernels::BatchArrayStep& step) {
  using namespace kernels::avx2;
  if (step.information)
    step.n == 2 ? fixed_batch_array_step<2, 1, 1, true>(step) : fixed_batch_array_step<3, 1, 2, true>(step);
  else
    step.n == 2 ? fixed_batch_array_step<2, 1, 1, false>(step) : fixed_batch_array_step<3, 1, 2, false>(step);
}

void kfstab::test::fixed_batch_avx2(const kernels::BatchCovarianceStep& step) {
  using namespace kernels::avx2;
  step.n == 2 ? fixed_batch_covariance_step<2, 1, 1>(step) : fixed_batch_covariance_step<3, 1, 2>(step);
}
