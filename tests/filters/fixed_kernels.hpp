#pragma once

#include <kfstab/filters/kernels/array_step.hpp>
#include <kfstab/filters/kernels/batch_step.hpp>

/// The kernels for sizes that are known at compile time, as a user's source has them that is compiled for one instruction set:
/// fixed_kernels_ISA.cpp.
namespace kfstab::test {

/// n = 4, m = 2, p = 2, as srcf wants it, or n = 3, m = 1, p = 2 with the last row and transposed, as srif does; for AVX-512
/// n = 9, m = 1, p = 9, too.
bool fixed_sse2(const kernels::ArrayStep& step);
bool fixed_avx2(const kernels::ArrayStep& step);
bool fixed_avx512(const kernels::ArrayStep& step);

/// n = 2, m = 1, p = 1 of the array, which have room for two vectors at once, or what has not: n = 5, m = 3, p = 2 for AVX-512,
/// n = 3, m = 1, p = 2 for the others.
void fixed_batch_sse2(const kernels::BatchArrayStep& step);
void fixed_batch_avx2(const kernels::BatchArrayStep& step);
void fixed_batch_avx512(const kernels::BatchArrayStep& step);
void fixed_batch_sse2(const kernels::BatchCovarianceStep& step);
void fixed_batch_avx2(const kernels::BatchCovarianceStep& step);
void fixed_batch_avx512(const kernels::BatchCovarianceStep& step);

}  // namespace kfstab::test
