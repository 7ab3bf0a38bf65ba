#pragma once

#include <limits>

#include <kfstab/filters/kernels.hpp>
#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/state_space.hpp>
#include <kfstab/filters/step_report.hpp>

namespace kfstab {

/// How a filter that holds P takes a measurement in; W = P C' V^{-1}, V'V = Re.
enum class MeasurementUpdate {
  downdate,  ///< P_{k|k} = P - W W'
  joseph,    ///< P_{k|k} = (I - Kf C) P (I - Kf C)' + Kf R Kf'
};

/// The filters that hold P and cannot lose its symmetry, because they compute one triangle of it: ConventionalFilter
/// below, and JosephFilter (joseph.hpp).
///
template <MeasurementUpdate form, class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
class SymmetricCovarianceFilter {
 public:
  using Scalar = S;
  using Model = CovarianceModel<S, N, M, P>;
  using Output = Vector<S, P>;
  using Input = Vector<S>;

  /// @param tolerance  least reciprocal condition number of Re that counts as regular; <= 0 means p^2 u
  explicit SymmetricCovarianceFilter(Dimensions d = {N, M, P}, S tolerance = S(0))
      : tolerance_(tolerance > S(0) ? tolerance : default_tolerance<S>(d.p)),
        P_(d.n, d.n), next_(d.n, d.n), filtered_(d.n, d.n), AP_(d.n, d.n), BQ_(d.n, d.m), reduction_(d.n, form == MeasurementUpdate::joseph ? d.n : 0),
        Re_(d.p, d.p), W_(d.n, d.p), gain_(d.n, d.p), next_gain_(d.n, d.p),
        x_(d.n), next_x_(d.n), filtered_x_(d.n), innovation_(d.p), work_(d.p), sign_(d.p),
        kernel_work_(kernels::work_size<S, N, M, P>(d, form == MeasurementUpdate::joseph)) {
    P_.setZero();
    gain_.setZero();
    x_.setZero();
  }

  /// Takes P0 (n x n; the upper triangle is read) and x0 of the predicted state.
  template <class P0Type, class X0Type>
  void start(const P0Type& P0, const X0Type& x0) {
    P_ = P0;
    mirror_upper(P_);
    x_ = x0;
    gain_.setZero();
  }

  /// One combined measurement and time update, from k|k-1 to k+1|k.
  /// @param y  p, or null: no state is computed, and x stays what it was
  /// @param u  as many as D has columns, or null for none
  /// Statuses: not_positive_definite, singular_innovation (of Re), non_finite_input, overflow.
  StepReport<S> step(const Model& model, const Output* y = nullptr, const Input* u = nullptr) {
    S rcond = S(0);
    const bool by_kernel = covariance_by_kernel(model, rcond);
    const auto report = by_kernel ? judge_innovation(model, y, rcond) : update_covariance(model, y, P_, filtered_);
    if (!report) return report;
    if (y && !update_state(model, *y, x_, filtered_x_)) return failed(Status::overflow, report.rcond, model, y);
    if (!by_kernel) predict_covariance(model, filtered_);
    if (y) predict_state(model, u, filtered_x_);
    if ((!by_kernel && !all_finite(next_)) || (y && !all_finite(next_x_)))
      return failed(Status::overflow, report.rcond, model, y, u);
    gain_.swap(next_gain_);
    accept(y != nullptr);
    return report;
  }

  /// The measurement update alone: what is held goes from k|k-1 to k|k.
  StepReport<S> measurement_update(const Model& model, const Output* y = nullptr) {
    const auto report = update_covariance(model, y, P_, next_);
    if (!report) return report;
    if (y && !update_state(model, *y, x_, next_x_)) return failed(Status::overflow, report.rcond, model, y);
    gain_.swap(next_gain_);
    accept(y != nullptr);
    return report;
  }

  /// The time update alone: what is held goes from k|k to k+1|k.
  StepReport<S> time_update(const Model& model, const Input* u = nullptr) {
    predict_covariance(model, P_);
    predict_state(model, u, x_);
    if (!all_finite(next_) || !all_finite(next_x_)) return failed(Status::overflow, S(1), model, u);
    accept(true);
    return {};
  }

  /// P, n x n, symmetric to the last bit.
  const Matrix<S, N, N>& covariance() const { return P_; }
  /// Kf = P C' Re^{-1}, n x p, of the last step.
  const Matrix<S, N, P>& filter_gain() const { return gain_; }
  const Vector<S, N>& state() const { return x_; }

