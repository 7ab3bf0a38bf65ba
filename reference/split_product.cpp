#include <kfstab/reference/detail/split_product.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <new>

// How splitting works, for Z = X Y with inner dimension k.
//
// Row i of X is divided by 2^(a_i + 1), column j of Y by 2^(b_j + 1), so that all entries lie within (-1/2, 1/2); then
// each is cut into digits of beta bits, x = sum_s x_s 2^(-beta (s+1)) with whole |x_s| <= 2^(beta-1), and likewise y.
// So
//
//     sum_l x_l y_l = sum_v 2^(-beta (v+2)) C_v,   C_v = sum_{s+t=v} sum_l x_ls y_lt.
//
// Each C_v is a sum of at most k (v+1) whole numbers of at most 2^(2 beta - 2), and beta is such that no partial sum
// exceeds 2^53: doubles hold it exactly, whatever the order of summation. With the digits of X in rising and those of Y
// in falling order, C_v is one product of matrices of doubles with inner dimension k (v+1), its operands contiguous.
// The C_v are carried into one fixed-point number, and that is rounded once.
//
// What is lost, with q = beta S bits kept of x and y and v < S: cutting x off costs less than 2^-q |y| < 2^(-q-1),
// likewise y, and each pair s + t >= S at most 2^(-q-2), of which S - 1 have s + t = S, and those beyond add less than
// one more. In the units of Z that is less than
//
//     k (S + 4) 2^(a_i + b_j - q) <= 1/4 2^-p 2^(e_ij - 2) <= 1/4 2^-p (|X| |Y|)_ij
//
// where e_ij = max_l (exponent of x_il + exponent of y_lj), if q >= p + 4 + log2 k (S + 4) + max_ij (a_i + b_j - e_ij).
// That last maximum, the spread, is computed. It is what a bad scaling costs; that of the inner index (states in other
// units) is taken away before, by moving powers of two from column l of X to row l of Y.

#if defined(__x86_64__) && defined(__GNUC__)
#define KFSTAB_X86 1
#else
#define KFSTAB_X86 0
#endif

namespace kfstab::reference::detail {
namespace {

constexpr Index lanes = 8;  // lines (rows of X, columns of Y) side by side in a panel

using Doubles = double __attribute__((vector_size(8 * lanes)));
using Words = std::uint64_t __attribute__((vector_size(8 * lanes)));
using Floats = float __attribute__((vector_size(4 * lanes)));

constexpr float nothing = -std::numeric_limits<float>::infinity();  // the exponent of 0

Index ceil_div(Index a, Index b) { return (a + b - 1) / b; }
int width_of(Index a) { return static_cast<int>(std::bit_width(static_cast<std::size_t>(a))); }

/// Memory that is kept from one product to the next, by each thread. Not std::vector: the allocator of a vector type
/// does not heed its alignment.
template <class T>
class Buffer {
 public:
  /// Room for as many; what was there before is lost.
  T* reserve(Index size) {
    if (size > size_) {
      memory_.reset(static_cast<T*>(::operator new(static_cast<std::size_t>(size) * sizeof(T), alignment)));
      size_ = size;
    }
    return memory_.get();
  }
  T* operator+(Index at) const { return memory_.get() + at; }
  T& operator[](Index at) const { return memory_.get()[at]; }

 private:
  static constexpr std::align_val_t alignment{64};
  struct Delete {
    void operator()(T* memory) const { ::operator delete(memory, alignment); }
  };
  std::unique_ptr<T, Delete> memory_;
  Index size_ = 0;
};

/// One operand: `lines` of `inner` entries each, in panels of eight lines side by side.
struct Operand {
  Entries entries;  // (line, l)
  Index lines = 0, inner = 0, panels = 0;
  Buffer<Floats> exponents;  // [panel][l]: 2^exponent exceeds the entry
  Buffer<Floats> lowest;     // [panel][l]: exponent of its last bit
  Buffer<Floats> top;        // [panel]: greatest exponent of a line
  Buffer<Doubles> digits;    // [panel][digit][l], or with the digits in falling order
  Index digit_count = 0;

  Floats* exponents_of(Index panel) { return exponents + panel * inner; }
  Floats* lowest_of(Index panel) { return lowest + panel * inner; }
  Doubles* digits_of(Index panel) { return digits + panel * inner * digit_count; }

