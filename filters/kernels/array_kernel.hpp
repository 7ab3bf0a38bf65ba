#pragma once

#include <kfstab/filters/kernels/condition.hpp>

#ifdef KFSTAB_KERNELS

/// ArrayStep by vectors: rows of the array lie side by side in the lanes, and a column of a strip of rows is one vector.
///
/// A reflector that annihilates row j of [head, X], head (a vector) being the column of the pivot, is H = I + d u u' with
/// u = (pivot; x_j), x_j being row j of X, d = -2 / u'u, beta = -+|(alpha; x_j)|, pivot = alpha - beta. One pass over the columns
/// k of X,
///
///     w += X_k x_jk,
///
/// gives the products of row j with all rows, and in lane j its own square, of which beta is made. Then f = d (head pivot + w)
/// is what each row takes of u: head += f pivot, X_k += f x_jk, and while column k is at hand, its part of the next w.
///
/// Squares are taken of the numbers as they are. Where the norm of a pivot's row is so small or large that a square could
/// leave the range of a double (or no number at all), the kernel gives up, and the caller takes the plain text, which scales, in
/// its place. Every row of the array becomes a pivot's row, so none escapes this.
namespace kfstab::kernels::KFSTAB_KERNELS {

/// What a squared norm may be: as make_reflector has it.
inline constexpr double least_square = 0x1p-511, greatest_square = 0x1p511;

struct Reflector {
  double beta, pivot, d;  ///< d = 0: nothing is to be done
};

/// The reflector of a row (alpha; x) with x'x = square. Not ok, and d = 0, if squares are not safe; is_zero() says whether
/// x = 0 to the last bit.
template <class Zero>
KFSTAB_INLINE Reflector reflector(double alpha, double square, bool& ok, Zero&& is_zero) {
  const double norm2 = alpha * alpha + square;
  if (!(norm2 >= least_square && norm2 <= greatest_square)) [[unlikely]] {
    ok = ok && alpha == 0 && is_zero();
    return {alpha, 0, 0};
  }
  if (square == 0) return {alpha, 0, 0};
  // d = -2 / u'u of the rounded pivot: H is orthogonal but for the rounding of d itself. 1 / (beta pivot) is the same on paper,
  // and has the root's rounding in it; -1 / (|alpha| norm + norm2) would be known sooner, and has the pivot's, too.
  const double beta = -__builtin_copysign(root(norm2), alpha), pivot = alpha - beta;
  return {beta, pivot, -2 / fma(pivot, pivot, square)};
}

/// Entries k ... of U x, or of x if there is no U; 0 behind the last one.
KFSTAB_INLINE V entries_of_Ux(const ArrayStep& step, Index k) {
  if (!step.U_transposed.data) return load(step.x + k, 1, 0, least(step.n - k, width));
  V sum[width] = {};
  for (Index i = 0; i < step.n; i += width) {
    const Index high = least(step.n - i, width);
    const V x = load(step.x + i, 1, 0, high);
    const double* const part = step.U_transposed.data + i + k * step.U_transposed.leading;
    each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
      if (k + q < step.n) sum[q] = fma(load(part + q * step.U_transposed.leading, 1, 0, high), x, sum[q]);
    });
  }
  return sums_of_lanes(sum);
}

// ---- small: the whole array in registers, or near them, one reflector after the other ----

/// Whether B Q stands before A S: where rows of A S end early. Elsewhere it is behind: in S, and so in A S, columns often are the
/// smaller the further they are to the right, and reflectors keep small columns right as long as the pivots are in large ones.
KFSTAB_INLINE bool noise_first(const ArrayStep& step) { return step.A_band < step.n; }

/// The sizes of a step: known when it is compiled, or not.
template <Index N, Index M, Index P, bool has_last_, bool transposed_>
struct FixedSizes {
  static constexpr bool known = true, has_last = has_last_, transposed = transposed_;
  static constexpr Constant<N> n{};
  static constexpr Constant<M> m{};
  static constexpr Constant<P> p{};
  /// Where A S begins in [A S, B Q], and B Q.
  static constexpr Constant<0> at_S{};
  static constexpr Constant<N> at_Q{};
  /// The columns of the pre-array in which a row is annihilated: those of C S, or of [A S, B Q] right of the diagonal.
  template <Index Row>
  KFSTAB_INLINE static constexpr auto first_column(Constant<Row>) {
    return Constant<(Row < P ? 0 : Row - P + 1)>{};
  }
  template <Index Row>
  KFSTAB_INLINE static constexpr auto end_column(Constant<Row>) {
    return Constant<(Row < P ? N : N + M)>{};
  }
  /// A row that is not a Constant is one of the first P, but for the last of them.
  KFSTAB_INLINE static constexpr Constant<0> first_column(Index) { return {}; }
  KFSTAB_INLINE static constexpr Constant<N> end_column(Index) { return {}; }
  static constexpr Index most_columns = greatest(N + M, 1), most_heads = greatest(P, 1), most_states = greatest(N, 1),
                         most_noises = greatest(M, 1), most_rows_of_gain = (M + width) / width * most_states;
};
struct RunTimeSizes {
  static constexpr bool known = false;
  bool has_last, transposed;
  Index n, m, p, A_band, C_band;
  Index at_S, at_Q;

  KFSTAB_INLINE explicit RunTimeSizes(const ArrayStep& step)
      : has_last(step.x), transposed(step.transposed), n(step.n), m(step.m), p(step.p), A_band(step.A_band),
        C_band(step.C_band), at_S(noise_first(step) ? m : 0), at_Q(noise_first(step) ? 0 : n) {}
  KFSTAB_INLINE Index first_column(Index row) const { return row < p ? at_S : row - p + 1; }
  /// The rows of A S end where all rows above them do, or behind them: A's band is no narrower than what C's reflectors fill in.
  KFSTAB_INLINE Index end_column(Index row) const {
    if (row >= p && at_S == 0) return n + m;
    return at_S + least(n, (row < p ? row + C_band : row - p + A_band) + 1);
  }
  static constexpr Index most_columns = 48, most_heads = 4 * width, most_states = 4 * width, most_noises = 1,
                         most_rows_of_gain = 1;
};

/// f(row, v) for each row, which lies in vector v, a Constant.
template <Index vectors, Index First, Index Last, class F>
KFSTAB_INLINE void each_row(Constant<First> first, Constant<Last> last, F&& f) {
  each(first, last, [&](auto row) KFSTAB_INLINED { f(row, Constant<decltype(row)::value / width>{}); });
}
template <Index vectors, class F>
KFSTAB_INLINE void each_row(Index first, Index last, F&& f) {
  each(zero, Constant<vectors>{}, [&](auto v) KFSTAB_INLINED {
    for (Index row = greatest(first, v * width); row < least(last, (v + 1) * width); ++row) f(row, v);
  });
}

/// f(v) for the vector v that has a row, `from` or the one after it.
template <Index Row, Index From, Index All, class F>
KFSTAB_INLINE void with_vector_of(Constant<Row>, Constant<From>, Constant<All>, F&& f) {
  f(Constant<Row / width>{});
}
template <Index From, Index All, class F>
KFSTAB_INLINE void with_vector_of(Index row, Constant<From> from, Constant<All>, F&& f) {
  if (row < (From + 1) * width)
    f(from);
  else if constexpr (From + 1 < All)
    f(from + one);
}

