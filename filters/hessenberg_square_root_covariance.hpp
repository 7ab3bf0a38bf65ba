#pragma once

#include <algorithm>

#include <kfstab/filters/condensed.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/square_root_covariance.hpp>

namespace kfstab {

/// The square-root covariance filter in observer-Hessenberg form: SquareRootCovarianceFilter for time-invariant
/// systems, at a fraction of its price. It works in coordinates U x,
///
///     A_U = U A U',  B_U = U B,  C_U = C U',     C_U(i, j) = 0 for j > i,     A_U(i, j) = 0 for j > i + p,
///
///     [ R^{1/2}  0            C_U S ]       [ Re^{1/2}  0   0 ]
///     [                             ] V  =  [                 ],   K = U' G Re^{-1/2},   P = U' S S' U    theory (2.8)
///     [ 0        B_U Q^{1/2}  A_U S ]       [ G         S+  0 ]
///
/// where a reflector reaches over i + 1 columns in row i <= p, then over m + p + 1, as the zeros of the array stay.
/// What it shows is in the coordinates of the model.
///
/// The first step reduces the model, O(n^3), and keeps a copy: a later step with other numbers in A, B, C, Q or R is
/// refused. D may change. If p = 0 there is nothing to condense by, and A_U = A is full.
///
/// Source: SLICOT FB01RD; Van Dooren, Verhaegen, SIAM J. Sci. Stat. Comput. 9 (1988). Operations
/// 1/6 n^3 + n^2 (3p/2 + m) + n p^2 (fewer than FB01RD's 2 n p^2 + 2/3 p^3: reflectors end where the matrix does), and
/// n^2 p for the gain in the coordinates of the model. factor() costs 7/6 n^3 when it is asked for.
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
class HessenbergSquareRootCovarianceFilter {
 public:
  using Scalar = S;
  using Model = RootModel<S, N, M, P>;
  using Output = Vector<S, P>;
  using Input = Vector<S>;

  /// @param tolerance  least reciprocal condition number of Re^{1/2} that counts as regular; <= 0 means p^2 u
  explicit HessenbergSquareRootCovarianceFilter(Dimensions d = {N, M, P}, S tolerance = S(0))
      : tolerance_(tolerance > S(0) ? tolerance : default_tolerance<S>(d.p)), band_(d.p > 0 ? d.p : d.n),
        U_(d.n, d.n), A_(d.n, d.n), S_(d.n, d.n), next_(d.n, d.n), factor_(d.n, d.n), U_transposed_(d.n, d.n),
        BQ_(d.n, d.m), C_(d.p, d.n),
        CS_(d.p, d.n), BQ_AS_(d.n, d.m + d.n), Re_root_(d.p, d.p), next_Re_root_(d.p, d.p), G_(d.n, d.p),
        gain_(d.n, d.p), next_gain_(d.n, d.p), tau_(std::max(d.n, d.p)), x_(d.n), next_x_(d.n), innovation_(d.p),
        work_(d.p), sign_(d.p),
        kernel_work_(kernels::work_size<S, N, M, P, false>(d.n, d.m, d.p)) {
    system_.A.resize(d.n, d.n);
    system_.B.resize(d.n, d.m);
    system_.C.resize(d.p, d.n);
    system_.Q_root.resize(d.m, d.m);
    system_.R_root.resize(d.p, d.p);
    U_.setIdentity();
    S_.setZero();
    next_.setZero();  // kernels write the lower triangles alone
    factor_.setZero();
    Re_root_.setZero();
    next_Re_root_.setZero();
    gain_.setZero();
    x_.setZero();
  }

  /// Takes S0 (n x n; the lower triangle is read), S0 S0' = P0, and x0 of the predicted state. The next step may bring
  /// another model.
  template <class S0Type, class X0Type>
  void start(const S0Type& S0, const X0Type& x0) {
    copy_lower(S0, S_);
    factor_ = S_;
    has_factor_ = true;
    U_.setIdentity();
    reduced_ = false;
    x_ = x0;
    gain_.setZero();
  }

  /// One combined measurement and time update, from k|k-1 to k+1|k.
  /// @param y  p, or null: no state is computed, and x stays what it was
  /// @param u  as many as D has columns, or null for none
  /// Statuses: time_varying_model (its numbers are not those of the first step), singular_innovation (of Re^{1/2}),
  /// non_finite_input, overflow.
  StepReport<S> step(const Model& model, const Output* y = nullptr, const Input* u = nullptr,
                     Wanted wanted = Wanted::all) {
    if (reduced_ && !model.same_system(system_)) return failed(Status::time_varying_model, S(0), model, y, u);
    if (!reduced_ && !reduce(model)) return failed(Status::overflow, S(0), model, y, u);
    if (wanted == Wanted::factor) y = nullptr;

    S rcond = std::numeric_limits<S>::quiet_NaN();
    const bool by_kernel = array_by_kernel(model, wanted, rcond);
    if (!by_kernel) {
      auto AS = BQ_AS_.rightCols(S_.rows());
      BQ_AS_.leftCols(BQ_.cols()) = BQ_;
      multiply_hessenberg_lower(band_, A_, S_, AS);
      multiply_hessenberg_lower(0, C_, S_, CS_);
      copy_lower(model.R_root, next_Re_root_);
      structured_lq(Shape::trapezoidal, next_Re_root_, CS_, AS, G_, tau_);
    }
    const auto report = by_kernel ? divided_by_innovation_root(wanted, tolerance_, rcond)
                                  : divide_by_innovation_root(next_Re_root_, wanted, tolerance_, G_, work_, sign_);
    if (!report) return failed(report.status, report.rcond, model, y, u);
    if (!by_kernel) {
      hessenberg_lq(BQ_.cols() + band_, BQ_AS_, tau_);
      copy_lower(BQ_AS_, next_);
      if (wanted != Wanted::factor) multiply_transposed(U_, G_, next_gain_);
    }
    if (y) {
      innovation_ = *y;
      innovation_.noalias() -= model.C.lazyProduct(x_);
      next_x_.noalias() = model.A.lazyProduct(x_);
      next_x_.noalias() += next_gain_.lazyProduct(innovation_);
      if (u) next_x_.noalias() += model.D.lazyProduct(*u);
    }
    if (!by_kernel && (!all_finite(next_) || (wanted != Wanted::factor && !all_finite(next_gain_))))
      return failed(Status::overflow, report.rcond, model, y, u);
    if (y && !all_finite(next_x_)) return failed(Status::overflow, report.rcond, model, y, u);
    S_.swap(next_);
    has_factor_ = false;
    if (wanted != Wanted::factor) gain_.swap(next_gain_);
    Re_root_.swap(next_Re_root_);
    if (y) x_.swap(next_x_);
    return report;
  }

