#pragma once

#include <kfstab/filters/kernels/vector.hpp>

#ifdef KFSTAB_KERNELS

/// ArrayStep by vectors: rows of the array lie side by side in the lanes, and a column of a strip of rows is one vector.
///
/// A reflector that annihilates row j of [head, X], head (a vector) being the column of the pivot, is H = I + d u u' with
/// u = (pivot; x_j), x_j being row j of X, and d = 1 / (beta pivot), beta = -+|(alpha; x_j)|, pivot = alpha - beta. One pass
/// over the columns k of X,
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

struct Reflector {
  double beta, pivot, d;  ///< d = 0: nothing is to be done
};

/// The reflector of a row (alpha; x) with x'x = square. Not ok, and d = 0, if squares are not safe; zero() says whether
/// x = 0 to the last bit.
template <class Zero>
KFSTAB_INLINE Reflector reflector(double alpha, double square, bool& ok, Zero&& zero) {
  const double norm2 = alpha * alpha + square;
  if (!(norm2 >= least_square && norm2 <= greatest_square)) [[unlikely]] {
    ok = ok && alpha == 0 && zero();
    return {alpha, 0, 0};
  }
  if (square == 0) return {alpha, 0, 0};
  const double norm = root(norm2), beta = alpha < 0 ? norm : -norm, pivot = alpha - beta;
  return {beta, pivot, 1 / (beta * pivot)};
}

// ---- small: the whole array in NV vectors a column, one reflector after the other ----

/// The sizes of a step: known when it is compiled, or not.
template <Index N, Index M, Index P, bool has_last_, bool transposed_>
struct FixedSizes {
  static constexpr bool known = true, has_last = has_last_, transposed = transposed_;
  static constexpr Constant<N> n{};
  static constexpr Constant<M> m{};
  static constexpr Constant<P> p{};
  static constexpr Index most_columns = greatest(N + M, 1), most_heads = greatest(P, 1);
};
struct RunTimeSizes {
  static constexpr bool known = false;
  bool has_last, transposed;
  Index n, m, p;
  static constexpr Index most_columns = 48, most_heads = 4 * width;
};

inline constexpr Constant<0> zero{};
inline constexpr Constant<1> one{};

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

