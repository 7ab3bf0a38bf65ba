#include <kfstab/reference/same_numbers.hpp>

#include <kfstab/reference/rational.hpp>

namespace kfstab::reference {
namespace {

using Covariances = Problem<CovarianceModel<double>>;
using Roots = Problem<RootModel<double>>;
using Information = Problem<InformationModel<double>>;

template <class X>
bool equal(const X& x, const X& y) {
  return x.rows() == y.rows() && x.cols() == y.cols() && x == y;
}

// Each noise and start as a covariance, or as the inverse of one, in exact numbers. Triangles that are not read may hold
// anything.
Matrix<Rational> of_root(const Matrix<double>& L) {
  return product_of_root(rational(Matrix<double>(L.triangularView<Eigen::Lower>())));
}
Matrix<Rational> of_inverse_root(const Matrix<double>& U) {
  const Matrix<Rational> upper = rational(Matrix<double>(U.triangularView<Eigen::Upper>()));
  return product(upper.transpose(), upper);
}

Matrix<Rational> P0(const Covariances& problem) { return rational(problem.initial); }
Matrix<Rational> Q(const CovarianceModel<double>& model) { return rational(model.Q); }
Matrix<Rational> R(const CovarianceModel<double>& model) { return rational(model.R); }

Matrix<Rational> P0(const Roots& problem) { return of_root(problem.initial); }
Matrix<Rational> Q(const RootModel<double>& model) { return of_root(model.Q_root); }
Matrix<Rational> R(const RootModel<double>& model) { return of_root(model.R_root); }

/// X Y = I, of square X and Y.
bool inverses(const Matrix<Rational>& X, const Matrix<Rational>& Y) {
  if (X.rows() != Y.rows() || X.cols() != Y.cols()) return false;
  // Entry by entry: rounded numbers differ in the first already.
  for (Index i = 0; i < X.rows(); ++i)
    for (Index j = 0; j < X.rows(); ++j) {
      Rational sum = i == j ? -1 : 0;
      for (Index l = 0; l < X.cols(); ++l) sum += X(i, l) * Y(l, j);
      if (!sum.is_zero()) return false;
    }
  return true;
}

template <class Left, class Right>
bool same_model(const Left& x, const Right& y) {
  return equal(x.A, y.A) && equal(x.B, y.B) && equal(x.C, y.C) && equal(x.D, y.D) && equal(Q(x), Q(y)) &&
         equal(R(x), R(y));
}
template <class Left>
bool same_model(const Left& x, const InformationModel<double>& y) {
  return equal(x.C, y.C) && equal(x.D, y.D) && (y.w_mean.array() == 0).all() &&
         inverses(rational(x.A), rational(y.A_inverse)) &&
         equal(product(rational(y.A_inverse), rational(x.B)), rational(y.A_inverse_B)) &&
         inverses(Q(x), of_inverse_root(y.Q_inverse_root)) && inverses(R(x), of_inverse_root(y.R_inverse_root));
}
bool same_model(const InformationModel<double>& x, const InformationModel<double>& y) {
  return equal(x.A_inverse, y.A_inverse) && equal(x.A_inverse_B, y.A_inverse_B) && equal(x.C, y.C) && equal(x.D, y.D) &&
         equal(x.w_mean, y.w_mean) && equal(of_inverse_root(x.Q_inverse_root), of_inverse_root(y.Q_inverse_root)) &&
         equal(of_inverse_root(x.R_inverse_root), of_inverse_root(y.R_inverse_root));
}

template <class Left, class Right>
bool same_start(const Left& x, const Right& y) {
  return equal(P0(x), P0(y));
}
template <class Left>
bool same_start(const Left& x, const Information& y) {
  return inverses(P0(x), of_inverse_root(y.initial));
}
bool same_start(const Information& x, const Information& y) {
  return equal(of_inverse_root(x.initial), of_inverse_root(y.initial));
}

template <class Left, class Right>
bool same(const Left& x, const Right& y) {
  if (x.models.size() != y.models.size() || !equal(x.x0, y.x0) || !same_start(x, y)) return false;
  for (std::size_t k = 0; k < x.models.size(); ++k)
    if (!same_model(x.models[k], y.models[k])) return false;
  return true;
}
template <class Right>
requires(!std::is_same_v<Right, Information>) bool same(const Information& x, const Right& y) { return same(y, x); }

bool finite(const AnyProblem<double>& any) {
  return std::visit(
      [](const auto& problem) {
        bool all = all_finite(problem.x0);
        if constexpr (std::is_same_v<std::decay_t<decltype(problem)>, Covariances>)
          all = all && all_finite(problem.initial);
        else if constexpr (std::is_same_v<std::decay_t<decltype(problem)>, Roots>)
          all = all && all_finite_lower(problem.initial);
        else
          all = all && all_finite_upper(problem.initial);
        for (const auto& model : problem.models) all = all && model.finite();
        return all;
      },
      any);
}

}  // namespace

bool same_numbers(const AnyProblem<double>& left, const AnyProblem<double>& right) {
  return finite(left) && finite(right) &&
         std::visit([](const auto& x, const auto& y) { return same(x, y); }, left, right);
}

}  // namespace kfstab::reference
