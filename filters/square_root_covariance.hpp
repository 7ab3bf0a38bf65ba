#pragma once

#include <limits>

#include <kfstab/filters/kernels.hpp>
#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/state_space.hpp>
#include <kfstab/filters/step_report.hpp>
#include <kfstab/filters/structured_lq.hpp>

namespace kfstab {

/// The last of what every square-root covariance array needs: from G to the gain G Re^{-1/2}.
///
/// @param Re_root  p x p, lower, zero above the diagonal
/// @param tolerance  least reciprocal condition number of Re_root that counts as regular
/// @param divided  G is the gain already, as kernels leave it
/// @param G  r x p; overwritten with G Re^{-1/2} unless Re_root is refused
/// @param work, sign  p each
/// Statuses: singular_innovation, overflow. rcond is that of Re_root.
template <class S, class ReType, class GType, class WorkType>
StepReport<S> divide_by_innovation_root(const ReType& Re_root, Wanted wanted, const S& tolerance, GType& G, WorkType& work,
                                        WorkType& sign) {
  if (!all_finite(Re_root)) return {Status::overflow, S(0)};
  S rcond = std::numeric_limits<S>::quiet_NaN();
  if (wanted == Wanted::factor) return {Status::ok, rcond};
  if (wants_rcond(wanted)) {
    rcond = reciprocal_condition_triangular<Triangle::lower>(Re_root, work, sign);
    if (!(rcond >= tolerance)) return {Status::singular_innovation, rcond};
  } else {
    for (Index j = 0; j < Re_root.cols(); ++j)
      if (Re_root(j, j) == S(0)) return {Status::singular_innovation, rcond};
  }
  solve_triangular_right<Triangle::lower, false>(Re_root, G);
  return {all_finite(G) ? Status::ok : Status::overflow, rcond};
}

/// The same, where a kernel has divided: it gives up where the gain is not finite, so nothing but rcond is left to be seen to.
template <class S>
StepReport<S> divided_by_innovation_root(Wanted wanted, const S& tolerance, const S& rcond) {
  return {wants_rcond(wanted) && !(rcond >= tolerance) ? Status::singular_innovation : Status::ok, rcond};
}

/// The square-root covariance filter: it holds S, lower, P = S S', and never forms P.
///
///     [ R^{1/2}  C S    0        ]       [ Re^{1/2}  0   0 ]
///     [                          ] U  =  [                 ],    K = G Re^{-1/2}                     theory (2.3)
///     [ 0        A S    B Q^{1/2} ]      [ G         S+  0 ]
///
/// U is orthogonal, made of reflectors that leave the zeros alone. P stays definite whatever is rounded, and one step
/// loses the condition number of Re^{1/2}, the root of what the forms that hold P lose. Factors are unique up to the
/// signs of their columns: compare S S', never S.
///
/// Source: SLICOT FB01QD; Vanbegin, Van Dooren, Verhaegen, ACM Algorithm 675 (1989).
/// Operations 7/6 n^3 + n^2 (5p/2 + m) + n (p^2 + m^2/2).
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
class SquareRootCovarianceFilter {
 public:
  using Scalar = S;
  using Model = RootModel<S, N, M, P>;
  using Output = Vector<S, P>;
  using Input = Vector<S>;

  /// @param tolerance  least reciprocal condition number of Re^{1/2} that counts as regular; <= 0 means p^2 u
  explicit SquareRootCovarianceFilter(Dimensions d = {N, M, P}, S tolerance = S(0))
      : tolerance_(tolerance > S(0) ? tolerance : default_tolerance<S>(d.p)), S_(d.n, d.n), next_(d.n, d.n),
        AS_BQ_(d.n, d.n + d.m), CS_(d.p, d.n), Re_root_(d.p, d.p), next_Re_root_(d.p, d.p), predictor_gain_(d.n, d.p),
        next_predictor_gain_(d.n, d.p), filter_gain_(d.n, d.p), next_filter_gain_(d.n, d.p), tau_(std::max(d.n, d.p)),
        x_(d.n), next_x_(d.n), innovation_(d.p), work_(d.p), sign_(d.p),
        kernel_work_(kernels::work_size<S, N, M, P, false>(d.n, d.m, d.p)) {
    S_.setZero();
    next_.setZero();  // kernels write the lower triangles alone
    Re_root_.setZero();
    next_Re_root_.setZero();
    predictor_gain_.setZero();
    filter_gain_.setZero();
    x_.setZero();
  }

