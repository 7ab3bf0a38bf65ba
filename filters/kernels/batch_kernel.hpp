#pragma once

#include <kfstab/filters/kernels/lanes.hpp>

#ifdef KFSTAB_KERNELS

/// BatchArrayStep: what array_kernel.hpp does with one reflector after the other is done with those of many filters at once.
///
/// Sizes are Constants, and then all loops are unrolled and the array is a local one, or known at run time, and then the array is
/// in the caller's workspace. Passes take several rows at a time, so that an entry of the pivot's row, once loaded, serves all.
namespace kfstab::kernels::KFSTAB_KERNELS {

template <class T>
struct LaneReflectors {
  T beta, pivot, d;
};

/// The reflectors of (alpha; x), x'x = square, one in each lane. A lane whose squares are not safe is marked in `bad`, unless
/// some() says that it has nothing but zeros. Not exact: marked all the same, and some() is not asked.
template <bool exact, class Some>
KFSTAB_INLINE LaneReflectors<V> lane_reflectors(V alpha, V square, Lanes& bad, Some&& some) {
  const V norm2 = fma(alpha, alpha, square);
  const Lanes unsafe = ~((norm2 >= least_square) & (norm2 <= greatest_square));
  const V norm = root(norm2), opposite = alpha < 0 ? norm : -norm;
  if constexpr (!exact) {
    bad |= unsafe;
    const V pivot = alpha - opposite;
    return {opposite, pivot, -2 / fma(pivot, pivot, square)};
  } else {
    if (any(unsafe)) [[unlikely]]
      bad |= unsafe & some();
    const Lanes idle = unsafe | (square == 0);
    const V beta = idle ? alpha : opposite, pivot = alpha - beta;
    return {beta, pivot, idle ? V{} : -2 / fma(pivot, pivot, square)};
  }
}
template <bool exact, class Some>
KFSTAB_INLINE LaneReflectors<Two> lane_reflectors(Two alpha, Two square, TwoLanes& bad, Some&& some) {
  const auto a = lane_reflectors<exact>(alpha.first, square.first, bad.first,
                                        [&]() KFSTAB_INLINED { return some().first; }),
             b = lane_reflectors<exact>(alpha.second, square.second, bad.second,
                                        [&]() KFSTAB_INLINED { return some().second; });
  return {{a.beta, b.beta}, {a.pivot, b.pivot}, {a.d, b.d}};
}

/// Numbers to work with: where sizes are known they are local, and the compiler keeps what it can in registers.
template <class T, Index size>
struct LocalWork {
  T numbers[greatest(size, 1)];
  KFSTAB_INLINE explicit LocalWork(Eight*) {}
  KFSTAB_INLINE T* begin() { return numbers; }
};
template <class T>
struct GivenWork {
  T* numbers;
  KFSTAB_INLINE explicit GivenWork(Eight* work) : numbers(reinterpret_cast<T*>(work)) {}
  KFSTAB_INLINE T* begin() { return numbers; }
};

/// All lanes of `lanes`. Those that gave up are returned.
/// @tparam information  the array is transposed, and the gain is that of T+
/// @param n, m, p  of the array    @param last  1 if it has its last row, else 0
template <class T, bool known, bool information, class Array, class N, class M, class P, class Last>
KFSTAB_INLINE auto batch_array_lanes(N n, M m, P p, Last last, const BatchArrayStep& step, const LanesOf<T>& lanes) {
  constexpr Index rows_at_once = 4;
  const auto states_end = p + n;
  const auto end = states_end + last;
  const auto columns = n + m;
  Array array(step.work);
  T* const X = array.begin();  // columns [C S, 0; A S, B Q], and the last row
  T* const head = X + columns * end;
  T* const w = head + p * end;
  T* const f = w + end;
  T* const inverses = f + end;  // of a diagonal
  T* const square = inverses + greatest(n, p);
  T* const z = square + greatest(n, p) * greatest(n, p);  // p, or y - C x
  T* const moved = z + p;                                 // n
  T* const gain = moved + n;                              // n x (m + 1)

  const auto A = lanes.of(step.A, n * n), B = lanes.of(step.B, n * m), C = lanes.of(step.C, p * n),
             S = lanes.of(step.S, n * n), Q = lanes.of(step.Q, m * m), R_root = lanes.of(step.R, p * p),
             state = lanes.of(step.x, n), output = lanes.of(step.y, information ? m : p), Du = lanes.of(step.Du, n),
             mean = lanes.of(step.w, p), S_next = lanes.of(step.S_next, n * n), Re = lanes.of(step.Re, p * p),
             K = lanes.of(step.K, n * (information ? m : p)), rcond = lanes.of(step.rcond, 1),
             x_next = lanes.of(step.x_next, n);
  // Entry (i, j) of a matrix of the array.
  const auto entry_of = [&](const LaneMatrix<T>& Y, Index rows, Index cols, Index i, Index j)
                            KFSTAB_INLINED { return Y.get(information ? j + i * cols : i + j * rows); };
  if (information && last == 1) {
    each(zero, n, [&](Index i) KFSTAB_INLINED {
      moved[i] = state.get(i);
      if (Du.data)
        each(zero, n, [&](Index k) KFSTAB_INLINED { moved[i] = fma(entry_of(A, n, n, k, i), Du.get(k), moved[i]); });
    });
    each(zero, p, [&](auto j) KFSTAB_INLINED {
      z[j] = T{};
      if (mean.data)
        each(j, p, [&](Index k) KFSTAB_INLINED { z[j] = fma(-entry_of(R_root, p, p, k, j), mean.get(k), z[j]); });
    });
  }

  // X(i, to + j) = sum over k >= j of Y(i, k) L(k, j) for R rows
  const auto multiply = [&](auto R, auto i, Index to, const LaneMatrix<T>& L, auto size, auto Y) KFSTAB_INLINED {
    each(zero, size, [&](auto j) KFSTAB_INLINED {
      T sum[decltype(R)::value] = {};
      each(j, size, [&](Index k) KFSTAB_INLINED {
        const T l = entry_of(L, size, size, k, j);
        each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = fma(Y(i + r, k), l, sum[r]); });
      });
      each(zero, R, [&](Index r) KFSTAB_INLINED { X[(to + j) * end + i + r] = sum[r]; });
    });
  };
  const auto of_C = [&](Index i, Index k) KFSTAB_INLINED { return entry_of(C, p, n, i, k); };
  const auto of_A = [&](Index i, Index k) KFSTAB_INLINED { return entry_of(A, n, n, i - p, k); };
  const auto of_B = [&](Index i, Index k) KFSTAB_INLINED { return entry_of(B, n, m, i - p, k); };
  each_block<rows_at_once>(zero, p, [&](auto R, auto i) KFSTAB_INLINED { multiply(R, i, zero, S, n, of_C); });
  each_block<rows_at_once>(p, states_end, [&](auto R, auto i) KFSTAB_INLINED { multiply(R, i, zero, S, n, of_A); });
  each_block<rows_at_once>(p, states_end, [&](auto R, auto i) KFSTAB_INLINED { multiply(R, i, n, Q, m, of_B); });
  each(zero, p, [&](auto j) KFSTAB_INLINED {
    each(j, p, [&](Index i) KFSTAB_INLINED { head[j * end + i] = entry_of(R_root, p, p, i, j); });
    each(p, states_end, [&](Index i) KFSTAB_INLINED { head[j * end + i] = T{}; });
  });
  if (last == 1) {
    multiply(one, states_end, zero, S, n, [&](Index, Index k) KFSTAB_INLINED { return moved[k]; });
    multiply(one, states_end, n, Q, m, [&](Index, Index k) KFSTAB_INLINED { return output.get(k); });
    each(zero, p, [&](Index j) KFSTAB_INLINED { head[j * end + states_end] = z[j]; });
  }
  // The right-hand sides of an information filter's gain, B Q Q'; behind them there will be the state's.
  if (information && K.data)
    each_block<rows_at_once>(zero, n, [&](auto R, Index k) KFSTAB_INLINED {
      each(zero, m, [&](auto j) KFSTAB_INLINED {
        T sum[decltype(R)::value] = {};
        each(zero, j + one, [&](Index i) KFSTAB_INLINED {
          const T l = entry_of(Q, m, m, j, i);
          each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = fma(X[(n + i) * end + p + k + r], l, sum[r]); });
        });
        each(zero, R, [&](Index r) KFSTAB_INLINED { gain[j * n + k + r] = sum[r]; });
      });
    });

  decltype(not_zero(T{})) bad{};
  LaneReflectors<T> is{};
  // The reflectors of row `row` with its alpha in `column`, x from column `first` on, up to `last_column`.
  const auto make_reflectors = [&](Index row, const T* column, T x_square, auto first, auto last_column) KFSTAB_INLINED {
    is = lane_reflectors<!known>(column[row], x_square, bad, [&]() KFSTAB_INLINED {
      auto some = not_zero(column[row]);
      each(first, last_column, [&](Index k) KFSTAB_INLINED { some = some | not_zero(X[k * end + row]); });
      return some;
    });
  };
  // The first of a pass, and the products of its row with all rows behind it.
  const auto begin = [&](auto row, const T* column, auto first, auto last_column) KFSTAB_INLINED {
    each_block<rows_at_once>(row, end, [&](auto R, Index i) KFSTAB_INLINED {
      T sum[decltype(R)::value] = {};
      each(first, last_column, [&](Index k) KFSTAB_INLINED {
        const T y = X[k * end + row];
        each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = fma(X[k * end + i + r], y, sum[r]); });
      });
      each(zero, R, [&](Index r) KFSTAB_INLINED { w[i + r] = sum[r]; });
    });
    make_reflectors(row, column, w[row], first, last_column);
  };
  // Does the reflectors `is` of row j, whose pivots are in `column` and whose x begin in column `first`, to the rows behind it, and
  // leaves the products of the next row, from column `next_first` to `next_last`, in w and its reflectors in `is`. Those are made
  // as soon as they can be: a root and a division take as long as a pass over several rows, and go on meanwhile.
  const auto reflect = [&](auto j, T* column, auto first, auto last_column, const T* next_column, auto next_first,
                           auto next_last) KFSTAB_INLINED {
    const auto next = j + one;
    column[j] = is.beta;
    each(next, end, [&](Index i) KFSTAB_INLINED {
      f[i] = fma(column[i], is.pivot, w[i]) * is.d;
      column[i] = fma(f[i], is.pivot, column[i]);
    });
    if (next >= states_end) return;
    const auto update = [&](Index i, Index k) KFSTAB_INLINED {
      const T updated = fma(f[i], X[k * end + j], X[k * end + i]);
      X[k * end + i] = updated;
      return updated;
    };
    T sums[2] = {};
    each(first, next_first, [&](Index k) KFSTAB_INLINED { update(next, k); });
    each_column(next_first, last_column, [&](Index k, Index c) KFSTAB_INLINED {
      const T x = update(next, k);
      sums[c % 2] = fma(x, x, sums[c % 2]);
    });
    each_column(last_column, next_last, [&](Index k, Index c) KFSTAB_INLINED {
      const T x = X[k * end + next];
      sums[c % 2] = fma(x, x, sums[c % 2]);
    });
    w[next] = sums[0] + sums[1];
    make_reflectors(next, next_column, w[next], next_first, next_last);
    each_block<rows_at_once>(next + one, end, [&](auto R, Index i) KFSTAB_INLINED {
      constexpr Index chains = decltype(R)::value == 1 ? 2 : 1;
      T sum[decltype(R)::value][chains] = {}, factor[decltype(R)::value];
      each(zero, R, [&](Index r) KFSTAB_INLINED { factor[r] = f[i + r]; });
      each(first, next_first, [&](Index k) KFSTAB_INLINED {
        const T x = X[k * end + j];
        each(zero, R, [&](Index r) KFSTAB_INLINED { X[k * end + i + r] = fma(factor[r], x, X[k * end + i + r]); });
      });
      each_column(next_first, last_column, [&](Index k, Index c) KFSTAB_INLINED {
        const T x = X[k * end + j], y = X[k * end + next];
        each(zero, R, [&](Index r) KFSTAB_INLINED {
          const T updated = fma(factor[r], x, X[k * end + i + r]);
          X[k * end + i + r] = updated;
          sum[r][c % chains] = fma(updated, y, sum[r][c % chains]);
        });
      });
      each_column(last_column, next_last, [&](Index k, Index c) KFSTAB_INLINED {
        const T y = X[k * end + next];
        each(zero, R,
             [&](Index r) KFSTAB_INLINED { sum[r][c % chains] = fma(X[k * end + i + r], y, sum[r][c % chains]); });
      });
      each(zero, R, [&](Index r) KFSTAB_INLINED {
        w[i + r] = sum[r][0];
        if constexpr (chains == 2) w[i + r] += sum[r][1];
      });
    });
  };
  if (p == 0) {
    if (n > 0) begin(p, X, one, columns);
  } else {
    begin(zero, head, zero, n);
    each(zero, p - one,
         [&](auto j) KFSTAB_INLINED { reflect(j, head + j * end, zero, n, head + (j + one) * end, zero, n); });
    reflect(p - one, head + (p - one) * end, zero, n, X, one, columns);
  }
  each(zero, n, [&](auto j) KFSTAB_INLINED {
    const auto first = j + one;
    reflect(p + j, X + j * end, first, columns, X + first * end, first + one, columns);
  });

  T difference{};
  const auto put = [&](const LaneMatrix<T>& to, Index at, T result) KFSTAB_INLINED {
    difference += result - result;
    to.put(at, result);
  };
  each(zero, n, [&](auto j) KFSTAB_INLINED {
    each(j, n, [&](Index i) KFSTAB_INLINED { put(S_next, information ? j + i * n : i + j * n, X[j * end + p + i]); });
  });
  if (Re.data)
    each(zero, p, [&](auto j) KFSTAB_INLINED {
      each(j, p, [&](Index i) KFSTAB_INLINED { put(Re, i + j * p, head[j * end + i]); });
    });

  const auto invert_diagonal = [&](const T* diagonal, auto order) KFSTAB_INLINED {
    each(zero, order, [&](Index j) KFSTAB_INLINED { inverses[j] = inverse_of(diagonal[j * end + j]); });
  };
  if constexpr (information) {
    const auto L = [&](Index i, Index j) KFSTAB_INLINED { return X[j * end + p + i]; };  // T+'
    if (K.data || rcond.data || last == 1) invert_diagonal(X + p, n);
    if (rcond.data) put(rcond, 0, rcond_of_lower<true>(n, inverses, square, L));
    const auto solve = [&](auto R, Index j, bool both) KFSTAB_INLINED {  // of columns j ... of gain
      if (both)
        each(zero, n, [&](auto k) KFSTAB_INLINED {
          T sum[decltype(R)::value];
          each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = gain[(j + r) * n + k]; });
          each(zero, k, [&](Index i) KFSTAB_INLINED {
            const T minus = -L(k, i);
            each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = fma(minus, gain[(j + r) * n + i], sum[r]); });
          });
          each(zero, R, [&](Index r) KFSTAB_INLINED { gain[(j + r) * n + k] = sum[r] * inverses[k]; });
        });
      each(zero, n, [&](auto before) KFSTAB_INLINED {
        const auto k = n - one - before;
        T sum[decltype(R)::value];
        each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = gain[(j + r) * n + k]; });
        each(k + one, n, [&](Index i) KFSTAB_INLINED {
          const T minus = -L(i, k);
          each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = fma(minus, gain[(j + r) * n + i], sum[r]); });
        });
        each(zero, R, [&](Index r) KFSTAB_INLINED { gain[(j + r) * n + k] = sum[r] * inverses[k]; });
      });
    };
    if (K.data) {
      each_block<4>(zero, m, [&](auto R, auto j) KFSTAB_INLINED { solve(R, j, true); });
      each(zero, m, [&](auto j) KFSTAB_INLINED {
        each(zero, n, [&](Index k) KFSTAB_INLINED { put(K, k + j * n, gain[j * n + k]); });
      });
    }
    if (last == 1) {
      each(zero, n, [&](Index k) KFSTAB_INLINED { gain[m * n + k] = X[k * end + states_end]; });
      solve(one, m, false);
      each(zero, n, [&](Index k) KFSTAB_INLINED { put(x_next, k, gain[m * n + k]); });
    }
  } else {
    const auto L = [&](Index i, Index j) KFSTAB_INLINED { return head[j * end + i]; };
    if (K.data || rcond.data) invert_diagonal(head, p);
    if (rcond.data) put(rcond, 0, rcond_of_lower<false>(p, inverses, square, L));
    if (K.data)
      each_block<4>(p, states_end, [&](auto R, auto i) KFSTAB_INLINED {
        each(zero, p, [&](auto before) KFSTAB_INLINED {
          const auto j = p - one - before;
          T sum[decltype(R)::value];
          each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = head[j * end + i + r]; });
          each(j + one, p, [&](Index k) KFSTAB_INLINED {
            const T minus = -L(k, j);
            each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = fma(minus, head[k * end + i + r], sum[r]); });
          });
          each(zero, R, [&](Index r) KFSTAB_INLINED {
            const T x = sum[r] * inverses[j];
            head[j * end + i + r] = x;
            put(K, i - p + r + j * n, x);
          });
        });
      });
    if (state.data) {
      each(zero, p, [&](auto i) KFSTAB_INLINED {
        z[i] = output.get(i);
        each(zero, n, [&](Index k) KFSTAB_INLINED { z[i] = fma(-of_C(i, k), state.get(k), z[i]); });
      });
      each_block<4>(zero, n, [&](auto R, auto i) KFSTAB_INLINED {
        T sum[decltype(R)::value] = {};
        if (Du.data) each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = Du.get(i + r); });
        each(zero, n, [&](Index k) KFSTAB_INLINED {
          const T x = state.get(k);
          each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = fma(of_A(p + i + r, k), x, sum[r]); });
        });
        each(zero, p, [&](Index k) KFSTAB_INLINED {
          each(zero, R, [&](Index r) KFSTAB_INLINED { sum[r] = fma(head[k * end + p + i + r], z[k], sum[r]); });
        });
        each(zero, R, [&](Index r) KFSTAB_INLINED { put(x_next, i + r, sum[r]); });
      });
    }
  }
  return bad | not_zero(difference);
}

