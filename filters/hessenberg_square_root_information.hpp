#pragma once

#include <algorithm>
#include <limits>

#include <kfstab/filters/condensed.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/square_root_information.hpp>

namespace kfstab {

/// The square-root information filter in controller-Hessenberg form: SquareRootInformationFilter for time-invariant
/// systems, at a fraction of its price. It works in coordinates U x, F = U A^{-1} U', H = U A^{-1} B,
///
///     H(i, j) = 0 for i > j,     F(i, j) = 0 for i > j + m,
///
///       [ Q^{-1/2}  0              Q^{-1/2} z ]     [ Qe^{-1/2}  *   *  ]
///     V [ 0         R^{-1/2} C U'  R^{-1/2} y ]  =  [ 0          T+  xi ],   x+ = U' T+^{-1} xi           theory (2.9)
///       [ T H       T F            T x_U      ]     [ 0          0   e  ]
///
/// with P_{k|k}^{-1} = U' T'T U, x_U = U (x + A^{-1} D u), z = -E w. A reflector reaches over j + 1 rows in column
/// j <= m, then over m + p + 1, as the zeros of the array stay. What it shows is in the coordinates of the model.
///
/// The first step, or measurement update, reduces the model, O(n^3), and keeps a copy: a later step with other numbers
/// in A^{-1}, A^{-1}B, C, Q or R is refused. D and the mean of w may change. If m = 0 there is nothing to condense by,
/// and F is full.
///
/// Source: SLICOT FB01TD, whose Z is this z; Van Dooren, Verhaegen, SIAM J. Sci. Stat. Comput. 9 (1988). Operations
/// 1/6 n^3 + n^2 (3m/2 + p) + n m^2 (fewer than FB01TD's 2 n m^2 + 2/3 m^3: reflectors end where the matrix does), and
/// 2 n^2 p for the gain in the coordinates of the model. information_factor() costs 7/6 n^3 when it is asked for.
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
class HessenbergSquareRootInformationFilter {
 public:
  using Scalar = S;
  using Model = InformationModel<S, N, M, P>;
  using Output = Vector<S, P>;
  using Input = Vector<S>;

  /// @param tolerance  least reciprocal condition number of T that counts as regular; <= 0 means n^2 u
  explicit HessenbergSquareRootInformationFilter(Dimensions d = {N, M, P}, S tolerance = S(0))
      : tolerance_(tolerance > S(0) ? tolerance : default_tolerance<S>(d.n)), band_(d.m > 0 ? d.m : d.n),
        U_(d.n, d.n), F_(d.n, d.n), T_(d.n, d.n), next_(d.n, d.n), factor_(d.n, d.n),
        U_transposed_(d.n, d.n), CR_inverse_(d.n, d.p), H_(d.n, d.m), TH_(d.n, d.m),
        over_(d.m, d.n), Qe_root_(d.m, d.m), C_weighted_(d.p, d.n), CR_TF_(d.p + d.n, d.n), gain_(d.n, d.p),
        condensed_gain_(d.n, d.p), next_gain_(d.n, d.p), right_(d.p + d.n), z_(d.m), w_(d.m), tau_(d.m), x_(d.n),
        next_x_(d.n), moved_(d.n), e_(d.p), work_(d.n), sign_(d.n), weighted_y_(d.p),
        kernel_work_(kernels::work_size<S, N, P, M, true>(d.n, d.p, d.m)) {
    system_.A_inverse.resize(d.n, d.n);
    system_.A_inverse_B.resize(d.n, d.m);
    system_.C.resize(d.p, d.n);
    system_.Q_inverse_root.resize(d.m, d.m);
    system_.R_inverse_root.resize(d.p, d.p);
    U_.setIdentity();
    T_.setZero();
    next_.setZero();  // kernels write the upper triangle alone
    factor_.setZero();
    gain_.setZero();
    x_.setZero();
    e_.setZero();
  }