  /// Takes S0 (n x n; the lower triangle is read), S0 S0' = P0, and x0 of the predicted state.
  template <class S0Type, class X0Type>
  void start(const S0Type& S0, const X0Type& x0) {
    copy_lower(S0, S_);
    x_ = x0;
    predictor_gain_.setZero();
    filter_gain_.setZero();
  }

  /// One combined measurement and time update, from k|k-1 to k+1|k.
  /// @param y  p, or null: no state is computed, and x stays what it was
  /// @param u  as many as D has columns, or null for none
  /// Statuses: singular_innovation (of Re^{1/2}), non_finite_input, overflow.
  StepReport<S> step(const Model& model, const Output* y = nullptr, const Input* u = nullptr,
                     Wanted wanted = Wanted::all) {
    if (wanted == Wanted::factor) y = nullptr;
    S rcond = std::numeric_limits<S>::quiet_NaN();
    const bool by_kernel = array_by_kernel(model, wanted, rcond);
    if (!by_kernel) {
      auto AS = AS_BQ_.leftCols(S_.rows());
      multiply_lower(model.A, S_, AS);
      model.process_noise_root(AS_BQ_.rightCols(model.B.cols()));
      annihilate(model, AS, next_predictor_gain_);
    }
    const auto report =
        by_kernel ? divided_by_innovation_root(wanted, tolerance_, rcond)
                  : divide_by_innovation_root(next_Re_root_, wanted, tolerance_, next_predictor_gain_, work_, sign_);
    if (!report) return failed(report.status, report.rcond, model, y);
    if (!by_kernel) {
      lq(AS_BQ_, tau_);
      copy_lower(AS_BQ_, next_);
    }
    if (y) {
      innovate(model, *y);
      next_x_.noalias() = model.A.lazyProduct(x_);
      next_x_.noalias() += next_predictor_gain_.lazyProduct(innovation_);
      if (u) next_x_.noalias() += model.D.lazyProduct(*u);
    }
    if (!accept(y != nullptr, by_kernel)) return failed(Status::overflow, report.rcond, model, y, u);
    if (wanted != Wanted::factor) predictor_gain_.swap(next_predictor_gain_);
    Re_root_.swap(next_Re_root_);
    return report;
  }

  /// The measurement update alone: what is held goes from k|k-1 to k|k. Its gain is filter_gain().
  StepReport<S> measurement_update(const Model& model, const Output* y = nullptr) {
    auto updated = AS_BQ_.leftCols(S_.rows());
    updated = S_;
    annihilate(model, updated, next_filter_gain_);
    const auto report =
        divide_by_innovation_root(next_Re_root_, Wanted::all, tolerance_, next_filter_gain_, work_, sign_);
    if (!report) return failed(report.status, report.rcond, model, y);
    lq(updated, tau_);
    copy_lower(updated, next_);
    if (y) {
      innovate(model, *y);
      next_x_ = x_;
      next_x_.noalias() += next_filter_gain_.lazyProduct(innovation_);
    }
    if (!accept(y != nullptr)) return failed(Status::overflow, report.rcond, model, y);
    filter_gain_.swap(next_filter_gain_);
    Re_root_.swap(next_Re_root_);
    return report;
  }

