#pragma once

#include <algorithm>

#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/state_space.hpp>
#include <kfstab/filters/step_report.hpp>

namespace kfstab {

/// What PotterFilter (potter.hpp), CarlsonFilter (carlson.hpp) and UdFilter (ud.hpp) have in common: they take the
/// measurements in one at a time, each with noise of variance 1, so that nothing but a number is inverted. For that a
/// correlated R is whitened first, by triangular solves with R^{1/2}:
///
///     Phi = R^{-1/2} C,   with rows phi_j',   y~ = R^{-1/2} y
///     k_j = P phi_j / (1 + phi_j' P phi_j),   P := P - k_j phi_j' P,   x := x + k_j (y~_j - phi_j' x)   theory (2.10)
///
/// The gain of the whole measurement is gathered on the way: x is an affine function of y~ all along, with coefficients
///
///     K~ := [ (I - k_j phi_j') K~   k_j ],    and in the end    Kf = K~ R^{-1/2} = P C' Re^{-1}.
///
/// R must be regular, P0 and Q need not be. One step loses at most 1 + k(R^{1/2}) |Phi| |P|^{1/2}: the whitening's
/// condition number and, as a square-root filter, the root of that of I + Phi P Phi'.
///
/// A Form has, as static functions, for what it keeps in X (n x n) with P = P(X), f and k (n) and work (n + m):
///     start(S0, X, W, work)           X of P = S0 S0', S0 lower
///     Scalar measure(phi, X, f, k)    X of P - k phi' P; leaves k and returns 1 + phi' P phi, f is work
///     restore(X, work)                the shape of X, where measure spoils it
///     multiply(A, X, out)             out (n x n), A P A' = out D out', D as the form has it
///     predict(W, X, work)             X of W D W', W (n x (n+m)) the columns of `multiply` and those of B Q^{1/2}
template <class Form, class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
class ScalarUpdatesFilter {
 public:
  using Scalar = S;
  using Model = RootModel<S, N, M, P>;
  using Output = Vector<S, P>;
  using Input = Vector<S>;

  /// @param tolerance  least reciprocal condition number of R^{1/2} that counts as regular; <= 0 means p^2 u
  explicit ScalarUpdatesFilter(Dimensions d = {N, M, P}, S tolerance = S(0))
      : tolerance_(tolerance > S(0) ? tolerance : default_tolerance<S>(d.p)), X_(d.n, d.n), next_(d.n, d.n),
        W_(d.n, d.n + d.m), Phi_(d.n, d.p), gain_(d.n, d.p), next_gain_(d.n, d.p), f_(d.n), k_(d.n), work_(d.n + d.m),
        x_(d.n), filtered_x_(d.n), next_x_(d.n), whitened_(d.p), solved_(d.p), sign_(d.p) {
    X_.setZero();
    gain_.setZero();
    x_.setZero();
  }

  /// Takes S0 (n x n; the lower triangle is read), S0 S0' = P0, and x0 of the predicted state. P0 is not formed.
  template <class S0Type, class X0Type>
  void start(const S0Type& S0, const X0Type& x0) {
    Form::start(S0, X_, W_, work_);
    x_ = x0;
    gain_.setZero();
  }

  /// One combined measurement and time update, from k|k-1 to k+1|k.
  /// @param y  p, or null: no state is computed, and x stays what it was
  /// @param u  as many as D has columns, or null for none
  /// rcond is that of R^{1/2}, which is all that is divided by.
  /// Statuses: singular_measurement_noise (of R^{1/2}), non_finite_input, overflow.
  StepReport<S> step(const Model& model, const Output* y = nullptr, const Input* u = nullptr) {
    const auto report = measure(model, y, filtered_x_);
    if (!report) return report;
    predict(model, filtered_x_, y != nullptr, u);
    if (!accept(y != nullptr)) return failed(Status::overflow, report.rcond, model, y, u);
    gain_.swap(next_gain_);
    return report;
  }