  /// Takes T0 (n x n; the upper triangle is read), T0'T0 = P0^{-1}, and x0: of the predicted state if
  /// measurement_update follows, of the filtered one if step does. Either may bring another model.
  template <class T0Type, class X0Type>
  void start(const T0Type& T0, const X0Type& x0) {
    copy_upper(T0, T_);
    factor_ = T_;
    has_factor_ = true;
    U_.setIdentity();
    reduced_ = false;
    x_ = x0;
    gain_.setZero();
    e_.setZero();
  }

  /// One combined time and measurement update, from k|k to k+1|k+1.
  /// @param model  of step k: D and the mean of w    @param next  of step k+1; all other numbers are those of model
  /// @param y  y_{k+1} (p), or null: no state is computed, and x stays what it was
  /// @param u  u_k, as many as D has columns, or null for none
  /// @param wanted  whatever it is there is a state, if there is y
  /// Statuses: time_varying_model (its numbers, or those of next, are not those of the first step),
  /// singular_information (of T+), non_finite_input, overflow.
  StepReport<S> step(const Model& model, const Model& next, const Output* y = nullptr, const Input* u = nullptr,
                     Wanted wanted = Wanted::all) {
    const Status status = recognise(model, next);
    if (status != Status::ok) return blame(status, S(0), model, next, y, u);
    if (y) {
      moved_ = x_;
      if (u) {
        work_.noalias() = model.D.lazyProduct(*u);
        moved_.noalias() += model.A_inverse.lazyProduct(work_);
      }
      z_.setZero();
      if (model.w_mean.size() > 0) {
        w_ = -model.w_mean;
        multiply_upper(model.Q_inverse_root, w_, z_);
      }
      multiply_upper(next.R_inverse_root, *y, weighted_y_);
    }
    S rcond = std::numeric_limits<S>::quiet_NaN();
    if (all_by_kernel(model, y != nullptr, wanted, rcond)) {
      if (!is_regular_information_root(next_, wanted, rcond, tolerance_))
        return blame(Status::singular_information, rcond, model, next, y, u);
      accept(y != nullptr, wants_gain(wanted));
      return {Status::ok, rcond};
    }

    const Index n = T_.rows(), m = H_.cols();
    auto TF = CR_TF_.bottomRows(n);
    multiply_upper_hessenberg(band_, T_, F_, TF);
    multiply_upper_hessenberg(0, T_, H_, TH_);
    copy_upper(model.Q_inverse_root, Qe_root_);
    structured_qr(Shape::trapezoidal, Qe_root_, TH_, TF, over_, tau_);
    if (y) {
      auto xi = transformed(moved_);
      for (Index j = 0; j < m; ++j) apply_reflector(S(tau_(j)), TH_, j, std::min(j + 1, n), z_(j), xi);
    }
    triangularise(band_, y != nullptr);
    return finish(model, next, y, u, wanted);
  }

  /// The measurement update alone: from k|k-1 to k|k. It starts a run from P_{0|-1}.
  StepReport<S> measurement_update(const Model& model, const Output* y = nullptr) {
    const Input* u = nullptr;
    const Status status = recognise(model, model);
    if (status != Status::ok) return blame(status, S(0), model, model, y, u);
    const Index n = T_.rows(), p = e_.size();
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i <= j; ++i) CR_TF_(p + i, j) = T_(i, j);
    if (y) {
      transformed(x_);
      multiply_upper(model.R_inverse_root, *y, weighted_y_);
    }
    triangularise(0, y != nullptr);
    return finish(model, model, y, u, Wanted::all);
  }

  /// T, n x n, zero below the diagonal, T'T = P_{k|k}^{-1}: the QR factor of condensed_factor() U, made when it
  /// is asked for.
  const Matrix<S, N, N>& information_factor() {
    if (!has_factor_) {
      triangularise(U_, T_, factor_);
      has_factor_ = true;
    }
    return factor_;
  }
  /// T of the array, n x n, zero below the diagonal: U P_{k|k}^{-1} U' = T'T.
  const Matrix<S, N, N>& condensed_factor() const { return T_; }
  /// U, n x n, orthogonal; the identity before the first step.
  const Matrix<S, N, N>& transformation() const { return U_; }
  /// Kf = P_{k|k} C' R^{-1}, n x p, of the last step.
  const Matrix<S, N, P>& filter_gain() const { return gain_; }
  const Vector<S, N>& state() const { return x_; }
  /// e, p: the whitened residual that the last step left over; e'e adds to the sum of squares.
  const Vector<S, P>& residual() const { return e_; }