/// f(k, chain) for k = first ... last - 1: sums in so many chains are not held up by the latency of an addition.
template <Index First, Index Last, class F>
KFSTAB_INLINE void each_column(Constant<First> first, Constant<Last> last, F&& f) {
  each(first, last, [&](auto k) KFSTAB_INLINED { f(k, Constant<decltype(k)::value % 4>{}); });
}
template <class F>
KFSTAB_INLINE void each_column(Index first, Index last, F&& f) {
  for (; first + 1 < last; first += 2) {
    f(first, zero);
    f(first + 1, one);
  }
  if (first < last) f(first, zero);
}

/// The entry of that row in all lanes, of its vector, or of the column (of which code that never runs may want rows that it has
/// not).
template <Index Row>
KFSTAB_INLINE V lane(V x, Constant<Row>) {
  return lane<Row % width>(x);
}
KFSTAB_INLINE V lane(V x, Index row) { return lane_of(x, row % width); }
template <Index vectors, Index Row>
KFSTAB_INLINE V entry(const V (&column)[vectors], Constant<Row>) {
  return lane<Row % width>(column[least(Row / width, vectors - 1)]);
}
template <Index vectors>
KFSTAB_INLINE V entry(const V (&column)[vectors], Index row) {
  return splat(column[row / width][row % width]);
}

template <Index Row, Index Last>
KFSTAB_INLINE auto after(Constant<Row>, Constant<Last>) {
  return Constant<(Row + 1 < Last ? Row + 1 : Row)>{};
}
KFSTAB_INLINE Index after(Index row, Index last) { return row + 1 < last ? row + 1 : row; }

/// 1 / (norm |W|_1), W the inverse of a lower triangle of that order, or 1 / (norm |W'W|_1). Row i of it is in the lanes:
///
///     w_i = (e_i - sum of entry(i, k) w_k, k < i) / entry(i, i).
template <Index vectors, Index most, Of of = Of::triangle, class Order, class Entry>
KFSTAB_INLINE double small_reciprocal_condition(Order order, double norm, Entry&& entry) {
  if (order == 0) return 1;
  constexpr Constant<vectors> all{};
  V W[most][vectors], sum[vectors] = {};
  each(zero, order, [&](auto i) KFSTAB_INLINED {
    V row[vectors];
    each(zero, all, [&](Index v) KFSTAB_INLINED { row[v] = lane_numbers == i - v * width ? splat(1) : V{}; });
    each(zero, i, [&](Index k) KFSTAB_INLINED {
      const V minus = -entry(i, k);
      each(zero, all, [&](Index v) KFSTAB_INLINED {
        if (v * width <= k) row[v] = fma(minus, W[k][v], row[v]);
      });
    });
    const V inverse = splat(1 / entry(i, i)[0]);
    each(zero, all, [&](Index v) KFSTAB_INLINED {
      W[i][v] = row[v] * inverse;
      if (of == Of::triangle) sum[v] += magnitude(W[i][v]);
    });
  });
  if constexpr (of == Of::product)
    each(zero, order, [&](auto j) KFSTAB_INLINED {
      V row[vectors] = {};
      each(j, order, [&](auto i) KFSTAB_INLINED {
        const V w = KFSTAB_KERNELS::entry(W[i], j);
        each(zero, all, [&](Index v) KFSTAB_INLINED {
          if (v * width <= i) row[v] = fma(w, W[i][v], row[v]);
        });
      });
      each(zero, all, [&](Index v) KFSTAB_INLINED { sum[v] += magnitude(row[v]); });
    });
  double of_inverse = 0;
  each(zero, all, [&](Index v) KFSTAB_INLINED { of_inverse = larger(largest_lane(sum[v]), of_inverse); });
  if (!(norm > 0) || norm - norm != 0 || of_inverse - of_inverse != 0) return 0;
  return 1 / norm / of_inverse;
}

