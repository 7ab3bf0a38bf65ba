#pragma once

#include <limits>

#include <kfstab/filters/kernels.hpp>
#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/state_space.hpp>
#include <kfstab/filters/step_report.hpp>
#include <kfstab/filters/structured_lq.hpp>

namespace kfstab {

/// Kf = T^{-1} T^{-T} C' R^{-1} of T, column by column.
///
/// @param T  n x n, upper; what is below its diagonal is not read
/// @param C_weighted  p x n, R^{-1/2} C    @param R_inverse_root  p x p, R^{-1/2}: the upper triangle is read
/// @param gain  n x p. Out Kf.    @param work  n
template <class TType, class CType, class RType, class GainType, class WorkType>
void information_gain(const TType& T, const CType& C_weighted, const RType& R_inverse_root, GainType& gain,
                      WorkType& work) {
  using Scalar = typename GainType::Scalar;
  const Index n = T.rows();
  for (Index j = 0; j < gain.cols(); ++j) {
    for (Index i = 0; i < n; ++i) work(i) = Scalar(0);
    for (Index k = 0; k <= j; ++k)
      for (Index i = 0; i < n; ++i) work(i) += C_weighted(k, i) * R_inverse_root(k, j);
    solve_triangular<Triangle::upper, true>(T, work);
    solve_triangular<Triangle::upper, false>(T, work);
    gain.col(j) = work;
  }
}

/// Whether T+ is regular, as a kernel leaves it, which gives up where it divides by zero: without outputs and data it divides by
/// nothing.
template <class TType, class S>
bool is_regular_information_root(const TType& T, Wanted wanted, const S& rcond, const S& tolerance) {
  if (wants_rcond(wanted)) return rcond >= tolerance;
  bool regular = true;
  if (wanted == Wanted::gain)
    for (Index j = 0; j < T.rows(); ++j) regular = regular && T(j, j) != S(0);
  return regular;
}

/// The square-root information filter: it holds T, upper, P_{k|k}^{-1} = T'T, and goes from k|k to k+1|k+1.
///
///       [ Q^{-1/2}      0          Q^{-1/2} z          ]     [ Qe^{-1/2}  *   *  ]
///     U [ T A^{-1} B    T A^{-1}   T (x + A^{-1} D u)  ]  =  [ 0          T+  xi ],   x+ = T+^{-1} xi      theory (2.4)
///       [ 0             R^{-1/2}C  R^{-1/2} y          ]     [ 0          0   e  ]
///
/// A, B, D, Q, u are those of step k; C, R, y those of step k+1. The eliminated unknown is -w, so z = -E w. A must be
/// invertible, Q, R and P0 positive definite. A weak prior, even T = 0 in some directions, costs it nothing; what it
/// loses is the condition number of A, in A^{-1}. Judge it against P_{k|k}, never P_{k|k-1}.
///
/// Source: SLICOT FB01SD, whose Z is this z, the mean of -w. Operations 7/6 n^3 + n^2 (5m/2 + p) + n (p^2/2 + m^2), and
/// n^2 p for the gain (FB01SD's 7m/2 forms A^{-1} B, too).
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
class SquareRootInformationFilter {
 public:
  using Scalar = S;
  using Model = InformationModel<S, N, M, P>;
  using Output = Vector<S, P>;
  using Input = Vector<S>;

  /// @param tolerance  least reciprocal condition number of T that counts as regular; <= 0 means n^2 u
  explicit SquareRootInformationFilter(Dimensions d = {N, M, P}, S tolerance = S(0))
      : tolerance_(tolerance > S(0) ? tolerance : default_tolerance<S>(d.n)), T_(d.n, d.n), next_(d.n, d.n),
        Qe_root_(d.m, d.m), TAB_(d.n, d.m), over_(d.m, d.n), stack_(d.n + d.p, d.n), C_weighted_(d.p, d.n),
        gain_(d.n, d.p), next_gain_(d.n, d.p), right_(d.n + d.p), z_(d.m), w_(d.m), tau_(d.m), x_(d.n), next_x_(d.n),
        moved_(d.n), e_(d.p), work_(d.n), sign_(d.n),
        kernel_work_(kernels::work_size<S, N, P, M, true>(d.n, d.p, d.m)) {
    T_.setZero();
    next_.setZero();  // kernels write the upper triangle alone
    gain_.setZero();
    x_.setZero();
    e_.setZero();
  }

