// Compiled for AVX2 and FMA: filters/CMakeLists.txt.
#include <kfstab/filters/kernels/array_kernel.hpp>
#include <kfstab/filters/kernels/batch_kernel.hpp>
#include <kfstab/filters/kernels/covariance_kernel.hpp>

namespace kfstab::kernels::avx2 {

bool library_array_step(const ArrayStep& step);
bool library_array_step(const ArrayStep& step) { return array_step(step); }
unsigned library_batch_step(const BatchStep& step);
unsigned library_batch_step(const BatchStep& step) { return batch_step(step); }

bool library_covariance_step(const CovarianceStep& step);
bool library_covariance_step(const CovarianceStep& step) { return covariance_step(step); }

}  // namespace kfstab::kernels::avx2