template <Index vectors, class Sizes>
KFSTAB_INLINE bool small_array_step(const Sizes& size, const ArrayStep& step) {
  constexpr Index chains = Sizes::known ? 4 : 2;
  constexpr Constant<vectors> all{};
  const auto n = size.n;
  const auto m = size.m;
  const auto p = size.p;
  const auto rows = p + n;  // without the last one
  const Layout layout{size.transposed};

  // Columns [C S, 0; A S, B Q], or in the other order, and a column [Re; G] for each pivot of the first p rows.
  V X[Sizes::most_columns][vectors], head[Sizes::most_heads][vectors];
  double Ux[strips_of(Sizes::most_states) * width];
  if (size.has_last)
    each(zero, strips_of(n),
         [&](Index s) KFSTAB_INLINED { store(Ux + s * width, 1, 0, width, entries_of_Ux(step, s * width)); });

  // Columns of p rows from `above` and n from `below`, X(i, j) = 0 for j > i + band of each, and a last row. Where matrices are
  // stored row by row, tiles are loaded by rows and transposed: a vector along a column would be gathered entry by entry.
  const auto load_columns = [&](V(*to)[vectors], auto count, const Source& above, Index above_band, const Source& below,
                                Index below_band, const double* last) KFSTAB_INLINED {
    if (layout.transposed) {
      const auto row_part = [&](Index row, Index j) KFSTAB_INLINED {
        const double* data = nullptr;
        Index end = count;
        if (row < p) {
          data = above.data ? layout.at(above, row, 0) : nullptr;
          end = least(end, row + above_band + 1);
        } else if (row < rows) {
          data = below.data ? layout.at(below, row - p, 0) : nullptr;
          end = least(end, row - p + below_band + 1);
        } else if (size.has_last && row == rows) {
          data = last;
        }
        return data && j < end ? load(data + j, 1, 0, least(end - j, width)) : V{};
      };
      each(zero, all, [&](Index v) KFSTAB_INLINED {
        each(zero, strips_of(count), [&](Index t) KFSTAB_INLINED {
          V tile[width];
          each(zero, Constant<width>{},
               [&](Index l) KFSTAB_INLINED { tile[l] = row_part(v * width + l, t * width); });
          transpose(tile);
          each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
            if (t * width + q < count) to[t * width + q][v] = tile[q];
          });
        });
      });
      return;
    }
    each(zero, count, [&](Index j) KFSTAB_INLINED {
      each(zero, all, [&](Index v) KFSTAB_INLINED {
        const Index row = v * width;
        V column{};
        if (above.data && row < p) {
          const Index low = greatest(j - above_band - row, 0), high = least(p - row, width);
          if (low < high) column = load(layout.at(above, row, j), 1, low, high);
        }
        if (below.data && row + width > p && row < rows) {
          const Index low = greatest(p + greatest(j - below_band, 0) - row, 0), high = least(rows - row, width);
          if (low < high) column += load(layout.at(below, row - p, j), 1, low, high);
        }
        if (size.has_last && rows / width == v) column = with_lane(rows % width, column, splat(last[j]));
        to[j][v] = column;
      });
    });
  };
  // X_j := sum over k >= j of X_k L(k, j), of the columns from `first` on. Vector v is zero from column ends[v] on.
  const auto multiply_by_lower = [&](auto first, auto size_of_L, const Source& L, const Index(&ends)[vectors]) KFSTAB_INLINED {
    each(zero, size_of_L, [&](auto j) KFSTAB_INLINED {
      V sum[vectors];
      const V diagonal = splat(*layout.at(L, j, j));
      each(zero, all, [&](Index v) KFSTAB_INLINED { sum[v] = X[first + j][v] * diagonal; });
      const auto add = [&](auto k_first, auto k_end, auto from) KFSTAB_INLINED {
        each(k_first, k_end, [&](Index k) KFSTAB_INLINED {
          const V l = splat(*layout.at(L, k, j));
          each(from, all, [&](Index v) KFSTAB_INLINED { sum[v] = fma(X[first + k][v], l, sum[v]); });
        });
      };
      if constexpr (Sizes::known) {
        add(j + one, size_of_L, zero);
      } else {
        Index done = j + 1;
        each(zero, all, [&](auto v) KFSTAB_INLINED {
          add(done, ends[v], v);
          done = greatest(done, ends[v]);
        });
      }
      each(zero, all, [&](Index v) KFSTAB_INLINED { X[first + j][v] = sum[v]; });
    });
  };
  const Index C_band = Sizes::known ? Index(n) : step.C_band, A_band = Sizes::known ? Index(n) : step.A_band;
  Index ends[vectors];
  each(zero, all, [&](Index v) KFSTAB_INLINED {
    const Index last = (v + 1) * width - 1;  // row
    const Index of_C = v * width < p ? least(last, p - 1) + C_band + 1 : 0, of_A = last >= p ? last - p + A_band + 1 : 0;
    ends[v] = least(greatest(of_C, of_A), n);  // n where the last row is
  });
  load_columns(X + size.at_S, n, step.C, C_band, step.A, A_band, Ux);
  multiply_by_lower(size.at_S, n, step.S, ends);
  load_columns(X + size.at_Q, m, {}, 0, step.B, n + m, step.y);
  each(zero, all, [&](Index v) KFSTAB_INLINED { ends[v] = m; });
  if (step.Q.data) multiply_by_lower(size.at_Q, m, step.Q, ends);
  load_columns(head, p, step.R, 0, {}, 0, step.z);

  // Of an information filter's gain the right-hand sides: rows in lanes, and one more for the state. Where sizes are not known
  // information_results() does it.
  const auto rows_of_gain = strips_of(m + one);
  V gain[Sizes::most_rows_of_gain];
  // Columns of the m rows that strip t of the gain has, X(i, j) = 0 for j > i + band.
  const auto load_gain = [&](V* to, Index t, auto count, const Source& from, Index band) KFSTAB_INLINED {
    const Index first = t * width;
    if (!layout.transposed) {
      each(zero, count, [&](Index j) KFSTAB_INLINED {
        const Index low = greatest(j - band - first, 0), high = least(m - first, width);
        to[j] = low < high ? load(layout.at(from, first, j), 1, low, high) : V{};
      });
      return;
    }
    each(zero, strips_of(count), [&](Index c) KFSTAB_INLINED {
      V tile[width];
      each(zero, Constant<width>{}, [&](Index l) KFSTAB_INLINED {
        const Index row = first + l, j = c * width, end = least(count, row + band + 1);
        tile[l] = row < m && j < end ? load(layout.at(from, row, j), 1, 0, least(end - j, width)) : V{};
      });
      transpose(tile);
      each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
        if (c * width + q < count) to[c * width + q] = tile[q];
      });
    });
  };
  if (Sizes::known && step.Kf.data)
    each(zero, strips_of(m), [&](auto t) KFSTAB_INLINED {
      if (step.QQB.data) {
        load_gain(gain + t * n, t, n, step.QQB, n + m);
        return;
      }
      V Q[Sizes::most_noises];
      load_gain(Q, t, m, step.Q, 0);
      each(zero, n, [&](auto k) KFSTAB_INLINED {
        V sum{};
        each(zero, m, [&](Index i) KFSTAB_INLINED { sum = fma(Q[i], entry(X[size.at_Q + i], p + k), sum); });
        gain[t * n + k] = sum;
      });
    });

  // Rows first ... last - 1 of columns, and of a lower triangle that alone, go out: by rows, in tiles, where matrices are stored
  // so. What is not finite makes x - x a NaN.
  V difference{};
  const auto store_columns = [&](const auto* columns_of, auto count, Index first, Index last, bool lower,
                                 const Target& to) KFSTAB_INLINED {
    if (layout.transposed) {
      each(zero, all, [&](auto v) KFSTAB_INLINED {
        each(zero, strips_of(count), [&](Index t) KFSTAB_INLINED {
          const Index j = t * width;
          if (v * width >= last || (v + one) * width <= first || (lower && (v + one) * width <= first + j)) return;
          V tile[width];
          each(zero, Constant<width>{},
               [&](Index q) KFSTAB_INLINED { tile[q] = j + q < count ? columns_of[j + q][v] : V{}; });
          transpose(tile);
          each(zero, Constant<width>{}, [&](Index l) KFSTAB_INLINED {
            const Index row = v * width + l, end = lower ? least(count, row - first + 1) : Index(count);
            if (row < first || row >= last || j >= end) return;
            const V used = in_lanes(0, least(end - j, width), tile[l]);
            difference += used - used;
            store(layout.at(to, row - first, j), 1, 0, least(end - j, width), tile[l]);
          });
        });
      });
      return;
    }
    each(zero, count, [&](Index j) KFSTAB_INLINED {
      each(zero, all, [&](Index v) KFSTAB_INLINED {
        const Index row = v * width, low = greatest(first + (lower ? Index(j) : 0) - row, 0),
                    high = least(last - row, width);
        if (low >= high) return;
        difference += columns_of[j][v] - columns_of[j][v];
        store(layout.at(to, row - first, j), 1, low, high, columns_of[j][v]);
      });
    });
  };
  // Row after row. What is known of the one that is annihilated next: its reflector, and its products with all rows, summed in
  // several chains.
  bool ok = true;
  Reflector is{};
  V w[chains][vectors], squares[chains] = {};
  const auto pivot_column = [&](Index row) KFSTAB_INLINED -> V(&)[vectors] { return row < p ? head[row] : X[row - p]; };
  const auto sum_of_chains = [&](Index v) KFSTAB_INLINED {
    V sum = w[0][v] + w[1][v];
    if constexpr (chains == 4) sum += w[2][v] + w[3][v];
    return sum;
  };
  const auto clear_products = [&](auto from) KFSTAB_INLINED {
    each(zero, Constant<chains>{},
         [&](Index c) KFSTAB_INLINED { each(from, all, [&](Index v) KFSTAB_INLINED { w[c][v] = V{}; }); });
  };
  // Of a row in vector v, whose products with the rows there are at hand.
  const auto make_reflector = [&](auto row, auto v) KFSTAB_INLINED {
    V square = squares[0] + squares[1];
    if constexpr (chains == 4) square += squares[2] + squares[3];
    each(zero, Constant<chains>{}, [&](Index c) KFSTAB_INLINED { squares[c] = V{}; });
    is = reflector(lane(pivot_column(row)[v], row)[0], square[0], ok, [&]() KFSTAB_INLINED {
      Lanes bits{};
      each(size.first_column(row), size.end_column(row), [&](Index k) KFSTAB_INLINED { bits |= (Lanes)X[k][v]; });
      return lane(magnitude((V)bits), row)[0] == 0;
    });
  };
  // Does the reflector of a row, in vector `from`, to the rows below it, and prepares that of the next row. The vector that has the
  // next row goes first: then the next reflector is known, and its root and its division are on their way while the vectors below
  // follow.
  const auto reflect = [&](auto row, auto from) KFSTAB_INLINED {
    V(&pivots)[vectors] = pivot_column(row);
    const auto next = after(row, rows);
    if (next == row && !size.has_last) {  // it has no row below: nobody waits for d
      pivots[from] = with_lane(row % width, pivots[from], splat(is.beta));
      return;
    }
    V f[vectors];
    const V pivot = splat(is.pivot), d = splat(is.d);
    each(from, all, [&](Index v) KFSTAB_INLINED {
      const V product = fma(pivots[v], pivot, sum_of_chains(v));
      f[v] = (v == from ? in_lanes(row % width + 1, width, product) : product) * d;
      pivots[v] = fma(f[v], pivot, pivots[v]);
    });
    pivots[from] = with_lane(row % width, pivots[from], splat(is.beta));
    const auto first = size.first_column(row);
    const auto end = size.end_column(row);  // of a type of its own
    // Columns before the next row's are updated alone, those from `end` on have products alone.
    const auto update = [&](Index k, Index v, V x) KFSTAB_INLINED {
      if (k < end) X[k][v] = fma(f[v], x, X[k][v]);
    };
    if (next == row) {
      each(first, end, [&](Index k) KFSTAB_INLINED {
        const V x = lane(X[k][from], row);
        each(from, all, [&](Index v) KFSTAB_INLINED { update(k, v, x); });
      });
      return;
    }
    clear_products(from);
    const auto next_first = size.first_column(next);
    const auto next_end = size.end_column(next);
    with_vector_of(next, from, all, [&](auto of_next) KFSTAB_INLINED {
      each(first, next_first, [&](Index k) KFSTAB_INLINED { update(k, of_next, lane(X[k][from], row)); });
      each_column(next_first, next_end, [&](Index k, Index c) KFSTAB_INLINED {
        update(k, of_next, lane(X[k][from], row));
        const V y = lane(X[k][of_next], next);
        squares[c] = fma(y, y, squares[c]);
        w[c][of_next] = fma(X[k][of_next], y, w[c][of_next]);
      });
      make_reflector(next, of_next);
      each(first, next_first, [&](Index k) KFSTAB_INLINED {
        const V x = lane(X[k][from], row);
        each(of_next + one, all, [&](Index v) KFSTAB_INLINED { update(k, v, x); });
      });
      each_column(next_first, next_end, [&](Index k, Index c) KFSTAB_INLINED {
        const V x = lane(X[k][from], row), y = lane(X[k][of_next], next);
        each(of_next + one, all, [&](Index v) KFSTAB_INLINED {
          update(k, v, x);
          w[c][v] = fma(X[k][v], y, w[c][v]);
        });
      });
    });
  };
  const auto results_of_Re = [&]() KFSTAB_INLINED {
    store_columns(head, p, 0, p, true, step.Re);
    if (step.rcond_of_Re) {
      double norm = 0;
      each(zero, p, [&](Index j) KFSTAB_INLINED {
        V sum{};
        each(zero, all, [&](Index v) KFSTAB_INLINED {
          const Index row = v * width;
          if (row < p) sum += magnitude(in_lanes(j - row, p - row, head[j][v]));
        });
        norm = larger(sum_of_lanes(sum), norm);
      });
      *step.rcond_of_Re = small_reciprocal_condition<vectors, Sizes::most_heads>(
          p, norm, [&](auto i, auto k) KFSTAB_INLINED { return entry(head[k], i); });
    }
    if (step.K.data) {
      if (step.divide)
        each(zero, p, [&](auto i) KFSTAB_INLINED {
          const auto j = p - one - i;
          V sum[vectors];
          each(zero, all, [&](Index v) KFSTAB_INLINED { sum[v] = head[j][v]; });
          each(j + one, p, [&](auto k) KFSTAB_INLINED {
            const V l = entry(head[j], k);
            each(zero, all, [&](Index v) KFSTAB_INLINED { sum[v] = fma(-l, head[k][v], sum[v]); });
          });
          const V inverse = splat(1 / entry(head[j], j)[0]);
          each(zero, all, [&](Index v) KFSTAB_INLINED { head[j][v] = sum[v] * inverse; });
        });
      if (step.U_transposed.data)
        each(zero, p, [&](auto j) KFSTAB_INLINED {
          V sum[vectors] = {};
          each(zero, n, [&](auto k) KFSTAB_INLINED {
            const V x = entry(head[j], p + k);
            each(zero, all, [&](Index v) KFSTAB_INLINED {
              const Index row = v * width, low = greatest(p - row, 0), high = least(rows - row, width);
              if (low < high)
                sum[v] = fma(load(step.U_transposed.data + (row - p) + k * step.U_transposed.leading, 1, low, high), x, sum[v]);
            });
          });
          each(zero, all, [&](Index v) KFSTAB_INLINED { head[j][v] = sum[v]; });
        });
      store_columns(head, p, p, rows, false, step.K);
    }
  };
  clear_products(zero);
  const auto row_0 = n - n;
  if (rows > 0) {
    each_column(size.first_column(row_0), size.end_column(row_0), [&](Index k, Index c) KFSTAB_INLINED {
      const V x = entry(X[k], row_0);
      squares[c] = fma(x, x, squares[c]);
      each(zero, all, [&](Index v) KFSTAB_INLINED { w[c][v] = fma(X[k][v], x, w[c][v]); });
    });
    make_reflector(row_0, zero);
  }
  if constexpr (Sizes::known) {
    // The gain is made of Re and G while the reflectors of the other rows wait for their roots.
    constexpr Constant<greatest(decltype(p)::value - 1, 0)> last_of_C{};
    if constexpr (vectors * (n + m) * p > 256)  // code for each row would be more than the processor has at hand
      each_row<vectors>(Index(zero), Index(last_of_C), reflect);
    else
      each_row<vectors>(zero, last_of_C, reflect);
    each_row<vectors>(last_of_C, p, reflect);
    results_of_Re();
    each_row<vectors>(p, rows, reflect);
  } else {  // the text once
    each_row<vectors>(zero, rows, reflect);
    results_of_Re();
  }
  if (!ok) return false;

  store_columns(X, n, p, rows, true, step.S_next);
  if (size.has_last) {
    each(zero, n, [&](Index j) KFSTAB_INLINED {
      const V x = entry(X[j], rows);
      difference += x - x;
      step.xi[j] = x[0];
    });
    each(zero, m, [&](Index j) KFSTAB_INLINED {
      const V x = entry(X[n + j], rows);
      difference += x - x;
      step.e[j] = x[0];
    });
  }
  if (Sizes::known && step.rcond_of_T) {
    V sum[vectors] = {};  // of a row of S+, which is a column of T
    each(zero, n, [&](Index j) KFSTAB_INLINED {
      each(zero, all, [&](Index v) KFSTAB_INLINED {
        const Index row = v * width;
        if (row < rows) sum[v] += magnitude(in_lanes(p + j - row, rows - row, X[j][v]));
      });
    });
    double norm = 0;
    each(zero, all, [&](Index v) KFSTAB_INLINED { norm = larger(largest_lane(sum[v]), norm); });
    // From the last to the first, T is lower triangular.
    *step.rcond_of_T = small_reciprocal_condition<vectors, Sizes::most_states>(
        n, norm, [&](auto i, auto k) KFSTAB_INLINED { return entry(X[n - one - i], p + (n - one - k)); });
  }
  if (Sizes::known && (step.Kf.data || step.x_next)) {
    V inverse[Sizes::most_states];
    each(zero, n, [&](auto j) KFSTAB_INLINED { inverse[j] = splat(1 / entry(X[j], p + j)[0]); });
    each(zero, rows_of_gain, [&](Index t) KFSTAB_INLINED {
      const Index row = t * width, last_row = step.Kf.data ? Index(m) : 0, high = least(last_row - row, width);
      const bool state = step.x_next && last_row / width == t;
      if (high <= 0 && !state) return;
      V x[Sizes::most_states];
      each(zero, n, [&](Index k) KFSTAB_INLINED { x[k] = high > 0 ? gain[t * n + k] : V{}; });
      if (high > 0)  // x := x S+'^{-1}
        each(zero, n, [&](auto j) KFSTAB_INLINED {
          x[j] *= inverse[j];
          each(j + one, n, [&](auto k) KFSTAB_INLINED { x[k] = fma(-entry(X[j], p + k), x[j], x[k]); });
        });
      if (state)
        each(zero, n, [&](Index k) KFSTAB_INLINED { x[k] = with_lane(last_row % width, x[k], splat(step.xi[k])); });
      each(zero, n, [&](auto i) KFSTAB_INLINED {  // x := x S+^{-1}
        const auto j = n - one - i;
        x[j] *= inverse[j];
        each(zero, j, [&](Index k) KFSTAB_INLINED { x[k] = fma(-entry(X[k], p + j), x[j], x[k]); });
      });
      V result[Sizes::most_states];
      each(zero, n, [&](Index k) KFSTAB_INLINED {
        result[k] = x[k];
        if (step.U_transposed.data) {
          result[k] = V{};
          each(zero, n, [&](Index i) KFSTAB_INLINED {
            result[k] = fma(x[i], splat(step.U_transposed.data[k + i * step.U_transposed.leading]), result[k]);
          });
        }
      });
      each(zero, strips_of(n), [&](Index c) KFSTAB_INLINED {
        V tile[width];
        const Index j = c * width, end = least(n - j, width);
        each(zero, Constant<width>{},
             [&](Index q) KFSTAB_INLINED { tile[q] = q < end ? result[least(j + q, n - 1)] : V{}; });
        each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
          if (!layout.transposed && high > 0 && q < end) store(layout.at(step.Kf, row, j + q), 1, 0, high, tile[q]);
        });
        transpose(tile);
        each(zero, Constant<width>{}, [&](Index l) KFSTAB_INLINED {
          const bool of_state = state && last_row % width == l;
          if (l >= high && !of_state) return;
          difference += tile[l] - tile[l];
          if (of_state) store(step.x_next + j, 1, 0, end, tile[l]);
          else if (layout.transposed) store(layout.at(step.Kf, row + l, j), 1, 0, end, tile[l]);
        });
      });
    });
  }
  return all_zero(difference);
}