  /// False if an entry is not finite, or out of all proportion.
  bool read(Entries from, Index lines_, Index inner_) {
    entries = from;
    lines = lines_;
    inner = inner_;
    panels = ceil_div(lines, lanes);
    exponents.reserve(panels * inner);
    lowest.reserve(panels * inner);
    top.reserve(panels);
    for (Index panel = 0; panel < panels; ++panel)
      for (Index l = 0; l < inner; ++l) {
        Floats exponent, low;
        for (Index lane = 0; lane < lanes; ++lane) {
          exponent[lane] = nothing;
          low[lane] = -nothing;
          const Index line = panel * lanes + lane;
          if (line >= lines) continue;
          const __mpfr_struct& x = entries.row(line)[l];
          if (is_ordinary(x)) {
            const auto size = (x._mpfr_prec + 63) / 64;
            mpfr_prec_t unused = 0;
            const mp_limb_t* limb = x._mpfr_d;
            for (; *limb == 0; ++limb) unused += 64;
            unused += std::countr_zero(*limb);
            exponent[lane] = static_cast<float>(x._mpfr_exp);
            low[lane] = static_cast<float>(x._mpfr_exp - 64 * size + unused);
          } else if (!is_zero(x)) {
            return false;
          }
        }
        exponents_of(panel)[l] = exponent;
        lowest_of(panel)[l] = low;
      }
    return true;
  }

  float greatest(Index l) {
    float most = nothing;
    for (Index panel = 0; panel < panels; ++panel)
      for (Index lane = 0; lane < lanes; ++lane) most = std::max(most, exponents_of(panel)[l][lane]);
    return most;
  }

  void scale(Index l, float power) {
    for (Index panel = 0; panel < panels; ++panel) {
      exponents_of(panel)[l] += power;
      lowest_of(panel)[l] += power;
    }
  }

  void drop(Index l) {
    for (Index panel = 0; panel < panels; ++panel) {
      exponents_of(panel)[l] = Floats{} + nothing;
      lowest_of(panel)[l] = Floats{} - nothing;
    }
  }

