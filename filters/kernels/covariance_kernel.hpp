#pragma once

#include <kfstab/filters/kernels/array_kernel.hpp>
#include <kfstab/filters/kernels/covariance_step.hpp>

#ifdef KFSTAB_KERNELS

/// CovarianceStep by vectors. All of it is products X Y', and all matrices are held in strips (array_kernel.hpp): `width`
/// rows, column after column. So a column of a strip is a vector where the matrix stands on the left, and the entries that
/// belong to `width` columns of the product where it stands on the right, and nothing is ever packed anew. A tile of the
/// product, R strips high and `width` columns wide, is summed in registers.
///
/// What must be symmetric is computed as a triangle of tiles and mirrored. Where Re is not positive definite, or a result
/// not finite, the kernel gives up, and the caller takes the plain text, which says what is wrong.
namespace kfstab::kernels::KFSTAB_KERNELS {

/// The tile of x in strip s and columns t width ..., transposed, into strip t of `to`. One on the diagonal of a symmetric
/// matrix, x = to, s = t, gets its upper triangle from its lower one if that is the part, or else its lower from the upper.
template <Part of_diagonal = Part::all>
KFSTAB_INLINE void transpose_tile(const Strips& x, Index s, Index rows, Index t, Index columns, const Strips& to) {
  V tile[width], turned[width];
  each(zero, Constant<width>{},
       [&](Index q) KFSTAB_INLINED { tile[q] = turned[q] = t * width + q < columns ? x(s, t * width + q) : V{}; });
  transpose(turned);
  for (Index l = 0; l < least(rows - s * width, width); ++l) {
    const bool diagonal = of_diagonal != Part::all && s == t;
    const auto kept = of_diagonal == Part::lower ? lane_numbers >= l : lane_numbers <= l;
    if (diagonal) turned[l] = kept ? tile[l] : turned[l];
    to(t, s * width + l) = turned[l];
  }
}

/// The `width` columns of [Re; W] that strip t stands for, by Cholesky's method: what the columns before them take away, then
/// the columns among themselves. False if a pivot is not positive.
template <class P>
KFSTAB_INLINE bool factor_columns(const Strips& H, Index t, Index last, P p) {
  const Index j = t * width, columns = least(p - j, width);
  bool definite = true;
  V inverse[width] = {};
  const auto strip = [&](Index s, const V(&sum)[width], bool diagonal) KFSTAB_INLINED {
    each(zero, Constant<width>{}, [&](auto q) KFSTAB_INLINED {
      if (q >= columns) return;
      V column = H(s, j + q) - sum[q];
      each(zero, q,
           [&](Index k) KFSTAB_INLINED { column = fma(-H(s, j + k), splat(H.at(t, 0).entries(j + k)[q]), column); });
      if (diagonal) {
        const double pivot = lane<decltype(q)::value>(column)[0];
        definite = definite && pivot > 0;
        inverse[q] = splat(1 / root(pivot));
      }
      H(s, j + q) = column * inverse[q];
    });
  };
  const auto group = [&](auto R, Index s) KFSTAB_INLINED {
    V sum[decltype(R)::value][width] = {};
    const Strips left = H.at(s, 0), right = H.at(t, 0);
    for (Index k = 0; k < j; ++k) add_outer<decltype(R)::value>(sum, left, k, right.entries(k));
    each(zero, R, [&](Index i) KFSTAB_INLINED { strip(s + i, sum[i], s + i == t); });
  };
  group(one, t);
  each_group(t + 1, last, most_strips, group);
  return definite;
}

/// The reciprocal condition number of Re = L L' of that norm, of L in strips, or packed.
template <Index P>
KFSTAB_INLINE double condition_of_Re(Constant<P> p, double norm, const Strips& L, const V* packed, V* work) {
  if constexpr (P <= 2 * width)
    return small_reciprocal_condition<greatest(strips_of(P), 1), greatest(P, 1), Of::product>(
        p, norm, [&](Index i, Index k) KFSTAB_INLINED { return splat(L.at(i / width, 0).entries(k)[i % width]); });
  else
    return reciprocal_condition(norm, packed, P, Of::product, work);
}
KFSTAB_INLINE double condition_of_Re(Index p, double norm, const Strips&, const V* packed, V* work) {
  return reciprocal_condition(norm, packed, p, Of::product, work);
}

/// Sizes are Constants, or known at run time. False: it gave up, and what it was to write is undefined.
template <class N, class M, class P>
KFSTAB_INLINE bool covariance_step(N n, M m, P p, const CovarianceStep& step, V* work) {
  const auto n_strips = strips_of(n);
  const auto p_strips = strips_of(p);
  const auto m_strips = strips_of(m);
  const auto take = [&](Index strips, Index length) KFSTAB_INLINED {
    const Strips taken{work, length};
    work += strips * length;
    return taken;
  };
  const Strips AB = take(n_strips, n + m), product = take(n_strips, n + greatest(m, p)), F = take(n_strips, n),
               C = take(p_strips, n), CP = take(p_strips, n), Q = take(m_strips, m), H = take(p_strips + n_strips, p),
               W = H.at(p_strips, 0);
  V* const packed = work;  // V', and room for what its condition number is made of
  work += packed_size(p) + (p_strips + one) * p;

  V difference{};  // x - x of all results: not 0 where one is not finite
  const auto load_rows = [&](const Strips& to, const Source& X, Index rows, Index columns) KFSTAB_INLINED {
    for (Index s = 0; s * width < rows; ++s)
      for (Index k = 0; k < columns; ++k)
        to(s, k) = load(X.data + s * width + k * X.leading, 1, 0, least(rows - s * width, width));
  };
  // The transpose of a matrix.
  const auto load_transposed = [&](const Strips& to, const Source& X, Index rows, Index columns) KFSTAB_INLINED {
    load_strips(Layout{true}, X, rows, columns, columns, strips_of(rows), to);
  };
  const auto store_column = [&](const Target& X, Index s, Index j, V column) KFSTAB_INLINED {
    difference += column - column;
    store(X.data + s * width + j * X.leading, 1, 0, least(n - s * width, width), column);
  };
  load_rows(AB, step.A, n, n);
  load_rows(AB.at(0, n), step.B, n, m);
  load_rows(C, step.C, p, n);
  load_rows(F, step.P, n, n);
  load_transposed(Q, step.Q, m, m);

  // H = [Re; W], Re = R + C P C' by its lower triangle, W still P C'
  multiply<Part::all>(W, F, 0, n_strips, C, p, n);
  for (Index s = 0; s < n_strips; ++s)
    for (Index t = 0; t < p_strips; ++t) transpose_tile(W, s, n, t, p, CP);
  multiply<Part::lower>(H, CP, 0, p_strips, C, p, n);
  for (Index s = 0; s < p_strips; ++s)
    for (Index t = 0; t <= s; ++t) {  // of R the upper triangle
      V tile[width];
      const Index i = s * width, j = t * width;
      each(zero, Constant<width>{}, [&](Index l) KFSTAB_INLINED {
        tile[l] = i + l < p ? load(step.R.data + j + (i + l) * step.R.leading, 1, 0, least(i + l - j + 1, width)) : V{};
      });
      transpose(tile);
      each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
        if (j + q < p) H(s, j + q) += tile[q];
      });
    }
  for (Index s = 0; s < p_strips; ++s)
    for (Index t = 0; t <= s; ++t) transpose_tile<Part::lower>(H, s, p, t, p, H);
  V most{};
  for (Index s = 0; s < p_strips; ++s) {
    V sum{};
    for (Index k = 0; k < p; ++k) sum += magnitude(H(s, k));
    most = larger(sum, most);
  }
  const double norm = largest_lane(most);
  difference += splat(norm - norm);

  // H := [V'; W], W = P C' V^{-1}
  for (Index t = 0; t < p_strips; ++t)
    if (!factor_columns(H, t, p_strips + n_strips, p)) return false;
  for (Index t = 0; t < p_strips; ++t)
    for (Index s = t; s < p_strips; ++s) {
      V *const rows = packed + packed_block(p, t * width) + (s - t) * width, tile[width];
      each(zero, Constant<width>{}, [&](Index q) KFSTAB_INLINED {
        tile[q] = t * width + q < p ? in_lanes(s == t ? q : 0, width, H(s, t * width + q)) : V{};
        difference += tile[q] - tile[q];
      });
      transpose(tile);
      for (Index l = 0; l < least(p - s * width, width); ++l) rows[l] = tile[l];
    }
  *step.rcond = condition_of_Re(p, norm, H, packed, packed + packed_size(p));

  // P_{k|k}, in the place of P, by its lower triangle
  const auto divide = [&]() KFSTAB_INLINED {  // W := Kf, Kf V' = W
    each_group(0, n_strips, most_strips,
               [&](auto R, Index s) KFSTAB_INLINED { divide_strips<decltype(R)::value>(W.at(s, 0), packed, p); });
  };
  if (step.joseph) {
    const Strips JK = take(n_strips, n + p), CR = take(greatest(n_strips, p_strips), p);
    divide();
    load_transposed(CR, step.C, n, p);
    multiply<Part::all>(JK, W, 0, n_strips, CR, n, p);
    for (Index s = 0; s < n_strips; ++s) {
      for (Index j = 0; j < n; ++j) JK(s, j) = (lane_numbers + s * width == j ? splat(1) : V{}) - JK(s, j);
      for (Index j = 0; j < p; ++j) JK(s, n + j) = W(s, j);
    }
    load_transposed(CR, step.R, p, p);
    multiply<Part::all>(product, JK, 0, n_strips, F, n, n);
    multiply<Part::all>(product.at(0, n), W, 0, n_strips, CR, p, p);
    multiply<Part::lower>(F, product, 0, n_strips, JK, n, n + p);
  } else {
    multiply<Part::lower>(product, W, 0, n_strips, W, n, p);
    for (Index s = 0; s < n_strips; ++s)
      for (Index j = 0; j < least(n, (s + 1) * width); ++j) F(s, j) -= product(s, j);
    if (step.K.data) divide();
  }
  for (Index s = 0; s < n_strips; ++s)
    for (Index t = 0; t <= s; ++t) transpose_tile<Part::lower>(F, s, n, t, n, F);
  if (step.K.data)
    for (Index s = 0; s < n_strips; ++s)
      for (Index j = 0; j < p; ++j) store_column(step.K, s, j, W(s, j));

  // P+ = [A P_{k|k}, B Q] [A, B]', by its upper triangle
  multiply<Part::all>(product, AB, 0, n_strips, F, n, n);
  multiply<Part::all>(product.at(0, n), AB.at(0, n), 0, n_strips, Q, m, m);
  multiply<Part::upper>(F, product, 0, n_strips, AB, n, n + m);
  for (Index t = 0; t < n_strips; ++t)
    for (Index s = 0; s <= t; ++s) {
      transpose_tile<Part::upper>(F, s, n, t, n, F);
      for (Index j = t * width; j < least(n, (t + 1) * width); ++j) store_column(step.P_next, s, j, F(s, j));
      if (s < t)
        for (Index j = s * width; j < (s + 1) * width; ++j) store_column(step.P_next, t, j, F(t, j));
    }
  return all_zero(difference);
}

/// For sizes that are known at run time.
inline bool covariance_step(const CovarianceStep& step) {
  // Aligned by hand: what a caller has is aligned for doubles alone.
  const std::size_t beyond = reinterpret_cast<std::size_t>(step.work) % sizeof(V);
  auto* const work = reinterpret_cast<V*>(reinterpret_cast<char*>(step.work) + (sizeof(V) - beyond) % sizeof(V));
  return covariance_step(step.n, step.m, step.p, step, work);
}

/// Whether sizes that are known at compile time are best done by a kernel of their own.
constexpr bool fixed_covariance_pays(Index n, Index m, Index p) { return n <= 16 && m <= 16 && p <= 16; }

template <Index N, Index M, Index P>
KFSTAB_INLINE bool fixed_covariance_step(const CovarianceStep& step) {
  V work[covariance_step_work(N, M, P, true) / width];
  return covariance_step(Constant<N>{}, Constant<M>{}, Constant<P>{}, step, work);
}

}  // namespace kfstab::kernels::KFSTAB_KERNELS

#endif
