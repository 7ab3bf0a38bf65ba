#pragma once

#include <cstddef>

#include <mpfr.h>

#include <kfstab/filters/matrix.hpp>

/// Sums of products of mpfr numbers with one rounding, on their limbs: compiled once for all precisions.
namespace kfstab::reference::detail {

/// Numbers in memory at equal distances, in bytes: mpfr's structs lie inside of Boost's numbers.
struct Line {
  const void* first;
  std::ptrdiff_t stride;

  const __mpfr_struct& operator[](Index l) const {
    return *reinterpret_cast<const __mpfr_struct*>(static_cast<const char*>(first) + l * stride);
  }
};

enum class Into { set, add, subtract };

/// z = x'y, z += x'y or z -= x'y, over `count` entries; z may be one of them.
///
/// The error is at most 2^-p (|z| + 1/4 (|z_before| + |x|'|y|)) for a z of p bits: one rounding, of a sum of terms cut
/// off far below. x, y and z have one precision. Where all terms are 0, z is +0.
void fused_dot(__mpfr_struct& z, Into into, Line x, Line y, Index count);

/// z = +-(m / 2^(64 size)) 2^exponent, rounded to nearest, ties to even. m is overwritten.
void set_rounded(__mpfr_struct& z, bool negative, mp_limb_t* m, Index size, mpfr_exp_t exponent);

/// Exponents beyond these, and those of NaN and the infinities, are left to mpfr: here they must add up without
/// overflow.
inline constexpr mpfr_exp_t largest_exponent = mpfr_exp_t(1) << 22;

/// Longer numbers go the plain way: what is worked on lies on the stack.
inline constexpr Index most_limbs = 128;

inline bool is_zero(const __mpfr_struct& x) { return mpfr_zero_p(&x); }
inline bool is_ordinary(const __mpfr_struct& x) {
  return x._mpfr_exp >= -largest_exponent && x._mpfr_exp <= largest_exponent;
}

}  // namespace kfstab::reference::detail
