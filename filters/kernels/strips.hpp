#pragma once

#include <kfstab/filters/kernels/vector.hpp>

#ifdef KFSTAB_KERNELS

/// Matrices in strips, of which the kernels for large sizes are made: a strip is `width` rows, column after column, so a
/// column of a strip is a vector where the matrix stands on the left of a product, and the entries that belong to `width`
/// columns of the product where it stands, transposed, on the right. Products X Y', products and quotients with a triangle on
/// the right.
namespace kfstab::kernels::KFSTAB_KERNELS {

inline constexpr Constant<0> zero{};
inline constexpr Constant<1> one{};

/// Where entry (i, j) of a matrix is, and how far from it entry (i + 1, j).
struct Layout {
  bool transposed;
  template <class Pointer>
  KFSTAB_INLINE auto at(const Pointer& X, Index i, Index j) const {
    return X.data + (transposed ? j + i * X.leading : i + j * X.leading);
  }
  template <class Pointer>
  KFSTAB_INLINE Index stride(const Pointer& X) const {
    return transposed ? X.leading : 1;
  }
};

/// The strips that hold so many rows.
template <Index Rows>
KFSTAB_INLINE constexpr auto strips_of(Constant<Rows>) {
  return Constant<(Rows + width - 1) / width>{};
}
KFSTAB_INLINE constexpr Index strips_of(Index rows) { return (rows + width - 1) / width; }

using AllLanes = IndicesBelow<width>;

/// Lanes whose number has the bit `half` change places with those of b that have not: blocks of 2 x 2 blocks, transposed.
template <Index half, Index... L>
KFSTAB_INLINE void exchange(V& a, V& b, IndexList<L...>) {
  const V first = __builtin_shufflevector(a, b, ((L & half) ? width + L - half : L)...);
  b = __builtin_shufflevector(a, b, ((L & half) ? width + L : L + half)...);
  a = first;
}

/// Transposes the matrix that has these columns.
template <Index half = width / 2>
KFSTAB_INLINE void transpose(V (&columns)[width]) {
  each(zero, Constant<width>{}, [&](auto i) KFSTAB_INLINED {
    constexpr Index I = decltype(i)::value;
    if constexpr ((I & half) == 0) exchange<half>(columns[I], columns[I + half], AllLanes{});
  });
  if constexpr (half > 1) transpose<half / 2>(columns);
}

/// Columns of R strips, the same of each: a strip is `width` rows of the array, its columns one after the other, so that
/// every pass goes through memory in order.
struct Strips {
  V* column;
  Index length;  ///< columns of a strip
  KFSTAB_INLINE V& operator()(Index strip, Index k) const { return column[strip * length + k]; }
  KFSTAB_INLINE Strips at(Index strip, Index k) const { return {column + strip * length + k, length}; }
  KFSTAB_INLINE const double* entries(Index k) const { return reinterpret_cast<const double*>(column + k); }
};

/// f(R, strip) for groups of R strips, a Constant: as many as there are registers for, then fewer.
template <class F, Index R>
KFSTAB_INLINE void each_group(Index first, Index last, Constant<R>, F&& f) {
  for (; first + R <= last; first += R) f(Constant<R>{}, first);
  if constexpr (R > 1) each_group(first, last, Constant<R / 2>{}, f);
}
inline constexpr Constant<width == 8 ? 3 : width == 4 ? 2 : 4> most_strips{};

/// sum[i][q] += x(i, k) l[q distance], q = 0 ... Q - 1: the heart of all products.
template <Index R, Index distance = 1, Index Q>
KFSTAB_INLINE void add_outer(V (&sum)[R][Q], const Strips& x, Index k, const double* l) {
  V column[R];
  each(zero, Constant<R>{}, [&](Index i) KFSTAB_INLINED { column[i] = x(i, k); });
  each(zero, Constant<Q>{}, [&](Index q) KFSTAB_INLINED {
    const V entry_q = splat(l[q * distance]);
    each(zero, Constant<R>{}, [&](Index i) KFSTAB_INLINED { sum[i][q] = fma(column[i], entry_q, sum[i][q]); });
  });
}

/// Where the block of columns from j on begins in a packed triangle of order K, and how many vectors there are in all.
KFSTAB_INLINE constexpr Index packed_block(Index K, Index j) {
  const Index blocks = j / width;
  return blocks * K - width * (blocks * (blocks - 1) / 2);
}
KFSTAB_INLINE constexpr Index packed_size(Index K) { return packed_block(K, (K + width - 1) / width * width); }

/// Packs a lower triangle of order K, in blocks of `width` columns: a row of a block is a vector. Memory is read in the order in
/// which it lies there.
KFSTAB_INLINE void pack_lower(const Layout& layout, const Source& L, Index K, V* out) {
  const auto rows_at = [&](Index k, Index j) KFSTAB_INLINED { return out + packed_block(K, j) + (k - j); };
  if (layout.transposed) {
    for (Index k = 0; k < K; ++k)
      for (Index j = 0; j <= k; j += width) *rows_at(k, j) = load(layout.at(L, k, j), 1, 0, least(k - j + 1, width));
    return;
  }
  for (Index j = 0; j < K; j += width)
    for (Index k = j; k < K; k += width) {
      V *const rows = rows_at(k, j), tile[width];
      const Index high = least(K - k, width);
      each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
        const Index low = j == k ? Index(q) : 0;
        tile[q] = low < high ? load(layout.at(L, k, j + q), 1, low, high) : V{};
      });
      transpose(tile);
      each(zero, Constant<width>{}, [&](Index l) KFSTAB_INLINED {
        if (l < high) rows[l] = tile[l];
      });
    }
}

