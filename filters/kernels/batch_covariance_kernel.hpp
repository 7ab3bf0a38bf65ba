#pragma once

#include <kfstab/filters/kernels/batch_kernel.hpp>

#ifdef KFSTAB_KERNELS

/// BatchCovarianceStep, the filter in every lane as the plain text does it; sizes as in batch_kernel.hpp.
namespace kfstab::kernels::KFSTAB_KERNELS {

/// to(i, j, sum over k of x(i, k) y(k, j)) for i of [first, last), j of [column, columns), in tiles: of an entry, once loaded, all
/// rows or columns of its tile make use.
/// @tparam Rows, Columns  of a tile
template <class T, Index Rows, Index Columns, class First, class Last, class Column, class End, class K, class X,
          class Y, class To>
KFSTAB_INLINE void multiply_tiles(First first, Last last, Column column, End columns, K length, X&& x, Y&& y, To&& to) {
  each_block<Rows>(first, last, [&](auto R, auto i) KFSTAB_INLINED {
    each_block<Columns>(column, columns, [&](auto Q, auto j) KFSTAB_INLINED {
      T sum[decltype(R)::value][decltype(Q)::value] = {};
      each(zero, length, [&](Index k) KFSTAB_INLINED {
        T left[decltype(R)::value];
        each(zero, R, [&](Index r) KFSTAB_INLINED { left[r] = x(i + r, k); });
        each(zero, Q, [&](Index q) KFSTAB_INLINED {
          const T right = y(k, j + q);
          each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r][q] = fma(left[r], right, sum[r][q]); });
        });
      });
      each(zero, R,
           [&](Index r) KFSTAB_INLINED { each(zero, Q, [&](Index q) KFSTAB_INLINED { to(i + r, j + q, sum[r][q]); }); });
    });
  });
}

