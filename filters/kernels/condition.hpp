#pragma once

#include <kfstab/filters/kernels/strips.hpp>

#ifdef KFSTAB_KERNELS

/// The reciprocal condition number of a packed triangle L in the 1-norm, or of its transpose: what
/// reciprocal_condition_triangular of linear_solve.hpp computes. Solves are of as many right-hand sides as a vector has lanes, and
/// one takes as long as all of them. So up to some order L^{-1} itself costs less than the half dozen solves, one after the
/// other, that an estimate takes, and its norm is no estimate.
namespace kfstab::kernels::KFSTAB_KERNELS {

inline constexpr Index greatest_inverse = 8 * width;

KFSTAB_INLINE V magnitude(V x) { return (V)((Lanes)x & 0x7fffffffffffffff); }
/// NaN where one of them is.
KFSTAB_INLINE V larger(V x, V most) { return ((x > most) | (x != x)) ? x : most; }
KFSTAB_INLINE double larger(double x, double most) { return x > most || x != x ? x : most; }
KFSTAB_INLINE double largest_lane(V x) {
  return fold_lanes(x, [](V a, V b) KFSTAB_INLINED { return larger(b, a); }, AllLanes{})[0];
}
/// In lane l the sum of the lanes of x[l].
KFSTAB_INLINE V sums_of_lanes(V (&x)[width]) {
  transpose(x);
  V sum = x[0];
  for (Index l = 1; l < width; ++l) sum += x[l];
  return sum;
}

/// Largest sum of absolute values of a column of L, or of a row: |L|, |L'|.
KFSTAB_INLINE double norm_of_packed(const V* L, Index K, bool transposed) {
  V most{};
  if (!transposed) {
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
        each(zero, Constant<width>{}, [&](auto l) KFSTAB_INLINED {
          if (k + l < K) sum[l] += magnitude(rows[l]);
        });
      }
      most = larger(sums_of_lanes(sum), most);
    }
  }
  return largest_lane(most);
}

/// |L^{-1}| or |L'^{-1}|, of L^{-1}. work: (strips_of(K) + 1) K vectors
KFSTAB_INLINE double norm_of_inverse(const V* L, Index K, bool transposed, V* work) {
  const Strips X{work, K}, columns{work + strips_of(K) * K, K};
  for (Index k = 0; k < K; ++k) columns(0, k) = V{};
  V most{};
  each_group(0, strips_of(K), most_strips, [&](auto R, Index s) KFSTAB_INLINED {
    const Index order = least(K, (s + R) * width);  // a row of L^{-1} ends at the diagonal
    const Strips x = X.at(s, 0);
    for (Index k = 0; k < order; ++k)
      each(zero, R, [&](auto i) KFSTAB_INLINED {
        x(i, k) = lane_numbers == k - (s + i) * width ? splat(1) : V{};
      });
    divide_strips<decltype(R)::value>(x, L, K, order);
    if (transposed) {
      V rows[decltype(R)::value] = {};
      for (Index k = 0; k < order; ++k)
        each(zero, R, [&](auto i) KFSTAB_INLINED { rows[i] += magnitude(x(i, k)); });
      each(zero, R, [&](auto i) KFSTAB_INLINED { most = larger(rows[i], most); });
    } else {
      for (Index k = 0; k < order; ++k)
        each(zero, R, [&](auto i) KFSTAB_INLINED { columns(0, k) += magnitude(x(i, k)); });
    }
  });
  if (transposed) return largest_lane(most);
  for (Index k = 0; k < K; k += width) {
    V sum[width];
    each(zero, Constant<width>{}, [&](auto q) KFSTAB_INLINED { sum[q] = k + q < K ? columns(0, k + q) : V{}; });
    most = larger(sums_of_lanes(sum), most);
  }
  return largest_lane(most);
}

/// An estimate of the same from below, as reciprocal_condition of linear_solve.hpp makes it: the vectors are row 0 of a strip.
/// The alternating one is row 1 in the first solve. work: 2 K vectors
__attribute__((noinline)) inline double estimate_of_inverse(const V* L, Index K, bool transposed, V* work) {
  const Strips x{work, K}, sign{work + K, K};
  const auto solve = [&](bool other) KFSTAB_INLINED {  // x := M^{-1} x; other: M'^{-1} x, M = L or L'
    if (transposed != other)
      divide_strips<1>(x, L, K);
    else
      divide_strips_transposed<1>(x, L, K);
  };
  const auto sum = [&](Index row) KFSTAB_INLINED {
    double s = 0;
    for (Index k = 0; k < K; ++k) s += x(0, k)[row] < 0 ? -x(0, k)[row] : x(0, k)[row];
    return s;
  };
  const auto signs = [&]() KFSTAB_INLINED {
    bool same = true;
    for (Index k = 0; k < K; ++k) {
      const V s = x(0, k) < 0 ? splat(-1) : splat(1);
      same = same && s[0] == sign(0, k)[0];
      sign(0, k) = s;
    }
    return same;
  };
  const auto largest = [&]() KFSTAB_INLINED {
    Index at = 0;
    for (Index k = 1; k < K; ++k)
      if (magnitude(x(0, k))[0] > magnitude(x(0, at))[0]) at = k;
    return at;
  };
  for (Index k = 0; k < K; ++k) {
    const double size = 1 + static_cast<double>(k) / static_cast<double>(K - 1);
    x(0, k) = with_lane(0, with_lane(1, V{}, splat(k % 2 ? -size : size)), splat(1 / static_cast<double>(K)));
    sign(0, k) = V{};
  }
  solve(false);
  double estimate = sum(0);
  const double alternative = 2 * sum(1) / static_cast<double>(3 * K);
  signs();
  for (Index k = 0; k < K; ++k) x(0, k) = sign(0, k);
  solve(true);
  Index at = largest();
  for (int round = 0; round < 5; ++round) {
    for (Index k = 0; k < K; ++k) x(0, k) = k == at ? splat(1) : V{};
    solve(false);
    const double before = estimate, now = sum(0);
    estimate = larger(now, estimate);
    if (signs() || !(now > before)) break;
    for (Index k = 0; k < K; ++k) x(0, k) = sign(0, k);
    solve(true);
    const Index next = largest();
    if (!(magnitude(x(0, next))[0] > magnitude(x(0, at))[0])) break;
    at = next;
  }
  return larger(alternative, estimate);
}

/// 1 for K = 0; 0 where L is singular to the point of overflow.
KFSTAB_INLINE double reciprocal_condition(const V* L, Index K, bool transposed, V* work) {
  if (K == 0) return 1;
  const double norm = norm_of_packed(L, K, transposed);
  const double inverse = K <= greatest_inverse ? norm_of_inverse(L, K, transposed, work)
                                               : estimate_of_inverse(L, K, transposed, work);
  if (!(norm > 0) || norm - norm != 0 || inverse - inverse != 0) return 0;
  return 1 / norm / inverse;
}

}  // namespace kfstab::kernels::KFSTAB_KERNELS

#endif
