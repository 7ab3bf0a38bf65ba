#include <kfstab/reference/steady_state.hpp>

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include <kfstab/filters/chandrasekhar.hpp>
#include <kfstab/reference/detail/dense.hpp>
#include <kfstab/reference/detail/elimination.hpp>
#include <kfstab/reference/exact_filter.hpp>
#include <kfstab/reference/trajectory.hpp>

#include "support.hpp"
#include "tolerance.hpp"

namespace kfstab::reference::testing {
namespace {

using test::ulp;

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

// ---- without measurements ----

AnyProblem<double> unmeasured(const Matrix<double>& A, const Matrix<double>& B, const Matrix<double>& Q) {
  CovarianceModel<double> model;
  model.A = A;
  model.B = B;
  model.Q = Q;
  model.C = Matrix<double>(0, A.rows());
  model.R = Matrix<double>(0, 0);
  return Problem<CovarianceModel<double>>{
      {model}, Matrix<double>::Zero(A.rows(), A.rows()), Vector<double>::Zero(A.rows())};
}

/// The equation as n^2 linear ones, P - A P A' = B Q B', solved exactly.
Matrix<Rational> by_elimination(const AnyProblem<double>& any) {
  const CovarianceModel<Rational> model = exact_problem(any).models[0];
  const Index n = model.A.rows();
  Matrix<Rational> equations = detail::unit<Rational>(n * n), P(n * n, 1);
  const Matrix<Rational> BQB = detail::sandwich(model.B, model.Q);
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < n; ++j) {
      P(i * n + j, 0) = BQB(i, j);
      for (Index k = 0; k < n; ++k)
        for (Index l = 0; l < n; ++l) equations(i * n + j, k * n + l) -= model.A(i, k) * model.A(j, l);
    }
  Rational determinant;
  EXPECT_TRUE(detail::solve(
      equations, P, determinant, [](const Rational& x) { return x != 0; }, false));
  return P;
}

TEST(StationaryCovariance, SolvesTheLyapunovEquation) {
  std::mt19937_64 random(32);
  for (int trial = 0; trial < 12; ++trial) {
    SCOPED_TRACE(trial);
    const Index n = 1 + trial % 4, m = trial % 3;
    // The sum of the moduli in a row is at most n / (n + 1/4): stable
    const Matrix<double> A = few_bits(random, n, n) / (static_cast<double>(n) + 0.25), S = few_bits_root(random, m);
    const AnyProblem<double> problem = unmeasured(A, few_bits(random, n, m), product_of(S));
    const StationaryCovariance s = stationary_covariance(problem);
    const Matrix<Rational> P = by_elimination(problem);
    for (Index i = 0; i < n; ++i)
      for (Index j = 0; j < n; ++j) EXPECT_EQ(s.P(i, j), nearest(P(i * n + j, 0)));
    EXPECT_EQ(s.spectral_radius, spectral_radius(A));
    EXPECT_GE(s.certified_digits, 80);
    EXPECT_LE(s.residual, 1e-180);
  }
  EXPECT_EQ(
      stationary_covariance(unmeasured(Matrix<double>(0, 0), Matrix<double>(0, 0), Matrix<double>(0, 0))).P.size(), 0);
}

TEST(StationaryCovariance, NearTheEndAndBeyond) {
  const auto of = [](const Matrix<double>& A) {
    return stationary_covariance(
        unmeasured(A, Matrix<double>::Identity(A.rows(), A.rows()), Matrix<double>::Identity(A.rows(), A.rows())));
  };
  // q / (1 - a^2) as far as doubles go
  const double a = 1 - 0x1p-53;
  EXPECT_EQ(of(matrix(1, 1, {a})).P(0, 0), round_to_double(Wide(1 / (1 - Wide(a) * a))));
  // far from normal: terms grow by 1e16 before they die out
  EXPECT_GE(of(matrix(2, 2, {0.5, 1e8, 0, 0.5})).certified_digits, 60);
  EXPECT_THROW(of(matrix(1, 1, {1})), ReferenceError);
  EXPECT_THROW(of(matrix(2, 2, {0.6, -0.8, 0.8, 0.6})), ReferenceError);  // on the circle, by an ulp at most
  EXPECT_THROW(of(matrix(2, 2, {0, 1.25, 1, 0})), ReferenceError);
  EXPECT_THROW(of(1e200 * matrix(2, 2, {0, 1, 0, 0})), ReferenceError);  // stable, but P is 1e400
  auto twice = std::get<0>(scalar(0.5, 1, 1));
  twice.models.push_back(twice.models[0]);
  EXPECT_THROW(stationary_covariance(twice), ReferenceError);
}

/// What it is for: L_0 = G_0 with Sig = -I. S0 is a double, so S0 S0' misses the equation by some E, and the filter is
/// that of the system with B Q B' - E.
TEST(StationaryCovariance, StartsTheChandrasekharFilter) {
  std::mt19937_64 random(33);
  for (int trial = 0; trial < 6; ++trial) {
    SCOPED_TRACE(trial);
    const Dimensions d{3, 2, 1 + trial % 2};
    Problem<RootModel<double>> root;
    root.models = {random_root_model(random, d)};
    RootModel<double>& model = root.models[0];
    model.A *= 0.3;
    root.x0 = Vector<double>::Zero(d.n);
    const StationaryCovariance s = stationary_covariance([&] {
      root.initial = Matrix<double>::Identity(d.n, d.n);
      return AnyProblem<double>(root);
    }());
    Matrix<HighPrecision> L;
    ASSERT_TRUE(detail::cholesky(exact<HighPrecision>(s.P), L).done);
    root.initial = detail::round_to_double(L);
    const AnyProblem<double> problem = root;

    const double unit = test::u * static_cast<double>(d.n + d.m + d.p);
    const double a = two_norm(model.A), c = two_norm(model.C), size = two_norm(s.P);
    // S0 and s.P are rounded once, entry by entry; n for ||X||_F against the entries
    const double E = 4 * test::u * static_cast<double>(d.n) * (1 + a * a) * size;
    const auto worst = [&](InitialCovariance kind, const Matrix<double>& S0) {
      Trajectory trajectory(problem, nullptr);
      ChandrasekharFilter<double> filter(d);
      filter.start(S0, root.x0, kind);
      double result = 0, of_P = E, local = 0;
      for (int k = 0; k < 40; ++k) {
        trajectory.advance();
        EXPECT_TRUE(filter.step(model));
        EXPECT_EQ(filter.growing(), 0);
        const Truth& t = trajectory.truth();
        const double re = two_norm(t.innovation), re_inverse = t.innovation_condition / re;
        const double root_next = std::sqrt(two_norm(t.P_next));
        // theory (4.2); what rounding does to G and Re^{1/2} stays there, so it adds up
        local += unit * filter.rotation_condition() * std::sqrt(re_inverse) *
                 ((std::sqrt(t.innovation_condition) + 1 / t.cosine) * root_next + re * two_norm(t.predictor_gain));
        const double f = two_norm(t.closed_loop);
        const double bound = f * of_P * c * re_inverse + 30 * local;
        of_P = f * f * of_P + E;
        result = std::max(result, (filter.predictor_gain() - t.predictor_gain).norm() / bound);
      }
      return result;
    };
    EXPECT_LE(worst(InitialCovariance::stationary, root.initial), 1);
    // The flag is believed: with a P0 that is not stationary the gain is another filter's.
    EXPECT_GT(worst(InitialCovariance::stationary, Matrix<double>(2 * root.initial)), 1e6);
  }
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