  /// The time update alone: what is held goes from k|k to k+1|k.
  StepReport<S> time_update(const Model& model, const Input* u = nullptr) {
    multiply_lower(model.A, S_, AS_BQ_.leftCols(S_.rows()));
    model.process_noise_root(AS_BQ_.rightCols(model.B.cols()));
    lq(AS_BQ_, tau_);
    copy_lower(AS_BQ_, next_);
    next_x_.noalias() = model.A.lazyProduct(x_);
    if (u) next_x_.noalias() += model.D.lazyProduct(*u);
    if (!accept(true)) return failed(Status::overflow, S(1), model, u);
    return {};
  }

  /// S, n x n, zero above the diagonal.
  const Matrix<S, N, N>& factor() const { return S_; }
  /// K = A P C' Re^{-1}, n x p, of the last step.
  const Matrix<S, N, P>& predictor_gain() const { return predictor_gain_; }
  /// Kf = P C' Re^{-1}, n x p, of the last measurement_update.
  const Matrix<S, N, P>& filter_gain() const { return filter_gain_; }
  const Vector<S, N>& state() const { return x_; }
  /// Re^{1/2}, p x p, lower, zero above the diagonal, of the last step or measurement_update.
  const Matrix<S, P, P>& innovation_root() const { return Re_root_; }

 private:
  static constexpr int columns = N == Dynamic || M == Dynamic ? Dynamic : N + M;

  /// All of the array of a step, gain included if it is wanted; false if there are no kernels, or they gave up.
  bool array_by_kernel([[maybe_unused]] const Model& model, [[maybe_unused]] Wanted wanted, [[maybe_unused]] S& rcond) {
    if constexpr (kernels::exist<S>) {
      using kernels::source, kernels::target;
      const Index n = S_.rows();
      return kernels::run_sized<N, M, P, false, false>(
          {.n = n,
           .m = model.B.cols(),
           .p = next_Re_root_.rows(),
           .A_band = n,
           .C_band = n,
           .A = source(model.A),
           .B = source(model.B),
           .C = source(model.C),
           .S = source(S_),
           .Q = model.Q_root.rows() == 0 ? kernels::Source{} : source(model.Q_root),
           .R = source(model.R_root),
           .S_next = target(next_),
           .Re = target(next_Re_root_),
           .K = wanted == Wanted::factor ? kernels::Target{} : target(next_predictor_gain_),
           .rcond_of_Re = wants_rcond(wanted) ? &rcond : nullptr,
           .work = kernel_work_.data()});
    }
    return false;
  }

  /// Annihilates C S against R^{1/2} and takes `rows`, A S or S, along; leaves G.
  template <class Rows>
  void annihilate(const Model& model, Rows& rows, Matrix<S, N, P>& G) {
    copy_lower(model.R_root, next_Re_root_);
    multiply_lower(model.C, S_, CS_);
    structured_lq(Shape::full, next_Re_root_, CS_, rows, G, tau_);
  }

  /// y - C x.
  void innovate(const Model& model, const Output& y) {
    innovation_ = y;
    innovation_.noalias() -= model.C.lazyProduct(x_);
  }

  bool accept(bool has_state, bool known_to_be_finite = false) {
    if ((!known_to_be_finite && !all_finite(next_)) || (has_state && !all_finite(next_x_))) return false;
    S_.swap(next_);
    if (has_state) x_.swap(next_x_);
    return true;
  }

  S tolerance_;
  Matrix<S, N, N> S_, next_;
  Matrix<S, N, columns> AS_BQ_;
  Matrix<S, P, N> CS_;
  Matrix<S, P, P> Re_root_, next_Re_root_;
  Matrix<S, N, P> predictor_gain_, next_predictor_gain_, filter_gain_, next_filter_gain_;
  Vector<S> tau_;
  Vector<S, N> x_, next_x_;
  Vector<S, P> innovation_, work_, sign_;
  Vector<S> kernel_work_;
};

}  // namespace kfstab