/// All lanes of `lanes`. Those that gave up are returned.
template <class T, class Array, class N, class M, class P>
KFSTAB_INLINE auto batch_covariance_lanes(N n, M m, P p, const BatchCovarianceStep& step, const LanesOf<T>& lanes) {
  constexpr Index rows = 4, tile_columns = 2;
  Array array(step.work);
  T* const F = array.begin();  // P_{k|k}, n x n
  T* const AF = F + n * n;     // A P_{k|k}, B Q
  T* const W = AF + n * (n + m);
  T* const gain = W + n * p;
  T* const L = gain + n * p;  // of Re, p x p
  T* const square = L + p * p;
  T* const inverses = square + p * p;
  T* const sums = inverses + p;
  T* const innovation = sums + p;
  T* const x_filtered = innovation + p;

  const auto given_A = lanes.of(step.A, n * n), given_B = lanes.of(step.B, n * m), given_C = lanes.of(step.C, p * n),
             given_P = lanes.of(step.P, n * n), given_Q = lanes.of(step.Q, m * m), given_R = lanes.of(step.R, p * p),
             x = lanes.of(step.x, n), y = lanes.of(step.y, p), Du = lanes.of(step.Du, n),
             P_next = lanes.of(step.P_next, n * n), K = lanes.of(step.K, n * p), rcond = lanes.of(step.rcond, 1),
             x_next = lanes.of(step.x_next, n);
  const auto A = [&](Index i, Index j) KFSTAB_INLINED { return given_A.get(i + j * n); };
  const auto B = [&](Index i, Index j) KFSTAB_INLINED { return given_B.get(i + j * n); };
  const auto C = [&](Index i, Index j) KFSTAB_INLINED { return given_C.get(i + j * p); };
  const auto at_W = [&](Index i, Index j) KFSTAB_INLINED -> T& { return W[i + j * n]; };
  const auto at_L = [&](Index i, Index j) KFSTAB_INLINED -> T& { return L[i + j * p]; };

  // W = P C', Re = R + C W
  multiply_tiles<T, rows, tile_columns>(
      zero, n, zero, p, n, [&](Index i, Index k) KFSTAB_INLINED { return given_P.get(i + k * n); },
      [&](Index k, Index j) KFSTAB_INLINED { return C(j, k); },
      [&](Index i, Index j, T sum) KFSTAB_INLINED { at_W(i, j) = sum; });
  each(zero, p, [&](auto j) KFSTAB_INLINED {
    multiply_tiles<T, rows, 1>(j, p, j, j + one, n, C, at_W, [&](Index i, Index q, T sum) KFSTAB_INLINED {
      at_L(i, q) = given_R.get(q + i * p) + sum;
    });
  });

  T difference{};
  const auto put = [&](const LaneMatrix<T>& to, Index at, T result) KFSTAB_INLINED {
    difference += result - result;
    to.put(at, result);
  };
  // The largest sum of a column of a symmetric matrix, by its lower triangle.
  const auto norm = [&](auto&& entry) KFSTAB_INLINED {
    T most{};
    each(zero, p, [&](Index j) KFSTAB_INLINED { sums[j] = T{}; });
    each(zero, p, [&](auto j) KFSTAB_INLINED {
      each(j, p, [&](Index i) KFSTAB_INLINED {
        const T size = magnitude(entry(i, j));
        sums[j] += size;
        if (i > j) sums[i] += size;
      });
      most = larger(sums[j], most);
    });
    return most;
  };
  const T Re_norm = norm(at_L);
  difference += Re_norm - Re_norm;

  decltype(not_zero(T{})) bad{};
  each(zero, p, [&](auto j) KFSTAB_INLINED {
    T pivot = at_L(j, j);
    each(zero, j, [&](Index k) KFSTAB_INLINED { pivot = fma(-at_L(j, k), at_L(j, k), pivot); });
    bad = bad | not_positive(pivot);
    const T diagonal = root(pivot);
    inverses[j] = inverse_of(diagonal);
    at_L(j, j) = diagonal;
    each(j + one, p, [&](Index i) KFSTAB_INLINED {
      T sum = at_L(i, j);
      each(zero, j, [&](Index k) KFSTAB_INLINED { sum = fma(-at_L(i, k), at_L(j, k), sum); });
      at_L(i, j) = sum * inverses[j];
    });
  });
  if (p == 0) {
    put(rcond, 0, all_ones<T>());
  } else {
    invert_lower(p, inverses, square, at_L);
    const T inverse_norm = norm([&](Index i, Index j) KFSTAB_INLINED {
      T sum{};
      each(i, p, [&](Index k) KFSTAB_INLINED { sum = fma(square[i * p + k], square[j * p + k], sum); });
      return sum;
    });
    put(rcond, 0, inverse_of(Re_norm * inverse_norm));
  }

  // W := W L'^{-1}, Kf = W L^{-1}
  each_block<rows>(zero, n, [&](auto R, auto i) KFSTAB_INLINED {
    each(zero, p, [&](auto j) KFSTAB_INLINED {
      T sum[decltype(R)::value];
      each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = at_W(i + r, j); });
      each(zero, j, [&](Index k) KFSTAB_INLINED {
        const T minus = -at_L(j, k);
        each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = fma(minus, at_W(i + r, k), sum[r]); });
      });
      each(zero, R, [&](Index r) KFSTAB_INLINED { at_W(i + r, j) = sum[r] * inverses[j]; });
    });
    each(zero, p, [&](auto before) KFSTAB_INLINED {
      const auto j = p - one - before;
      T sum[decltype(R)::value];
      each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = at_W(i + r, j); });
      each(j + one, p, [&](Index k) KFSTAB_INLINED {
        const T minus = -at_L(k, j);
        each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = fma(minus, gain[i + r + k * n], sum[r]); });
      });
      each(zero, R, [&](Index r) KFSTAB_INLINED {
        gain[i + r + j * n] = sum[r] * inverses[j];
        put(K, i + r + j * n, gain[i + r + j * n]);
      });
    });
  });

  if (x.data) {
    each(zero, p, [&](Index i) KFSTAB_INLINED {
      T sum = y.get(i);
      each(zero, n, [&](Index k) KFSTAB_INLINED { sum = fma(-C(i, k), x.get(k), sum); });
      innovation[i] = sum;
    });
    multiply_tiles<T, rows, 1>(
        zero, n, zero, one, p, [&](Index i, Index k) KFSTAB_INLINED { return gain[i + k * n]; },
        [&](Index k, Index) KFSTAB_INLINED { return innovation[k]; },
        [&](Index i, Index, T sum) KFSTAB_INLINED { x_filtered[i] = x.get(i) + sum; });
    multiply_tiles<T, rows, 1>(
        zero, n, zero, one, n, A, [&](Index k, Index) KFSTAB_INLINED { return x_filtered[k]; },
        [&](Index i, Index, T sum) KFSTAB_INLINED { put(x_next, i, Du.data ? sum + Du.get(i) : sum); });
  }

  // P_{k|k} = P - W W', both triangles of it by the lower one
  const auto at_F = [&](Index i, Index j) KFSTAB_INLINED -> T& { return F[i + j * n]; };
  const auto W_transposed = [&](Index k, Index j) KFSTAB_INLINED { return at_W(j, k); };
  each_block<tile_columns>(zero, n, [&](auto Q, Index j) KFSTAB_INLINED {
    multiply_tiles<T, rows, decltype(Q)::value>(j, n, j, j + Q, p, at_W, W_transposed,
                                                [&](Index i, Index q, T sum) KFSTAB_INLINED {
                                                  if (i < q) return;
                                                  at_F(i, q) = given_P.get(i + q * n) - sum;
                                                  at_F(q, i) = at_F(i, q);
                                                });
  });
  // P+ = [A P_{k|k}, B Q] [A, B]', likewise
  const auto at_AF = [&](Index i, Index j) KFSTAB_INLINED -> T& { return AF[i + j * n]; };
  multiply_tiles<T, rows, tile_columns>(zero, n, zero, n, n, A, at_F,
                                        [&](Index i, Index j, T sum) KFSTAB_INLINED { at_AF(i, j) = sum; });
  multiply_tiles<T, rows, tile_columns>(
      zero, n, zero, m, m, B, [&](Index k, Index j) KFSTAB_INLINED { return given_Q.get(k + j * m); },
      [&](Index i, Index j, T sum) KFSTAB_INLINED { at_AF(i, n + j) = sum; });
  each_block<tile_columns>(zero, n, [&](auto Q, Index j) KFSTAB_INLINED {
    multiply_tiles<T, rows, decltype(Q)::value>(
        j, n, j, j + Q, n + m, at_AF, [&](Index k, Index q) KFSTAB_INLINED { return k < n ? A(q, k) : B(q, k - n); },
        [&](Index i, Index q, T sum) KFSTAB_INLINED {
          if (i < q) return;
          put(P_next, i + q * n, sum);
          P_next.put(q + i * n, sum);
        });
  });
  return bad | not_zero(difference);
}

