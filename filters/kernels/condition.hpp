#pragma once

#include <kfstab/filters/kernels/strips.hpp>

#ifdef KFSTAB_KERNELS

/// The reciprocal condition number in the 1-norm of a matrix of which a packed triangle L is known: what reciprocal_condition of
/// linear_solve.hpp computes, half a dozen solves one after the other, in each of which every entry waits for those before it. Up
/// to some order the inverse itself costs less, and its norm is no estimate. Beyond, as an estimate needs no more than a digit,
/// blocks of `width` on the diagonal are inverted before, none of which waits for another, and a solve goes from block to block.
namespace kfstab::kernels::KFSTAB_KERNELS {

/// Which matrix: L, L' or L L'.
enum class Of { triangle, transpose, product };

inline constexpr Index greatest_inverse = 3 * width;

KFSTAB_INLINE V magnitude(V x) { return (V)((Lanes)x & 0x7fffffffffffffff); }
/// NaN where one of them is.
KFSTAB_INLINE V larger(V x, V most) { return ((x > most) | (x != x)) ? x : most; }
KFSTAB_INLINE double larger(double x, double most) { return x > most || x != x ? x : most; }
KFSTAB_INLINE double largest_lane(V x) {
  return fold_lanes(x, [](V a, V b) KFSTAB_INLINED { return larger(b, a); }, AllLanes{})[0];
}

/// Largest sum of absolute values of a column of L, or of a row: |L|, |L'|.
KFSTAB_INLINE double norm_of_packed(const V* L, Index K, Of of) {
  V most{};
  if (of == Of::triangle) {
    for (Index j = 0; j < K; j += width) {
      const V* block = L + packed_block(K, j);
      V sum[2] = {};
      Index k = 0;
      for (; k + 1 < K - j; k += 2) {
        sum[0] += magnitude(block[k]);
        sum[1] += magnitude(block[k + 1]);
      }
      if (k < K - j) sum[0] += magnitude(block[k]);
      most = larger(sum[0] + sum[1], most);
    }
  } else {
    for (Index k = 0; k < K; k += width) {
      V sum[width] = {};
      for (Index j = 0; j <= k; j += width) {
        const V* rows = L + packed_block(K, j) + (k - j);
        each(zero, Constant<width>{}, [&](Index l) KFSTAB_INLINED {
          if (k + l < K) sum[l] += magnitude(rows[l]);
        });
      }
      most = larger(sums_of_lanes(sum), most);
    }
  }
  return largest_lane(most);
}

/// |L^{-1}| or |L'^{-1}|, of L^{-1}; or |(L L')^{-1}|. work: (strips_of(K) + 1) K vectors
KFSTAB_INLINE double norm_of_inverse(const V* L, Index K, Of of, V* work) {
  const Strips X{work, K}, columns{work + strips_of(K) * K, K};
  for (Index k = 0; k < K; ++k) columns(0, k) = V{};
  V most{};
  each_group(0, strips_of(K), most_strips, [&](auto R, Index s) KFSTAB_INLINED {
    const Index order = of == Of::product ? K : least(K, (s + R) * width);  // a row of L^{-1} ends at the diagonal
    const Strips x = X.at(s, 0);
    for (Index k = 0; k < order; ++k)
      each(zero, R, [&](auto i) KFSTAB_INLINED {
        x(i, k) = lane_numbers == k - (s + i) * width ? splat(1) : V{};
      });
    if (of == Of::product) divide_strips_transposed<decltype(R)::value>(x, L, K);
    divide_strips<decltype(R)::value>(x, L, K, order);
    if (of != Of::triangle) {
      V rows[decltype(R)::value] = {};
      for (Index k = 0; k < order; ++k)
        each(zero, R, [&](auto i) KFSTAB_INLINED { rows[i] += magnitude(x(i, k)); });
      each(zero, R, [&](Index i) KFSTAB_INLINED { most = larger(rows[i], most); });
    } else {
      for (Index k = 0; k < order; ++k)
        each(zero, R, [&](auto i) KFSTAB_INLINED { columns(0, k) += magnitude(x(i, k)); });
    }
  });
  if (of != Of::triangle) return largest_lane(most);
  for (Index k = 0; k < K; k += width) {
    V sum[width];
    each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED { sum[q] = k + q < K ? columns(0, k + q) : V{}; });
    most = larger(sums_of_lanes(sum), most);
  }
  return largest_lane(most);
}

/// The inverses of the blocks on the diagonal of a packed triangle, by rows and by columns: row j, or column j, is a vector.
struct DiagonalInverses {
  V *rows, *columns;

  KFSTAB_INLINE DiagonalInverses(const V* L, Index K, V* work) : rows(work), columns(work + strips_of(K) * width) {
    for (Index j = 0; j < K; j += width) {
      const auto* l =
          reinterpret_cast<const double*>(L + packed_block(K, j));  // entry (j + k, j + q) is l[k width + q]
      const Index high = least(K - j, width);
      V W[width], diagonal = splat(1);
      for (Index i = 0; i < high; ++i) diagonal[i] = l[i * width + i];
      const V inverse = splat(1) / diagonal;
      each(zero, Constant<width>{}, [&](auto i) KFSTAB_INLINED {
        V row{};  // what is behind the last one makes no contribution
        if (i < high) {
          row = with_lane(i, row, splat(1));
          each(zero, i, [&](Index k) KFSTAB_INLINED { row = fma(splat(-l[i * width + k]), W[k], row); });
        }
        W[i] = row * lane<decltype(i)::value>(inverse);
        rows[j + i] = W[i];
      });
      transpose(W);
      each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED { columns[j + q] = W[q]; });
    }
  }
};

