#pragma once

#include <kfstab/filters/kernels/array_kernel.hpp>
#include <kfstab/filters/kernels/batch_step.hpp>
#include <kfstab/filters/kernels/condition.hpp>

#ifdef KFSTAB_KERNELS

/// BatchStep by vectors: one filter in each lane, and what array_kernel.hpp does with one reflector after the other is done
/// with all of them at once. The passes take four rows at a time, so that an entry of the pivot's row, once loaded, serves all.
namespace kfstab::kernels::KFSTAB_KERNELS {

/// `width` of the eight lanes.
struct LanesOf {
  Index first;
  KFSTAB_INLINE V get(const Eight& x) const { return *reinterpret_cast<const V*>(x.lane + first); }
  KFSTAB_INLINE void put(Eight& x, V value) const { *reinterpret_cast<V*>(x.lane + first) = value; }
};

/// The row that is annihilated, and the next, whose products are wanted.
struct Rows {
  V* X;  ///< column k from X + k distance on
  Index distance, columns;
  Index pivot, next;
  KFSTAB_INLINE V& operator()(Index i, Index k) const { return X[k * distance + i]; }
};

/// Rows i ... i + R - 1: X_k += f x_k,pivot in columns first ... and, from column first + skip on, w = products with row next.
template <Index R>
KFSTAB_INLINE void update_rows(const Rows& rows, Index i, Index first, Index skip, const V* f, V* w) {
  constexpr Constant<R> all{};
  V sum[R] = {}, factor[R];
  each(zero, all, [&](auto r) KFSTAB_INLINED { factor[r] = f[i + r]; });
  Index k = first;
  for (; k < least(first + skip, rows.columns); ++k) {
    const V x = rows(rows.pivot, k);
    each(zero, all, [&](auto r) KFSTAB_INLINED { rows(i + r, k) = fma(factor[r], x, rows(i + r, k)); });
  }
  for (; k < rows.columns; ++k) {
    const V x = rows(rows.pivot, k), y = rows(rows.next, k);
    each(zero, all, [&](auto r) KFSTAB_INLINED {
      const V updated = fma(factor[r], x, rows(i + r, k));
      rows(i + r, k) = updated;
      sum[r] = fma(updated, y, sum[r]);
    });
  }
  each(zero, all, [&](auto r) KFSTAB_INLINED { w[i + r] = sum[r]; });
}

template <Index R>
KFSTAB_INLINE void row_products(const Rows& rows, Index i, Index first, V* w) {
  constexpr Constant<R> all{};
  V sum[R] = {};
  for (Index k = first; k < rows.columns; ++k) {
    const V y = rows(rows.next, k);
    each(zero, all, [&](auto r) KFSTAB_INLINED { sum[r] = fma(rows(i + r, k), y, sum[r]); });
  }
  each(zero, all, [&](auto r) KFSTAB_INLINED { w[i + r] = sum[r]; });
}

inline constexpr Constant<4> four{};

/// A reflector in every lane.
struct LaneReflectors {
  V beta, pivot, d;
};

/// Those of (alpha; x), x the entries of `row` from column `first` on. A lane whose squares are not safe is marked in `bad`.
KFSTAB_INLINE LaneReflectors lane_reflectors(V alpha, V square, const Rows& rows, Index row, Index first, Lanes& bad) {
  const V norm2 = fma(alpha, alpha, square);
  const Lanes unsafe = ~((norm2 >= least_square) & (norm2 <= greatest_square)), idle = unsafe | (square == 0);
  if (any(unsafe)) [[unlikely]] {
    Lanes some = alpha != 0;
    for (Index k = first; k < rows.columns; ++k) some |= rows(row, k) != 0;
    bad |= unsafe & some;
  }
  const V norm = root(norm2), beta = idle ? alpha : alpha < 0 ? norm : -norm, pivot = alpha - beta;
  return {beta, pivot, idle ? V{} : 1 / (beta * pivot)};
}

/// Does the reflector of row rows.pivot, whose column of the pivot is head and whose x begins in column `first`, to the rows
/// up to `end`, and leaves the products of row rows.next in w and its reflector in `is`. That is made as soon as it can be: a
/// root and a division take as long as a pass over several rows, and go on meanwhile.
/// @param next_head  the column of the next pivot; the first `skip` columns of X are that
KFSTAB_INLINE void reflect_lanes(const Rows& rows, Index end, Index first, Index skip, V* head, const V* next_head,
                                 V* w, V* f, LaneReflectors& is, Lanes& bad) {
  const Index j = rows.pivot, next = j + 1;
  head[j] = is.beta;
  for (Index i = next; i < end; ++i) {
    f[i] = fma(head[i], is.pivot, w[i]) * is.d;
    head[i] = fma(f[i], is.pivot, head[i]);
  }
  if (next >= end) return;
  V sum[2] = {};
  const auto update_next = [&](Index k)
                               KFSTAB_INLINED { return rows(next, k) = fma(f[next], rows(j, k), rows(next, k)); };
  for (Index k = first; k < least(first + skip, rows.columns); ++k) update_next(k);
  each_column(first + skip, rows.columns, [&](Index k, auto c) KFSTAB_INLINED {
    const V x = update_next(k);
    sum[c] = fma(x, x, sum[c]);
  });
  if (next_head) is = lane_reflectors(next_head[next], sum[0] + sum[1], rows, next, first + skip, bad);
  each_group(j + 2, end, four,
             [&](auto R, Index i) KFSTAB_INLINED { update_rows<decltype(R)::value>(rows, i, first, skip, f, w); });
}

/// 1 / (||L||_1 ||L^{-1}||_1) of L, p x p, lower, in the first rows of `head`. L^{-1} is formed, column after column: p^3/6
/// multiply-adds are little beside the array, and no lane goes a way of its own, as an estimate would have it.
/// @param inverses  1 / L_jj    @param x  p, workspace
KFSTAB_INLINE V rcond_of_root(const V* head, Index distance, Index p, const V* inverses, V* x) {
  V norm{}, inverse_norm{};
  for (Index j = 0; j < p; ++j) {
    V sum = magnitude(head[j * distance + j]), inverse_sum = magnitude(inverses[j]);
    x[j] = inverses[j];
    for (Index i = j + 1; i < p; ++i) {
      sum += magnitude(head[j * distance + i]);
      V product{};
      for (Index k = j; k < i; ++k) product = fma(head[k * distance + i], x[k], product);
      x[i] = -product * inverses[i];
      inverse_sum += magnitude(x[i]);
    }
    norm = larger(sum, norm);
    inverse_norm = larger(inverse_sum, inverse_norm);
  }
  return p > 0 ? 1 / (norm * inverse_norm) : 1 + V{};
}

/// All lanes of `lanes`. Which of them gave up: all bits of such a lane are set.
KFSTAB_INLINE Lanes batch_lanes(const BatchStep& step, const LanesOf& lanes) {
  const Index n = step.n, m = step.m, p = step.p, end = p + n, columns = n + m;
  V* const X = reinterpret_cast<V*>(step.work);  // columns [C S, 0; A S, B Q]
  V* const head = X + columns * end;
  V* const w = head + p * end;
  V* const f = w + end;
  const auto row_of = [&](Index i, Index k) KFSTAB_INLINED {  // [C; A]
    return lanes.get(i < p ? step.C[i + k * p] : step.A[i - p + k * n]);
  };
  const auto row_of_B = [&](Index i, Index k) KFSTAB_INLINED { return lanes.get(step.B[i - p + k * n]); };
  const auto multiply = [&](auto R, Index i, Index to, const Eight* L, Index size, auto row) KFSTAB_INLINED {
    for (Index j = 0; j < size; ++j) {
      V sum[decltype(R)::value] = {};
      for (Index k = j; k < size; ++k) {
        const V l = lanes.get(L[k + j * size]);
        each(zero, R, [&](auto r) KFSTAB_INLINED { sum[r] = fma(row(i + r, k), l, sum[r]); });
      }
      each(zero, R, [&](auto r) KFSTAB_INLINED { X[(to + j) * end + i + r] = sum[r]; });
    }
  };
  each_group(0, end, four, [&](auto R, Index i) KFSTAB_INLINED { multiply(R, i, 0, step.S, n, row_of); });
  each_group(p, end, four, [&](auto R, Index i) KFSTAB_INLINED { multiply(R, i, n, step.Q, m, row_of_B); });
  for (Index j = 0; j < p; ++j) {
    for (Index i = 0; i < end; ++i) head[j * end + i] = i >= j && i < p ? lanes.get(step.R[i + j * p]) : V{};
  }

  Lanes bad{};
  Rows at{X, end, n, 0, 0};
  const auto products = [&](Index first) KFSTAB_INLINED {
    each_group(at.next, end, four,
               [&](auto R, Index i) KFSTAB_INLINED { row_products<decltype(R)::value>(at, i, first, w); });
  };
  if (p > 0) {
    products(0);
    LaneReflectors is = lane_reflectors(head[0], w[0], at, 0, 0, bad);
    for (Index j = 0; j < p; ++j) {
      at.pivot = j;
      at.next = j + 1;
      V* const column = head + j * end;
      reflect_lanes(at, end, 0, 0, column, j + 1 < p ? column + end : nullptr, w, f, is, bad);
    }
  }
  if (n > 0) {
    at.columns = columns;
    at.next = p;
    products(1);
    LaneReflectors is = lane_reflectors(X[p], w[p], at, p, 1, bad);
    for (Index j = 0; j < n; ++j) {
      at.pivot = p + j;
      at.next = p + j + 1;
      reflect_lanes(at, end, j + 1, 1, X + j * end, X + (j + 1) * end, w, f, is, bad);
    }
  }

  V difference{};
  const auto put = [&](Eight& to, V x) KFSTAB_INLINED {
    difference += x - x;
    lanes.put(to, x);
  };
  for (Index j = 0; j < n; ++j)
    for (Index i = j; i < n; ++i) put(step.S_next[i + j * n], X[j * end + p + i]);
  for (Index j = 0; j < p; ++j)
    for (Index i = j; i < p; ++i) put(step.Re[i + j * p], head[j * end + i]);
  V* const inverses = f + end;  // of the diagonal of Re
  if (step.K || step.rcond)
    for (Index j = 0; j < p; ++j) inverses[j] = 1 / head[j * end + j];
  if (step.rcond) lanes.put(*step.rcond, rcond_of_root(head, end, p, inverses, inverses + p));
  if (step.K)
    for (Index j = p - 1; j >= 0; --j) {
      const V inverse = inverses[j];
      for (Index i = p; i < end; ++i) {
        V sum = head[j * end + i];
        for (Index k = j + 1; k < p; ++k) sum = fma(-head[j * end + k], head[k * end + i], sum);
        head[j * end + i] = sum * inverse;
        put(step.K[i - p + j * n], head[j * end + i]);
      }
    }
  if (step.x) {
    V* const innovation = inverses + p;
    for (Index i = 0; i < p; ++i) {
      V sum = lanes.get(step.y[i]);
      for (Index k = 0; k < n; ++k) sum = fma(-lanes.get(step.C[i + k * p]), lanes.get(step.x[k]), sum);
      innovation[i] = sum;
    }
    for (Index i = 0; i < n; ++i) {
      V sum = lanes.get(step.Du[i]);
      for (Index k = 0; k < n; ++k) sum = fma(lanes.get(step.A[i + k * n]), lanes.get(step.x[k]), sum);
      for (Index k = 0; k < p; ++k) sum = fma(head[k * end + p + i], innovation[k], sum);
      put(step.x_next[i], sum);
    }
  }
  return bad | ~(difference == 0);
}

/// Returns the lanes that gave up, as bits: what was to be written for them is undefined.
inline unsigned batch_step(const BatchStep& step) {
  unsigned gave_up = 0;
  for (Index first = 0; first < 8; first += width) {
    const Lanes bad = batch_lanes(step, {first});
    for (Index l = 0; l < width; ++l)
      if (bad[l]) gave_up |= 1u << (first + l);
  }
  return gave_up;
}

}  // namespace kfstab::kernels::KFSTAB_KERNELS

#endif