/// Whether unrolling everything for a size pays: the vectors fit the registers, or nearly.
constexpr bool fixed_pays(Index n, Index m, Index p, bool has_last) {
  const Index vectors = (n + p + has_last + width - 1) / width;
  return vectors * (n + m + p) <= (width == 8 ? 96 : width == 4 ? 64 : 48);
}

/// For sizes that are known at compile time, and small: all vectors stay in registers, or near them.
template <Index N, Index M, Index P, bool has_last, bool transposed>
KFSTAB_INLINE bool fixed_array_step(const ArrayStep& step) {
  return small_array_step<(P + N + has_last + width - 1) / width>(FixedSizes<N, M, P, has_last, transposed>{}, step);
}

// ---- large: panels of as many rows as a vector has lanes, applied to all rows below at once (compact WY) ----

/// The reflectors of a panel, H_0 H_1 ... = I + U T U'. Column j of U is (pivot e_j; x_j) where the heads stand apart from X,
/// and for heads that are columns of X it has the x_j of the heads between; head[k] is row k of the heads' part. T is upper
/// triangular, T(i, j) = t[j][i].
struct Panel {
  V head[width];
  V t[width];
};

/// Makes the first `rows` reflectors of a strip and does them to it.
/// @param head  the pivots' columns    @param X  `count` columns. within: the heads are the first of them
/// @param meanwhile  called once for each reflector, where the processor has nothing to do but to wait for its root and its
///   division
template <bool within, class Meanwhile>
KFSTAB_INLINE bool factor_panel(V* head, V* X, Index count, Index rows, Panel& panel, Meanwhile&& meanwhile) {
  bool ok = true;
  constexpr Constant<4> chains{};  // sums, so that none waits for the addition before
  V w[chains] = {};
  const auto each_of_X = [&](Index k, auto f) KFSTAB_INLINED {
    for (; k + chains <= count; k += chains) each(zero, chains, [&](Index c) KFSTAB_INLINED { f(k + c, c); });
    for (; k < count; ++k) f(k, zero);
  };
  each_of_X(Index(within), [&](Index k, Index c) KFSTAB_INLINED { w[c] = fma(X[k], lane<0>(X[k]), w[c]); });
  each(zero, Constant<width>{}, [&](auto j) KFSTAB_INLINED {
    constexpr Index J = decltype(j)::value, next = least(J + 1, width - 1);
    panel.t[J] = panel.head[J] = V{};
    if (J >= rows) return;
    const V sum = (w[0] + w[1]) + (w[2] + w[3]);
    const Index first = within ? J + 1 : 0;
    const Reflector is = reflector(lane<J>(head[J])[0], lane<J>(sum)[0], ok, [&] {
      bool none = true;
      for (Index k = first; k < count; ++k) none = none && X[k][J] == 0;
      return none;
    });
    meanwhile();
    const V pivot = splat(is.pivot), d = splat(is.d);
    const V product = fma(head[J], pivot, sum) * d;  // d u_i'u_J in the lanes i before J, f in those behind
    V column{};
    each(zero, j, [&](auto i) KFSTAB_INLINED { column = fma(panel.t[i], lane<decltype(i)::value>(product), column); });
    panel.t[J] = with_lane(J, column, d);
    const V f = from_lane<J + 1>(product);
    panel.head[J] = with_lane(J, within ? head[J] - from_lane<J>(head[J]) : V{}, pivot);
    head[J] = with_lane(J, fma(f, pivot, head[J]), splat(is.beta));
    each(zero, chains, [&](Index c) KFSTAB_INLINED { w[c] = V{}; });
    if (within && first < count) X[first] = fma(f, lane<J>(X[first]), X[first]);  // the next head
    each_of_X(first + within, [&](Index k, Index c) KFSTAB_INLINED {
      const V x = X[k] = fma(f, splat(reinterpret_cast<const double*>(X + k)[J]), X[k]);
      w[c] = fma(x, lane<next>(x), w[c]);
    });
  });
  return ok;
}