  /// Finds the lines' greatest exponents; returns how many bits below the greatest exponent, at most, an entry has.
  float find_tops() {
    float depth = 0;
    for (Index panel = 0; panel < panels; ++panel) {
      Floats most = Floats{} + nothing, least = Floats{} - nothing;
      for (Index l = 0; l < inner; ++l) {
        const Floats e = exponents_of(panel)[l], low = lowest_of(panel)[l];
        most = e > most ? e : most;
        least = low < least ? low : least;
      }
      top[panel] = most;
      for (Index lane = 0; lane < lanes; ++lane)
        if (most[lane] != nothing) depth = std::max(depth, most[lane] - least[lane]);
    }
    return depth;
  }
};

struct Workspace {
  Operand x, y;
  Buffer<Doubles> sums;
  Buffer<Words> limbs;
};

/// The width of the digits and how many of them.
struct Cut {
  int bits = 0;       // beta
  Index digits = 0;   // S
  Index weights = 0;  // C_v are computed for v < weights
};

/// max_ij (a_i + b_j - e_ij) over all e_ij that there are; of a symmetric product, in the lower triangle.
inline __attribute__((always_inline)) float spread_of(Operand& x, Operand& y, Structure structure) {
  Floats most{};
  for (Index p = 0; p < x.panels; ++p)
    for (Index q = 0; q < (structure == Structure::symmetric ? p + 1 : y.panels); ++q) {
      Floats e[lanes];
      for (Index j = 0; j < lanes; ++j) e[j] = Floats{} + nothing;
      const Floats *ex = x.exponents_of(p), *ey = y.exponents_of(q);
      for (Index l = 0; l < x.inner; ++l) {
        const Floats a = ex[l];
#pragma GCC unroll 8
        for (Index j = 0; j < lanes; ++j) {
          const Floats sum = a + ey[l][j];
          e[j] = sum > e[j] ? sum : e[j];
        }
      }
      const Floats a = x.top[p], b = y.top[q];
      for (Index j = 0; j < lanes; ++j) {
        const Floats gap = a + b[j] - e[j];  // infinite or NaN where there is no e
        most = gap > most && gap < -nothing ? gap : most;
      }
    }
  float greatest = 0;
  for (Index lane = 0; lane < lanes; ++lane) greatest = std::max(greatest, most[lane]);
  return greatest;
}

/// Cuts all entries into digits.
inline __attribute__((always_inline)) void split_into_digits(Operand& x, const Cut& cut, bool falling, Words* u) {
  const Index L = ceil_div(x.digit_count * cut.bits, 64);
  const Words mask = Words{} + ((std::uint64_t(1) << cut.bits) - 1);
  const Words two52 = Words{} + std::bit_cast<std::uint64_t>(0x1p52), one = Words{} + std::bit_cast<std::uint64_t>(1.0);
  const double half = std::ldexp(0.5, cut.bits), whole = std::ldexp(1.0, cut.bits);
  for (Index panel = 0; panel < x.panels; ++panel)
    for (Index l = 0; l < x.inner; ++l) {
      // magnitudes, as fixed-point numbers of L limbs
      std::fill_n(u, L + 1, Words{});
      Words signs{};
      const Index first = panel * lanes, present = std::min(lanes, x.lines - first);
      for (Index lane = 0; lane < present; ++lane) {
        const float exponent = x.exponents_of(panel)[l][lane];
        if (exponent == nothing) continue;
        const __mpfr_struct& entry = x.entries.row(first + lane)[l];
        const auto shift = static_cast<Index>(x.top[panel][lane] - exponent) + 1;
        const Index size = (entry._mpfr_prec + 63) / 64;
        const mp_limb_t* limb = entry._mpfr_d + size;
        const auto part = static_cast<unsigned>(shift % 64);
        Index t = L - 1 - shift / 64;
        mp_limb_t above = 0;
        const Index last = std::max<Index>(t - size + 1, 0);
        if (part == 0) {
          for (; t >= last; --t) u[t][lane] = *--limb;
        } else {
          for (; t >= last; --t) {
            const mp_limb_t here = *--limb;
            u[t][lane] = above << (64 - part) | here >> part;
            above = here;
          }
          if (t >= 0) u[t][lane] = above << (64 - part);
        }
        if (entry._mpfr_sign < 0) signs[lane] = std::uint64_t(1) << 63;
      }
      // digits from the last: those of at least half are made negative, and carry
      Doubles carry{};
      for (Index s = x.digit_count - 1; s >= 0; --s) {
        const Index at = 64 * L - cut.bits * (s + 1);
        const auto part = static_cast<unsigned>(at % 64);
        Words word = u[at / 64] >> part;
        if (part + static_cast<unsigned>(cut.bits) > 64) word |= u[at / 64 + 1] << (64 - part);
        Doubles digit = reinterpret_cast<Doubles>((word & mask) | two52) - 0x1p52 + carry;
        if (s > 0) {  // the first has room for it: |x| < 1/2
          carry = reinterpret_cast<Doubles>(reinterpret_cast<Words>(digit >= half) & one);
          digit -= carry * whole;
        }
        x.digits_of(panel)[(falling ? x.digit_count - 1 - s : s) * x.inner + l] =
            reinterpret_cast<Doubles>(reinterpret_cast<Words>(digit) ^ signs);
      }
    }
}

/// c[j] = sum_l x[l] y[l][j] for some of the columns j and some of the lanes of x: as many sums as there are registers
/// for, and enough to hide a multiply-add's latency.
template <class Vector, Index cols, Index parts, Index chains>
inline __attribute__((always_inline)) void multiply_block(const double* x, const double* y, Index length, double* c) {
  Vector sum[chains][cols][parts] = {};
  Index l = 0;
  for (; l + chains <= length; l += chains)
#pragma GCC unroll 8
    for (Index chain = 0; chain < chains; ++chain)
#pragma GCC unroll 8
      for (Index j = 0; j < cols; ++j)
#pragma GCC unroll 8
        for (Index i = 0; i < parts; ++i)
          sum[chain][j][i] += reinterpret_cast<const Vector*>(x + (l + chain) * lanes)[i] * y[(l + chain) * lanes + j];
  for (; l < length; ++l)
#pragma GCC unroll 8
    for (Index j = 0; j < cols; ++j)
#pragma GCC unroll 8
      for (Index i = 0; i < parts; ++i)
        sum[0][j][i] += reinterpret_cast<const Vector*>(x + l * lanes)[i] * y[l * lanes + j];
#pragma GCC unroll 8
  for (Index j = 0; j < cols; ++j)
#pragma GCC unroll 8
    for (Index i = 0; i < parts; ++i) {
#pragma GCC unroll 8
      for (Index chain = 1; chain < chains; ++chain) sum[0][j][i] += sum[chain][j][i];
      reinterpret_cast<Vector*>(c + j * lanes)[i] = sum[0][j][i];
    }
}

/// All lanes, for the first `cols` columns or more.
template <class Vector>
inline __attribute__((always_inline)) void multiply_panels(const double* x, const double* y, Index length, Index cols,
                                                           double* c) {
  constexpr Index width = sizeof(Vector) / sizeof(double), half = lanes / 2;
  if constexpr (width == lanes) {
    if (cols <= half) {
      multiply_block<Vector, half, 1, 2>(x, y, length, c);
    } else {
      multiply_block<Vector, lanes, 1, 1>(x, y, length, c);
    }
  } else {
    for (Index j = 0; j < cols; j += half)
      for (Index i = 0; i < lanes; i += 2 * width)
        multiply_block<Vector, half, 2, 1>(x + i, y + j, length, c + j * lanes + i);
  }
}

/// The C_v of a panel of X and one of Y, carried into fixed-point numbers in two's complement: limbs[t][j], L and one
/// more above. As a fraction of the L limbs they are z 2^(beta - a_i - b_j - 2).
template <class Vector>
inline __attribute__((always_inline)) void multiply_tile(Operand& x, Index p, Operand& y, Index q, const Cut& cut,
                                                         Doubles* sums, Words* limbs) {
  const Index cols = std::min(lanes, y.lines - q * lanes);
  for (Index v = 0; v < cut.weights; ++v) {
    const Index first = std::max<Index>(0, v - y.digit_count + 1), last = std::min(v, x.digit_count - 1);
    multiply_panels<Vector>(reinterpret_cast<const double*>(x.digits_of(p) + first * x.inner),
                            reinterpret_cast<const double*>(y.digits_of(q) + (y.digit_count - 1 - v + first) * x.inner),
                            (last - first + 1) * x.inner, cols, reinterpret_cast<double*>(sums + v * lanes));
  }
  const Index L = ceil_div(cut.weights * cut.bits, 64);
  std::fill_n(limbs, (L + 1) * lanes, Words{});
  const double down = std::ldexp(1.0, -cut.bits), up = std::ldexp(1.0, cut.bits);
  const Words two52 = Words{} + std::bit_cast<std::uint64_t>(0x1p52);
  Doubles carry[lanes] = {};
  for (Index v = cut.weights - 1; v >= 0; --v) {
    const Index at = 64 * L - cut.bits * (v + 1);
    const auto part = static_cast<unsigned>(at % 64);
    for (Index j = 0; j < cols; ++j) {
      const Doubles sum = sums[v * lanes + j] + carry[j];
      Doubles next = (sum * down + 0x1.8p52) - 0x1.8p52;  // to the nearest whole number
      Doubles digit = sum - next * up;
      const auto negative = reinterpret_cast<Words>(digit < 0);
      next -= reinterpret_cast<Doubles>(negative & (Words{} + std::bit_cast<std::uint64_t>(1.0)));
      digit += reinterpret_cast<Doubles>(negative & (Words{} + std::bit_cast<std::uint64_t>(up)));
      carry[j] = next;
      const Words word = reinterpret_cast<Words>(digit + 0x1p52) ^ two52;
      limbs[at / 64 * lanes + j] |= word << part;
      if (part + static_cast<unsigned>(cut.bits) > 64) limbs[(at / 64 + 1) * lanes + j] |= word >> (64 - part);
    }
  }
  for (Index j = 0; j < cols; ++j)
    limbs[L * lanes + j] = reinterpret_cast<Words>(carry[j] + 0x1.8p52) - std::bit_cast<std::uint64_t>(0x1.8p52);
}

// ---- the same for each width of vectors ----

struct Kernels {
  float (*spread)(Operand& x, Operand& y, Structure structure);
  void (*split)(Operand& x, const Cut& cut, bool falling, Words* limbs);
  void (*tile)(Operand& x, Index p, Operand& y, Index q, const Cut& cut, Doubles* sums, Words* limbs);
};

#define KFSTAB_KERNELS(width, target)                                                                                \
  struct KernelsOf##width {                                                                                          \
    using Vector = double __attribute__((vector_size(8 * width)));                                                   \
    target static float spread(Operand& x, Operand& y, Structure structure) { return spread_of(x, y, structure); }   \
    target static void split(Operand& x, const Cut& cut, bool falling, Words* limbs) {                               \
      split_into_digits(x, cut, falling, limbs);                                                                     \
    }                                                                                                                \
    target static void tile(Operand& x, Index p, Operand& y, Index q, const Cut& cut, Doubles* sums, Words* limbs) { \
      multiply_tile<Vector>(x, p, y, q, cut, sums, limbs);                                                           \
    }                                                                                                                \
    static constexpr Kernels kernels{spread, split, tile};                                                           \
  };

KFSTAB_KERNELS(2, )
#if KFSTAB_X86
KFSTAB_KERNELS(4, __attribute__((target("avx2,fma"))))
KFSTAB_KERNELS(8, __attribute__((target("avx512f,avx512dq,avx512vl,avx2,fma"))))
#endif

const Kernels& kernels_for(Vectors vectors) {
#if KFSTAB_X86
  if (vectors == Vectors::of_8) return KernelsOf8::kernels;
  if (vectors == Vectors::of_4) return KernelsOf4::kernels;
#endif
  static_cast<void>(vectors);
  return KernelsOf2::kernels;
}

/// Digits as wide as can be, and as few as will do for `bits` bits beside log2 k (S + 4). None if k is too large.
Cut cut_for(Index inner, float bits) {
  Cut cut;
  for (cut.digits = 1;; ++cut.digits) {
    // k S 2^(2 beta - 2) and a carry of less than one term more are at most 2^53, if beta >= 19
    cut.bits = (55 - width_of(inner * cut.digits)) / 2;
    if (cut.bits < 19) return {};
    if (static_cast<float>(cut.digits * cut.bits) >= bits + static_cast<float>(width_of(inner * (cut.digits + 4))))
      return cut;
  }
}

/// Divides out the scales of the inner index, and drops what meets nothing but zeros.
void equilibrate(Operand& x, Operand& y) {
  for (Index l = 0; l < x.inner; ++l) {
    const float ex = x.greatest(l), ey = y.greatest(l);
    if (ex == nothing || ey == nothing) {
      x.drop(l);
      y.drop(l);
    } else {
      const float power = std::floor((ey - ex) / 2);
      x.scale(l, power);
      y.scale(l, -power);
    }
  }
}

/// Splitting costs so much for each entry of X, Y and Z, and saves so much for each term. Where they break even was
/// measured (docs/performance.md); it is nearly the same for all precisions, as both grow with them. With vectors of
/// two doubles alone, limbs multiply faster than digits from 7 limbs on.
bool pays(Shape shape, Structure structure, mpfr_prec_t precision, Vectors vectors) {
  const Index results = structure == Structure::symmetric ? shape.rows * (shape.rows + 1) / 2 : shape.rows * shape.cols;
  const Index entries = shape.rows * shape.inner + shape.inner * shape.cols + results;
  const Index terms = results * shape.inner;
  switch (vectors) {
    case Vectors::of_8: return 2 * terms >= 3 * entries;
    case Vectors::of_4: return 2 * terms >= 4 * entries;
    case Vectors::of_2: break;
  }
  return 2 * terms >= 5 * entries && precision <= 400;
}

/// A number of z's precision in memory of its own.
struct Scratch {
  explicit Scratch(const __mpfr_struct& z) { mpfr_custom_init_set(&number, MPFR_ZERO_KIND, 0, z._mpfr_prec, limbs); }
  mp_limb_t limbs[most_limbs];
  __mpfr_struct number;
};

void mirror(Results Z, Index i, Index j) {
  if (i != j) mpfr_set(&Z(j, i), &Z(i, j), MPFR_RNDN);
}

}  // namespace

