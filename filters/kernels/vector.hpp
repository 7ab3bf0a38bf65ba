#pragma once

/// Vectors of doubles as wide as this source is compiled for, and the few things that kernels do with them.
///
/// Everything that is compiled differently for each instruction set stands in a namespace named after it, kfstab::kernels::
/// KFSTAB_KERNELS: sources compiled for several sets link into one program, and the linker, which keeps one of several
/// inline functions of one name, must not keep for all what only a newer machine can run. For the same reason kernels
/// include nothing with functions of its own, neither Eigen nor the standard library.
///
/// A fused multiply-add happens where fma stands, if the instruction set has it, and nowhere else.

#if defined(__GNUC__)  // g++ and clang: vector extensions

#include <kfstab/filters/kernels/array_step.hpp>

#if defined(__AVX512F__) && defined(__AVX512DQ__)
#include <immintrin.h>
#define KFSTAB_KERNELS avx512
#define KFSTAB_VECTOR_WIDTH 8
#elif defined(__AVX2__) && defined(__FMA__)
#include <immintrin.h>
#define KFSTAB_KERNELS avx2
#define KFSTAB_VECTOR_WIDTH 4
#elif defined(__SSE2__)
#include <emmintrin.h>
#define KFSTAB_KERNELS sse2
#define KFSTAB_VECTOR_WIDTH 2
#else
#if defined(__aarch64__)
#include <arm_neon.h>
#define KFSTAB_KERNELS neon
#else
#define KFSTAB_KERNELS generic
#endif
#define KFSTAB_VECTOR_WIDTH 2
#endif

#define KFSTAB_INLINE inline __attribute__((always_inline))
#define KFSTAB_INLINED __attribute__((always_inline))  // of a lambda

