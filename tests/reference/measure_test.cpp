#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include <kfstab/reference/definiteness.hpp>
#include <kfstab/reference/trajectory.hpp>

#include "support.hpp"
#include "tolerance.hpp"

namespace kfstab::reference::testing {
namespace {

using test::ulp;

Metadata holding(Held held, Instant instant = Instant::predicted, GainKind gain = GainKind::predictor) {
  Metadata metadata;
  metadata.id = "hand-made";
  metadata.holds = held;
  metadata.instant = instant;
  metadata.gain = gain;
  return metadata;
}

Step<double> step_with(const Matrix<double>* held, const Matrix<double>* gain = nullptr,
                       const Vector<double>* state = nullptr) {
  return {{}, held, gain, state};
}

/// What the reference holds, as one wide matrix.
Matrix<Wide> sum_of(const std::vector<Matrix<double>>& expansion) {
  Matrix<Wide> X(expansion[0].rows(), expansion[0].cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) {
      X(i, j) = 0;
      for (const auto& term : expansion) X(i, j) += term(i, j);
    }
  return X;
}

Wide norm(const Matrix<Wide>& X) {
  Wide square = 0;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) square += X(i, j) * X(i, j);
  return sqrt(square);
}

Matrix<Wide> minus(const Matrix<Wide>& X, const Matrix<Wide>& Y) {
  Matrix<Wide> Z(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Z(i, j) = X(i, j) - Y(i, j);
  return Z;
}

/// X X' in 200 digits
Matrix<Wide> squared(const Matrix<Wide>& X) {
  Matrix<Wide> Z(X.rows(), X.rows());
  for (Index j = 0; j < Z.cols(); ++j)
    for (Index i = 0; i < Z.rows(); ++i) {
      Z(i, j) = 0;
      for (Index l = 0; l < X.cols(); ++l) Z(i, j) += X(i, l) * X(j, l);
    }
  return Z;
}

class Measure : public ::testing::Test {
 protected:
  Measure() {
    std::mt19937_64 random(42);
    Problem<RootModel<double>> root;
    root.models = {random_root_model(random, {3, 2, 2})};
    root.initial = few_bits_root(random, 3);
    root.x0 = few_bits(random, 3, 1);
    problem = root;
    trajectory = std::make_unique<Trajectory>(problem, random_data(random, 2, 1, 3));
    for (int k = 0; k < 3; ++k) trajectory->advance();
    P = sum_of(trajectory->expansion(Quantity::P_next, 4));
    Pf = sum_of(trajectory->expansion(Quantity::P_filtered, 4));
  }

  /// Two formulas of the same thing in 100 and 200 digits, each rounded once
  static void expect_same(double measured, const Wide& expected) {
    EXPECT_NEAR(measured / round_to_double(expected), 1, 4 * ulp);
  }

  AnyProblem<double> problem;
  std::unique_ptr<Trajectory> trajectory;
  Matrix<Wide> P, Pf;
};

TEST_F(Measure, CovarianceWithAKnownError) {
  for (double size : {0.0, 1e-15, 1e-8, 0.25, 1e6}) {
    Matrix<double> held = trajectory->truth().P_next;
    held(0, 1) += size;
    held(1, 0) += size;
    held(2, 2) -= size;
    const Errors errors = trajectory->measure(holding(Held::covariance), step_with(&held));
    const Matrix<Wide> difference = minus(exact<Wide>(held), P);
    const Wide expected = norm(difference) / norm(P);
    expect_same(errors.covariance, expected);
    Wide largest = 0;
    const Matrix<double> entries = trajectory->entry_errors(holding(Held::covariance), step_with(&held));
    for (Index j = 0; j < 3; ++j)
      for (Index i = 0; i < 3; ++i) {
        const Wide entry = abs(difference(i, j)) / sqrt(Wide(P(i, i) * P(j, j)));
        expect_same(entries(i, j), entry);
        largest = std::max(largest, entry);
      }
    expect_same(errors.entrywise, largest);
    EXPECT_EQ(errors.asymmetry, 0);
    EXPECT_EQ(errors.correct_digits, std::clamp(-std::log10(errors.covariance), 0.0, 53 * std::log10(2.0)));
    EXPECT_TRUE(std::isnan(errors.gain));
    EXPECT_TRUE(std::isnan(errors.state));
    EXPECT_TRUE(std::isnan(errors.information));
    EXPECT_EQ(errors.positive_semidefinite, is_positive_semidefinite(held));
    EXPECT_EQ(errors.smallest_eigenvalue, smallest_eigenvalue(held));
    if (size == 0) {
      // three entries rounded to nearest
      EXPECT_LE(errors.covariance, ulp / 2);
      EXPECT_GT(errors.covariance, 0);
    }
  }
}

TEST_F(Measure, FilteredIsJudgedAgainstFiltered) {
  const Matrix<double> held = trajectory->truth().P_filtered;
  expect_same(trajectory->measure(holding(Held::covariance, Instant::filtered), step_with(&held)).covariance,
              norm(minus(exact<Wide>(held), Pf)) / norm(Pf));
  EXPECT_GT(trajectory->measure(holding(Held::covariance), step_with(&held)).covariance, 1e-3);
}

TEST_F(Measure, AsymmetryIsMeasuredNotCured) {
  Matrix<double> held = trajectory->truth().P_next;
  held(2, 0) += 0x1p-20;
  const Errors errors = trajectory->measure(holding(Held::covariance), step_with(&held));
  Wide skew = Wide(held(2, 0)) - Wide(held(0, 2));
  expect_same(errors.asymmetry, Wide(sqrt(Wide(2)) * skew / 2 / norm(P)));
}

TEST_F(Measure, FactorIsMultipliedOutExactly) {
  std::mt19937_64 random(9);
  Matrix<double> S = few_bits_root(random, 3) / 3;
  S(2, 2) = 1e-30;  // S S' in double would lose this
  Matrix<double> dirty = S;
  dirty(0, 2) = std::numeric_limits<double>::quiet_NaN();
  const Errors errors = trajectory->measure(holding(Held::covariance_factor), step_with(&dirty));
  expect_same(errors.covariance, norm(minus(squared(exact<Wide>(S)), P)) / norm(P));
  EXPECT_EQ(errors.asymmetry, 0);
  EXPECT_TRUE(errors.positive_semidefinite);
  EXPECT_EQ(errors.smallest_eigenvalue, smallest_eigenvalue_of_product(S));
  EXPECT_GT(errors.smallest_eigenvalue, 0);
  EXPECT_LE(errors.smallest_eigenvalue, 1e-60);
}

TEST_F(Measure, InformationFactorIsInverted) {
  // T = [2 1; 0 4] on the first two states: (T'T)^{-1} = T^{-1} T^{-T}, by hand
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Matrix<double> T = matrix(3, 3, {2, 1, 0, nan, 4, 0, nan, nan, 3});
  const Matrix<Wide> T_inverse = [] {
    Matrix<Wide> X = exact<Wide>(matrix(3, 3, {0.5, -0.125, 0, 0, 0.25, 0, 0, 0, 0}));
    X(2, 2) = Wide(1) / 3;
    return X;
  }();
  const Errors errors = trajectory->measure(holding(Held::information_factor, Instant::filtered), step_with(&T));
  expect_same(errors.covariance, norm(minus(squared(T_inverse), Pf)) / norm(Pf));
  EXPECT_TRUE(errors.positive_semidefinite);
  // 1 / ||T||^2, T'T = [4 2; 2 17] + 9
  EXPECT_NEAR(errors.smallest_eigenvalue * (21 + std::sqrt(13.0 * 13 + 16)) / 2, 1, 16 * ulp);

  const Matrix<double> singular = matrix(3, 3, {2, 1, 0, 0, 0, 0, 0, 0, 3});
  const Errors infinite =
      trajectory->measure(holding(Held::information_factor, Instant::filtered), step_with(&singular));
  EXPECT_EQ(infinite.covariance, std::numeric_limits<double>::infinity());
  EXPECT_EQ(infinite.correct_digits, 0);
}

TEST_F(Measure, GainAndState) {
  const Truth& truth = trajectory->truth();
  Matrix<double> K = truth.predictor_gain, Kf = truth.filter_gain;
  Vector<double> x = truth.x_next, xf = truth.x_filtered;
  K(0, 1) += 1e-3;
  Kf(2, 0) += 1e-6;
  x(1) += 1e-4;
  xf(0) += 1e-5;
  const Errors predicted = trajectory->measure(holding(Held::covariance), step_with(nullptr, &K, &x));
  // The perturbation stands far above the double rounding of the truth that it is added to.
  EXPECT_NEAR(predicted.gain / (1e-3 / truth.predictor_gain.norm()), 1, 1e-9);
  EXPECT_NEAR(predicted.state / (1e-4 / truth.x_next.norm()), 1, 1e-9);
  EXPECT_TRUE(std::isnan(predicted.covariance));
  EXPECT_FALSE(predicted.positive_semidefinite);
  const Errors filtered =
      trajectory->measure(holding(Held::covariance, Instant::filtered, GainKind::filter), step_with(nullptr, &Kf, &xf));
  EXPECT_NEAR(filtered.gain / (1e-6 / truth.filter_gain.norm()), 1, 1e-7);
  EXPECT_NEAR(filtered.state / (1e-5 / truth.x_filtered.norm()), 1, 1e-8);
}

TEST_F(Measure, RubbishIsNotANumber) {
  Matrix<double> held = trajectory->truth().P_next;
  held(1, 1) = std::numeric_limits<double>::infinity();
  const Errors errors = trajectory->measure(holding(Held::covariance), step_with(&held));
  EXPECT_TRUE(std::isnan(errors.covariance));
  EXPECT_TRUE(std::isnan(errors.smallest_eigenvalue));
  EXPECT_FALSE(errors.positive_semidefinite);
  EXPECT_EQ(errors.correct_digits, 0);
  const Matrix<double> small = Matrix<double>::Identity(2, 2);
  EXPECT_THROW(trajectory->measure(holding(Held::covariance), step_with(&small)), ReferenceError);
}

TEST(MeasureZero, RelativeToAnExactZero) {
  // P0 = 0 and no noise: P stays 0, the gain is 0.
  CovarianceModel<double> model;
  model.A = matrix(2, 2, {0.5, 1, 0, 0.5});
  model.B = Matrix<double>(2, 0);
  model.Q = Matrix<double>(0, 0);
  model.C = matrix(1, 2, {1, 0});
  model.R = matrix(1, 1, {1});
  const AnyProblem<double> problem =
      Problem<CovarianceModel<double>>{{model}, Matrix<double>::Zero(2, 2), Vector<double>::Zero(2)};
  Trajectory trajectory(problem, nullptr);
  trajectory.advance();
  Matrix<double> held = Matrix<double>::Zero(2, 2), gain = Matrix<double>::Zero(2, 1);
  Errors errors = trajectory.measure(holding(Held::covariance), step_with(&held, &gain));
  EXPECT_EQ(errors.covariance, 0);
  EXPECT_EQ(errors.gain, 0);
  EXPECT_EQ(errors.correct_digits, 53 * std::log10(2.0));
  EXPECT_TRUE(errors.positive_semidefinite);
  held(0, 0) = gain(0, 0) = 1e-300;
  errors = trajectory.measure(holding(Held::covariance), step_with(&held, &gain));
  EXPECT_EQ(errors.covariance, std::numeric_limits<double>::infinity());
  EXPECT_EQ(errors.gain, std::numeric_limits<double>::infinity());
  EXPECT_EQ(errors.entrywise, 0);  // no state has a variance to be relative to
  EXPECT_EQ(trajectory.entry_errors(holding(Held::covariance), step_with(&held)), Matrix<double>::Zero(2, 2));
  EXPECT_EQ(trajectory.entry_errors(holding(Held::gain), step_with(nullptr)).size(), 0);
  EXPECT_EQ(errors.correct_digits, 0);
}

TEST(MeasureInformation, AgainstTheInverse) {
  InformationModel<double> model;
  model.A_inverse = Matrix<double>::Identity(2, 2);
  model.A_inverse_B = Matrix<double>::Identity(2, 2);
  model.C = matrix(1, 2, {1, 0});
  model.Q_inverse_root = Matrix<double>::Identity(2, 2);
  model.R_inverse_root = matrix(1, 1, {2});
  const AnyProblem<double> problem =
      Problem<InformationModel<double>>{{model}, matrix(2, 2, {1, 1, 0, 1}), Vector<double>::Zero(2)};
  Trajectory trajectory(problem, nullptr);
  trajectory.advance();
  // P_{0|0}^{-1} = T0'T0 + C' R^{-1} C = [1 1; 1 2] + [4 0; 0 0]
  EXPECT_EQ(trajectory.truth().information, matrix(2, 2, {5, 1, 1, 2}));
  const Matrix<double> T = matrix(2, 2, {2, 0.5, 0, 1});  // T'T = [4 1; 1 1.25]
  const Errors errors = trajectory.measure(holding(Held::information_factor, Instant::filtered), step_with(&T));
  EXPECT_NEAR(errors.information, std::sqrt((1 + 0.75 * 0.75) / (25 + 1 + 1 + 4)), 4 * ulp);
}

}  // namespace
}  // namespace kfstab::reference::testing
