#pragma once

#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/state_space.hpp>
#include <kfstab/filters/step_report.hpp>

namespace kfstab {

/// The information filter, by normal equations: it holds Y = P_{k|k}^{-1} and d = Y x, and goes from k|k to k+1|k+1.
/// With G = A^{-1} B and the Cholesky factor V, V'V = Q^{-1} + G'Y G,
///
///     W  = Y G V^{-1},                         c  = d + Y A^{-1} D u                                    theory (2.11)
///     Y- = A^{-T} (Y - W W') A^{-1},           d- = A^{-T} (c + W V^{-T} (Q^{-1} E w - G'c))
///     Y+ = Y- + C'R^{-1} C,                    d+ = d- + C'R^{-1} y,    x+ = Y+^{-1} d+,    Kf = Y+^{-1} C'R^{-1}
///
/// A, B, D, Q, u are those of step k; C, R, y those of step k+1. It is the square-root information filter squared:
/// where that loses the condition number of A or of a root, this loses its square, and Y - W W' cancels. It takes the
/// same model, whose roots it squares, and needs the same: A invertible, Q, R and P0 positive definite. Judge it
/// against P_{k|k}, never P_{k|k-1}.
///
/// Source: Fraser, A New Technique for the Optimal Smoothing of Data (1967); Anderson, Moore, Optimal Filtering (1979),
/// 6.3. Operations 5/3 n^3 + 3/2 n^2 (m + p) + n (m^2 + p^2/2) + m^3/6, and n^2 p + n p^2/2 for the gain.
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
class InformationFilter {
 public:
  using Scalar = S;
  using Model = InformationModel<S, N, M, P>;
  using Output = Vector<S, P>;
  using Input = Vector<S>;

  /// @param tolerance  least reciprocal condition number of Y that counts as regular; <= 0 means n^2 u
  explicit InformationFilter(Dimensions d = {N, M, P}, S tolerance = S(0))
      : tolerance_(tolerance > S(0) ? tolerance : default_tolerance<S>(d.n)), Y_(d.n, d.n), next_(d.n, d.n),
        V_(d.n, d.n), YA_(d.n, d.n), M_(d.m, d.m), W_(d.n, d.m), Phi_(d.p, d.n), gain_(d.n, d.p), next_gain_(d.n, d.p),
        d_(d.n), next_d_(d.n), c_(d.n), x_(d.n), next_x_(d.n), work_(d.n), sign_(d.n), w_(d.m), y_(d.p) {
    Y_.setZero();
    gain_.setZero();
    d_.setZero();
    x_.setZero();
  }

  /// Takes T0 (n x n; the upper triangle is read), T0'T0 = P0^{-1}, and x0: of the predicted state if
  /// measurement_update follows, of the filtered one if step does.
  template <class T0Type, class X0Type>
  void start(const T0Type& T0, const X0Type& x0) {
    copy_upper(T0, V_);
    Y_.setZero();
    add_product_upper(Y_, V_.transpose(), V_.transpose());
    mirror_upper(Y_);
    x_ = x0;
    d_.noalias() = Y_.lazyProduct(x_);
    gain_.setZero();
  }

  /// One combined time and measurement update, from k|k to k+1|k+1.
  /// @param model  of step k: A, B, D, Q    @param next  of step k+1: C, R
  /// @param y  y_{k+1} (p), or null: no state is computed, x stays what it was, and d becomes Y x of the new Y
  /// @param u  u_k, as many as D has columns, or null for none
  /// Statuses: not_positive_definite (Q^{-1} + G'Y G, or Y+), singular_information (of Y+), non_finite_input, overflow.
  StepReport<S> step(const Model& model, const Model& next, const Output* y = nullptr, const Input* u = nullptr) {
    const Status status = move(model, y != nullptr, u);
    return finish(status, model, next, y, u, true);
  }

  /// The measurement update alone: from k|k-1 to k|k. It starts a run from P_{0|-1}.
  StepReport<S> measurement_update(const Model& model, const Output* y = nullptr) {
    next_ = Y_;
    next_d_ = d_;
    return finish(Status::ok, model, model, y, static_cast<const Input*>(nullptr), true);
  }

  /// The time update alone: from k|k to k+1|k.
  StepReport<S> time_update(const Model& model, const Input* u = nullptr) {
    const Status status = move(model, true, u);
    return finish(status, model, model, static_cast<const Output*>(nullptr), u, false);
  }

  /// Y, n x n, symmetric to the last bit.
  const Matrix<S, N, N>& information() const { return Y_; }
  /// Kf = Y^{-1} C' R^{-1}, n x p, of the last step.
  const Matrix<S, N, P>& filter_gain() const { return gain_; }
  const Vector<S, N>& state() const { return x_; }
  /// d = Y x, n.
  const Vector<S, N>& information_state() const { return d_; }

