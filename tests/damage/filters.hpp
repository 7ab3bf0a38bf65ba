#pragma once

#include <cmath>

#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/state_space.hpp>
#include <kfstab/filters/step_report.hpp>
#include <kfstab/filters/structured_lq.hpp>
#include <kfstab/filters/unsymmetrised.hpp>

/// Filters whose fault is a policy. With the policy that is no fault each is the filter of the library, written once more:
/// what turns a verdict is then the fault, not the rewriting.
namespace kfstab::damage {

/// X = [L 0] Q; on exit L stands in the lower triangle of X's first columns.
struct Householder {
  static void triangularise(Matrix<double>& X) {
    Vector<double> tau(X.rows());
    lq(X, tau);
  }
};

/// The same by classical Gram-Schmidt, which loses the orthogonality of Q with the square of X's condition number.
struct GramSchmidt {
  static void triangularise(Matrix<double>& X) {
    Matrix<double> Q = X;
    Matrix<double> L = Matrix<double>::Zero(X.rows(), X.rows());
    for (Index i = 0; i < X.rows(); ++i) {
      for (Index j = 0; j < i; ++j) L(i, j) = X.row(i).dot(Q.row(j));
      for (Index j = 0; j < i; ++j) Q.row(i) -= L(i, j) * Q.row(j);
      L(i, i) = std::sqrt(Q.row(i).dot(Q.row(i)));
      if (L(i, i) > 0) Q.row(i) /= L(i, i);
    }
    X.leftCols(X.rows()) = L;
  }
};

/// The square-root covariance filter, theory (2.3), its array triangularised as a whole by the policy.
template <class Factorisation>
class ArrayFilter {
 public:
  using Scalar = double;
  using Model = RootModel<double>;

  explicit ArrayFilter(Dimensions d)
      : S_(Matrix<double>::Zero(d.n, d.n)), gain_(Matrix<double>::Zero(d.n, d.p)), x_(Vector<double>::Zero(d.n)) {}

  void start(const Matrix<double>& S0, const Vector<double>& x0) {
    S_ = S0.triangularView<Eigen::Lower>();
    x_ = x0;
  }

  StepReport<double> step(const Model& model, const Vector<double>* y, const Vector<double>* u) {
    const auto [n, m, p] = model.dimensions();
    Matrix<double> array = Matrix<double>::Zero(p + n, p + n + m);
    array.topLeftCorner(p, p) = model.R_root.triangularView<Eigen::Lower>();
    array.block(0, p, p, n) = model.C.lazyProduct(S_);
    array.block(p, p, n, n) = model.A.lazyProduct(S_);
    array.bottomRightCorner(n, m) = model.B.lazyProduct(Matrix<double>(model.Q_root.triangularView<Eigen::Lower>()));
    Factorisation::triangularise(array);
    const Matrix<double> Re_root = array.topLeftCorner(p, p).triangularView<Eigen::Lower>();
    for (Index i = 0; i < p; ++i)
      if (!(std::abs(Re_root(i, i)) > 0)) return {Status::singular_innovation, 0};
    gain_ = array.block(p, 0, n, p);
    solve_triangular_right<Triangle::lower, false>(Re_root, gain_);
    if (y) {
      Vector<double> x = model.A.lazyProduct(x_) + gain_.lazyProduct(*y - model.C.lazyProduct(x_));
      if (u) x += model.D.lazyProduct(*u);
      x_ = x;
    }
    S_ = array.block(p, p, n, n).triangularView<Eigen::Lower>();
    return {Status::ok, 1};
  }

  const Matrix<double>& factor() const { return S_; }
  const Matrix<double>& predictor_gain() const { return gain_; }
  const Vector<double>& state() const { return x_; }

 private:
  Matrix<double> S_, gain_;
  Vector<double> x_;
};

/// Coding (iii), theory (3.iii). Symmetrised, it is what its authors would have written had they known.
template <bool symmetrised>
class Coding3 {
 public:
  using Scalar = double;
  using Model = CovarianceModel<double>;

  explicit Coding3(Dimensions d) : filter_(d), gain_(Matrix<double>::Zero(d.n, d.p)), x_(Vector<double>::Zero(d.n)) {}

  void start(const Matrix<double>& P0, const Vector<double>& x0) {
    filter_.start(P0, x0);
    x_ = x0;
  }

  StepReport<double> step(const Model& model, const Vector<double>* y, const Vector<double>* u) {
    const auto report = filter_.step(model, y, u);
    if (!report) return report;
    gain_ = filter_.predictor_gain();
    x_ = filter_.state();
    if constexpr (symmetrised) {
      const Matrix<double> P = filter_.covariance();
      filter_.start(Matrix<double>((P + P.transpose()) / 2), x_);
    }
    return report;
  }

  const Matrix<double>& covariance() const { return filter_.covariance(); }
  const Matrix<double>& predictor_gain() const { return gain_; }
  const Vector<double>& state() const { return x_; }

 private:
  GainFilter<double> filter_;
  Matrix<double> gain_;
  Vector<double> x_;
};

}  // namespace kfstab::damage
