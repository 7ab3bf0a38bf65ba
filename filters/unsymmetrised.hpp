#pragma once

#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/metadata.hpp>
#include <kfstab/filters/state_space.hpp>
#include <kfstab/filters/step_report.hpp>

namespace kfstab {

/// Five ways to code the conventional Kalman filter that are one on paper, and do nothing to keep P symmetric.
///
/// Do not use them. They are here because they are what people write: with U = P C' and V = C P, which are each other's
/// transpose only as long as P is symmetric,
///
///     textbook  (i)    Re = R + C U    K = A U  Re^{-1}    P+ = (A - K C) P A' + B Q B'
///     mixed     (ii)   Re = R + C V'   K = A V' Re^{-1}    P+ = A P A' - K U' A' + B Q B'
///     gain      (iii)  Re = R + C U    K = A U  Re^{-1}    P+ = A P A' - K Re K' + B Q B'
///     cp        (iv)   Re = R + V C'   K = A V' Re^{-1}    P+ = A P A' - K V A'  + B Q B'
///     downdate  (v)    Re = R + C U    Kf = U Re^{-1}      P+ = A (P - Kf U') A' + B Q B'        theory (3.i)-(3.v)
///
/// an asymmetry D = P - P' of rounding size goes into the next step by a different map in each. (i) damps it as it damps
/// any error. With one output the others let it grow by the product of the two largest moduli of A's eigenvalues, (ii)
/// by more, even for a stable A; with several outputs (iv) and (v) can grow for a stable A too. Re is used as computed,
/// unsymmetric, by LU: a Cholesky factorisation would read one triangle, and change the map (theory (3.8)).
///
/// Source: Verhaegen and Van Dooren, IEEE TAC 31 (1986) 907-917; the maps derived in docs/theory.md, after them.
template <Asymmetry coding, class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
class UnsymmetrisedFilter {
  static_assert(coding != Asymmetry::none);

 public:
  using Scalar = S;
  using Model = CovarianceModel<S, N, M, P>;
  using Output = Vector<S, P>;
  using Input = Vector<S>;

  /// @param tolerance  least reciprocal condition number of Re that counts as regular; <= 0 means p^2 u
  explicit UnsymmetrisedFilter(Dimensions d = {N, M, P}, S tolerance = S(0))
      : tolerance_(tolerance > S(0) ? tolerance : default_tolerance<S>(d.p)),
        P_(d.n, d.n), next_(d.n, d.n), left_(d.n, d.n), BQ_(d.n, d.m), U_(d.n, d.p), V_(d.p, d.n), Re_(d.p, d.p),
        LU_(d.p, d.p), pivots_(d.p), Kf_(d.n, d.p), gain_(d.n, d.p), next_gain_(d.n, d.p), KRe_(d.n, d.p),
        VA_(d.p, d.n), x_(d.n), next_x_(d.n), innovation_(d.p), work_(d.p), sign_(d.p) {
    P_.setZero();
    gain_.setZero();
    x_.setZero();
  }

  /// Takes P0 (n x n, all of it, symmetric or not) and x0 of the predicted state.
  template <class P0Type, class X0Type>
  void start(const P0Type& P0, const X0Type& x0) {
    P_ = P0;
    x_ = x0;
    gain_.setZero();
  }