template <class T>
inline void run_time_batch_covariance_step(const BatchCovarianceStep& step) {
  each_lanes<T>(step.groups, step.gave_up, [&](const LanesOf<T>& lanes) KFSTAB_INLINED {
    return batch_covariance_lanes<T, GivenWork<T>>(step.n, step.m, step.p, step, lanes);
  });
}

/// For sizes that are known at run time.
inline void batch_covariance_step(const BatchCovarianceStep& step) {
  if constexpr (width == 8)
    if (two_pay(false, step.n, step.m, step.p)) return run_time_batch_covariance_step<Two>(step);
  run_time_batch_covariance_step<V>(step);
}

/// For sizes that are known at compile time, and small.
template <Index N, Index M, Index P>
inline void fixed_batch_covariance_step(const BatchCovarianceStep& step) {
  using T = ChosenLanes<two_pay(true, N, M, P)>;
  each_lanes<T>(step.groups, step.gave_up, [&](const LanesOf<T>& lanes) KFSTAB_INLINED {
    return batch_covariance_lanes<T, LocalWork<T, batch_covariance_work(N, M, P) / 2>>(Constant<N>{}, Constant<M>{},
                                                                                       Constant<P>{}, step, lanes);
  });
}

}  // namespace kfstab::kernels::KFSTAB_KERNELS

#endif
