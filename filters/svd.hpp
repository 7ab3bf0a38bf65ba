#pragma once

#include <algorithm>

#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/singular_values.hpp>
#include <kfstab/filters/state_space.hpp>
#include <kfstab/filters/step_report.hpp>

namespace kfstab {

/// The SVD filter: it holds F, n x n, P = F F', F = V D with V orthogonal and D the square roots of P's eigenvalues.
/// With the right singular vectors and the singular values of
///
///     [ R^{1/2}' ]                                [ F'(I - Kf C)' ]                          [ F'A'       ]
///     [ F'C'     ] = W Sigma V',  then those of   [ R^{1/2}' Kf'  ]  (P_{k|k}),  at last of  [ Q^{1/2}'B' ]  (P+),
///     Re = V Sigma^2 V',   Kf = F F'C' V Sigma^{-2} V'                                                 theory (2.12)
///
/// Nothing but Sigma is divided by, so P0, Q and A may be singular, and R too where Re is not. The measurement update
/// is a root of Joseph's, into which an error of the gain enters to second order alone. Eigenvalues of P are there for
/// the asking: squares of the norms of F's columns, in decreasing order.
///
/// Source: Kulikova, Tsyganova, Improved discrete-time Kalman filtering within singular value decomposition, IET
/// Control Theory & Applications 11 (2017) 2412-2418. Operations, with s sweeps of Jacobi (singular_values.hpp),
/// (7/3 + 7s) n^3 + n^2 (4p + m) + n (7p^2 + m^2)/2 + (2/3 + 7s/2) p^3.
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
class SvdFilter {
 public:
  using Scalar = S;
  using Model = RootModel<S, N, M, P>;
  using Output = Vector<S, P>;
  using Input = Vector<S>;

  /// @param tolerance  least ratio of the singular values of Re^{1/2} that counts as regular; <= 0 means p^2 u
  explicit SvdFilter(Dimensions d = {N, M, P}, S tolerance = S(0))
      : tolerance_(tolerance > S(0) ? tolerance : default_tolerance<S>(d.p)), F_(d.n, d.n), filtered_(d.n, d.n),
        next_(d.n, d.n), reduced_(d.n, d.n), CF_(d.p, d.n), innovation_stack_(d.p + d.n, d.p),
        measured_stack_(d.n + d.p, d.n), moved_stack_(d.n + d.m, d.n), BQ_(d.n, d.m), V_(d.p, d.p), W_(d.n, d.p),
        gain_(d.n, d.p), next_gain_(d.n, d.p), KR_(d.n, d.p), sigma_(d.n), Re_sigma_(d.p), pivots_(std::max(d.n, d.p)),
        x_(d.n), filtered_x_(d.n), next_x_(d.n), innovation_(d.p) {
    F_.setZero();
    gain_.setZero();
    x_.setZero();
  }

  /// Takes S0 (n x n; the lower triangle is read), S0 S0' = P0, and x0 of the predicted state.
  template <class S0Type, class X0Type>
  void start(const S0Type& S0, const X0Type& x0) {
    copy_lower(S0, reduced_);
    next_ = reduced_.transpose();
    singular_values(next_, F_, sigma_, pivots_);  // F_ F_' = P0 if it does not converge, too
    x_ = x0;
    gain_.setZero();
  }

  /// One combined measurement and time update, from k|k-1 to k+1|k.
  /// @param y  p, or null: no state is computed, and x stays what it was
  /// @param u  as many as D has columns, or null for none
  /// rcond is the smallest singular value of Re^{1/2} by the largest.
  /// Statuses: singular_innovation (of Re^{1/2}), no_convergence, non_finite_input, overflow.
  StepReport<S> step(const Model& model, const Output* y = nullptr, const Input* u = nullptr) {
    const auto report = measure(model, y, filtered_, filtered_x_);
    if (!report) return report;
    const Status status = predict(model, y != nullptr, u, filtered_, filtered_x_);
    if (status != Status::ok) return failed(status, report.rcond, model, y, u);
    gain_.swap(next_gain_);
    accept(y != nullptr);
    return report;
  }

  /// The measurement update alone: what is held goes from k|k-1 to k|k.
  StepReport<S> measurement_update(const Model& model, const Output* y = nullptr) {
    const auto report = measure(model, y, next_, next_x_);
    if (!report) return report;
    gain_.swap(next_gain_);
    accept(y != nullptr);
    return report;
  }

  /// The time update alone: what is held goes from k|k to k+1|k.
  StepReport<S> time_update(const Model& model, const Input* u = nullptr) {
    const Status status = predict(model, true, u, F_, x_);
    if (status != Status::ok) return failed(status, S(1), model, u);
    accept(true);
    return {};
  }

  /// F, n x n, full, with orthogonal columns in decreasing order of their norms.
  const Matrix<S, N, N>& covariance_root() const { return F_; }
  /// Kf = P C' Re^{-1}, n x p, of the last step or measurement_update.
  const Matrix<S, N, P>& filter_gain() const { return gain_; }
  const Vector<S, N>& state() const { return x_; }