namespace kfstab::kernels::KFSTAB_KERNELS {

inline constexpr Index width = KFSTAB_VECTOR_WIDTH;
using V = double __attribute__((vector_size(8 * KFSTAB_VECTOR_WIDTH)));

constexpr Index least(Index a, Index b) { return a < b ? a : b; }
constexpr Index greatest(Index a, Index b) { return a > b ? a : b; }

KFSTAB_INLINE V splat(double x) { return x - V{}; }

/// a b + c
KFSTAB_INLINE V fma(V a, V b, V c) {
#if KFSTAB_VECTOR_WIDTH == 8
  return _mm512_fmadd_pd(a, b, c);
#elif KFSTAB_VECTOR_WIDTH == 4
  return _mm256_fmadd_pd(a, b, c);
#elif defined(__aarch64__)
  return vfmaq_f64(c, a, b);
#else
  return a * b + c;
#endif
}

KFSTAB_INLINE double fma(double a, double b, double c) {
#if defined(__FMA__) || defined(__aarch64__)
  return __builtin_fma(a, b, c);
#else
  return a * b + c;
#endif
}

KFSTAB_INLINE double root(double x) { return __builtin_sqrt(x); }

KFSTAB_INLINE V root(V x) {
#if KFSTAB_VECTOR_WIDTH == 8
  return _mm512_maskz_sqrt_pd(0xff, x);  // g++ 12 warns of the other
#elif KFSTAB_VECTOR_WIDTH == 4
  return _mm256_sqrt_pd(x);
#elif defined(__SSE2__)
  return _mm_sqrt_pd(x);
#else
  for (Index l = 0; l < width; ++l) x[l] = __builtin_sqrt(x[l]);
  return x;
#endif
}

/// Lane J in all lanes.
template <Index J>
KFSTAB_INLINE V lane(V x) {
#if KFSTAB_VECTOR_WIDTH == 8
  return __builtin_shufflevector(x, x, J, J, J, J, J, J, J, J);
#elif KFSTAB_VECTOR_WIDTH == 4
  return __builtin_shufflevector(x, x, J, J, J, J);
#else
  return __builtin_shufflevector(x, x, J, J);
#endif
}

/// Lane j in all lanes.
KFSTAB_INLINE V lane_of(V x, Index j) {
#if KFSTAB_VECTOR_WIDTH == 8
  return _mm512_maskz_permutexvar_pd(0xff, _mm512_set1_epi64(j), x);
#else
  return splat(x[j]);
#endif
}

using Lanes = decltype(V{} < V{});  ///< of integers: all bits or none
#if KFSTAB_VECTOR_WIDTH == 8
inline constexpr Lanes lane_numbers = {0, 1, 2, 3, 4, 5, 6, 7};
#elif KFSTAB_VECTOR_WIDTH == 4
inline constexpr Lanes lane_numbers = {0, 1, 2, 3};
#else
inline constexpr Lanes lane_numbers = {0, 1};
#endif

KFSTAB_INLINE bool all_zero(V x) {
  bool zero = true;
  for (Index l = 0; l < width; ++l) zero = zero && x[l] == 0;
  return zero;
}

KFSTAB_INLINE bool any(Lanes x) {
#if KFSTAB_VECTOR_WIDTH == 8
  return _mm512_movepi64_mask((__m512i)x) != 0;
#else
  bool some = false;
  for (Index l = 0; l < width; ++l) some = some || x[l] != 0;
  return some;
#endif
}

/// x in the lanes from J on, 0 in those before.
template <Index J>
KFSTAB_INLINE V from_lane(V x) {
  return (V)((Lanes)x & (lane_numbers >= J));
}

/// x in the lanes low ... high - 1, 0 in the others.
KFSTAB_INLINE V in_lanes(Index low, Index high, V x) {
  return (V)((Lanes)x & (lane_numbers >= low) & (lane_numbers < high));
}

/// x, with y in lane J.
KFSTAB_INLINE V with_lane(Index J, V x, V y) { return lane_numbers == J ? y : x; }

/// All lanes from data[l], which need not be aligned.
KFSTAB_INLINE V load(const double* data) {
  V x;
  __builtin_memcpy(&x, data, sizeof(V));
  return x;
}

/// Lanes low ... high - 1 from data[l stride], 0 in the others, which are not read.
KFSTAB_INLINE V load(const double* data, Index stride, Index low, Index high) {
#if KFSTAB_VECTOR_WIDTH == 8
  const auto mask = static_cast<__mmask8>((0xffu << low) & ~(~0u << high));
  if (stride == 1) return _mm512_maskz_loadu_pd(mask, data);
  return _mm512_mask_i64gather_pd(V{}, mask, (__m512i)(lane_numbers * stride), data, 8);
#elif KFSTAB_VECTOR_WIDTH == 4
  const auto mask = (lane_numbers >= low) & (lane_numbers < high);
  if (stride == 1) return _mm256_maskload_pd(data, (__m256i)mask);
  return _mm256_mask_i64gather_pd(V{}, data, (__m256i)(lane_numbers * stride), (__m256d)mask, 8);
#else
  V x{};
  for (Index l = low; l < high; ++l) x[l] = data[l * stride];
  return x;
#endif
}

/// data[l stride] = lane l, for l = low ... high - 1.
KFSTAB_INLINE void store(double* data, Index stride, Index low, Index high, V x) {
#if KFSTAB_VECTOR_WIDTH == 8
  const auto mask = static_cast<__mmask8>((0xffu << low) & ~(~0u << high));
  if (stride == 1) return _mm512_mask_storeu_pd(data, mask, x);
#elif KFSTAB_VECTOR_WIDTH == 4
  if (stride == 1) return _mm256_maskstore_pd(data, (__m256i)((lane_numbers >= low) & (lane_numbers < high)), x);
#endif
  for (Index l = low; l < high; ++l) data[l * stride] = x[l];
}

/// A number that is known when the kernel is compiled. Loops over one are unrolled; over an Index they stay loops.
template <Index I>
struct Constant {
  static constexpr Index value = I;
  KFSTAB_INLINE constexpr operator Index() const { return I; }
};

template <Index A, Index B>
KFSTAB_INLINE constexpr Constant<A + B> operator+(Constant<A>, Constant<B>) {
  return {};
}
template <Index A, Index B>
KFSTAB_INLINE constexpr Constant<A - B> operator-(Constant<A>, Constant<B>) {
  return {};
}

/// 0 ... count - 1.
template <Index...>
struct IndexList {};
#if defined(__clang__)
template <class, Index... I>
using IndexListOf = IndexList<I...>;
template <Index count>
using IndicesBelow = __make_integer_seq<IndexListOf, Index, count>;
#else
template <Index count>
using IndicesBelow = IndexList<__integer_pack(count)...>;
#endif

/// f(i) for i = first ... last - 1. Where f takes an Index and not a Constant it is compiled once, and still unrolled. Not by
/// recursion: a compiler that inlines one call after the other would look at what follows the i-th i times.
template <Index First, Index... I, class F>
KFSTAB_INLINE void each_in(IndexList<I...>, F&& f) {
  (f(Constant<First + I>{}), ...);
}
template <Index First, Index Last, class F>
KFSTAB_INLINE void each(Constant<First>, Constant<Last>, F&& f) {
  if constexpr (First < Last) each_in<First>(IndicesBelow<Last - First>{}, f);
}
template <class F>
KFSTAB_INLINE void each(Index first, Index last, F&& f) {
  for (Index i = first; i < last; ++i) f(i);
}

}  // namespace kfstab::kernels::KFSTAB_KERNELS

#endif