Vectors widest_vectors() {
#if KFSTAB_X86
  static const Vectors widest = [] {
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
      return Vectors::of_8;
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") ? Vectors::of_4 : Vectors::of_2;
  }();
  return widest;
#else
  return Vectors::of_2;
#endif
}

void multiply_by_dots(Results Z, Into into, Entries X, Entries Y, Shape shape, Structure structure) {
  const bool symmetric = structure == Structure::symmetric;
  for (Index j = 0; j < shape.cols; ++j)
    for (Index i = symmetric ? j : 0; i < shape.rows; ++i) {
      fused_dot(Z(i, j), into, X.row(i), Y.column(j), shape.inner);
      if (symmetric) mirror(Z, i, j);
    }
}

bool multiply_by_splitting(Results Z, Into into, Entries X, Entries Y, Shape shape, Structure structure,
                           Vectors vectors) {
  if (std::min({shape.rows, shape.inner, shape.cols}) == 0) return false;
  // rows fill a panel of eight, columns may fill half of one
  if (shape.rows < shape.cols && structure == Structure::general)
    return multiply_by_splitting(Z.transposed(), into, Y.transposed(), X.transposed(),
                                 {shape.cols, shape.inner, shape.rows}, structure, vectors);
  const mpfr_prec_t precision = Z(0, 0)._mpfr_prec;
  if (precision > 64 * most_limbs) return false;

  const Kernels& kernels = kernels_for(vectors);
  const bool symmetric = structure == Structure::symmetric;
  thread_local Workspace workspace;
  Operand &x = workspace.x, &y = workspace.y;
  if (!x.read(X, shape.rows, shape.inner) || !y.read(Y.transposed(), shape.cols, shape.inner)) return false;
  equilibrate(x, y);
  const float x_depth = x.find_tops(), y_depth = y.find_tops();
  const float spread = kernels.spread(x, y, structure);
  if (spread > static_cast<float>(precision) / 2) return false;

  Cut cut = cut_for(shape.inner, static_cast<float>(precision) + 4 + spread);
  if (cut.digits == 0) return false;
  const auto digits_for = [&](float depth) {
    return std::min(cut.digits, static_cast<Index>(std::min(depth, 1e6f)) / cut.bits + 1);
  };
  x.digit_count = digits_for(x_depth + 1);
  y.digit_count = digits_for(y_depth + 1);
  cut.weights = std::min(cut.digits, x.digit_count + y.digit_count - 1);
  x.digits.reserve(x.panels * x.inner * x.digit_count);
  y.digits.reserve(y.panels * y.inner * y.digit_count);
  Doubles* const sums = workspace.sums.reserve(cut.weights * lanes);
  const Index L = ceil_div(cut.weights * cut.bits, 64);
  Words* const limbs = workspace.limbs.reserve((ceil_div(cut.digits * cut.bits, 64) + 1) * lanes);
  kernels.split(x, cut, false, limbs);
  kernels.split(y, cut, true, limbs);

  Scratch scratch(Z(0, 0));
  mp_limb_t number[2 * most_limbs];
  for (Index p = 0; p < x.panels; ++p)
    for (Index q = 0; q < (symmetric ? p + 1 : y.panels); ++q) {
      kernels.tile(x, p, y, q, cut, sums, limbs);
      const Floats a = x.top[p], b = y.top[q];
      const Index rows = std::min(lanes, shape.rows - p * lanes), cols = std::min(lanes, shape.cols - q * lanes);
      for (Index jl = 0; jl < cols; ++jl)
        for (Index il = symmetric && p == q ? jl : 0; il < rows; ++il) {
          const Index i = p * lanes + il, j = q * lanes + jl;
          __mpfr_struct& z = Z(i, j);
          __mpfr_struct& sum = into == Into::set ? z : scratch.number;
          if (a[il] == nothing || b[jl] == nothing) {
            mpfr_set_zero(&sum, 1);
          } else {
            for (Index t = 0; t <= L; ++t) number[t] = limbs[t * lanes + jl][il];
            const bool negative = (number[L] >> 63) != 0;
            if (negative) mpn_neg(number, number, L + 1);
            set_rounded(sum, negative, number, L + 1, 66 - cut.bits + static_cast<mpfr_exp_t>(a[il] + b[jl]));
          }
          if (into == Into::add) mpfr_add(&z, &z, &sum, MPFR_RNDN);
          if (into == Into::subtract) mpfr_sub(&z, &z, &sum, MPFR_RNDN);
          if (symmetric) mirror(Z, i, j);
        }
    }
  return true;
}

void multiply(Results Z, Into into, Entries X, Entries Y, Shape shape, Structure structure) {
  if (shape.rows == 0 || shape.cols == 0) return;
  const Vectors vectors = widest_vectors();
  if (!pays(shape, structure, Z(0, 0)._mpfr_prec, vectors) ||
      !multiply_by_splitting(Z, into, X, Y, shape, structure, vectors))
    multiply_by_dots(Z, into, X, Y, shape, structure);
}

}  // namespace kfstab::reference::detail