  /// Takes T0 (n x n; the upper triangle is read), T0'T0 = P0^{-1}, and x0: of the predicted state if
  /// measurement_update follows, of the filtered one if step does.
  template <class T0Type, class X0Type>
  void start(const T0Type& T0, const X0Type& x0) {
    copy_upper(T0, T_);
    x_ = x0;
    gain_.setZero();
    e_.setZero();
  }

  /// One combined time and measurement update, from k|k to k+1|k+1.
  /// @param model  of step k: A, B, D, Q    @param next  of step k+1: C, R
  /// @param y  y_{k+1} (p), or null: no state is computed, and x stays what it was
  /// @param u  u_k, as many as D has columns, or null for none
  /// @param wanted  whatever it is there is a state, if there is y
  /// Statuses: singular_information (of T+), non_finite_input, overflow.
  StepReport<S> step(const Model& model, const Model& next, const Output* y = nullptr, const Input* u = nullptr,
                     Wanted wanted = Wanted::all) {
    if (y) right_hand_side(model, u);
    S rcond = std::numeric_limits<S>::quiet_NaN();
    if (all_by_kernel(model, next, y, wanted, rcond)) {
      if (!is_regular_information_root(next_, wanted, rcond, tolerance_)) {
        const auto report = failed(Status::singular_information, rcond, model, y, u);
        return failed(report.status, rcond, next);
      }
      accept(y != nullptr, wants_gain(wanted));
      if (y) e_ = right_.tail(e_.size());
      return {Status::ok, rcond};
    }
    move(model, y != nullptr);
    weigh(next, y, true);
    triangularise();
    return finish(model, next, y, u, true, wanted);
  }

  /// The measurement update alone: from k|k-1 to k|k. It starts a run from P_{0|-1}.
  StepReport<S> measurement_update(const Model& model, const Output* y = nullptr) {
    stack_.topRows(T_.rows()) = T_;
    if (y) multiply_upper(T_, x_, right_.head(T_.rows()));
    weigh(model, y, true);
    triangularise();
    return finish(model, model, y, static_cast<const Input*>(nullptr), true, Wanted::all);
  }

  /// The time update alone: from k|k to k+1|k.
  StepReport<S> time_update(const Model& model, const Input* u = nullptr) {
    right_hand_side(model, u);
    move(model, true);
    weigh(model, nullptr, false);
    triangularise();
    return finish(model, model, static_cast<const Output*>(nullptr), u, false, Wanted::all);
  }

  /// T, n x n, zero below the diagonal.
  const Matrix<S, N, N>& information_factor() const { return T_; }
  /// Kf = T^{-1} T^{-T} C' R^{-1}, n x p, of the last step.
  const Matrix<S, N, P>& filter_gain() const { return gain_; }
  const Vector<S, N>& state() const { return x_; }
  /// e, p: the whitened residual that the last step left over; e'e adds to the sum of squares.
  const Vector<S, P>& residual() const { return e_; }

 private:
  static constexpr int rows = N == Dynamic || P == Dynamic ? Dynamic : N + P;

  /// x + A^{-1} D u in moved_, and z = Q^{-1/2} (-E w) in z_.
  void right_hand_side(const Model& model, const Input* u) {
    moved_ = x_;
    if (u) {
      work_.noalias() = model.D.lazyProduct(*u);
      moved_.noalias() += model.A_inverse.lazyProduct(work_);
    }
    if (model.w_mean.size() > 0) {
      w_ = -model.w_mean;
      multiply_upper(model.Q_inverse_root, w_, z_);
    } else {
      z_.setZero();
    }
  }

  /// All of a step but what its report says; false if there are no kernels, or they gave up: where something is singular or
  /// not finite, too.
  bool all_by_kernel([[maybe_unused]] const Model& model, [[maybe_unused]] const Model& next,
                     [[maybe_unused]] const Output* y, [[maybe_unused]] Wanted wanted, [[maybe_unused]] S& rcond) {
    if constexpr (kernels::exist<S>) {
      using kernels::source, kernels::target;
      const Index n = T_.rows(), m = TAB_.cols(), p = C_weighted_.rows();
      kernels::ArrayStep step{.n = n,
                              .m = p,
                              .p = m,
                              .A_band = n,
                              .C_band = n,
                              .transposed = true,
                              .A = source(model.A_inverse),
                              .B = source(next.C),
                              .C = source(model.A_inverse_B),
                              .S = source(T_),
                              .Q = source(next.R_inverse_root),
                              .R = source(model.Q_inverse_root),
                              .S_next = target(next_),
                              .Re = target(Qe_root_),
                              .Kf = wants_gain(wanted) ? target(next_gain_) : kernels::Target{},
                              .rcond_of_T = wants_rcond(wanted) ? &rcond : nullptr,
                              .work = kernel_work_.data()};
      if (!y) return kernels::run_sized<N, P, M, false, true>(step);
      step.x = moved_.data();
      step.y = y->data();
      step.z = z_.data();
      step.xi = right_.data();
      step.e = right_.data() + n;
      step.x_next = next_x_.data();
      return kernels::run_sized<N, P, M, true, true>(step);
    }
    return false;
  }