 private:
  /// The time update's part: leaves the upper triangle of Y- in next_ and d- in next_d_.
  Status move(const Model& model, bool has_state, const Input* u) {
    const auto& G = model.A_inverse_B;
    // V in the upper triangle of M_, W in W_.
    M_.setZero();
    for (Index j = 0; j < M_.cols(); ++j)
      for (Index i = 0; i <= j; ++i)
        for (Index k = 0; k <= i; ++k) M_(i, j) += model.Q_inverse_root(k, i) * model.Q_inverse_root(k, j);
    W_.noalias() = Y_.lazyProduct(G);
    add_product_upper(M_, G.transpose(), W_.transpose());
    if (!is_finite(one_norm_symmetric_upper(M_))) return Status::overflow;
    if (cholesky_upper(M_) != 0) return Status::not_positive_definite;
    solve_triangular_right<Triangle::upper, false>(M_, W_);

    V_ = Y_;
    subtract_product_upper(V_, W_, W_);
    mirror_upper(V_);
    YA_.noalias() = V_.lazyProduct(model.A_inverse);
    next_.setZero();
    add_product_upper(next_, model.A_inverse.transpose(), YA_.transpose());
    if (!has_state) return Status::ok;

    c_ = d_;
    if (u) {
      work_.noalias() = model.D.lazyProduct(*u);
      next_d_.noalias() = model.A_inverse.lazyProduct(work_);
      c_.noalias() += Y_.lazyProduct(next_d_);
    }
    multiply_transposed(G, c_, w_);
    w_ = -w_;
    if (model.w_mean.size() > 0)
      for (Index k = 0; k < w_.size(); ++k) {
        S z(0);
        for (Index j = k; j < w_.size(); ++j) z += model.Q_inverse_root(k, j) * model.w_mean(j);
        for (Index i = k; i < w_.size(); ++i) w_(i) += model.Q_inverse_root(k, i) * z;
      }
    solve_triangular<Triangle::upper, true>(M_, w_);
    c_.noalias() += W_.lazyProduct(w_);
    multiply_transposed(model.A_inverse, c_, next_d_);
    return Status::ok;
  }

  /// The measurement update's part, on the upper triangle of next_ and next_d_, and the step's end.
  StepReport<S> finish(Status moved, const Model& model, const Model& next, const Output* y, const Input* u,
                       bool measured) {
    const Index n = Y_.rows(), p = Phi_.rows();
    const bool has_state = y || !measured;
    const auto refuse = [&](Status status, const S& rcond) {
      const auto report = failed(status, rcond, model, y, u);
      return failed(report.status, rcond, next);
    };
    if (moved != Status::ok) return refuse(moved, S(0));
    if (measured) {
      multiply_upper(next.R_inverse_root, next.C, Phi_);
      add_product_upper(next_, Phi_.transpose(), Phi_.transpose());
      if (y) {
        multiply_upper(next.R_inverse_root, *y, y_);
        for (Index k = 0; k < p; ++k) next_d_ += Phi_.row(k).transpose() * y_(k);
      }
    }
    mirror_upper(next_);
    const S norm = one_norm_symmetric_upper(next_);
    if (!is_finite(norm)) return refuse(Status::overflow, S(0));
    V_ = next_;
    if (cholesky_upper(V_) != 0) return refuse(Status::not_positive_definite, S(0));
    const auto solve = [this](auto& b) {
      solve_triangular<Triangle::upper, true>(V_, b);
      solve_triangular<Triangle::upper, false>(V_, b);
    };
    const S rcond = reciprocal_condition(norm, work_, sign_, solve, solve);
    if (!(rcond >= tolerance_)) return refuse(Status::singular_information, rcond);

    if (measured) {
      for (Index j = 0; j < p; ++j) {
        for (Index i = 0; i < n; ++i) work_(i) = S(0);
        for (Index k = 0; k <= j; ++k)
          for (Index i = 0; i < n; ++i) work_(i) += Phi_(k, i) * next.R_inverse_root(k, j);
        solve(work_);
        next_gain_.col(j) = work_;
      }
    }
    if (has_state) {
      next_x_ = next_d_;
      solve(next_x_);
    } else {
      next_d_.noalias() = next_.lazyProduct(x_);
    }
    if ((measured && !all_finite(next_gain_)) || !all_finite(next_d_) || (has_state && !all_finite(next_x_)))
      return refuse(Status::overflow, rcond);
    Y_.swap(next_);
    d_.swap(next_d_);
    if (measured) gain_.swap(next_gain_);
    if (has_state) x_.swap(next_x_);
    return {Status::ok, rcond};
  }

  S tolerance_;
  Matrix<S, N, N> Y_, next_;
  Matrix<S, N, N> V_, YA_;
  Matrix<S, M, M> M_;
  Matrix<S, N, M> W_;
  Matrix<S, P, N> Phi_;
  Matrix<S, N, P> gain_, next_gain_;
  Vector<S, N> d_, next_d_, c_, x_, next_x_, work_, sign_;
  Vector<S, M> w_;
  Vector<S, P> y_;
};

}  // namespace kfstab
