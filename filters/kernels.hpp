#pragma once

#include <type_traits>

#include <kfstab/filters/kernels/array_kernel.hpp>
#include <kfstab/filters/kernels/batch_step.hpp>
#include <kfstab/filters/kernels/covariance_kernel.hpp>
#include <kfstab/filters/matrix.hpp>

#ifdef KFSTAB_FILTERS_LIBRARY
#include <span>
#include <string_view>
#endif

/// Where filters of doubles meet their kernels. What a kernel computes the plain text beside it says too, for any scalar;
/// a kernel may give up, and then the plain text does the step.
///
/// Sizes that are known at compile time and small are done by a kernel made for them, for the instruction set that the source
/// is compiled for. All others go to the kernels of the library, which has one for each instruction set and chooses when
/// the program runs, or, where the headers are used without the library, to one compiled in the user's source.
namespace kfstab::kernels {

#ifdef KFSTAB_FILTERS_LIBRARY

/// The kernels of one instruction set.
struct Kernels {
  std::string_view isa;  ///< "sse2", "avx2", "avx512"; elsewhere "neon" or "generic"
  bool (*array_step)(const ArrayStep&);
  bool (*covariance_step)(const CovarianceStep&);
  void (*batch_array_step)(const BatchArrayStep&);
  void (*batch_covariance_step)(const BatchCovarianceStep&);
};

/// Those that this machine can run, the fastest last.
std::span<const Kernels> available();

/// Those that every machine has which can run the library, on x86-64 without fused multiply-adds: the same numbers on all. Null
/// where there are none.
inline const Kernels* everywhere() { return available().empty() ? nullptr : &available().front(); }

/// Those in use: what KFSTAB_ISA in the environment says, else the fastest. Null for KFSTAB_ISA=plain: the plain text.
const Kernels* in_use();

/// From now on, in all threads, the kernels of that name, or "plain". Throws std::invalid_argument if this machine has no
/// such kernels.
void use(std::string_view isa);

/// Throws std::invalid_argument if KFSTAB_ISA names no kernels of this machine.
void check_environment();

inline bool run(const ArrayStep& step) {
  const Kernels* kernels = in_use();
  return kernels && kernels->array_step(step);
}

inline bool run(const CovarianceStep& step) {
  const Kernels* kernels = in_use();
  return kernels && kernels->covariance_step(step);
}

#elif defined(KFSTAB_KERNELS)
inline bool run(const ArrayStep& step) { return KFSTAB_KERNELS::array_step(step); }
inline bool run(const CovarianceStep& step) { return KFSTAB_KERNELS::covariance_step(step); }
#else
inline bool run(const ArrayStep&) { return false; }
inline bool run(const CovarianceStep&) { return false; }
#endif

/// Whether filters of that scalar have kernels.
template <class Scalar>
inline constexpr bool exist = std::is_same_v<Scalar, double>;

/// run(step), for sizes that may be known: n, m, p of the array, has_last and transposed as in ArrayStep.
template <int n, int m, int p, bool has_last, bool transposed>
bool run_sized(const ArrayStep& step) {
#ifdef KFSTAB_KERNELS
  if constexpr (n != Dynamic && m != Dynamic && p != Dynamic)
    if constexpr (KFSTAB_KERNELS::fixed_pays(n, m, p, has_last))
      return KFSTAB_KERNELS::fixed_array_step<n, m, p, has_last, transposed>(step);
#endif
  return run(step);
}

/// How much workspace run needs, or run_sized; none where there are no kernels.
template <class Scalar, int n = Dynamic, int m = Dynamic, int p = Dynamic, bool has_last = false>
Index work_size(Index rows_of_A, Index columns_of_B, Index rows_of_C) {
  if constexpr (!exist<Scalar>) return 0;
#ifdef KFSTAB_KERNELS
  if constexpr (n != Dynamic && m != Dynamic && p != Dynamic)
    if constexpr (KFSTAB_KERNELS::fixed_pays(n, m, p, has_last)) return 0;
#endif
  return array_step_work(rows_of_A, columns_of_B, rows_of_C);
}

/// run(step), for sizes that may be known. With fewer states than this the plain text is as fast.
inline constexpr Index least_states = 4;
template <int n, int m, int p>
bool run_sized(const CovarianceStep& step) {
  if constexpr (n != Dynamic && n < least_states) return false;
#ifdef KFSTAB_KERNELS
  else if constexpr (n != Dynamic && m != Dynamic && p != Dynamic && KFSTAB_KERNELS::fixed_covariance_pays(n, m, p))
    return KFSTAB_KERNELS::fixed_covariance_step<n, m, p>(step);
#endif
  else
    return step.n >= least_states && run(step);
}

/// How much workspace that needs.
template <class Scalar, int n, int m, int p>
Index work_size(const Dimensions& d, bool joseph) {
  if constexpr (!exist<Scalar>) return 0;
#ifdef KFSTAB_KERNELS
  if constexpr (n != Dynamic && m != Dynamic && p != Dynamic)
    if constexpr (KFSTAB_KERNELS::fixed_covariance_pays(n, m, p)) return 0;
#endif
  return covariance_step_work(d.n, d.m, d.p, joseph);
}

/// Eigen's matrices as kernels see them. Those of one row are stored row by row, which for them is column by column.
template <class MatrixType>
Source source(const MatrixType& X) {
  return {X.data(), MatrixType::IsRowMajor ? 1 : X.outerStride()};
}
template <class MatrixType>
Target target(MatrixType& X) {
  return {X.data(), MatrixType::IsRowMajor ? 1 : X.outerStride()};
}

}  // namespace kfstab::kernels