  /// The time update's part: eliminates w; leaves T of k+1|k, full, on top of stack_ and its right-hand side in right_.
  void move(const Model& model, bool has_state) {
    const Index n = T_.rows(), m = TAB_.cols();
    auto TA = stack_.topRows(n);
    multiply_upper(T_, model.A_inverse, TA);
    multiply_upper(T_, model.A_inverse_B, TAB_);
    copy_upper(model.Q_inverse_root, Qe_root_);
    structured_qr(Shape::full, Qe_root_, TAB_, TA, over_, tau_);
    if (!has_state) return;
    auto xi = right_.head(n);
    multiply_upper(T_, moved_, xi);
    for (Index j = 0; j < m; ++j) apply_reflector(S(tau_(j)), TAB_, j, n, z_(j), xi);
  }

  /// The measurement's rows, at the bottom of stack_ and right_.
  void weigh(const Model& next, const Output* y, bool measured) {
    const Index p = C_weighted_.rows();
    if (measured) {
      multiply_upper(next.R_inverse_root, next.C, C_weighted_);
      stack_.bottomRows(p) = C_weighted_;
      if (y) multiply_upper(next.R_inverse_root, *y, right_.tail(p));
    } else {
      stack_.bottomRows(p).setZero();
      right_.tail(p).setZero();
    }
    if (!y && measured) right_.setZero();
  }

  void triangularise() {
    qr(stack_, right_);
    copy_upper(stack_.topRows(T_.rows()), next_);
  }

  /// The step's end: what is made of T+, in next_, and of (xi; e), in right_.
  StepReport<S> finish(const Model& model, const Model& next, const Output* y, const Input* u, bool measured,
                       Wanted wanted) {
    const Index n = T_.rows(), p = C_weighted_.rows();
    const bool has_state = y || !measured, has_gain = measured && wants_gain(wanted);
    const bool finite = all_finite(next_);
    S rcond = finite ? std::numeric_limits<S>::quiet_NaN() : S(0);
    bool regular = finite;
    if (finite && wants_rcond(wanted)) {
      rcond = reciprocal_condition_triangular<Triangle::upper>(next_, work_, sign_);
      regular = rcond >= tolerance_;
    } else if (finite && (has_state || has_gain)) {
      for (Index j = 0; j < n; ++j) regular = regular && next_(j, j) != S(0);
    }
    if (!regular) {
      const auto report = failed(finite ? Status::singular_information : Status::overflow, rcond, model, y, u);
      return failed(report.status, rcond, next);
    }
    if (has_gain) information_gain(next_, C_weighted_, next.R_inverse_root, next_gain_, work_);
    if (has_state) {
      next_x_ = right_.head(n);
      solve_triangular<Triangle::upper, false>(next_, next_x_);
    }
    if ((has_gain && !all_finite(next_gain_)) || (has_state && !all_finite(next_x_))) {
      const auto report = failed(Status::overflow, rcond, model, y, u);
      return failed(report.status, rcond, next);
    }
    accept(has_state, has_gain);
    if (y) e_ = right_.tail(p);
    return {Status::ok, rcond};
  }

  void accept(bool has_state, bool has_gain) {
    T_.swap(next_);
    if (has_gain) gain_.swap(next_gain_);
    if (has_state) x_.swap(next_x_);
  }

  S tolerance_;
  Matrix<S, N, N> T_, next_;
  Matrix<S, M, M> Qe_root_;
  Matrix<S, N, M> TAB_;
  Matrix<S, M, N> over_;
  Matrix<S, rows, N> stack_;
  Matrix<S, P, N> C_weighted_;
  Matrix<S, N, P> gain_, next_gain_;
  Vector<S, rows> right_;
  Vector<S, M> z_, w_, tau_;
  Vector<S, N> x_, next_x_, moved_;
  Vector<S, P> e_;
  Vector<S, N> work_, sign_;
  Vector<S> kernel_work_;
};

}  // namespace kfstab