/// The sum of left[q] x[q]: a row times a matrix of these rows.
KFSTAB_INLINE V times_rows(V left, const V* x) {
  V sum[2] = {};
  each(zero, Constant<width>{}, [&](auto q) KFSTAB_INLINED {
    constexpr Index chain = decltype(q)::value % 2;
    sum[chain] = fma(lane<decltype(q)::value>(left), x[q], sum[chain]);
  });
  return sum[0] + sum[1];
}

/// x := x L^{-1} for one row, as divide_row.
__attribute__((noinline)) inline void solve_row(V* x, const V* L, Index K, const DiagonalInverses& of) {
  divide_row(x, L, K, [&](Index j, V left) KFSTAB_INLINED { return times_rows(left, of.rows + j); });
}
/// x := x L'^{-1}.
__attribute__((noinline)) inline void solve_row_transposed(V* x, const V* L, Index K, const DiagonalInverses& of) {
  for (Index j = 0; j < K; j += width) {
    const auto products_of_rows = [&](auto rows) KFSTAB_INLINED {
      V sum[width] = {};
      for (Index before = 0; before < j; before += width) {
        const V* row = L + packed_block(K, before) + (j - before);
        each(zero, rows, [&](Index q) KFSTAB_INLINED { sum[q] = fma(row[q], x[before / width], sum[q]); });
      }
      return sums_of_lanes(sum);
    };
    const Index rows = least(K - j, width);
    const V products = rows == width ? products_of_rows(Constant<width>{}) : products_of_rows(rows);
    x[j / width] = times_rows(x[j / width] - products, of.columns + j);
  }
}

/// An estimate of the same from below, as reciprocal_condition of linear_solve.hpp makes it. work: (3 + 2 width) strips_of(K) vectors
__attribute__((noinline)) inline double estimate_of_inverse(const V* L, Index K, Of of, V* work) {
  const Index vectors = strips_of(K);
  V *const x = work, *const sign = work + vectors, *const alternating = work + 2 * vectors;
  const DiagonalInverses inverses(L, K, work + 3 * vectors);
  const auto solve = [&](V* y, bool other) KFSTAB_INLINED {  // y := M^{-1} y; other: M'^{-1} y, M = L, L' or L L'
    if (of == Of::product || (of == Of::transpose) == other) solve_row_transposed(y, L, K, inverses);
    if (of == Of::product || (of == Of::transpose) != other) solve_row(y, L, K, inverses);
  };
  const auto sum = [&](const V* y) KFSTAB_INLINED {
    V s{};
    for (Index v = 0; v < vectors; ++v) s += magnitude(y[v]);
    return sum_of_lanes(s);
  };
  const auto signs = [&]() KFSTAB_INLINED {
    Lanes other{};
    for (Index v = 0; v < vectors; ++v) {
      const V s = x[v] < 0 ? splat(-1) : splat(1);
      other |= s != sign[v];
      sign[v] = s;
    }
    return !any(other);
  };
  const auto size = [&](Index k) KFSTAB_INLINED { return magnitude(splat(x[k / width][k % width]))[0]; };
  const auto largest = [&]() KFSTAB_INLINED {
    V most{};
    for (Index v = 0; v < vectors; ++v) most = larger(magnitude(x[v]), most);
    const V all = splat(largest_lane(most));
    for (Index v = 0; v < vectors; ++v)
      if (const Lanes at = magnitude(x[v]) == all; any(at))
        for (Index l = 0; l < width; ++l)
          if (at[l]) return v * width + l;
    return Index(0);  // NaN
  };
  const V one_more = splat(1 / static_cast<double>(K - 1)), alternate = (lane_numbers & 1) == 1 ? splat(-1) : splat(1);
  V grown = splat(1) + __builtin_convertvector(lane_numbers, V) * one_more;
  for (Index v = 0; v < vectors; ++v) {
    x[v] = splat(1 / static_cast<double>(K));
    alternating[v] = grown * alternate;
    grown += splat(width) * one_more;
  }
  solve(alternating, false);
  solve(x, false);
  double estimate = sum(x);
  signs();
  for (Index v = 0; v < vectors; ++v) x[v] = sign[v];
  solve(x, true);
  Index at = largest();
  for (int round = 0; round < 5; ++round) {
    for (Index v = 0; v < vectors; ++v) x[v] = lane_numbers == at - v * width ? splat(1) : V{};
    solve(x, false);
    const double before = estimate, now = sum(x);
    estimate = larger(now, estimate);
    if (signs() || !(now > before)) break;
    for (Index v = 0; v < vectors; ++v) x[v] = sign[v];
    solve(x, true);
    const Index next = largest();
    if (!(size(next) > size(at))) break;
    at = next;
  }
  return larger(2 * sum(alternating) / static_cast<double>(3 * K), estimate);
}

/// 1 for K = 0; 0 where the matrix, of that norm, is singular to the point of overflow.
KFSTAB_INLINE double reciprocal_condition(double norm, const V* L, Index K, Of of, V* work) {
  if (K == 0) return 1;
  if (K == 1) return norm > 0 && norm - norm == 0 ? 1 : 0;
  const double inverse = K <= greatest_inverse ? norm_of_inverse(L, K, of, work) : estimate_of_inverse(L, K, of, work);
  if (!(norm > 0) || norm - norm != 0 || inverse - inverse != 0) return 0;
  return 1 / norm / inverse;
}
/// The same of L or L'.
KFSTAB_INLINE double reciprocal_condition(const V* L, Index K, Of of, V* work) {
  return reciprocal_condition(K == 0 ? 1 : norm_of_packed(L, K, of), L, K, of, work);
}

}  // namespace kfstab::kernels::KFSTAB_KERNELS

#endif
