#include <kfstab/reference/steady_state.hpp>

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include <kfstab/reference/trajectory.hpp>

#include "support.hpp"

namespace kfstab::reference::testing {
namespace {

constexpr double ulp = 0x1p-52;

AnyProblem<double> scalar(double a, double q, double r) {
  CovarianceModel<double> model;
  model.A = matrix(1, 1, {a});
  model.B = model.C = matrix(1, 1, {1});
  model.Q = matrix(1, 1, {q});
  model.R = matrix(1, 1, {r});
  return Problem<CovarianceModel<double>>{{model}, matrix(1, 1, {1}), Vector<double>::Zero(1)};
}

TEST(SteadyState, ScalarInClosedForm) {
  for (double a : {0.0, 0.5, 1.0, 1.25, 8.0})
    for (double q : {1.0, 0x1p-20, 0x1p-40}) {
      SCOPED_TRACE(::testing::Message() << "a = " << a << ", q = " << q);
      // P^2 + (1 - a^2 - q) P - q = 0 with r = 1
      const Wide b = 1 - Wide(a) * a - q, root = sqrt(Wide(b * b + 4 * Wide(q)));
      const Wide P = b > 0 ? Wide(2 * Wide(q) / (b + root)) : Wide((root - b) / 2);
      const SteadyState s = steady_state(scalar(a, q, 1));
      EXPECT_EQ(s.P(0, 0), round_to_double(P));
      EXPECT_EQ(s.predictor_gain(0, 0), round_to_double(Wide(a * P / (P + 1))));
      EXPECT_EQ(s.closed_loop(0, 0), round_to_double(Wide(a / (P + 1))));
      EXPECT_NEAR(s.spectral_radius, std::abs(s.closed_loop(0, 0)), ulp);
      EXPECT_GE(s.certified_digits, 60);
      EXPECT_LE(s.residual, 1e-100);
    }
}

TEST(SteadyState, IsWhereTheRecursionGoes) {
  std::mt19937_64 random(31);
  for (int trial = 0; trial < 8; ++trial) {
    SCOPED_TRACE(trial);
    Problem<RootModel<double>> root;
    root.models = {random_root_model(random, {3, 3, 2})};
    root.initial = few_bits_root(random, 3);
    root.x0 = Vector<double>::Zero(3);
    const AnyProblem<double> problem = root;
    const SteadyState s = steady_state(problem);
    ASSERT_LT(s.spectral_radius, 1);
    // Until what is left of P0 is below 1e-40: rho(F)^{2 k}
    const int steps = static_cast<int>(std::ceil(-20 / std::log10(std::min(0.99, s.spectral_radius)))) + 40;
    Trajectory trajectory(problem, nullptr);
    for (int k = 0; k < steps; ++k) trajectory.advance();
    EXPECT_EQ(s.P, trajectory.truth().P_next);
    EXPECT_EQ(s.predictor_gain, trajectory.truth().predictor_gain);
    EXPECT_EQ(s.closed_loop, trajectory.truth().closed_loop);
  }
}

TEST(SteadyState, SlowAsADoubleIntegrator) {
  for (int j : {8, 20}) {
    const double q = std::ldexp(1.0, -j);
    RootModel<double> model;
    model.A = matrix(2, 2, {1, 0.5, 0, 1});
    model.B = q * matrix(2, 1, {0.125, 0.5});
    model.C = matrix(1, 2, {1, 0});
    model.Q_root = model.R_root = matrix(1, 1, {1});
    const AnyProblem<double> problem =
        Problem<RootModel<double>>{{model}, Matrix<double>::Identity(2, 2), Vector<double>::Zero(2)};
    const SteadyState s = steady_state(problem);
    // Continuous time gives rho = exp(-T (q / 2 r)^{1/2}) for acceleration noise q; to leading order in q^{1/2}.
    const double leading = 0.5 * std::sqrt(q / 2);
    EXPECT_NEAR((1 - s.spectral_radius) / leading, 1, 2 * leading + 0.05);
    EXPECT_GE(s.certified_digits, 60);
  }
}

TEST(SteadyState, WithoutNoiseAStableSystemForgetsAll) {
  RootModel<double> model;
  model.A = matrix(2, 2, {0.5, 1, 0, 0.25});
  model.B = Matrix<double>(2, 0);
  model.Q_root = Matrix<double>(0, 0);
  model.C = matrix(1, 2, {1, 0});
  model.R_root = matrix(1, 1, {1});
  Problem<RootModel<double>> problem{{model}, Matrix<double>::Identity(2, 2), Vector<double>::Zero(2)};
  const SteadyState s = steady_state(problem);
  EXPECT_EQ(s.P, Matrix<double>::Zero(2, 2));
  EXPECT_NEAR(s.spectral_radius, 0.5, ulp);
  // and without states there is nothing
  model.A = Matrix<double>(0, 0);
  model.B = Matrix<double>(0, 0);
  model.C = Matrix<double>(1, 0);
  EXPECT_EQ(steady_state(Problem<RootModel<double>>{{model}, Matrix<double>(0, 0), Vector<double>(0)}).P.size(), 0);
}

TEST(SteadyState, RefusesWhatHasNone) {
  EXPECT_THROW(steady_state(scalar(1.25, 0, 1)), ReferenceError);  // nothing excites the unstable mode
  EXPECT_THROW(steady_state(scalar(1, 0, 1)), ReferenceError);     // nor the marginal one
  EXPECT_THROW(steady_state(scalar(0.5, 1, 0)), ReferenceError);   // R singular
  // an unstable mode that is not seen
  CovarianceModel<double> model = std::get<0>(scalar(1.25, 1, 1)).models[0];
  model.C(0, 0) = 0;
  EXPECT_THROW(steady_state(Problem<CovarianceModel<double>>{{model}, matrix(1, 1, {1}), Vector<double>::Zero(1)}),
               ReferenceError);
  auto twice = std::get<0>(scalar(0.5, 1, 1));
  twice.models.push_back(twice.models[0]);
  EXPECT_THROW(steady_state(twice), ReferenceError);
}

TEST(SpectralRadius, KnownOnes) {
  EXPECT_EQ(spectral_radius(Matrix<double>(0, 0)), 0);
  EXPECT_EQ(spectral_radius(matrix(2, 2, {0, 1, 0, 0})), 0);
  EXPECT_EQ(spectral_radius(Matrix<double>::Zero(3, 3)), 0);
  EXPECT_NEAR(spectral_radius(matrix(1, 1, {-3})), 3, 4 * ulp);
  EXPECT_NEAR(spectral_radius(matrix(2, 2, {0.6, -0.8, 0.8, 0.6})), std::hypot(0.6, 0.8), 2 * ulp);
  EXPECT_NEAR(spectral_radius(matrix(2, 2, {0.9, 1, 0, 0.9})), 0.9, 4 * ulp);     // not diagonalisable
  EXPECT_NEAR(spectral_radius(matrix(2, 2, {0.9, 1e8, 0, 0.85})), 0.9, 4 * ulp);  // far from normal
  EXPECT_NEAR(spectral_radius(1e300 * matrix(2, 2, {1, 1, 1, 1})) / 2e300, 1, 4 * ulp);
  // companion matrix of (x - 2)(x - 1)(x + 1/2)
  EXPECT_NEAR(spectral_radius(matrix(3, 3, {2.5, -0.5, -1, 1, 0, 0, 0, 1, 0})), 2, 8 * ulp);
  EXPECT_TRUE(std::isnan(spectral_radius(matrix(1, 1, {std::numeric_limits<double>::quiet_NaN()}))));
  EXPECT_THROW(spectral_radius(Matrix<double>::Ones(2, 3)), ReferenceError);
  // beyond 32, in double: similar to diag(.5, ...) with one 1.5
  Matrix<double> X = 0.5 * Matrix<double>::Identity(40, 40);
  X(39, 39) = 1.5;
  for (Index i = 0; i < 39; ++i) X(i, i + 1) = 0.25;
  EXPECT_NEAR(spectral_radius(X), 1.5, 100 * ulp);
}

}  // namespace
}  // namespace kfstab::reference::testing