  /// The measurement update alone: what is held goes from k|k-1 to k|k.
  StepReport<S> measurement_update(const Model& model, const Output* y = nullptr) {
    const auto report = measure(model, y, next_x_);
    if (!report) return report;
    Form::restore(next_, work_);
    if (!accept(y != nullptr)) return failed(Status::overflow, report.rcond, model, y);
    gain_.swap(next_gain_);
    return report;
  }

  /// The time update alone: what is held goes from k|k to k+1|k.
  StepReport<S> time_update(const Model& model, const Input* u = nullptr) {
    next_ = X_;
    predict(model, x_, true, u);
    if (!accept(true)) return failed(Status::overflow, S(1), model, u);
    return {};
  }

  /// Kf = P C' Re^{-1}, n x p, of the last step or measurement_update, in terms of y as it was given.
  const Matrix<S, N, P>& filter_gain() const { return gain_; }
  const Vector<S, N>& state() const { return x_; }

 protected:
  const Matrix<S, N, N>& held() const { return X_; }

 private:
  static constexpr int columns = N == Dynamic || M == Dynamic ? Dynamic : N + M;

  /// All measurements, from X_ and x_ into next_, next_gain_ and `to_x`.
  StepReport<S> measure(const Model& model, const Output* y, Vector<S, N>& to_x) {
    const Index n = X_.rows(), p = Phi_.cols();
    const S rcond = reciprocal_condition_triangular<Triangle::lower>(model.R_root, solved_, sign_);
    if (!(rcond >= tolerance_)) return failed(Status::singular_measurement_noise, rcond, model, y);
    Phi_ = model.C.transpose();
    solve_triangular_right<Triangle::lower, true>(model.R_root, Phi_);
    if (y) {
      whitened_ = *y;
      solve_triangular<Triangle::lower, false>(model.R_root, whitened_);
      to_x = x_;
    }
    next_ = X_;
    for (Index j = 0; j < p; ++j) {
      const auto phi = Phi_.col(j);
      // A variance that is infinite would make the gain 0 and the update none at all.
      if (!is_finite(Form::measure(phi, next_, f_, k_))) return failed(Status::overflow, rcond, model, y);
      for (Index i = 0; i < j; ++i) {
        S s(0);
        for (Index r = 0; r < n; ++r) s += phi(r) * next_gain_(r, i);
        for (Index r = 0; r < n; ++r) next_gain_(r, i) -= k_(r) * s;
      }
      for (Index r = 0; r < n; ++r) next_gain_(r, j) = k_(r);
      if (!y) continue;
      S residual = whitened_(j);
      for (Index r = 0; r < n; ++r) residual -= phi(r) * to_x(r);
      for (Index r = 0; r < n; ++r) to_x(r) += k_(r) * residual;
    }
    solve_triangular_right<Triangle::lower, false>(model.R_root, next_gain_);
    if (!all_finite(next_gain_)) return failed(Status::overflow, rcond, model, y);
    return {Status::ok, rcond};
  }

  /// The time update of next_ in place, and of `x` into next_x_.
  void predict(const Model& model, const Vector<S, N>& x, bool has_state, const Input* u) {
    Form::multiply(model.A, next_, W_.leftCols(next_.rows()));
    model.process_noise_root(W_.rightCols(model.B.cols()));
    Form::predict(W_, next_, work_);
    if (!has_state) return;
    next_x_.noalias() = model.A.lazyProduct(x);
    if (u) next_x_.noalias() += model.D.lazyProduct(*u);
  }

  bool accept(bool has_state) {
    if (!all_finite(next_) || (has_state && !all_finite(next_x_))) return false;
    X_.swap(next_);
    if (has_state) x_.swap(next_x_);
    return true;
  }

  S tolerance_;
  Matrix<S, N, N> X_, next_;
  Matrix<S, N, columns> W_;
  Matrix<S, N, P> Phi_;  // Phi', column j is phi_j
  Matrix<S, N, P> gain_, next_gain_;
  Vector<S, N> f_, k_;
  Vector<S, columns> work_;
  Vector<S, N> x_, filtered_x_, next_x_;
  Vector<S, P> whitened_, solved_, sign_;
};

}  // namespace kfstab