/// What doing the first Q reflectors of a panel to R strips takes, Z (I + U T U'), in pieces: Z U, of the heads and of the
/// columns that the panel has in X; that times T; and what becomes of the heads and of the columns.
template <bool within, Index R, Index Q>
struct Application {
  const Panel* panel;
  Strips X;
  Index count;
  Strips head, to;  ///< of the R strips: their heads, Q columns, and their columns that the panel has in X
  V z[R][Q];

  static constexpr Constant<Q> all{};
  static constexpr Constant<R> strips{};

  KFSTAB_INLINE void begin() {
    each(zero, all, [&](Index q) KFSTAB_INLINED { each(zero, strips, [&](Index i) KFSTAB_INLINED { z[i][q] = V{}; }); });
    each_head_entry([&](Index k, Index q, V entry_q) KFSTAB_INLINED {
      each(zero, strips, [&](Index i) KFSTAB_INLINED { z[i][q] = fma(head(i, k), entry_q, z[i][q]); });
    });
  }
  /// Columns first ... last - 1.
  KFSTAB_INLINE void add(Index first, Index last) {
    V sum[R][Q];  // not in memory
    each(zero, all,
         [&](Index q) KFSTAB_INLINED { each(zero, strips, [&](Index i) KFSTAB_INLINED { sum[i][q] = z[i][q]; }); });
    for (Index k = first; k < last; ++k) add_outer<R>(sum, to, k, X.entries(k));
    each(zero, all,
         [&](Index q) KFSTAB_INLINED { each(zero, strips, [&](Index i) KFSTAB_INLINED { z[i][q] = sum[i][q]; }); });
  }
  KFSTAB_INLINE void turn() {
    const auto* t = reinterpret_cast<const double*>(panel->t);
    each(zero, all, [&](auto last) KFSTAB_INLINED {
      constexpr Constant<Q - 1 - decltype(last)::value> q{};
      const V diagonal = splat(t[q * width + q]);
      each(zero, strips, [&](Index i) KFSTAB_INLINED { z[i][q] *= diagonal; });
      each(zero, q, [&](Index before) KFSTAB_INLINED {
        const V entry_t = splat(t[q * width + before]);
        each(zero, strips, [&](Index i) KFSTAB_INLINED { z[i][q] = fma(z[i][before], entry_t, z[i][q]); });
      });
    });
    each_head_entry([&](Index k, Index q, V entry_q) KFSTAB_INLINED {
      each(zero, strips, [&](Index i) KFSTAB_INLINED { head(i, k) = fma(z[i][q], entry_q, head(i, k)); });
    });
  }
  KFSTAB_INLINE void subtract(Index first, Index last) {
    V f[R][Q];  // not in memory
    each(zero, all,
         [&](Index q) KFSTAB_INLINED { each(zero, strips, [&](Index i) KFSTAB_INLINED { f[i][q] = z[i][q]; }); });
    for (Index k = first; k < last; ++k) {
      const double* x = X.entries(k);
      V column[R];
      each(zero, strips, [&](Index i) KFSTAB_INLINED { column[i] = to(i, k); });
      each(zero, all, [&](Index q) KFSTAB_INLINED {
        const V entry_q = splat(x[q]);
        each(zero, strips, [&](Index i) KFSTAB_INLINED { column[i] = fma(f[i][q], entry_q, column[i]); });
      });
      each(zero, strips, [&](Index i) KFSTAB_INLINED { to(i, k) = column[i]; });
    }
  }