  /// One combined measurement and time update, from k|k-1 to k+1|k.
  /// @param y  p, or null: no state is computed, and x stays what it was
  /// @param u  as many as D has columns, or null for none
  /// Statuses: singular_innovation (of Re), non_finite_input, overflow.
  StepReport<S> step(const Model& model, const Output* y = nullptr, const Input* u = nullptr) {
    const auto& A = model.A;
    const auto& C = model.C;
    if constexpr (coding != Asymmetry::cp) U_.noalias() = P_.lazyProduct(C.transpose());
    if constexpr (coding == Asymmetry::cp || coding == Asymmetry::mixed) V_.noalias() = C.lazyProduct(P_);
    Re_ = model.R;
    if constexpr (coding == Asymmetry::cp)
      Re_.noalias() += V_.lazyProduct(C.transpose());
    else if constexpr (coding == Asymmetry::mixed)
      Re_.noalias() += C.lazyProduct(V_.transpose());
    else
      Re_.noalias() += C.lazyProduct(U_);

    LU_ = Re_;
    const S norm = one_norm(Re_);
    if (!is_finite(norm)) return failed(Status::overflow, S(0), model, y, u);
    const bool regular = lu_transposed(LU_, pivots_);
    const S rcond = regular ? reciprocal_condition(
                                  norm, work_, sign_, [this](auto& b) { solve_lu(LU_, pivots_, b); },
                                  [this](auto& b) { solve_lu_right(LU_, pivots_, b.transpose()); })
                            : S(0);
    if (!(rcond >= tolerance_)) return failed(Status::singular_innovation, rcond, model, y, u);

    if constexpr (coding == Asymmetry::downdate) {
      Kf_ = U_;
      solve_lu_right(LU_, pivots_, Kf_);
      next_gain_.noalias() = A.lazyProduct(Kf_);
    } else {
      if constexpr (coding == Asymmetry::mixed || coding == Asymmetry::cp)
        next_gain_.noalias() = A.lazyProduct(V_.transpose());
      else
        next_gain_.noalias() = A.lazyProduct(U_);
      solve_lu_right(LU_, pivots_, next_gain_);
    }
    const auto& K = next_gain_;

    if constexpr (coding == Asymmetry::textbook) {
      next_ = A;
      next_.noalias() -= K.lazyProduct(C);
      left_.noalias() = next_.lazyProduct(P_);
      next_.noalias() = left_.lazyProduct(A.transpose());
    } else if constexpr (coding == Asymmetry::downdate) {
      next_ = P_;
      next_.noalias() -= Kf_.lazyProduct(U_.transpose());
      left_.noalias() = A.lazyProduct(next_);
      next_.noalias() = left_.lazyProduct(A.transpose());
    } else {
      left_.noalias() = A.lazyProduct(P_);
      next_.noalias() = left_.lazyProduct(A.transpose());
      if constexpr (coding == Asymmetry::gain) {
        KRe_.noalias() = K.lazyProduct(Re_);
        next_.noalias() -= KRe_.lazyProduct(K.transpose());
      } else if constexpr (coding == Asymmetry::mixed) {
        VA_.noalias() = U_.transpose().lazyProduct(A.transpose());
        next_.noalias() -= K.lazyProduct(VA_);
      } else {
        VA_.noalias() = V_.lazyProduct(A.transpose());
        next_.noalias() -= K.lazyProduct(VA_);
      }
    }
    BQ_.noalias() = model.B.lazyProduct(model.Q);
    next_.noalias() += BQ_.lazyProduct(model.B.transpose());

    if (y) {
      innovation_ = *y;
      innovation_.noalias() -= C.lazyProduct(x_);
      next_x_.noalias() = A.lazyProduct(x_);
      next_x_.noalias() += K.lazyProduct(innovation_);
      if (u) next_x_.noalias() += model.D.lazyProduct(*u);
    }
    if (!all_finite(next_) || (y && !all_finite(next_x_))) return failed(Status::overflow, rcond, model, y, u);

    P_.swap(next_);
    gain_.swap(next_gain_);
    if (y) x_.swap(next_x_);
    return {Status::ok, rcond};
  }

  /// P, n x n, as computed.
  const Matrix<S, N, N>& covariance() const { return P_; }
  /// K = A P C' Re^{-1}, n x p, of the last step.
  const Matrix<S, N, P>& predictor_gain() const { return gain_; }
  const Vector<S, N>& state() const { return x_; }

 private:
  S tolerance_;
  Matrix<S, N, N> P_, next_, left_;
  Matrix<S, N, M> BQ_;
  Matrix<S, N, P> U_;
  Matrix<S, P, N> V_;
  Matrix<S, P, P> Re_, LU_;
  Vector<int, P> pivots_;
  Matrix<S, N, P> Kf_, gain_, next_gain_, KRe_;
  Matrix<S, P, N> VA_;
  Vector<S, N> x_, next_x_;
  Vector<S, P> innovation_, work_, sign_;
};

template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
using TextbookFilter = UnsymmetrisedFilter<Asymmetry::textbook, S, N, M, P>;
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
using MixedFilter = UnsymmetrisedFilter<Asymmetry::mixed, S, N, M, P>;
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
using GainFilter = UnsymmetrisedFilter<Asymmetry::gain, S, N, M, P>;
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
using CrossProductFilter = UnsymmetrisedFilter<Asymmetry::cp, S, N, M, P>;
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
using DowndateFilter = UnsymmetrisedFilter<Asymmetry::downdate, S, N, M, P>;

}  // namespace kfstab