/// The entry of that row in all lanes.
template <Index vectors, Index Row>
KFSTAB_INLINE V entry(const V (&column)[vectors], Constant<Row>) {
  return lane<Row % width>(column[Row / width]);
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

template <Index vectors, class Sizes>
KFSTAB_INLINE bool small_array_step(const Sizes& size, const ArrayStep& step) {
  constexpr Index chains = Sizes::known ? 4 : 2;
  constexpr Constant<vectors> all{};
  const auto n = size.n;
  const auto m = size.m;
  const auto p = size.p;
  const auto rows = p + n;  // without the last one
  const auto columns = n + m;
  const Layout layout{size.transposed};

  // Columns [C S, 0; A S, B Q], what they are made from, and a column [Re; G] for each pivot of the first p rows.
  V X[Sizes::most_columns][vectors], given[Sizes::most_columns][vectors], head[Sizes::most_heads][vectors];

  // Rows low ... of a column, the first p from `above` if there is one, and the entry of the last row.
  const auto load_column = [&](V(&to)[vectors], const Source* above, Index above_low, const Source& below,
                               Index below_low, Index j, const double* last) KFSTAB_INLINED {
    each(zero, all, [&](auto v) KFSTAB_INLINED {
      const Index row = v * width;
      V column{};
      if (above && row < p) {
        const Index low = greatest(above_low - row, 0), high = least(p - row, width);
        if (low < high) column = load(layout.at(*above, row, j), layout.stride(*above), low, high);
      }
      if (row + width > p && row < rows) {
        const Index low = greatest(p + below_low - row, 0), high = least(rows - row, width);
        if (low < high) column += load(layout.at(below, row - p, j), layout.stride(below), low, high);
      }
      if (size.has_last && rows / width == v) column = with_lane(rows % width, column, splat(last[j]));
      to[v] = column;
    });
  };
  // X[first + j] = sum over k >= j of given[k] L(k, j)
  const auto multiply_lower = [&](auto first, auto size_of_L, const Source& L) KFSTAB_INLINED {
    each(zero, size_of_L, [&](auto j) KFSTAB_INLINED {
      V sum[vectors];
      const V diagonal = splat(*layout.at(L, j, j));
      each(zero, all, [&](auto v) KFSTAB_INLINED { sum[v] = given[j][v] * diagonal; });
      each(j + one, size_of_L, [&](auto k) KFSTAB_INLINED {
        const V l = splat(*layout.at(L, k, j));
        each(zero, all, [&](auto v) KFSTAB_INLINED { sum[v] = fma(given[k][v], l, sum[v]); });
      });
      each(zero, all, [&](auto v) KFSTAB_INLINED { X[first + j][v] = sum[v]; });
    });
  };
  each(zero, n, [&](auto j) KFSTAB_INLINED {
    const Index C_low = Sizes::known ? 0 : j - step.C_band, A_low = Sizes::known ? 0 : greatest(j - step.A_band, 0);
    load_column(given[j], &step.C, C_low, step.A, A_low, j, step.x);
  });
  multiply_lower(zero, n, step.S);
  each(zero, m, [&](auto j) KFSTAB_INLINED { load_column(given[j], nullptr, 0, step.B, 0, j, step.y); });
  if (step.Q.data)
    multiply_lower(n, m, step.Q);
  else
    each(zero, m,
         [&](auto j) KFSTAB_INLINED { each(zero, all, [&](auto v) KFSTAB_INLINED { X[n + j][v] = given[j][v]; }); });
  each(zero, p, [&](auto j) KFSTAB_INLINED {
    each(zero, all, [&](auto v) KFSTAB_INLINED {
      const Index row = v * width, low = greatest(j - row, 0), high = least(p - row, width);
      V column{};
      if (low < high) column = load(layout.at(step.R, row, j), layout.stride(step.R), low, high);
      if (size.has_last && rows / width == v) column = with_lane(rows % width, column, splat(step.z[j]));
      head[j][v] = column;
    });
  });

  bool ok = true;
  V w[chains][vectors];
  const auto clear_products = [&](auto from) KFSTAB_INLINED {
    each(zero, Constant<chains>{},
         [&](auto c) KFSTAB_INLINED { each(from, all, [&](auto v) KFSTAB_INLINED { w[c][v] = V{}; }); });
  };
  const auto add_products = [&](auto row, auto from, auto k, auto c) KFSTAB_INLINED {
    const V x = entry(X[k], row);
    each(from, all, [&](auto v) KFSTAB_INLINED { w[c][v] = fma(X[k][v], x, w[c][v]); });
  };
  // Rows above the pivot's in its vector are finished, or never were there, and what happens to them is of no account:
  // so whole vectors are taken, from the pivot's on. The first `skip` of the columns have no part in the next row's w:
  // there they are the head.
  const auto reflect = [&](auto row, auto from, V(&pivot_column)[vectors], auto first, auto last, auto skip,
                           auto next) KFSTAB_INLINED {
    V sum[vectors], f[vectors];
    each(from, all, [&](auto v) KFSTAB_INLINED {
      sum[v] = w[0][v] + w[1][v];
      if constexpr (chains == 4) sum[v] += w[2][v] + w[3][v];
    });
    const Reflector is = reflector(entry(pivot_column, row)[0], entry(sum, row)[0], ok, [&]() KFSTAB_INLINED {
      bool none = true;
      each(first, last, [&](auto k) KFSTAB_INLINED { none = none && entry(X[k], row)[0] == 0; });
      return none;
    });
    const V pivot = splat(is.pivot), d = splat(is.d);
    each(from, all, [&](auto v) KFSTAB_INLINED {
      f[v] = fma(pivot_column[v], pivot, sum[v]) * d;
      pivot_column[v] = fma(f[v], pivot, pivot_column[v]);
    });
    pivot_column[from] = with_lane(row % width, pivot_column[from], splat(is.beta));
    clear_products(from);
    const auto update = [&](auto k) KFSTAB_INLINED {
      const V x = entry(X[k], row);
      each(from, all, [&](auto v) KFSTAB_INLINED { X[k][v] = fma(f[v], x, X[k][v]); });
    };
    if (skip > 0 && first < last) update(first);
    each_column(first + skip, last, [&](auto k, auto c) KFSTAB_INLINED {
      update(k);
      add_products(next, from, k, c);
    });
  };
  clear_products(zero);
  each_column(zero, n, [&](auto k, auto c) KFSTAB_INLINED { add_products(zero, zero, k, c); });
  each_row<vectors>(zero, p,
                    [&](auto row, auto v) KFSTAB_INLINED { reflect(row, v, head[row], zero, n, zero, after(row, p)); });
  clear_products(zero);
  each_column(one, columns, [&](auto k, auto c) KFSTAB_INLINED { add_products(p, zero, k, c); });
  each_row<vectors>(p, rows, [&](auto row, auto v) KFSTAB_INLINED {
    const auto j = row - p;
    reflect(row, v, X[j], j + one, columns, one, after(row, rows));
  });
  if (!ok) return false;

  // Out go the lower triangles. What is not finite makes x - x a NaN.
  V difference{};
  const auto store_rows = [&](const V(&column)[vectors], const Target& to, Index j, Index first, Index last,
                              Index shift) KFSTAB_INLINED {
    each(zero, all, [&](auto v) KFSTAB_INLINED {
      const Index row = v * width, low = greatest(first - row, 0), high = least(last - row, width);
      if (low >= high) return;
      difference += column[v] - column[v];
      store(layout.at(to, row - shift, j), layout.stride(to), low, high, column[v]);
    });
  };
  each(zero, n, [&](auto j) KFSTAB_INLINED { store_rows(X[j], step.S_next, j, p + j, rows, p); });
  each(zero, p, [&](auto j) KFSTAB_INLINED { store_rows(head[j], step.Re, j, j, p, 0); });
  if (step.K.data) {
    if (step.divide)
      each(zero, p, [&](auto i) KFSTAB_INLINED {
        const auto j = p - one - i;
        V sum[vectors];
        each(zero, all, [&](auto v) KFSTAB_INLINED { sum[v] = head[j][v]; });
        each(j + one, p, [&](auto k) KFSTAB_INLINED {
          const V l = entry(head[j], k);
          each(zero, all, [&](auto v) KFSTAB_INLINED { sum[v] = fma(-l, head[k][v], sum[v]); });
        });
        const V inverse = splat(1 / entry(head[j], j)[0]);
        each(zero, all, [&](auto v) KFSTAB_INLINED { head[j][v] = sum[v] * inverse; });
      });
    if (!Sizes::known && step.U.data) {
      for (Index j = 0; j < p; ++j) {
        V sum[vectors] = {};
        for (Index k = 0; k < n; ++k) {
          const V x = entry(head[j], p + k);
          each(zero, all, [&](auto v) KFSTAB_INLINED {
            const Index row = v * width, low = greatest(p - row, 0), high = least(rows - row, width);
            if (low < high)
              sum[v] = fma(load(step.U.data + k + (row - p) * step.U.leading, step.U.leading, low, high), x, sum[v]);
          });
        }
        each(zero, all, [&](auto v) KFSTAB_INLINED { head[j][v] = sum[v]; });
      }
    }
    each(zero, p, [&](auto j) KFSTAB_INLINED { store_rows(head[j], step.K, j, p, rows, p); });
  }
  if (size.has_last) {
    each(zero, n, [&](auto j) KFSTAB_INLINED {
      const V x = entry(X[j], rows);
      difference += x - x;
      step.xi[j] = x[0];
    });
    each(zero, m, [&](auto j) KFSTAB_INLINED {
      const V x = entry(X[n + j], rows);
      difference += x - x;
      step.e[j] = x[0];
    });
  }
  return all_zero(difference);
}

/// Whether unrolling everything for a size pays: the vectors fit the registers, or nearly.
constexpr bool fixed_pays(Index n, Index m, Index p, bool has_last) {
  const Index vectors = (n + p + has_last + width - 1) / width;
  return vectors * (n + m + p) <= (width == 8 ? 96 : 48);
}

/// For sizes that are known at compile time, and small: all vectors stay in registers, or near them.
template <Index N, Index M, Index P, bool has_last, bool transposed>
KFSTAB_INLINE bool fixed_array_step(const ArrayStep& step) {
  return small_array_step<(P + N + has_last + width - 1) / width>(FixedSizes<N, M, P, has_last, transposed>{}, step);
}

// ---- large: panels of as many rows as a vector has lanes, applied to all rows below at once (compact WY) ----

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

/// sum[i][q] += x(i, k) l[q distance], q = 0 ... width - 1: the heart of all products.
template <Index R, Index distance = 1>
KFSTAB_INLINE void add_outer(V (&sum)[R][width], const Strips& x, Index k, const double* l) {
  V column[R];
  each(zero, Constant<R>{}, [&](auto i) KFSTAB_INLINED { column[i] = x(i, k); });
  each(zero, Constant<width>{}, [&](auto q) KFSTAB_INLINED {
    const V entry_q = splat(l[q * distance]);
    each(zero, Constant<R>{}, [&](auto i) KFSTAB_INLINED { sum[i][q] = fma(column[i], entry_q, sum[i][q]); });
  });
}

/// Packs a lower triangle of order K for products from the right, in blocks of `width` columns: a row of a block is a vector.
KFSTAB_INLINE void pack_lower(const Layout& layout, const Source& L, Index K, V* out) {
  const Index stride = layout.transposed ? 1 : L.leading;
  for (Index j = 0; j < K; j += width)
    for (Index k = j; k < K; ++k) *out++ = load(layout.at(L, k, j), stride, 0, least(k - j + 1, width));
}

/// x := x L for R strips of K columns, in place; L packed. The strips are zero from column `end` on, and stay so.
template <Index R>
KFSTAB_INLINE void multiply_strips(const Strips& x, const V* L, Index K, Index end) {
  for (Index j = 0; j < least(K, end); L += K - j, j += width) {
    V sum[R][width] = {};
    for (Index k = j; k < least(K, end); ++k) add_outer<R>(sum, x, k, reinterpret_cast<const double*>(L + (k - j)));
    each(zero, Constant<width>{}, [&](auto q) KFSTAB_INLINED {
      if (j + q < K) each(zero, Constant<R>{}, [&](auto i) KFSTAB_INLINED { x(i, j + q) = sum[i][q]; });
    });
  }
}

/// x := x L^{-1}, likewise.
template <Index R>
KFSTAB_INLINE void divide_strips(const Strips& x, const V* L, Index K) {
  const V* end = L;
  for (Index j = 0; j < K; j += width) end += K - j;
  for (Index j = (K - 1) / width * width; j >= 0; j -= width) {
    end -= K - j;
    V sum[R][width] = {};
    for (Index k = j + width; k < K; ++k) add_outer<R>(sum, x, k, reinterpret_cast<const double*>(end + (k - j)));
    const auto* l = reinterpret_cast<const double*>(end);  // entry (j + k, j + q) is l[k width + q]
    each(zero, Constant<width>{}, [&](auto last) KFSTAB_INLINED {
      constexpr Constant<width - 1 - decltype(last)::value> q{};
      if (j + q >= K) return;
      const V inverse = splat(1 / l[q * width + q]);
      each(zero, Constant<R>{}, [&](auto i) KFSTAB_INLINED { sum[i][q] = (x(i, j + q) - sum[i][q]) * inverse; });
      each(zero, Constant<R>{}, [&](auto i) KFSTAB_INLINED { x(i, j + q) = sum[i][q]; });
      each(zero, q, [&](auto before) KFSTAB_INLINED {
        const V l_q = splat(l[q * width + before]);
        each(zero, Constant<R>{}, [&](auto i) KFSTAB_INLINED { sum[i][before] = fma(sum[i][q], l_q, sum[i][before]); });
      });
    });
  }
}

/// The reflectors of a panel, H_0 H_1 ... = I + U T U'. Column j of U is (pivot e_j; x_j) where the heads stand apart from X,
/// and for heads that are columns of X it has the x_j of the heads between; head[k] is row k of the heads' part. T is upper
/// triangular, T(i, j) = t[j][i].
struct Panel {
  V head[width];
  V t[width];
};

/// Makes the first `rows` reflectors of a strip and does them to it.
/// @param head  the pivots' columns    @param X  `count` columns. within: the heads are the first of them
template <bool within>
KFSTAB_INLINE bool factor_panel(V* head, V* X, Index count, Index rows, Panel& panel) {
  bool ok = true;
  V w[2] = {};
  each_column(Index(within), count, [&](Index k, auto c) KFSTAB_INLINED { w[c] = fma(X[k], lane<0>(X[k]), w[c]); });
  each(zero, Constant<width>{}, [&](auto j) KFSTAB_INLINED {
    constexpr Index J = decltype(j)::value, next = least(J + 1, width - 1);
    panel.t[J] = panel.head[J] = V{};
    if (J >= rows) return;
    const V sum = w[0] + w[1];
    const Index first = within ? J + 1 : 0;
    const Reflector is = reflector(lane<J>(head[J])[0], lane<J>(sum)[0], ok, [&] {
      bool none = true;
      for (Index k = first; k < count; ++k) none = none && X[k][J] == 0;
      return none;
    });
    const V pivot = splat(is.pivot), d = splat(is.d);
    const V product = fma(head[J], pivot, sum) * d;  // d u_i'u_J in the lanes i before J, f in those behind
    V column{};
    each(zero, j, [&](auto i) KFSTAB_INLINED { column = fma(panel.t[i], lane<decltype(i)::value>(product), column); });
    panel.t[J] = with_lane(J, column, d);
    const V f = from_lane<J + 1>(product);
    panel.head[J] = with_lane(J, within ? head[J] - from_lane<J>(head[J]) : V{}, pivot);
    head[J] = with_lane(J, fma(f, pivot, head[J]), splat(is.beta));
    w[0] = w[1] = V{};
    Index k = first;
    if (within && k < count) {  // the next head
      X[k] = fma(f, lane<J>(X[k]), X[k]);
      ++k;
    }
    for (; k + 1 < count; k += 2) {
      const V a = fma(f, lane<J>(X[k]), X[k]), b = fma(f, lane<J>(X[k + 1]), X[k + 1]);
      X[k] = a;
      X[k + 1] = b;
      w[0] = fma(a, lane<next>(a), w[0]);
      w[1] = fma(b, lane<next>(b), w[1]);
    }
    if (k < count) {
      X[k] = fma(f, lane<J>(X[k]), X[k]);
      w[0] = fma(X[k], lane<next>(X[k]), w[0]);
    }
  });
  return ok;
}

/// Does the reflectors of a panel to R strips: their heads, `width` columns, and their columns that the panel has in X.
template <bool within, Index R>
KFSTAB_INLINE void apply_panel(const Panel& panel, const Strips& X, Index count, const Strips& head, const Strips& to) {
  constexpr Constant<width> all{};
  constexpr Constant<R> strips{};
  const auto* u = reinterpret_cast<const double*>(panel.head);
  const auto* t = reinterpret_cast<const double*>(panel.t);
  V z[R][width] = {};
  const auto each_head_entry = [&](auto f) KFSTAB_INLINED {  // of U: diagonal, or upper triangular
    each(zero, all, [&](auto k) KFSTAB_INLINED {
      if constexpr (within) each(zero, k, [&](auto q) KFSTAB_INLINED { f(k, q, splat(u[k * width + q])); });
      f(k, k, splat(u[k * width + k]));
    });
  };
  each_head_entry([&](auto k, auto q, V entry_q) KFSTAB_INLINED {
    each(zero, strips, [&](auto i) KFSTAB_INLINED { z[i][q] = fma(head(i, k), entry_q, z[i][q]); });
  });
  for (Index k = 0; k < count; ++k) add_outer<R>(z, to, k, X.entries(k));
  each(zero, all, [&](auto last) KFSTAB_INLINED {
    constexpr Constant<width - 1 - decltype(last)::value> q{};
    const V diagonal = splat(t[q * width + q]);
    each(zero, strips, [&](auto i) KFSTAB_INLINED { z[i][q] *= diagonal; });
    each(zero, q, [&](auto before) KFSTAB_INLINED {
      const V entry_t = splat(t[q * width + before]);
      each(zero, strips, [&](auto i) KFSTAB_INLINED { z[i][q] = fma(z[i][before], entry_t, z[i][q]); });
    });
  });
  each_head_entry([&](auto k, auto q, V entry_q) KFSTAB_INLINED {
    each(zero, strips, [&](auto i) KFSTAB_INLINED { head(i, k) = fma(z[i][q], entry_q, head(i, k)); });
  });
  for (Index k = 0; k < count; ++k) {
    const double* x = X.entries(k);
    V column[R];
    each(zero, strips, [&](auto i) KFSTAB_INLINED { column[i] = to(i, k); });
    each(zero, all, [&](auto q) KFSTAB_INLINED {
      const V entry_q = splat(x[q]);
      each(zero, strips, [&](auto i) KFSTAB_INLINED { column[i] = fma(z[i][q], entry_q, column[i]); });
    });
    each(zero, strips, [&](auto i) KFSTAB_INLINED { to(i, k) = column[i]; });
  }
}

/// For any sizes. The strips are first those of C, filled up with zeros, then those of A; columns [B Q, A S], as the
/// Hessenberg forms want it, the heads [Re; G] apart.
inline bool large_array_step(const ArrayStep& step) {
  const Index n = step.n, m = step.m, p = step.p, columns = n + m;
  const Layout layout{step.transposed};
  const bool has_last = step.x != nullptr;
  const Index C_strips = (p + width - 1) / width, strips = C_strips + (n + has_last + width - 1) / width;
  const Index heads = C_strips * width, last_strip = C_strips + n / width, last_lane = n % width;

  // Aligned by hand: what a caller has is aligned for doubles alone.
  auto* const work =
      reinterpret_cast<V*>(reinterpret_cast<char*>(step.work) +
                           (sizeof(V) - reinterpret_cast<std::size_t>(step.work) % sizeof(V)) % sizeof(V));
  const Strips X{work, columns}, head{work + strips * columns, heads};
  V* const packed = head.column + strips * heads;
  const Strips AS = X.at(0, m);

  for (Index s = 0; s < strips; ++s) {
    const bool of_C = s < C_strips;
    const Index row = (of_C ? s : s - C_strips) * width, high = least((of_C ? p : n) - row, width);
    const Source& left = of_C ? step.C : step.A;
    const Index band = of_C ? step.C_band : step.A_band;
    for (Index k = 0; k < n; ++k) {
      const Index low = greatest(k - band - row, 0);
      AS(s, k) = low < high ? load(layout.at(left, row, k), layout.stride(left), low, high) : V{};
    }
    for (Index k = 0; k < m; ++k)
      X(s, k) = of_C || high <= 0 ? V{} : load(layout.at(step.B, row, k), layout.stride(step.B), 0, high);
    for (Index k = 0; k < heads; ++k) {
      const Index low = greatest(k - row, 0);
      head(s, k) =
          of_C && k < p && low < high ? load(layout.at(step.R, row, k), layout.stride(step.R), low, high) : V{};
    }
  }
  if (has_last) {
    for (Index k = 0; k < n; ++k) AS(last_strip, k)[last_lane] = step.x[k];
    for (Index k = 0; k < m; ++k) X(last_strip, k)[last_lane] = step.y[k];
    for (Index k = 0; k < p; ++k) head(last_strip, k)[last_lane] = step.z[k];
  }

  pack_lower(layout, step.S, n, packed);
  const auto multiply = [&](Index first, Index last, Index band) KFSTAB_INLINED {
    each_group(first, last, most_strips, [&](auto R, Index s) KFSTAB_INLINED {
      const bool full = has_last && s + R > last_strip;
      const Index end = full ? n : (s - first + R) * width + band;
      multiply_strips<decltype(R)::value>(AS.at(s, 0), packed, n, end);
    });
  };
  multiply(0, C_strips, step.C_band);
  multiply(C_strips, strips, step.A_band);
  if (step.Q.data) {
    pack_lower(layout, step.Q, m, packed);
    each_group(C_strips, strips, most_strips,
               [&](auto R, Index s) KFSTAB_INLINED { multiply_strips<decltype(R)::value>(X.at(s, 0), packed, m, m); });
  }

  bool ok = true;
  Panel panel;
  for (Index s = 0; s < C_strips && ok; ++s) {
    const Index row = s * width, count = least(n, row + width + step.C_band);
    ok = factor_panel<false>(&head(s, row), &AS(s, 0), count, least(p - row, width), panel);
    each_group(s + 1, strips, most_strips, [&](auto R, Index t) KFSTAB_INLINED {
      apply_panel<false, decltype(R)::value>(panel, AS.at(s, 0), count, head.at(t, row), AS.at(t, 0));
    });
  }
  for (Index s = C_strips; s < strips && ok; ++s) {
    const Index row = (s - C_strips) * width, rows = least(n - row, width);
    const Index count = least(columns - row, width + m + step.A_band);
    if (rows <= 0) break;
    ok = factor_panel<true>(&X(s, row), &X(s, row), count, rows, panel);
    each_group(s + 1, strips, most_strips, [&](auto R, Index t) KFSTAB_INLINED {
      apply_panel<true, decltype(R)::value>(panel, X.at(s, row + width), count - width, X.at(t, row),
                                            X.at(t, row + width));
    });
  }
  if (!ok) return false;

  V difference{};
  const auto put = [&](const Target& to, Index row, Index j, Index low, Index high, V x) KFSTAB_INLINED {
    difference += x - x;
    store(layout.at(to, row, j), layout.stride(to), low, high, x);
  };
  for (Index j = 0; j < n; ++j)
    for (Index row = j / width * width; row < n; row += width)
      put(step.S_next, row, j, greatest(j - row, 0), least(n - row, width), X(C_strips + row / width, j));
  for (Index j = 0; j < p; ++j)
    for (Index row = j / width * width; row < p; row += width)
      put(step.Re, row, j, greatest(j - row, 0), least(p - row, width), head(row / width, j));
  if (step.K.data) {
    if (step.divide) {
      pack_lower(layout, {step.Re.data, step.Re.leading}, p, packed);
      each_group(C_strips, strips, most_strips,
                 [&](auto R, Index s) KFSTAB_INLINED { divide_strips<decltype(R)::value>(head.at(s, 0), packed, p); });
    }
    if (step.U.data) {
      // Strips of U' in the place of X, whose lower triangle is stored by now.
      for (Index s = C_strips; s * width < heads + n; ++s)
        for (Index k = 0; k < n; ++k) {
          const Index row = (s - C_strips) * width;
          AS(s, k) = load(step.U.data + k + row * step.U.leading, step.U.leading, 0, least(n - row, width));
        }
      const auto K_entries = [&](Index k, Index j)
                                 KFSTAB_INLINED { return head.at(C_strips + k / width, j).entries(0) + k % width; };
      each_group(C_strips, strips, most_strips, [&](auto R, Index s) KFSTAB_INLINED {
        for (Index j = 0; j < p; j += width) {
          V sum[decltype(R)::value][width] = {};
          for (Index k = 0; k < n; ++k) add_outer<decltype(R)::value, width>(sum, AS.at(s, 0), k, K_entries(k, j));
          each(zero, R, [&](auto i) KFSTAB_INLINED {
            const Index row = (s + i - C_strips) * width;
            if (row >= n) return;
            each(zero, Constant<width>{}, [&](auto q) KFSTAB_INLINED {
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
  if (has_last) {
    for (Index j = 0; j < columns; ++j) {
      const double x = X(last_strip, j)[last_lane];
      difference += splat(x - x);
      (j < n ? step.xi[j] : step.e[j - n]) = x;
    }
  }
  return all_zero(difference);
}

template <Index vectors>
__attribute__((noinline)) inline bool run_time_array_step(const ArrayStep& step) {
  return small_array_step<vectors>(RunTimeSizes{step.x != nullptr, step.transposed, step.n, step.m, step.p}, step);
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