 private:
  template <class F>
  KFSTAB_INLINE void each_head_entry(F&& f) const {  // of U: diagonal, or upper triangular
    const auto* u = reinterpret_cast<const double*>(panel->head);
    each(zero, all, [&](auto k) KFSTAB_INLINED {
      if constexpr (within) each(zero, k, [&](auto q) KFSTAB_INLINED { f(k, q, splat(u[k * width + q])); });
      f(k, k, splat(u[k * width + k]));
    });
  }
};

/// All of it at once.
template <bool within, Index R, Index Q = width>
KFSTAB_INLINE void apply_panel(const Panel& panel, const Strips& X, Index count, const Strips& head, const Strips& to) {
  Application<within, R, Q> application{&panel, X, count, head, to, {}};
  application.begin();
  application.add(0, count);
  application.turn();
  application.subtract(0, count);
}

/// One strip to which a panel is still to be done: that is done while the reflectors of the next panel are waited for.
template <bool within>
struct Pending {
  Application<within, 1, width> application;
  Index done = 0, all = 0;  ///< columns, each to be added and subtracted

  KFSTAB_INLINE void begin(const Panel& panel, const Strips& X, Index count, const Strips& head, const Strips& to) {
    application = {&panel, X, count, head, to, {}};
    done = 0;
    all = 2 * count;
    application.begin();
  }
  __attribute__((noinline)) void advance(Index columns) {
    const Index count = application.count, last = least(done + columns, all);
    if (done >= last) return;
    if (done < count) {
      application.add(done, least(last, count));
      if (last < count) {
        done = last;
        return;
      }
      application.turn();
      done = count;
    }
    application.subtract(done - count, last - count);
    done = last;
  }
};

/// Columns first ... last - 1 of a strip: rows `row` ... `row` + high - 1 of X, X(i, j) = 0 for j > i + band, which is not read but
/// where a row is read whole. What is stored row by row is transposed in the registers.
KFSTAB_INLINE void load_strip(const Layout& layout, const Source& X, Index row, Index high, Index first, Index last,
                              Index band, const Strips& to) {
  Index k = first;
  high = least(high, width);
  const Index end = high <= 0 ? k : least(last, row + band + high);  // zeros behind it
  if (layout.transposed)
    for (; k + width <= end; k += width) {
      V tile[width];
      each(zero, Constant<width>{}, [&](Index l) KFSTAB_INLINED {
        tile[l] = l < high ? load(layout.at(X, row + l, k)) : V{};
      });
      transpose(tile);
      each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
        const Index low = k + q - band - row;
        to(0, k + q) = low <= 0 ? tile[q] : in_lanes(low, width, tile[q]);
      });
    }
  else if (high >= width)
    for (const Index full = least(end, row + band + 1); k < full; ++k) to(0, k) = load(layout.at(X, row, k));
  for (; k < end; ++k) to(0, k) = load(layout.at(X, row, k), layout.stride(X), greatest(k - band - row, 0), least(high, width));
  for (; k < last; ++k) to(0, k) = V{};
}

/// All strips of a matrix, a few columns at a time where these lie one after the other: memory is read in its order.
KFSTAB_INLINE void load_strips(const Layout& layout, const Source& X, Index rows, Index columns, Index band, Index strips,
                               const Strips& to) {
  const Index breadth = layout.transposed ? greatest(columns, 1) : 2 * width;
  for (Index k = 0; k < columns; k += breadth)
    for (Index s = 0; s < strips; ++s)
      load_strip(layout, X, s * width, rows - s * width, k, least(k + breadth, columns), band, to.at(s, 0));
}

/// Columns j ... j + width - 1 of a strip go where X(row, j) is; of a tile on the diagonal the lower triangle. Returns x - x.
KFSTAB_INLINE V store_tile(const Layout& layout, const Target& X, Index row, Index high, Index j, bool diagonal,
                           const Strips& strip) {
  V difference{}, tile[width];
  each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
    tile[q] = diagonal && q >= high ? V{} : in_lanes(diagonal ? Index(q) : 0, high, strip(0, j + q));
    difference += tile[q] - tile[q];
    if (!layout.transposed && !(diagonal && q >= high))
      store(layout.at(X, row, j + q), 1, diagonal ? Index(q) : 0, high, tile[q]);
  });
  if (layout.transposed) {
    transpose(tile);
    each(zero, Constant<width>{}, [&](Index l) KFSTAB_INLINED {
      if (l < high) store(layout.at(X, row + l, j), 1, 0, diagonal ? l + 1 : width, tile[l]);
    });
  }
  return difference;
}