 private:
  static constexpr int rows = N == Dynamic || P == Dynamic ? Dynamic : N + P;

  /// A failure's true cause may lie in either model.
  StepReport<S> blame(Status status, const S& rcond, const Model& model, const Model& next, const Output* y,
                      const Input* u) const {
    const auto report = failed(status, rcond, model, y, u);
    return failed(report.status, rcond, next);
  }

  /// ok if both models are the one that is known, after this call if none was before.
  Status recognise(const Model& model, const Model& next) {
    if (!reduced_ && !reduce(model)) return Status::overflow;
    const bool known = model.same_system(system_) && (&next == &model || next.same_system(system_));
    return known ? Status::ok : Status::time_varying_model;
  }

  /// Condenses the model and brings T into its coordinates; false, and nothing is kept, if the result is not finite.
  bool reduce(const Model& model) {
    F_ = model.A_inverse;
    H_ = model.A_inverse_B;
    U_.setIdentity();
    controller_hessenberg(Triangle::upper, F_, H_, U_.transpose());
    auto CR = CR_TF_.topRows(C_weighted_.rows());
    multiply_upper(model.R_inverse_root, model.C, CR);
    C_weighted_.noalias() = CR.lazyProduct(U_.transpose());
    triangularise(U_.transpose(), factor_, T_);
    if constexpr (kernels::exist<S>) {
      U_transposed_ = U_.transpose();
      for (Index j = 0; j < e_.size(); ++j)
        for (Index i = 0; i < T_.rows(); ++i) {
          S sum(0);
          for (Index k = 0; k <= j; ++k) sum += C_weighted_(k, i) * model.R_inverse_root(k, j);
          CR_inverse_(i, j) = sum;
        }
    }
    if (!all_finite(F_) || !all_finite(H_) || !all_finite(C_weighted_) || !all_finite(T_) || !model.finite()) {
      U_.setIdentity();
      T_ = factor_;
      return false;
    }
    system_.A_inverse = model.A_inverse;
    system_.A_inverse_B = model.A_inverse_B;
    system_.C = model.C;
    system_.Q_inverse_root = model.Q_inverse_root;
    system_.R_inverse_root = model.R_inverse_root;
    return reduced_ = true;
  }

  /// out = the upper triangular factor of T V.
  template <class VType>
  void triangularise(const VType& V, const Matrix<S, N, N>& T, Matrix<S, N, N>& out) {
    auto TV = CR_TF_.bottomRows(T.rows());
    multiply_upper(T, V, TV);
    work_.setZero();
    qr(TV, work_);
    copy_upper(TV, out);
  }

  /// T U x, for the lower part of the right-hand side.
  auto transformed(const Vector<S, N>& x) {
    auto xi = right_.tail(x.size());
    work_.noalias() = U_.lazyProduct(x);
    multiply_upper(T_, work_, xi);
    return xi;
  }

  /// All of a step but what its report says; false if there are no kernels, or they gave up: where something is singular or
  /// not finite, too.
  bool all_by_kernel([[maybe_unused]] const Model& model, [[maybe_unused]] bool has_state, [[maybe_unused]] Wanted wanted,
                     [[maybe_unused]] S& rcond) {
    if constexpr (kernels::exist<S>) {
      using kernels::source, kernels::target;
      const Index n = T_.rows();
      kernels::ArrayStep step{.n = n,
                              .m = e_.size(),
                              .p = H_.cols(),
                              .A_band = band_,
                              .C_band = 0,
                              .transposed = true,
                              .A = source(F_),
                              .B = source(C_weighted_),
                              .C = source(H_),
                              .S = source(T_),
                              .R = source(model.Q_inverse_root),
                              .U_transposed = source(U_transposed_),
                              .S_next = target(next_),
                              .Re = target(Qe_root_),
                              .QQB = source(CR_inverse_),
                              .Kf = wants_gain(wanted) ? target(next_gain_) : kernels::Target{},
                              .rcond_of_T = wants_rcond(wanted) ? &rcond : nullptr,
                              .work = kernel_work_.data()};
      if (!has_state) return kernels::run_sized<N, P, M, false, true>(step);
      step.x = moved_.data();
      step.y = weighted_y_.data();
      step.z = z_.data();
      step.xi = right_.data();
      step.e = right_.data() + n;
      step.x_next = next_x_.data();
      return kernels::run_sized<N, P, M, true, true>(step);
    }
    return false;
  }