 private:
  static constexpr int sum(int a, int b) { return a == Dynamic || b == Dynamic ? Dynamic : a + b; }

  /// F of the stack, F F' = X'X.
  template <class XType, class FType, class SigmaType>
  Status root(XType& X, FType& F, SigmaType& sigma) {
    if (singular_values(X, F, sigma, pivots_)) return Status::ok;
    return all_finite(F) ? Status::no_convergence : Status::overflow;
  }

  /// From F_ and x_ into `to`, `to_x` and next_gain_.
  StepReport<S> measure(const Model& model, const Output* y, Matrix<S, N, N>& to, Vector<S, N>& to_x) {
    const Index n = F_.rows(), p = CF_.rows();
    CF_.noalias() = model.C.lazyProduct(F_);
    for (Index j = 0; j < p; ++j) {
      for (Index i = 0; i < p; ++i) innovation_stack_(i, j) = i <= j ? model.R_root(j, i) : S(0);
      for (Index i = 0; i < n; ++i) innovation_stack_(p + i, j) = CF_(j, i);
    }
    Status status = root(innovation_stack_, V_, Re_sigma_);
    if (status == Status::ok && !all_finite(Re_sigma_)) status = Status::overflow;
    if (status != Status::ok) return failed(status, S(0), model, y);
    S rcond(1);
    if (p > 0) rcond = Re_sigma_(0) > S(0) ? S(Re_sigma_(p - 1) / Re_sigma_(0)) : S(0);
    if (!(rcond >= tolerance_)) return failed(Status::singular_innovation, rcond, model, y);

    // Divided in three places, never by Sigma^2, which may be out of range: V, then (F'C' V) Sigma^{-1}, whose columns
    // are at most 1, then F times that.
    for (Index j = 0; j < p; ++j)
      for (Index i = 0; i < p; ++i) V_(i, j) /= Re_sigma_(j);
    multiply_transposed(CF_, V_, W_);
    for (Index j = 0; j < p; ++j)
      for (Index i = 0; i < n; ++i) W_(i, j) /= Re_sigma_(j);
    KR_.noalias() = F_.lazyProduct(W_);
    for (Index j = 0; j < p; ++j)
      for (Index i = 0; i < n; ++i) KR_(i, j) /= Re_sigma_(j);
    next_gain_.noalias() = KR_.lazyProduct(V_.transpose());
    if (!all_finite(next_gain_)) return failed(Status::overflow, rcond, model, y);

    reduced_ = F_;
    reduced_.noalias() -= next_gain_.lazyProduct(CF_);
    multiply_lower(next_gain_, model.R_root, KR_);
    measured_stack_.topRows(n) = reduced_.transpose();
    measured_stack_.bottomRows(p) = KR_.transpose();
    status = root(measured_stack_, to, sigma_);
    if (status != Status::ok) return failed(status, rcond, model, y);
    if (y) {
      innovation_ = *y;
      innovation_.noalias() -= model.C.lazyProduct(x_);
      to_x = x_;
      to_x.noalias() += next_gain_.lazyProduct(innovation_);
    }
    if (!all_finite(to) || (y && !all_finite(to_x))) return failed(Status::overflow, rcond, model, y);
    return {Status::ok, rcond};
  }

  /// Into next_ and next_x_.
  Status predict(const Model& model, bool has_state, const Input* u, const Matrix<S, N, N>& from,
                 const Vector<S, N>& x) {
    const Index n = F_.rows();
    reduced_.noalias() = model.A.lazyProduct(from);
    model.process_noise_root(BQ_);
    moved_stack_.topRows(n) = reduced_.transpose();
    moved_stack_.bottomRows(BQ_.cols()) = BQ_.transpose();
    const Status status = root(moved_stack_, next_, sigma_);
    if (status != Status::ok) return status;
    if (has_state) {
      next_x_.noalias() = model.A.lazyProduct(x);
      if (u) next_x_.noalias() += model.D.lazyProduct(*u);
    }
    return all_finite(next_) && (!has_state || all_finite(next_x_)) ? Status::ok : Status::overflow;
  }

  void accept(bool has_state) {
    F_.swap(next_);
    if (has_state) x_.swap(next_x_);
  }

  S tolerance_;
  Matrix<S, N, N> F_, filtered_, next_, reduced_;
  Matrix<S, P, N> CF_;
  Matrix<S, sum(P, N), P> innovation_stack_;
  Matrix<S, sum(N, P), N> measured_stack_;
  Matrix<S, sum(N, M), N> moved_stack_;
  Matrix<S, N, M> BQ_;
  Matrix<S, P, P> V_;
  Matrix<S, N, P> W_, gain_, next_gain_, KR_;
  Vector<S, N> sigma_;
  Vector<S, P> Re_sigma_;
  Vector<int> pivots_;
  Vector<S, N> x_, filtered_x_, next_x_;
  Vector<S, P> innovation_;
};

}  // namespace kfstab