/// What there is in the workspace. The strips of the array are first those of C, filled up with zeros, then those of A.
struct Places {
  Strips X, head;  ///< columns [A S, B Q] or [B Q, A S], and the heads [Re; G] apart
  V* packed;       ///< a packed triangle, and what is made of it
  Strips gain;     ///< of an information filter: Kf'

  KFSTAB_INLINE explicit Places(const ArrayStep& step) {
    const Index n = step.n, m = step.m, p = step.p;
    const Index strips = strips_of(p) + strips_of(n + (step.x != nullptr));
    // Aligned by hand: what a caller has is aligned for doubles alone.
    X = {reinterpret_cast<V*>(reinterpret_cast<char*>(step.work) +
                              (sizeof(V) - reinterpret_cast<std::size_t>(step.work) % sizeof(V)) % sizeof(V)),
         n + m};
    head = {X.column + strips * X.length, strips_of(p) * width};
    packed = head.column + strips * head.length;
    gain = {packed + packed_room(n, m, p) / width, n};
  }
};

/// Q (B Q)', for Kf', of strips of B Q.
__attribute__((noinline)) inline void prepare_gain(const ArrayStep& step, const Places& at, const Strips& BQ) {
  const Layout layout{step.transposed};
  const Index m = step.m, n = step.n;
  const Strips Q{at.packed, m};
  if (step.QQB.data)
    load_strips(layout, step.QQB, m, n, n + m, strips_of(m), at.gain);
  else
    load_strips(layout, step.Q, m, m, 0, strips_of(m), Q);
  if (!step.QQB.data) multiply<Part::all>(at.gain, Q, 0, strips_of(m), BQ, n, m);
}

/// Strips of B Q, which a small array has in registers.
KFSTAB_INLINE Strips small_BQ(const ArrayStep& step, const Places& at) {
  const Layout layout{step.transposed};
  const Strips BQ{at.X.column, step.m};
  if (step.QQB.data) return BQ;
  load_strips(layout, step.B, step.n, step.m, step.n + step.m, strips_of(step.n), BQ);
  for (Index s = 0; s < strips_of(step.n); ++s) multiply_strips<1>(BQ.at(s, 0), {layout, step.Q}, step.m, step.m);
  return BQ;
}

/// Strips of U', in the place of [B Q, A S], which nobody needs any more.
KFSTAB_INLINE Strips strips_of_Ut(const ArrayStep& step, const Places& at) {
  const Strips Ut{at.X.column, step.n};
  load_strips({false}, step.U_transposed, step.n, step.n, 2 * step.n, strips_of(step.n), Ut);
  return Ut;
}

/// x_next, of S+ packed. Returns x - x for it.
__attribute__((noinline)) inline V information_state(const ArrayStep& step, const V* S, V* x) {
  const Index n = step.n;
  const auto part = [&](const double* from, Index v)
                        KFSTAB_INLINED { return load(from + v * width, 1, 0, least(n - v * width, width)); };
  for (Index v = 0; v < strips_of(n); ++v) x[v] = part(step.xi, v);
  divide_row(x, S, n);
  V difference{};
  each_group(0, strips_of(n), most_strips, [&](auto R, Index v) KFSTAB_INLINED {
    V result[decltype(R)::value] = {};
    if (step.U_transposed.data)
      for (Index k = 0; k < n; ++k) {
        const V x_k = splat(reinterpret_cast<const double*>(x)[k]);
        each(zero, R, [&](Index i) KFSTAB_INLINED {
          result[i] = fma(part(step.U_transposed.data + k * step.U_transposed.leading, v + i), x_k, result[i]);
        });
      }
    else
      each(zero, R, [&](Index i) KFSTAB_INLINED { result[i] = x[v + i]; });
    each(zero, R, [&](Index i) KFSTAB_INLINED {
      difference += result[i] - result[i];
      const Index first = (v + i) * width;
      store(step.x_next + first, 1, 0, least(n - first, width), result[i]);
    });
  });
  return difference;
}

/// What an information filter wants to know of S+, which is stored; at.gain is prepared. Returns x - x for all results.
__attribute__((noinline)) inline V information_results(const ArrayStep& step, const Places& at) {
  V difference{};
  if (!step.Kf.data && !step.x_next && !step.rcond_of_T) return difference;
  const Layout layout{step.transposed};
  const Index n = step.n, m = step.m;
  V* const beside = at.packed + packed_size(n);
  pack_lower(layout, {step.S_next.data, step.S_next.leading}, n, at.packed);
  if (step.rcond_of_T) *step.rcond_of_T = reciprocal_condition(at.packed, n, Of::transpose, beside);
  if (step.x_next) difference += information_state(step, at.packed, beside);
  if (!step.Kf.data) return difference;
  each_group(0, strips_of(m), most_strips, [&](auto R, Index s) KFSTAB_INLINED {
    divide_strips_transposed<decltype(R)::value>(at.gain.at(s, 0), at.packed, n);
    divide_strips<decltype(R)::value>(at.gain.at(s, 0), at.packed, n);
  });
  Strips results = at.gain;
  if (step.U_transposed.data) {
    results = {at.packed, n};
    multiply<Part::all>(results, at.gain, 0, strips_of(m), strips_of_Ut(step, at), n, n);
  }
  for (Index s = 0; s < strips_of(m); ++s)
    for (Index k = 0; k < n; ++k) {
      const Index row = s * width, high = least(m - row, width);
      const V column = in_lanes(0, high, results(s, k));
      difference += column - column;
      store(layout.at(step.Kf, row, k), layout.stride(step.Kf), 0, high, column);
    }
  return difference;
}