/// A lower triangle where it stands on the right of a product: as it lies in memory, or packed.
struct Lower {
  const double* data;
  Index down, across;  ///< how far from entry (k, j) are (k + 1, j) and (k, j + 1), of a packed one within a block
  bool packed;

  KFSTAB_INLINE Lower(const Layout& layout, const Source& L)
      : data(L.data), down(layout.stride(L)), across(layout.transposed ? 1 : L.leading), packed(false) {}
  KFSTAB_INLINE explicit Lower(const V* L)
      : data(reinterpret_cast<const double*>(L)), down(width), across(1), packed(true) {}
  /// Entry (j, j), j a multiple of `width`, of a triangle of order K.
  KFSTAB_INLINE const double* diagonal(Index K, Index j) const {
    return data + (packed ? packed_block(K, j) * width : j * (down + across));
  }
};

/// x := x L for R strips of K columns, in place. The strips are zero from column `end` on, and stay so.
template <Index R>
KFSTAB_INLINE void multiply_strips(const Strips& x, const Lower& L, Index K, Index end) {
  constexpr Constant<R> strips{};
  end = least(K, end);
  for (Index j = 0; j < end; j += width) {
    const double* l = L.diagonal(K, j);
    V sum[R][width] = {};
    const auto add_row = [&](Index k, auto entries) KFSTAB_INLINED {
      V column[R];
      each(zero, strips, [&](Index i) KFSTAB_INLINED { column[i] = x(i, k); });
      each(zero, entries, [&](Index q) KFSTAB_INLINED {
        const V entry_q = splat(l[q * L.across]);
        each(zero, strips, [&](Index i) KFSTAB_INLINED { sum[i][q] = fma(column[i], entry_q, sum[i][q]); });
      });
      l += L.down;
    };
    each(zero, Constant<width>{}, [&](auto q) KFSTAB_INLINED {
      if (j + q < end) add_row(j + q, q + one);
    });
    for (Index k = j + width; k < end; ++k) add_row(k, Constant<width>{});
    each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
      if (j + q < K) each(zero, strips, [&](Index i) KFSTAB_INLINED { x(i, j + q) = sum[i][q]; });
    });
  }
}