  /// S, n x n, zero above the diagonal, S S' = P: the LQ factor of U' condensed_factor(), made when it is asked for.
  const Matrix<S, N, N>& factor() {
    if (!has_factor_) {
      auto product = BQ_AS_.rightCols(S_.rows());
      multiply_lower(U_.transpose(), S_, product);
      lq(product, tau_);
      copy_lower(product, factor_);
      has_factor_ = true;
    }
    return factor_;
  }
  /// S of the array, n x n, zero above the diagonal: U P U' = S S'.
  const Matrix<S, N, N>& condensed_factor() const { return S_; }
  /// U, n x n, orthogonal; the identity before the first step.
  const Matrix<S, N, N>& transformation() const { return U_; }
  /// K = A P C' Re^{-1}, n x p, of the last step.
  const Matrix<S, N, P>& predictor_gain() const { return gain_; }
  const Vector<S, N>& state() const { return x_; }
  /// Re^{1/2}, p x p, lower, zero above the diagonal, of the last step.
  const Matrix<S, P, P>& innovation_root() const { return Re_root_; }

 private:
  static constexpr int columns = N == Dynamic || M == Dynamic ? Dynamic : N + M;

  /// All of the array of a step, and the gain if it is wanted, in the coordinates of the model; false if there are no kernels,
  /// or they gave up.
  bool array_by_kernel([[maybe_unused]] const Model& model, [[maybe_unused]] Wanted wanted, [[maybe_unused]] S& rcond) {
    if constexpr (kernels::exist<S>) {
      using kernels::source, kernels::target;
      return kernels::run_sized<N, M, P, false, false>(
          {.n = S_.rows(),
           .m = BQ_.cols(),
           .p = next_Re_root_.rows(),
           .A_band = band_,
           .C_band = 0,
           .A = source(A_),
           .B = source(BQ_),
           .C = source(C_),
           .S = source(S_),
           .R = source(model.R_root),
           .U_transposed = source(U_transposed_),
           .S_next = target(next_),
           .Re = target(next_Re_root_),
           .K = wanted == Wanted::factor ? kernels::Target{} : target(next_gain_),
           .rcond_of_Re = wants_rcond(wanted) ? &rcond : nullptr,
           .work = kernel_work_.data()});
    }
    return false;
  }

  /// Condenses the model and brings S into its coordinates; false, and nothing is kept, if the result is not finite.
  bool reduce(const Model& model) {
    A_ = model.A;
    C_ = model.C;
    U_.setIdentity();
    observer_hessenberg(Triangle::lower, A_, C_, U_.transpose());
    if constexpr (kernels::exist<S>) U_transposed_ = U_.transpose();
    auto BQ = BQ_AS_.leftCols(BQ_.cols());
    model.process_noise_root(BQ);
    BQ_.noalias() = U_.lazyProduct(BQ);
    auto US = BQ_AS_.rightCols(S_.rows());
    multiply_lower(U_, factor_, US);
    lq(US, tau_);
    copy_lower(US, S_);
    if (!all_finite(A_) || !all_finite(BQ_) || !all_finite(C_) || !all_finite(S_) || !model.finite()) {
      U_.setIdentity();
      S_ = factor_;
      return false;
    }
    system_.A = model.A;
    system_.B = model.B;
    system_.C = model.C;
    system_.Q_root = model.Q_root;
    system_.R_root = model.R_root;
    return reduced_ = true;
  }

  S tolerance_;
  Index band_;  // of A_: what is above the band_-th superdiagonal is 0
  bool reduced_ = false, has_factor_ = true;
  Model system_;
  Matrix<S, N, N> U_, A_, S_, next_, factor_;
  Matrix<S, N, N> U_transposed_;  // as kernels want it
  Matrix<S, N, M> BQ_;
  Matrix<S, P, N> C_, CS_;
  Matrix<S, N, columns> BQ_AS_;
  Matrix<S, P, P> Re_root_, next_Re_root_;
  Matrix<S, N, P> G_, gain_, next_gain_;
  Vector<S> tau_;
  Vector<S, N> x_, next_x_;
  Vector<S, P> innovation_, work_, sign_;
  Vector<S> kernel_work_;
};

}  // namespace kfstab