 private:
  /// P_{k|k} into `to`, and the gain into next_gain_.
  StepReport<S> update_covariance(const Model& model, const Output* y, const Matrix<S, N, N>& from,
                                  Matrix<S, N, N>& to) {
    W_.noalias() = from.lazyProduct(model.C.transpose());
    Re_ = model.R;
    add_product_upper(Re_, model.C, W_.transpose());
    const S norm = one_norm_symmetric_upper(Re_);
    if (!is_finite(norm)) return failed(Status::overflow, S(0), model, y);
    if (cholesky_upper(Re_) != 0) return failed(Status::not_positive_definite, S(0), model, y);
    const auto solve = [this](auto& b) {
      solve_triangular<Triangle::upper, true>(Re_, b);
      solve_triangular<Triangle::upper, false>(Re_, b);
    };
    const auto report = judge_innovation(model, y, reciprocal_condition(norm, work_, sign_, solve, solve));
    if (!report) return report;

    solve_triangular_right<Triangle::upper, false>(Re_, W_);
    next_gain_ = W_;
    solve_triangular_right<Triangle::upper, true>(Re_, next_gain_);
    if constexpr (form == MeasurementUpdate::downdate) {
      to = from;
      subtract_product_upper(to, W_, W_);
    } else {
      reduction_.setIdentity();
      reduction_.noalias() -= next_gain_.lazyProduct(model.C);
      AP_.noalias() = reduction_.lazyProduct(from);
      W_.noalias() = next_gain_.lazyProduct(model.R);
      to.setZero();
      add_product_upper(to, W_, next_gain_);
      add_product_upper(to, AP_, reduction_);
    }
    mirror_upper(to);
    return all_finite(to) ? report : failed(Status::overflow, report.rcond, model, y);
  }

  /// Whether Re is regular.
  StepReport<S> judge_innovation(const Model& model, const Output* y, const S& rcond) {
    if (!(rcond >= tolerance_)) return failed(Status::singular_innovation, rcond, model, y);
    return {Status::ok, rcond};
  }

  /// x_{k|k} by the gain in next_gain_; false if it is not finite.
  bool update_state(const Model& model, const Output& y, const Vector<S, N>& from, Vector<S, N>& to) {
    innovation_ = y;
    innovation_.noalias() -= model.C.lazyProduct(from);
    to = from;
    to.noalias() += next_gain_.lazyProduct(innovation_);
    return all_finite(to);
  }

  /// Into next_.
  void predict_covariance(const Model& model, const Matrix<S, N, N>& from) {
    AP_.noalias() = model.A.lazyProduct(from);
    BQ_.noalias() = model.B.lazyProduct(model.Q);
    next_.setZero();
    add_product_upper(next_, BQ_, model.B);
    add_product_upper(next_, AP_, model.A);
    mirror_upper(next_);
  }

  /// Into next_x_.
  void predict_state(const Model& model, const Input* u, const Vector<S, N>& from) {
    next_x_.noalias() = model.A.lazyProduct(from);
    if (u) next_x_.noalias() += model.D.lazyProduct(*u);
  }

  /// P+, the gain and Re's condition number; false if there are no kernels, or they gave up.
  bool covariance_by_kernel([[maybe_unused]] const Model& model, [[maybe_unused]] S& rcond) {
    if constexpr (kernels::exist<S>) {
      using kernels::source, kernels::target;
      return kernels::run_sized<N, M, P>(kernels::CovarianceStep{.n = P_.rows(),
                                                                 .m = model.B.cols(),
                                                                 .p = Re_.rows(),
                                                                 .joseph = form == MeasurementUpdate::joseph,
                                                                 .A = source(model.A),
                                                                 .B = source(model.B),
                                                                 .C = source(model.C),
                                                                 .P = source(P_),
                                                                 .Q = source(model.Q),
                                                                 .R = source(model.R),
                                                                 .P_next = target(next_),
                                                                 .K = target(next_gain_),
                                                                 .rcond = &rcond,
                                                                 .work = kernel_work_.data()});
    }
    return false;
  }

  void accept(bool has_state) {
    P_.swap(next_);
    if (has_state) x_.swap(next_x_);
  }

  S tolerance_;
  Matrix<S, N, N> P_, next_, filtered_, AP_;
  Matrix<S, N, M> BQ_;
  Matrix<S, N, form == MeasurementUpdate::joseph ? N : 0> reduction_;  // I - Kf C
  Matrix<S, P, P> Re_;
  Matrix<S, N, P> W_, gain_, next_gain_;
  Vector<S, N> x_, next_x_, filtered_x_;
  Vector<S, P> innovation_, work_, sign_;
  Vector<S> kernel_work_;
};

/// The conventional Kalman filter.
///
///     Re = R + C P C' = V'V,   W = P C' V^{-1},   Kf = W V^{-T},
///     P_{k|k} = P - W W',      P+ = A P_{k|k} A' + B Q B'                                        theory (2.1)
///
/// It squares what a square-root filter keeps as a root: one step loses the condition number of Re where that loses its
/// square root, and nothing keeps P definite. Choose it where Re is well conditioned and speed is everything.
///
/// Source: SLICOT FB01VD (which returns the same gain); operations 3/2 n^3 + n^2 (3p + m)/2 (FB01VD's text says
/// n^2 (3p + m/2)).
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
using ConventionalFilter = SymmetricCovarianceFilter<MeasurementUpdate::downdate, S, N, M, P>;

}  // namespace kfstab
