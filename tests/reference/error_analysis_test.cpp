#include <kfstab/reference/error_analysis.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include <kfstab/reference/closed_forms.hpp>
#include <kfstab/reference/definiteness.hpp>
#include <kfstab/reference/detail/elimination.hpp>

#include "support.hpp"
#include "tolerance.hpp"

namespace kfstab::reference::testing {
namespace {

using test::u;

TEST(ErrorAnalysis, ProductsFarBeyondTheRangeOfDouble) {
  for (double f : {1e-200, 1e200, 0.5}) {
    Truth truth;
    truth.closed_loop = f * matrix(2, 2, {0, 1, 1, 0});
    ErrorAnalysis analysis;
    for (int k = 0; k < 50; ++k) {
      analysis.advance(truth);
      EXPECT_NEAR(analysis.gamma() / f, 1, 8 * u);
      const double expected = 2 * (k + 1) * std::log10(f);
      EXPECT_NEAR(analysis.log10_amplification() / expected, 1, 8 * u * (k + 1));
    }
  }
}

TEST(ErrorAnalysis, WhatIsForgottenStaysForgotten) {
  Truth truth;
  truth.closed_loop = matrix(2, 2, {0, 1e8, 0, 0});  // nilpotent
  ErrorAnalysis analysis;
  analysis.advance(truth);
  EXPECT_NEAR(analysis.log10_amplification(), 16, 1e-12);
  for (int k = 0; k < 3; ++k) {
    analysis.advance(truth);
    EXPECT_EQ(analysis.log10_amplification(), -std::numeric_limits<double>::infinity());
    EXPECT_NEAR(analysis.gamma() / 1e8, 1, 8 * u);
  }
}

TEST(ErrorAnalysis, TheOrderOfTheProductIsTheOrderOfTime) {
  std::mt19937_64 random(61);
  ErrorAnalysis analysis;
  Matrix<Wide> product = detail::unit<Wide>(3);
  double gammas = 1;
  for (int k = 0; k < 30; ++k) {
    Truth truth;
    truth.closed_loop = few_bits(random, 3, 3);
    analysis.advance(truth);
    product = detail::times(exact<Wide>(truth.closed_loop), product);
    gammas *= analysis.gamma();
    Matrix<double> rounded(3, 3);
    for (Index i = 0; i < 9; ++i) rounded(i / 3, i % 3) = round_to_double(product(i / 3, i % 3));
    const double norm = two_norm(rounded);
    // n roundings an entry and step, carried on by the norms
    const double relative = 2 * 3 * u * (k + 2) * gammas / norm;
    EXPECT_NEAR(analysis.log10_amplification(), 2 * std::log10(norm),
                2 * relative + 8 * u * std::abs(2 * std::log10(norm)));
  }
}

/// What it says happens: P0 off by a little, and the difference of the two trajectories.
TEST(ErrorAnalysis, BoundsWhatAnErrorBecomesAndIsReached) {
  std::mt19937_64 random(62);
  Problem<CovarianceModel<double>> problem = [&] {
    Problem<RootModel<double>> root;
    for (int k = 0; k < 3; ++k) root.models.push_back(random_root_model(random, {2, 2, 1}));
    root.initial = few_bits_root(random, 2);
    root.x0 = Vector<double>::Zero(2);
    return as_covariance(root);
  }();
  constexpr double small = 0x1p-40;
  constexpr int steps = 12;
  double reached[steps] = {};
  ErrorAnalysis analysis;
  double said[steps] = {};
  const AnyProblem<double> unmoved = problem;
  for (const auto& v : {matrix(2, 1, {1, 0}), matrix(2, 1, {0, 1}), matrix(2, 1, {1, 1}), matrix(2, 1, {1, -1}),
                        matrix(2, 1, {2, 1}), matrix(2, 1, {1, 2}), matrix(2, 1, {2, -1}), matrix(2, 1, {1, -2})}) {
    Problem<CovarianceModel<double>> moved = problem;
    moved.initial += small * v.lazyProduct(v.transpose());  // exact
    const AnyProblem<double> other = moved;
    Trajectory a(unmoved, nullptr), b(other, nullptr);
    for (int k = 0; k < steps; ++k) {
      a.advance();
      b.advance();
      if (said[k] == 0) {
        analysis.advance(a.truth());
        said[k] = std::pow(10.0, analysis.log10_amplification());
      }
      const auto at_a = a.expansion(Quantity::P_next, 2), at_b = b.expansion(Quantity::P_next, 2);
      const Matrix<double> difference = (at_b[0] - at_a[0]) + (at_b[1] - at_a[1]);
      reached[k] = std::max(reached[k], two_norm(difference) / (small * v.squaredNorm()));
    }
  }
  double largest = 1;
  for (int k = 0; k < steps; ++k) {
    largest = std::max(largest, said[k]);
    // Second order, each step: dP C'Re^{-1}C dP, with |v|^2 <= 5, |C|^2 <= 2 and R >= 1/4
    const double second_order = (k + 1) * 5 * small * largest * 8;
    EXPECT_LE(reached[k], said[k] * (1 + second_order)) << k;
    // The worst direction is within 13.3 degrees of one of these: cos^2 = .947
    EXPECT_GE(reached[k], 0.947 * said[k] * (1 - second_order)) << k;
  }
}

TEST(ErrorAnalysis, OfDyerAndMcReynolds) {
  // k(Re) -> 4.5 / d^2, theory (6.3)
  CovarianceModel<double> model;
  const double d = 0x1p-20;
  model.A = Matrix<double>::Identity(3, 3);
  model.B = Matrix<double>(3, 0);
  model.Q = Matrix<double>(0, 0);
  model.C = matrix(2, 3, {1, 1, 1, 1, 1, 1 + d});
  model.R = d * d * Matrix<double>::Identity(2, 2);
  const AnyProblem<double> problem =
      Problem<CovarianceModel<double>>{{model}, Matrix<double>::Identity(3, 3), Vector<double>::Zero(3)};
  Trajectory trajectory(problem, nullptr);
  trajectory.advance();
  ErrorAnalysis analysis;
  analysis.advance(trajectory.truth());
  EXPECT_NEAR(analysis.innovation_condition() / (std::sqrt(4.5) / d), 1, 4 * d);
  // ||P+|| = 1, along [1; -1; 0], and A P A' + B Q B' = I
  EXPECT_NEAR(analysis.cosine(), 1, 16 * u);
  EXPECT_NEAR(analysis.gamma(), 1, 16 * u);
}

}  // namespace
}  // namespace kfstab::reference::testing