  /// The measurement's part of the array, whose lower part has `band` subdiagonals, and the triangle that comes of it.
  void triangularise(Index band, bool has_state) {
    const Index p = e_.size();
    CR_TF_.topRows(p) = C_weighted_;
    if (has_state)
      right_.head(p) = weighted_y_;
    else
      right_.setZero();
    hessenberg_qr(p + band, CR_TF_, right_);
    copy_upper(CR_TF_.topRows(T_.rows()), next_);
  }

  /// The step's end: what is made of T+, in next_, and of (xi; e), in right_.
  StepReport<S> finish(const Model& model, const Model& next, const Output* y, const Input* u, Wanted wanted) {
    const Index n = T_.rows();
    const bool has_gain = wants_gain(wanted);
    const bool finite = all_finite(next_);
    S rcond = finite ? std::numeric_limits<S>::quiet_NaN() : S(0);
    bool regular = finite;
    if (finite && wants_rcond(wanted)) {
      rcond = reciprocal_condition_triangular<Triangle::upper>(next_, work_, sign_);
      regular = rcond >= tolerance_;
    } else if (finite && (y || has_gain)) {
      for (Index j = 0; j < n; ++j) regular = regular && next_(j, j) != S(0);
    }
    if (!regular)
      return blame(finite ? Status::singular_information : Status::overflow, rcond, model, next, y, u);
    if (has_gain) {
      information_gain(next_, C_weighted_, next.R_inverse_root, condensed_gain_, work_);
      multiply_transposed(U_, condensed_gain_, next_gain_);
    }
    if (y) {
      moved_ = right_.head(n);
      solve_triangular<Triangle::upper, false>(next_, moved_);
      multiply_transposed(U_, moved_, next_x_);
    }
    if ((has_gain && !all_finite(next_gain_)) || (y && !all_finite(next_x_)))
      return blame(Status::overflow, rcond, model, next, y, u);
    accept(y != nullptr, has_gain);
    return {Status::ok, rcond};
  }

  void accept(bool has_state, bool has_gain) {
    T_.swap(next_);
    has_factor_ = false;
    if (has_gain) gain_.swap(next_gain_);
    if (has_state) {
      x_.swap(next_x_);
      e_ = right_.tail(e_.size());
    }
  }

  S tolerance_;
  Index band_;  // of F_: what is below the band_-th subdiagonal is 0
  bool reduced_ = false, has_factor_ = true;
  Model system_;
  Matrix<S, N, N> U_, F_, T_, next_, factor_;
  Matrix<S, N, N> U_transposed_;  // as kernels want it, and U C' R^{-1}
  Matrix<S, N, P> CR_inverse_;
  Matrix<S, N, M> H_, TH_;
  Matrix<S, M, N> over_;
  Matrix<S, M, M> Qe_root_;
  Matrix<S, P, N> C_weighted_;
  Matrix<S, rows, N> CR_TF_;
  Matrix<S, N, P> gain_, condensed_gain_, next_gain_;
  Vector<S, rows> right_;
  Vector<S, M> z_, w_, tau_;
  Vector<S, N> x_, next_x_, moved_;
  Vector<S, P> e_;
  Vector<S, N> work_, sign_;
  Vector<S, P> weighted_y_;
  Vector<S> kernel_work_;
};

}  // namespace kfstab
