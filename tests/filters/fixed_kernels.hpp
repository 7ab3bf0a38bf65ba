#pragma once

#include <string_view>

#include <kfstab/filters/kernels/array_step.hpp>
#include <kfstab/filters/kernels/batch_step.hpp>

/// The kernels for sizes that are known at compile time, as a user's source has them that is compiled for one instruction set:
/// the text is fixed_kernels_text.hpp, and fixed_kernels_ISA.cpp compile it.
namespace kfstab::test {

struct FixedKernels {
  const char* isa;
  kernels::Index width;  ///< of a vector, in doubles
  /// n = 4, m = 2, p = 2, as srcf wants it, or n = 3, m = 1, p = 2 with the last row and transposed, as srif does; of width 8
  /// n = 9, m = 1, p = 9, too.
  bool (*array)(const kernels::ArrayStep&);
  /// n = 2, m = 1, p = 1 of the array, which have room for two vectors at once, or what has not: n = 5, m = 3, p = 2 of width 8,
  /// n = 3, m = 1, p = 2 of the others.
  void (*batch_array)(const kernels::BatchArrayStep&);
  void (*batch_covariance)(const kernels::BatchCovarianceStep&);
  /// x := x L^{-1}, or x L'^{-1}, K numbers, L stored column by column, K at most most_divided; one after the other (L^{-1} alone),
  /// or by blocks of `width`. Returns whether what is behind them in the last vector is zero. And |L^{-1}| in the 1-norm, or
  /// |L'^{-1}|, by estimate.
  bool (*divide_row)(double* x, const double* L, kernels::Index K, bool transposed, bool by_blocks);
  double (*estimate_of_inverse)(const double* L, kernels::Index K, bool transposed);
};
inline constexpr kernels::Index most_divided = 40;

#if defined(__x86_64__)
extern const FixedKernels fixed_sse2, fixed_avx2, fixed_avx512;
inline const FixedKernels* const all_fixed_kernels[] = {&fixed_sse2, &fixed_avx2, &fixed_avx512};
#else
extern const FixedKernels fixed_only;
inline const FixedKernels* const all_fixed_kernels[] = {&fixed_only};
#endif

/// Those that are compiled for the same machine; null for "plain".
inline const FixedKernels* fixed_kernels(std::string_view isa) {
  for (const FixedKernels* fixed : all_fixed_kernels)
    if (fixed->isa == isa) return fixed;
  return nullptr;
}

}  // namespace kfstab::test