/// Whether two vectors at once pay, for sizes that are known when the kernel is compiled, or not: they find room in the
/// registers or, at run time, where there are 32 of them, with what they are made of in the nearest memory.
constexpr bool two_pay(bool known, Index n, Index m, Index p) {
  return (n + p) * (n + m + p) <= (known ? (width == 8 ? 64 : 24) : width == 8 ? 192 : 0);
}

template <class T>
inline void run_time_batch_array_step(const BatchArrayStep& step) {
  each_lanes<T>(step.groups, step.gave_up, [&](const LanesOf<T>& lanes) KFSTAB_INLINED {
    const Index none = 0, last = step.x ? 1 : 0;
    return step.information
               ? batch_array_lanes<T, false, true, GivenWork<T>>(step.n, step.m, step.p, last, step, lanes)
               : batch_array_lanes<T, false, false, GivenWork<T>>(step.n, step.m, step.p, none, step, lanes);
  });
}

/// For sizes that are known at run time.
inline void batch_array_step(const BatchArrayStep& step) {
  if constexpr (width == 8)
    if (two_pay(false, step.n, step.m, step.p)) return run_time_batch_array_step<Two>(step);
  run_time_batch_array_step<V>(step);
}

/// Whether sizes that are known at compile time are best done by a kernel of their own: the code grows with their cube.
constexpr bool fixed_batch_pays(Index n, Index m, Index p) { return (n + p) * (n + m + p) <= 192; }

/// For sizes that are known at compile time, and small.
template <Index N, Index M, Index P, bool information>
inline void fixed_batch_array_step(const BatchArrayStep& step) {
  const auto run = [&](auto last) {
    using T = ChosenLanes<two_pay(true, N, M, P)>;
    each_lanes<T>(step.groups, step.gave_up, [&](const LanesOf<T>& lanes) KFSTAB_INLINED {
      return batch_array_lanes<T, true, information, LocalWork<T, batch_array_work(N, M, P) / 2>>(
          Constant<N>{}, Constant<M>{}, Constant<P>{}, last, step, lanes);
    });
  };
  if constexpr (information)
    if (step.x) return run(one);
  run(zero);
}

}  // namespace kfstab::kernels::KFSTAB_KERNELS

#endif
