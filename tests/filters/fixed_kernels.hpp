#pragma once

#include <kfstab/filters/kernels/array_step.hpp>

/// The kernels for sizes that are known at compile time, as a user's source has them that is compiled for one instruction set:
/// fixed_kernels_ISA.cpp.
namespace kfstab::test {

/// n = 4, m = 2, p = 2, as srcf wants it, or n = 3, m = 1, p = 2 with the last row and transposed, as srif does.
bool fixed_sse2(const kernels::ArrayStep& step);
bool fixed_avx2(const kernels::ArrayStep& step);
bool fixed_avx512(const kernels::ArrayStep& step);

}  // namespace kfstab::test
