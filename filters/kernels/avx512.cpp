// Compiled for AVX-512F and AVX-512DQ: filters/CMakeLists.txt.
#include <kfstab/filters/kernels/array_kernel.hpp>
#include <kfstab/filters/kernels/batch_covariance_kernel.hpp>
#include <kfstab/filters/kernels/covariance_kernel.hpp>

namespace kfstab::kernels::avx512 {

bool library_array_step(const ArrayStep& step);
bool library_array_step(const ArrayStep& step) { return array_step(step); }

bool library_covariance_step(const CovarianceStep& step);
bool library_covariance_step(const CovarianceStep& step) { return covariance_step(step); }

void library_batch_array_step(const BatchArrayStep& step);
void library_batch_array_step(const BatchArrayStep& step) { batch_array_step(step); }
void library_batch_covariance_step(const BatchCovarianceStep& step);
void library_batch_covariance_step(const BatchCovarianceStep& step) { batch_covariance_step(step); }

}  // namespace kfstab::kernels::avx512
