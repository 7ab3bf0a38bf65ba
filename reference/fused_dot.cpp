#include <kfstab/reference/detail/fused_dot.hpp>

#include <algorithm>
#include <bit>
#include <cstdint>

namespace kfstab::reference::detail {
namespace {

static_assert(GMP_NUMB_BITS == 64, "limbs are taken for 64 bits");

Index limbs_of(mpfr_prec_t bits) { return (bits + 63) / 64; }

/// By mpfr's own functions: what they alone can say of NaN, infinities and overflow. Products are exact, and sums have
/// 64 bits more than the result.
void plain_dot(__mpfr_struct& z, Into into, Line x, Line y, Index count) {
  const mpfr_prec_t precision = mpfr_get_prec(&z);
  mpfr_t sum, term;
  mpfr_init2(sum, precision + 64);
  mpfr_init2(term, 2 * precision);
  mpfr_set_zero(sum, 1);
  if (into != Into::set) mpfr_set(sum, &z, MPFR_RNDN);
  for (Index l = 0; l < count; ++l) {
    mpfr_mul(term, &x[l], &y[l], MPFR_RNDN);
    if (into == Into::subtract) {
      mpfr_sub(sum, sum, term, MPFR_RNDN);
    } else {
      mpfr_add(sum, sum, term, MPFR_RNDN);
    }
  }
  mpfr_set(&z, sum, MPFR_RNDN);
  mpfr_clear(sum);
  mpfr_clear(term);
}

/// The limbs of a number's significand without the zeros at its end, of which doubles have many.
struct Significand {
  const mp_limb_t* limbs;
  Index size;

  explicit Significand(const __mpfr_struct& x) : limbs(x._mpfr_d), size(limbs_of(x._mpfr_prec)) {
    while (*limbs == 0) {
      ++limbs;
      --size;
    }
  }
};

/// A fixed-point number in two's complement; its highest bit is worth -2^(top - 1).
class Accumulator {
 public:
  Accumulator(mpfr_exp_t top, Index size) : top_(top), size_(size) { std::fill_n(limbs_, size, mp_limb_t(0)); }

  /// += or -= (m / 2^(64 size)) 2^exponent, cut off. Overwrites m, and one limb below it.
  void add(mp_limb_t* m, Index size, mpfr_exp_t exponent, bool subtract) {
    const auto shift = static_cast<std::uint64_t>(top_ - exponent);
    const auto whole = static_cast<Index>(shift / 64);
    if (whole >= size_) return;
    if (const auto part = static_cast<unsigned>(shift % 64); part != 0) {
      m[-1] = mpn_rshift(m, m, size, part);
      --m;
      ++size;
    }
    const Index room = size_ - whole;
    const Index used = std::min(size, room);
    m += size - used;
    mp_limb_t* const to = limbs_ + (room - used);
    const mp_limb_t carry = subtract ? mpn_sub_n(to, to, m, used) : mpn_add_n(to, to, m, used);
    for (Index l = room; carry != 0 && l < size_; ++l)
      if (subtract ? limbs_[l]-- != 0 : ++limbs_[l] != 0) break;
  }

  void round_to(__mpfr_struct& z) {
    const bool negative = (limbs_[size_ - 1] >> 63) != 0;
    if (negative) mpn_neg(limbs_, limbs_, size_);
    set_rounded(z, negative, limbs_, size_, top_);
  }