/// x := x L^{-1}, likewise: from right to left, what the columns behind a block take away from it, then the block itself. Of L
/// the first `order` rows and columns alone: x is zero behind them, and stays so.
template <Index R>
KFSTAB_INLINE void divide_strips(const Strips& x, const V* L, Index K, Index order) {
  for (Index j = (order - 1) / width * width; j >= 0; j -= width) {
    const V* block = L + packed_block(K, j);
    V sum[R][width] = {};
    for (Index k = j + width; k < order; ++k)
      add_outer<R>(sum, x, k, reinterpret_cast<const double*>(block + (k - j)));
    const auto* l = reinterpret_cast<const double*>(block);  // entry (j + k, j + q) is l[k width + q]
    each(zero, Constant<width>{}, [&](auto last) KFSTAB_INLINED {
      constexpr Constant<width - 1 - decltype(last)::value> q{};
      if (j + q >= order) return;
      const V inverse = splat(1 / l[q * width + q]);
      each(zero, Constant<R>{}, [&](Index i) KFSTAB_INLINED { sum[i][q] = (x(i, j + q) - sum[i][q]) * inverse; });
      each(zero, Constant<R>{}, [&](Index i) KFSTAB_INLINED { x(i, j + q) = sum[i][q]; });
      each(zero, q, [&](Index before) KFSTAB_INLINED {
        const V l_q = splat(l[q * width + before]);
        each(zero, Constant<R>{}, [&](Index i) KFSTAB_INLINED { sum[i][before] = fma(sum[i][q], l_q, sum[i][before]); });
      });
    });
  }
}
template <Index R>
KFSTAB_INLINE void divide_strips(const Strips& x, const V* L, Index K) {
  divide_strips<R>(x, L, K, K);
}

/// x := x L'^{-1}, likewise, from left to right: of the packed triangle a row of a block is at hand, not a column, and so a
/// block that is done is taken away from all columns behind it.
template <Index R>
KFSTAB_INLINE void divide_strips_transposed(const Strips& x, const V* L, Index K) {
  for (Index j = 0; j < K; j += width) {
    const auto* l = reinterpret_cast<const double*>(L + packed_block(K, j));  // entry (j + k, j + q) is l[k width + q]
    V minus[R][width] = {};
    each(zero, Constant<width>{}, [&](auto q) KFSTAB_INLINED {
      if (j + q >= K) return;
      const V inverse = splat(1 / l[q * width + q]);
      V column[R];
      each(zero, Constant<R>{}, [&](Index i) KFSTAB_INLINED { column[i] = x(i, j + q); });
      each(zero, q, [&](Index before) KFSTAB_INLINED {
        const V l_q = splat(l[q * width + before]);
        each(zero, Constant<R>{}, [&](Index i) KFSTAB_INLINED { column[i] = fma(minus[i][before], l_q, column[i]); });
      });
      each(zero, Constant<R>{}, [&](Index i) KFSTAB_INLINED {
        x(i, j + q) = column[i] * inverse;
        minus[i][q] = -x(i, j + q);
      });
    });
    for (Index k = j + width; k < K; ++k) {
      V column[R];
      each(zero, Constant<R>{}, [&](Index i) KFSTAB_INLINED { column[i] = x(i, k); });
      each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
        const V l_q = splat(l[(k - j) * width + q]);
        each(zero, Constant<R>{}, [&](Index i) KFSTAB_INLINED { column[i] = fma(minus[i][q], l_q, column[i]); });
      });
      each(zero, Constant<R>{}, [&](Index i) KFSTAB_INLINED { x(i, k) = column[i]; });
    }
  }
}

/// In lane l the sum of the lanes of x[l].
KFSTAB_INLINE V sums_of_lanes(V (&x)[width]) {
  transpose(x);
  V sum = x[0];
  for (Index l = 1; l < width; ++l) sum += x[l];
  return sum;
}