/// For any sizes.
inline bool large_array_step(const ArrayStep& step) {
  const Index n = step.n, m = step.m, p = step.p, columns = n + m;
  const Layout layout{step.transposed};
  const bool has_last = step.x != nullptr;
  const Index C_strips = (p + width - 1) / width, strips = C_strips + (n + has_last + width - 1) / width;
  const Index heads = C_strips * width, last_strip = C_strips + n / width, last_lane = n % width;

  const Places at(step);
  const Strips X = at.X, head = at.head, AS = X.at(0, noise_first(step) ? m : 0), BQ = X.at(0, noise_first(step) ? 0 : n);
  V* const packed = at.packed;

  load_strips(layout, step.C, p, n, step.C_band, C_strips, AS);
  load_strips(layout, step.A, n, n, step.A_band, strips - C_strips, AS.at(C_strips, 0));
  load_strips(layout, {}, 0, m, 0, C_strips, BQ);
  load_strips(layout, step.B, n, m, n + m, strips - C_strips, BQ.at(C_strips, 0));
  load_strips(layout, step.R, p, p, 0, C_strips, head);
  for (Index s = 0; s < C_strips; ++s)
    for (Index k = p; k < heads; ++k) head(s, k) = V{};
  load_strips(layout, {}, 0, heads, 0, strips - C_strips, head.at(C_strips, 0));
  if (has_last) {
    for (Index k = 0; k < n; k += width) {
      const V x = entries_of_Ux(step, k);
      for (Index q = 0; q < least(n - k, width); ++q) AS(last_strip, k + q)[last_lane] = x[q];
    }
    for (Index k = 0; k < m; ++k) BQ(last_strip, k)[last_lane] = step.y[k];
    for (Index k = 0; k < p; ++k) head(last_strip, k)[last_lane] = step.z[k];
  }

  // Rows of S that are far from each other are fetched from memory again and again, and packed rows lie one after the other.
  const bool pack = layout.transposed && n > 128;
  if (pack) pack_lower(layout, step.S, n, packed);
  const Lower S = pack ? Lower(packed) : Lower(layout, step.S);
  const auto multiply_by_S = [&](Index first, Index last, Index band) KFSTAB_INLINED {
    each_group(first, last, most_strips, [&](auto R, Index s) KFSTAB_INLINED {
      const bool full = has_last && s + R > last_strip;
      const Index end = full ? n : (s - first + R) * width + band;
      multiply_strips<decltype(R)::value>(AS.at(s, 0), S, n, end);
    });
  };
  multiply_by_S(0, C_strips, step.C_band);
  multiply_by_S(C_strips, strips, step.A_band);
  if (step.Q.data)
    each_group(C_strips, strips, most_strips, [&](auto R, Index s) KFSTAB_INLINED {
      multiply_strips<decltype(R)::value>(BQ.at(s, 0), {layout, step.Q}, m, m);
    });
  if (step.Kf.data) prepare_gain(step, at, BQ.at(C_strips, 0));

  bool ok = true;
  Panel panels[2];
  for (Index s = 0; s < C_strips && ok; ++s) {
    const Index row = s * width, count = least(n, row + width + step.C_band);
    Panel& panel = panels[0];
    ok = factor_panel<false>(&head(s, row), &AS(s, 0), count, least(p - row, width), panel, []() KFSTAB_INLINED {});
    const auto apply = [&](auto Q) KFSTAB_INLINED {
      each_group(s + 1, strips, most_strips, [&](auto R, Index t) KFSTAB_INLINED {
        apply_panel<false, decltype(R)::value, decltype(Q)::value>(panel, AS.at(s, 0), count, head.at(t, row), AS.at(t, 0));
      });
    };
    if (p - row > width / 2)
      apply(Constant<width>{});
    else
      apply(Constant<width / 2>{});
  }
  Pending<true> pending;
  for (Index s = C_strips; s < strips && ok; ++s) {
    const Index row = (s - C_strips) * width, rows = least(n - row, width);
    const Index count = least(columns - row, noise_first(step) ? width + m + step.A_band : columns);
    if (rows <= 0) break;
    Panel& panel = panels[s % 2];
    const Index share = (pending.all + width - 1) / width;  // of each reflector; a panel with fewer is the last, and has none
    ok = factor_panel<true>(&X(s, row), &X(s, row), count, rows, panel,
                            [&]() KFSTAB_INLINED { pending.advance(share); });
    // Of the strips below the last one is left to the next panel, which does not need it.
    const Index now = s + 2 < strips ? strips - 1 : strips;
    each_group(s + 1, now, most_strips, [&](auto R, Index t) KFSTAB_INLINED {
      apply_panel<true, decltype(R)::value>(panel, X.at(s, row + width), count - width, X.at(t, row),
                                            X.at(t, row + width));
    });
    pending.all = 0;
    if (now < strips) pending.begin(panel, X.at(s, row + width), count - width, X.at(now, row), X.at(now, row + width));
  }
  if (!ok) return false;

  V difference{};
  const auto put = [&](const Target& to, Index row, Index j, Index low, Index high, V x) KFSTAB_INLINED {
    difference += x - x;
    store(layout.at(to, row, j), layout.stride(to), low, high, x);
  };
  const auto store_tile_of_S = [&](Index row, Index j) KFSTAB_INLINED {
    difference += store_tile(layout, step.S_next, row, least(n - row, width), j, j == row, X.at(C_strips + row / width, 0));
  };
  if (layout.transposed) {  // in the order of memory
    for (Index row = 0; row < n; row += width)
      for (Index j = 0; j <= row; j += width) store_tile_of_S(row, j);
  } else {
    for (Index j = 0; j < n; j += width)
      for (Index row = j; row < n; row += width) store_tile_of_S(row, j);
  }
  for (Index j = 0; j < p; ++j)
    for (Index row = j / width * width; row < p; row += width)
      put(step.Re, row, j, greatest(j - row, 0), least(p - row, width), head(row / width, j));
  if (has_last) {
    for (Index j = 0; j < columns; ++j) {
      const double x = X(last_strip, j)[last_lane];
      difference += splat(x - x);
      (j < n ? step.xi[j] : step.e[j - n]) = x;
    }
  }

  if (step.K.data || step.rcond_of_Re) pack_lower(layout, {step.Re.data, step.Re.leading}, p, packed);
  if (step.rcond_of_Re) *step.rcond_of_Re = reciprocal_condition(packed, p, Of::triangle, packed + packed_size(p));
  if (step.K.data) {
    if (step.divide)
      each_group(C_strips, strips_of(n) + C_strips, most_strips,
                 [&](auto R, Index s) KFSTAB_INLINED { divide_strips<decltype(R)::value>(head.at(s, 0), packed, p); });
    if (step.U_transposed.data) {
      const Strips Ut = strips_of_Ut(step, at);
      const auto K_entries = [&](Index k, Index j)
                                 KFSTAB_INLINED { return head.at(C_strips + k / width, j).entries(0) + k % width; };
      each_group(0, strips_of(n), most_strips, [&](auto R, Index s) KFSTAB_INLINED {
        for (Index j = 0; j < p; j += width) {
          V sum[decltype(R)::value][width] = {};
          for (Index k = 0; k < n; ++k) add_outer<decltype(R)::value, width>(sum, Ut.at(s, 0), k, K_entries(k, j));
          each(zero, R, [&](Index i) KFSTAB_INLINED {
            const Index row = (s + i) * width;
            each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
              if (j + q < p) put(step.K, row, j + q, 0, least(n - row, width), sum[i][q]);
            });
          });
        }
      });
    } else {
      for (Index j = 0; j < p; ++j)
        for (Index row = 0; row < n; row += width)
          put(step.K, row, j, 0, least(n - row, width), head(C_strips + row / width, j));
    }
  }
  difference += information_results(step, at);
  return all_zero(difference);
}

template <Index vectors>
__attribute__((noinline)) inline bool run_time_array_step(const ArrayStep& step) {
  if (!small_array_step<vectors>(RunTimeSizes(step), step))
    return false;
  if (!step.Kf.data && !step.x_next && !step.rcond_of_T) return true;
  const Places at(step);
  if (step.Kf.data) prepare_gain(step, at, small_BQ(step, at));
  return all_zero(information_results(step, at));
}

/// For sizes that are known at run time. False: it gave up, and what it was to write is undefined.
inline bool array_step(const ArrayStep& step) {
  const Index vectors = (step.n + step.p + (step.x != nullptr) + width - 1) / width;
  if (step.n + step.m <= RunTimeSizes::most_columns) {
    if (vectors <= 1) return run_time_array_step<1>(step);
    if (vectors == 2) return run_time_array_step<2>(step);
    if (vectors == 3) return run_time_array_step<3>(step);
    if constexpr (width < 8)
      if (vectors == 4) return run_time_array_step<4>(step);
  }
  return large_array_step(step);
}

}  // namespace kfstab::kernels::KFSTAB_KERNELS

#endif
