#include <kfstab/reference/same_numbers.hpp>

#include <functional>
#include <limits>
#include <random>

#include "support.hpp"

namespace kfstab::reference::testing {
namespace {

using Covariances = Problem<CovarianceModel<double>>;
using Roots = Problem<RootModel<double>>;
using Information = Problem<InformationModel<double>>;

/// Two models, all of whose inverses are dyadic too: A and the roots are triangular with powers of two on the diagonal.
Roots roots() {
  Roots problem;
  for (const double a : {0.5, -0.25}) {
    RootModel<double> model;
    model.A = matrix(2, 2, {1, a, 0, 0.5});
    model.B = matrix(2, 1, {0.75, 1});
    model.C = matrix(2, 2, {1, 0.5, 0, 1});
    model.D = matrix(2, 1, {1, -1});
    model.Q_root = matrix(1, 1, {2});
    model.R_root = matrix(2, 2, {-0.5, std::numeric_limits<double>::quiet_NaN(), a, 1});  // above: never read
    problem.models.push_back(model);
  }
  problem.initial = matrix(2, 2, {2, 0, -1, 0.5});
  problem.x0 = Vector<double>::Constant(2, 0.1);
  return problem;
}

Matrix<double> lower(const Matrix<double>& X) { return X.triangularView<Eigen::Lower>(); }

/// Exact for the matrices here.
Matrix<double> inverse_of(const Matrix<double>& X) {
  if (X.rows() == 1) return matrix(1, 1, {1 / X(0, 0)});
  const double d = X(0, 0) * X(1, 1) - X(0, 1) * X(1, 0);
  return matrix(2, 2, {X(1, 1) / d, -X(0, 1) / d, -X(1, 0) / d, X(0, 0) / d});
}

/// Upper U with U'U = (L L')^{-1}: L^{-1} is lower, and its rows are turned into an upper one by a QL step, which for a
/// 2 x 2 needs a square root; the diagonal case needs none. So: the reversed Cholesky of L L', where it is dyadic.
Matrix<double> upper_inverse_root(const Matrix<double>& L) {
  if (L.rows() == 1) return inverse_of(L);
  const Matrix<double> Y = inverse_of(product_of(lower(L)));
  const double a = std::sqrt(Y(0, 0)), b = Y(0, 1) / a;
  return matrix(2, 2, {a, b, 0, std::sqrt(Y(1, 1) - b * b)});
}

Information information(const Roots& from) {
  Information problem;
  for (const auto& model : from.models) {
    InformationModel<double> to;
    to.A_inverse = inverse_of(model.A);
    to.A_inverse_B = to.A_inverse * model.B;
    to.C = model.C;
    to.D = model.D;
    to.Q_inverse_root = upper_inverse_root(model.Q_root);
    to.R_inverse_root = upper_inverse_root(model.R_root);
    problem.models.push_back(to);
  }
  problem.initial = upper_inverse_root(from.initial);
  problem.x0 = from.x0;
  return problem;
}

/// Roots whose inverse roots have no square root in them: diagonal ones.
Roots diagonal_roots() {
  Roots problem = roots();
  for (auto& model : problem.models) model.R_root(1, 0) = 0;
  problem.initial(1, 0) = 0;
  return problem;
}

Covariances covariances(const Roots& from) {
  Roots cleared = from;
  for (auto& model : cleared.models) model.R_root = lower(model.R_root);
  return as_covariance(cleared);
}

TEST(SameNumbers, WhateverTheParametrisation) {
  const AnyProblem<double> root = roots(), covariance = covariances(roots());
  EXPECT_TRUE(same_numbers(root, covariance));
  EXPECT_TRUE(same_numbers(covariance, root));
  EXPECT_TRUE(same_numbers(root, root));
  EXPECT_TRUE(same_numbers(covariance, covariance));
  const AnyProblem<double> other = diagonal_roots(), inverse = information(diagonal_roots());
  for (const auto& problem : {other, AnyProblem<double>(covariances(diagonal_roots())), inverse}) {
    EXPECT_TRUE(same_numbers(problem, inverse));
    EXPECT_TRUE(same_numbers(inverse, problem));
    EXPECT_FALSE(same_numbers(root, problem));
  }
}

TEST(SameNumbers, SignsOfARootDoNotMatter) {
  Roots turned = roots();
  turned.initial.col(0) *= -1;
  EXPECT_TRUE(same_numbers(turned, roots()));
}

TEST(SameNumbers, AnyOneNumberTellsThemApart) {
  const double up = 1 + std::numeric_limits<double>::epsilon();
  const std::vector<std::function<void(Roots&)>> changes = {[=](Roots& p) { p.models[1].A(0, 1) *= up; },
                                                            [=](Roots& p) { p.models[1].B(0, 0) *= up; },
                                                            [=](Roots& p) { p.models[0].C(0, 1) *= up; },
                                                            [=](Roots& p) { p.models[1].D(1, 0) *= up; },
                                                            [=](Roots& p) { p.models[0].Q_root(0, 0) *= up; },
                                                            [=](Roots& p) { p.models[1].R_root(1, 1) *= up; },
                                                            [=](Roots& p) { p.initial(1, 1) *= up; },
                                                            [=](Roots& p) { p.x0(1) *= up; },
                                                            [](Roots& p) { p.models.pop_back(); },
                                                            [](Roots& p) { p.models[0].D.resize(2, 0); }};
  const Covariances covariance = covariances(diagonal_roots());
  const Information inverse = information(diagonal_roots());
  for (std::size_t i = 0; i < changes.size(); ++i) {
    SCOPED_TRACE(i);
    Roots changed = diagonal_roots();
    changes[i](changed);
    for (const auto& problem :
         {AnyProblem<double>(diagonal_roots()), AnyProblem<double>(covariance), AnyProblem<double>(inverse)}) {
      EXPECT_FALSE(same_numbers(changed, problem));
      EXPECT_FALSE(same_numbers(problem, changed));
    }
  }
  Information with_mean = inverse;
  with_mean.models[1].w_mean = Vector<double>::Zero(1);
  EXPECT_TRUE(same_numbers(with_mean, covariance)) << "a mean of 0 is none";
  with_mean.models[1].w_mean(0) = 1e-300;
  EXPECT_FALSE(same_numbers(with_mean, covariance));
}

TEST(SameNumbers, ARoundedRootIsAnother) {
  Covariances covariance = covariances(roots());
  covariance.initial = matrix(2, 2, {2, 0, 0, 1});
  Roots root = roots();
  root.initial = matrix(2, 2, {std::sqrt(2.0), 0, 0, 1});
  EXPECT_FALSE(same_numbers(covariance, root));
}

TEST(SameNumbers, WhatIsNotFiniteIsLikeNothing) {
  Covariances covariance = covariances(roots());
  covariance.models[1].Q(0, 0) = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(same_numbers(covariance, covariance));
}

}  // namespace
}  // namespace kfstab::reference::testing
