#pragma once

#include <kfstab/filters/kernels/array_kernel.hpp>
#include <kfstab/filters/kernels/batch_step.hpp>
#include <kfstab/filters/kernels/condition.hpp>

#ifdef KFSTAB_KERNELS

/// What the kernels of many filters at once are made of: numbers that have a lane for each filter.
///
/// Such a number is a V, or Two of them. Sums, roots and divisions of one filter wait for each other, and half of a vector
/// unit's time is spent waiting; a second vector of filters, which have nothing to do with the first, fills it. It pays
/// as long as the numbers find room in the registers, or near them.
namespace kfstab::kernels::KFSTAB_KERNELS {

struct Two {
  V first, second;
};
struct TwoLanes {
  Lanes first, second;
};

KFSTAB_INLINE Two operator+(Two a, Two b) { return {a.first + b.first, a.second + b.second}; }
KFSTAB_INLINE Two operator-(Two a, Two b) { return {a.first - b.first, a.second - b.second}; }
KFSTAB_INLINE Two operator*(Two a, Two b) { return {a.first * b.first, a.second * b.second}; }
KFSTAB_INLINE Two operator-(Two a) { return {-a.first, -a.second}; }
KFSTAB_INLINE Two& operator+=(Two& a, Two b) { return a = a + b; }
KFSTAB_INLINE Two fma(Two a, Two b, Two c) {
  return {fma(a.first, b.first, c.first), fma(a.second, b.second, c.second)};
}
KFSTAB_INLINE Two root(Two x) { return {root(x.first), root(x.second)}; }
KFSTAB_INLINE Two magnitude(Two x) { return {magnitude(x.first), magnitude(x.second)}; }
KFSTAB_INLINE Two larger(Two x, Two most) { return {larger(x.first, most.first), larger(x.second, most.second)}; }
KFSTAB_INLINE V inverse_of(V x) { return 1 / x; }
KFSTAB_INLINE Two inverse_of(Two x) { return {1 / x.first, 1 / x.second}; }

KFSTAB_INLINE TwoLanes operator|(TwoLanes a, TwoLanes b) { return {a.first | b.first, a.second | b.second}; }
/// Of a NaN, too.
KFSTAB_INLINE Lanes not_zero(V x) { return ~(x == 0); }
KFSTAB_INLINE TwoLanes not_zero(Two x) { return {~(x.first == 0), ~(x.second == 0)}; }
KFSTAB_INLINE Lanes not_positive(V x) { return ~(x > 0); }
KFSTAB_INLINE TwoLanes not_positive(Two x) { return {~(x.first > 0), ~(x.second > 0)}; }

/// Two if that is said, else V.
template <bool two>
struct ChoiceOfLanes {
  using type = V;
};
template <>
struct ChoiceOfLanes<true> {
  using type = Two;
};
template <bool two>
using ChosenLanes = typename ChoiceOfLanes<two>::type;

/// A matrix of the filters that are in the lanes of a T.
template <class T>
struct LaneMatrix;
template <>
struct LaneMatrix<V> {
  double* data = nullptr;
  KFSTAB_INLINE LaneMatrix() = default;
  KFSTAB_INLINE LaneMatrix(double* data_, Index) : data(data_) {}
  KFSTAB_INLINE V get(Index entry) const { return *reinterpret_cast<const V*>(data + 8 * entry); }
  KFSTAB_INLINE void put(Index entry, V x) const { *reinterpret_cast<V*>(data + 8 * entry) = x; }
};
template <>
struct LaneMatrix<Two> {
  double* data = nullptr;
  Index second = 0;  ///< where the second vector is: in the next group, or half a group away
  KFSTAB_INLINE LaneMatrix() = default;
  KFSTAB_INLINE LaneMatrix(double* data_, Index size) : data(data_), second(width < 8 ? width : 8 * size) {}
  KFSTAB_INLINE Two get(Index entry) const {
    return {*reinterpret_cast<const V*>(data + 8 * entry), *reinterpret_cast<const V*>(data + 8 * entry + second)};
  }
  KFSTAB_INLINE void put(Index entry, Two x) const {
    *reinterpret_cast<V*>(data + 8 * entry) = x.first;
    *reinterpret_cast<V*>(data + 8 * entry + second) = x.second;
  }
};

/// Where the lanes of a T are among the groups: those from `first` on of a group.
template <class T>
struct LanesOf {
  Index group, first;
  /// Of matrices of so many entries the one of these lanes.
  KFSTAB_INLINE LaneMatrix<T> of(const Eight* X, Index size) const {
    return X ? LaneMatrix<T>(const_cast<double*>(X[group * size].lane) + first, size) : LaneMatrix<T>();
  }
};

template <class T>
KFSTAB_INLINE T all_ones() {
  if constexpr (sizeof(T) == sizeof(V))
    return splat(1);
  else
    return {splat(1), splat(1)};
}

KFSTAB_INLINE unsigned as_bits(Lanes bad, Index first) {
  unsigned bits = 0;
  for (Index l = 0; l < width; ++l) bits |= bad[l] ? 1u << (first + l) : 0u;
  return bits;
}

/// step(lanes) for all lanes of all groups: it returns those that gave up.
template <class T, class Step>
KFSTAB_INLINE void each_lanes(Index groups, unsigned char* gave_up, Step&& step) {
  constexpr bool two = sizeof(T) > sizeof(V);
  constexpr Index groups_at_once = two && width == 8 ? 2 : 1, lanes = two && width < 8 ? 2 * width : width;
  for (Index group = 0; group < groups; group += groups_at_once) {
    unsigned bits[2] = {};
    for (Index first = 0; first < 8; first += lanes) {
      const auto bad = step(LanesOf<T>{group, first});
      if constexpr (two) {
        bits[0] |= as_bits(bad.first, first);
        bits[width == 8] |= as_bits(bad.second, width == 8 ? 0 : first + width);
      } else {
        bits[0] |= as_bits(bad, first);
      }
    }
    gave_up[group] = static_cast<unsigned char>(bits[0]);
    if (groups_at_once == 2) gave_up[group + 1] = static_cast<unsigned char>(bits[1]);
  }
}

/// f(R, i) for the rows i ... i + R - 1, in blocks of as many as R says, then fewer.
template <Index R, Index First, Index Last, class F>
KFSTAB_INLINE void each_block(Constant<First>, Constant<Last> last, F&& f) {
  if constexpr (First + R <= Last) {
    f(Constant<R>{}, Constant<First>{});
    each_block<R>(Constant<First + R>{}, last, f);
  } else if constexpr (R > 1) {
    each_block<R / 2>(Constant<First>{}, last, f);
  }
}
template <Index R, class F>
KFSTAB_INLINE void each_block(Index first, Index last, F&& f) {
  each_group(first, last, Constant<R>{}, f);
}

/// The inverse of a lower triangle L(i, j) into X, column by column, of order p. `distance` is that of X's columns.
template <class T, class P, class Entry>
KFSTAB_INLINE void invert_lower(P p, const T* inverse_diagonal, T* X, Entry&& L) {
  each(zero, p, [&](auto j) KFSTAB_INLINED {
    X[j * p + j] = inverse_diagonal[j];
    each(j + one, p, [&](auto i) KFSTAB_INLINED {
      T product{};
      each(j, i, [&](Index k) KFSTAB_INLINED { product = fma(L(i, k), X[j * p + k], product); });
      X[j * p + i] = -product * inverse_diagonal[i];
    });
  });
}

/// The largest sum of magnitudes of a column of a lower triangle, or of a row.
template <bool of_rows, class T, class P, class Entry>
KFSTAB_INLINE T norm_of_lower(P p, Entry&& L) {
  T norm{};
  each(zero, p, [&](auto j) KFSTAB_INLINED {
    T sum{};
    if constexpr (of_rows)
      each(zero, j + one, [&](Index k) KFSTAB_INLINED { sum += magnitude(L(j, k)); });
    else
      each(j, p, [&](Index i) KFSTAB_INLINED { sum += magnitude(L(i, j)); });
    norm = larger(sum, norm);
  });
  return norm;
}

/// 1 / (|L| |L^{-1}|) in the 1-norm, or of L'. L^{-1} is formed: p^3/6 multiply-adds are little beside the array, and no lane
/// goes a way of its own, as an estimate would have it.
/// @param X  p^2, workspace
template <bool transposed, class T, class P, class Entry>
KFSTAB_INLINE T rcond_of_lower(P p, const T* inverse_diagonal, T* X, Entry&& L) {
  if (p == 0) return all_ones<T>();
  invert_lower(p, inverse_diagonal, X, L);
  const T norm = norm_of_lower<transposed, T>(p, L);
  return inverse_of(norm *
                    norm_of_lower<transposed, T>(p, [&](Index i, Index j) KFSTAB_INLINED { return X[j * p + i]; }));
}

}  // namespace kfstab::kernels::KFSTAB_KERNELS

#endif