 private:
  mpfr_exp_t top_;
  Index size_;
  mp_limb_t limbs_[most_limbs + 2];
};

}  // namespace

void set_rounded(__mpfr_struct& z, bool negative, mp_limb_t* m, Index size, mpfr_exp_t exponent) {
  while (size > 0 && m[size - 1] == 0) {
    --size;
    exponent -= 64;
  }
  if (size == 0) {
    mpfr_set_zero(&z, 1);
    return;
  }
  if (const int zeros = std::countl_zero(m[size - 1]); zeros != 0) {
    mpn_lshift(m, m, size, static_cast<unsigned>(zeros));
    exponent -= zeros;
  }
  const Index kept = limbs_of(z._mpfr_prec);
  mp_limb_t* const to = z._mpfr_d;
  const Index below = size - kept;  // limbs that go
  if (below < 0) std::fill_n(to, -below, mp_limb_t(0));
  std::copy(m + std::max<Index>(below, 0), m + size, to + std::max<Index>(-below, 0));

  // what is cut off, as a fraction of the last place: its first bit, and whether there is more
  const auto spare = static_cast<unsigned>(64 * kept - z._mpfr_prec);
  bool half = false, more = false;
  Index rest = std::max<Index>(below, 0);
  if (spare != 0) {
    const mp_limb_t cut = to[0] & ((mp_limb_t(1) << spare) - 1);
    to[0] -= cut;
    half = (cut >> (spare - 1)) != 0;
    more = (cut & ((mp_limb_t(1) << (spare - 1)) - 1)) != 0;
  } else if (rest > 0) {
    --rest;
    half = (m[rest] >> 63) != 0;
    more = (m[rest] << 1) != 0;
  }
  if (half) {
    while (!more && rest > 0) more = m[--rest] != 0;
    const mp_limb_t unit = mp_limb_t(1) << spare;
    if ((more || (to[0] & unit) != 0) && mpn_add_1(to, to, kept, unit) != 0) {
      to[kept - 1] = mp_limb_t(1) << 63;
      ++exponent;
    }
  }
  z._mpfr_sign = negative ? -1 : 1;
  z._mpfr_exp = exponent;
}

void fused_dot(__mpfr_struct& z, Into into, Line x, Line y, Index count) {
  // 2^highest exceeds every term; the greatest is at least a quarter of it
  constexpr mpfr_exp_t none = -4 * largest_exponent;
  mpfr_exp_t highest = none;
  bool ordinary = limbs_of(z._mpfr_prec) <= most_limbs;
  for (Index l = 0; l < count; ++l) {
    if (is_ordinary(x[l]) && is_ordinary(y[l])) {
      highest = std::max(highest, x[l]._mpfr_exp + y[l]._mpfr_exp);
    } else {
      ordinary = ordinary && (is_ordinary(x[l]) || is_zero(x[l])) && (is_ordinary(y[l]) || is_zero(y[l]));
    }
  }
  const bool with_z = into != Into::set && !is_zero(z);
  if (with_z) {
    ordinary = ordinary && is_ordinary(z);
    highest = std::max(highest, z._mpfr_exp);
  }
  if (!ordinary) {
    plain_dot(z, into, x, y, count);
    return;
  }
  if (highest == none) {
    mpfr_set_zero(&z, 1);
    return;
  }

  // Room for the sum of all terms and a sign above; below, what is cut off of all terms, less than one unit in the
  // accumulator's last place of each, is at most a quarter of 2^-p (greatest term).
  const auto carries = static_cast<int>(std::bit_width(static_cast<std::size_t>(count) + 1));
  const mpfr_exp_t top = highest + carries + 1;
  Accumulator sum(top, limbs_of(z._mpfr_prec + 2 * carries + 5));
  mp_limb_t term[2 * most_limbs + 1];
  if (with_z) {
    const Significand a(z);
    std::copy_n(a.limbs, a.size, term + 1);
    sum.add(term + 1, a.size, z._mpfr_exp, z._mpfr_sign < 0);
  }
  for (Index l = 0; l < count; ++l) {
    const __mpfr_struct &a = x[l], &b = y[l];
    if (!is_ordinary(a) || !is_ordinary(b)) continue;
    const Significand u(a), v(b);
    if (u.size == v.size) {
      mpn_mul_n(term + 1, u.limbs, v.limbs, u.size);
    } else if (u.size > v.size) {
      mpn_mul(term + 1, u.limbs, u.size, v.limbs, v.size);
    } else {
      mpn_mul(term + 1, v.limbs, v.size, u.limbs, u.size);
    }
    sum.add(term + 1, u.size + v.size, a._mpfr_exp + b._mpfr_exp,
            (a._mpfr_sign != b._mpfr_sign) != (into == Into::subtract));
  }
  sum.round_to(z);
}

}  // namespace kfstab::reference::detail