/// x := x L^{-1} for one row x of K numbers, which are in the lanes; L packed. What is behind them is zero, and stays so.
/// @param divide  of (j, what the columns behind a block leave of its right-hand side), x_j of that block
template <class Divide>
KFSTAB_INLINE void divide_row(V* x, const V* L, Index K, Divide&& divide) {
  const auto* entries = reinterpret_cast<const double*>(x);
  for (Index j = (K - 1) / width * width; j >= 0; j -= width) {
    const V* block = L + packed_block(K, j);
    V sum[4] = {};
    Index k = j + width;
    for (; k + 4 <= K; k += 4)
      each(zero, Constant<4>{},
           [&](Index c) KFSTAB_INLINED { sum[c] = fma(block[k + c - j], splat(entries[k + c]), sum[c]); });
    for (; k < K; ++k) sum[0] = fma(block[k - j], splat(entries[k]), sum[0]);
    x[j / width] = divide(j, x[j / width] - ((sum[0] + sum[1]) + (sum[2] + sum[3])));
  }
}
/// One entry after the other.
__attribute__((noinline)) inline void divide_row(V* x, const V* L, Index K) {
  divide_row(x, L, K, [&](Index j, V left) KFSTAB_INLINED {
    const V* block = L + packed_block(K, j);
    const auto* l = reinterpret_cast<const double*>(block);  // entry (j + k, j + q) is l[k width + q]
    V done{};
    each(zero, Constant<width>{}, [&](auto last) KFSTAB_INLINED {
      constexpr Constant<width - 1 - decltype(last)::value> q{};
      if (j + q >= K) return;
      const V entry_q = lane<q>(left) * splat(1 / l[q * width + q]);
      done = with_lane(q, done, entry_q);
      left = fma(-entry_q, block[q], left);
    });
    return done;
  });
}

/// f of all lanes, two and two, in each.
template <Index half = width / 2, class F, Index... L>
KFSTAB_INLINE V fold_lanes(V x, F&& f, IndexList<L...> lanes) {
  x = f(x, __builtin_shufflevector(x, x, (L ^ half)...));
  if constexpr (half > 1) return fold_lanes<half / 2>(x, f, lanes);
  return x;
}
KFSTAB_INLINE double sum_of_lanes(V x) {
  return fold_lanes(x, [](V a, V b) KFSTAB_INLINED { return a + b; }, AllLanes{})[0];
}

/// Which strips of a symmetric product are wanted.
enum class Part { all, lower, upper };

/// out(s, j) = sum over k < count of x(s, k) y(j, k), for j < columns and s from `first` to `last`, where the part has them.
///
/// Long sums are done a piece at a time, for as many columns as keep the strips of X in the nearest cache meanwhile.
template <Part part, class Columns, class Count>
KFSTAB_INLINE void multiply_sized(const Strips& out, const Strips& x, Index first, Index last, const Strips& y,
                                  Columns columns, Count count) {
  constexpr Index depth = 192, breadth = 8;
  for (Index t0 = 0; t0 * width < columns; t0 += breadth) {
    const Index t_end = least(t0 + breadth, strips_of(columns));
    const Index from = part == Part::lower ? greatest(first, t0) : first;
    const Index to = part == Part::upper ? least(last, t_end) : last;
    each_group(from, to, most_strips, [&](auto R, Index s) KFSTAB_INLINED {
      for (Index k0 = 0; k0 == 0 || k0 < count; k0 += depth)
        for (Index t = t0; t < t_end; ++t) {
          if (part == Part::lower && s + R <= t) break;
          if (part == Part::upper && s > t) continue;
          V sum[decltype(R)::value][width];
          const Index j = t * width;
          each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
            each(zero, R,
                 [&](Index i) KFSTAB_INLINED { sum[i][q] = k0 > 0 && j + q < columns ? out(s + i, j + q) : V{}; });
          });
          const Strips left = x.at(s, 0), right = y.at(t, 0);
          for (Index k = k0; k < least(k0 + depth, count); ++k)
            add_outer<decltype(R)::value>(sum, left, k, right.entries(k));
          each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
            if (j + q < columns) each(zero, R, [&](Index i) KFSTAB_INLINED { out(s + i, j + q) = sum[i][q]; });
          });
        }
    });
  }
}

/// multiply_sized, compiled once for all sizes that are not known.
template <Part part, class Columns, class Count>
KFSTAB_INLINE void multiply(const Strips& out, const Strips& x, Index first, Index last, const Strips& y,
                            Columns columns, Count count) {
  multiply_sized<part>(out, x, first, last, y, columns, count);
}
template <Part part>
__attribute__((noinline)) inline void multiply(const Strips& out, const Strips& x, Index first, Index last,
                                               const Strips& y, Index columns, Index count) {
  multiply_sized<part>(out, x, first, last, y, columns, count);
}

}  // namespace kfstab::kernels::KFSTAB_KERNELS

#endif
