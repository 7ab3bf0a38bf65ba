#include <kfstab/reference/enclosure.hpp>

#include <gtest/gtest.h>

#include <kfstab/reference/closed_forms.hpp>
#include <kfstab/reference/exact_filter.hpp>

#include "support.hpp"

namespace kfstab::reference::testing {
namespace {

/// What a sum of doubles stands for.
Matrix<Rational> sum(const std::vector<Matrix<double>>& terms) {
  Matrix<Rational> X(terms.front().rows(), terms.front().cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      for (const auto& term : terms) X(i, j) += Rational(term(i, j));
  return X;
}

TEST(Enclosure, ContainsTheExactFilterAndTheTrajectory) {
  std::mt19937_64 random(51);
  for (int trial = 0; trial < 12; ++trial) {
    const Dimensions d{1 + trial % 4, trial % 3, 1 + trial % 2};
    constexpr int steps = 8;
    Problem<RootModel<double>> root;
    root.models = {random_root_model(random, d)};
    root.initial = few_bits_root(random, d.n);
    root.x0 = few_bits(random, d.n, 1);
    const auto data = random_data(random, d.p, 1, steps);
    const AnyProblem<double> problem = root;

    Enclosure enclosure(exact_problem(problem), exact_data(problem, data));
    ExactFilter exact(exact_problem(problem), exact_data(problem, data));
    Trajectory trajectory(problem, data, {.digits = 60, .first_digits = 115});
    for (int k = 0; k < steps; ++k) {
      SCOPED_TRACE(::testing::Message() << "trial " << trial << ", step " << k);
      enclosure.advance();
      exact.advance();
      trajectory.advance();
      EXPECT_EQ(enclosure.k(), k);
      ASSERT_GT(trajectory.working_digits(), 100);  // finer than the intervals' 60
      for (const Quantity quantity : rational_quantities) {
        SCOPED_TRACE(static_cast<int>(quantity));
        const Matrix<Rational> truth = exact_quantity(exact.step(), quantity);
        EXPECT_TRUE(enclosure.contains(quantity, truth));
        EXPECT_TRUE(enclosure.contains(quantity, sum(trajectory.expansion(quantity, 7))));
        EXPECT_LE(enclosure.width(quantity), 1e-40);
        // and it is a bound, not everything: one unit of the tenth digit is outside
        if (truth(0, 0) == 0) continue;
        Matrix<Rational> moved = truth;
        moved(0, 0) *= Rational("10000000001/10000000000");
        EXPECT_FALSE(enclosure.contains(quantity, moved));
      }
      EXPECT_TRUE(enclosure.contains(Quantity::log_likelihood, sum(trajectory.expansion(Quantity::log_likelihood, 7))));
      EXPECT_LE(enclosure.width(Quantity::log_likelihood), 1e-40);
    }
  }
}

TEST(Enclosure, ProvesDyerMcReynoldsUntilNothingCanBeProven) {
  // k(Re) = 4.5 / d^2: 60 digits less those are left, and none at d = 1e-30.
  double previous = 0;
  for (const auto& [text, exponent] : {std::pair{"1/1000", 3}, {"1/1000000", 6}, {"1/1000000000000", 12}}) {
    const DyerMcReynolds form{Rational(text)};
    Enclosure enclosure(form.problem());
    enclosure.advance();
    EXPECT_TRUE(enclosure.contains(Quantity::P_filtered, form.P()));
    EXPECT_TRUE(enclosure.contains(Quantity::filter_gain, form.gain()));
    const double width = enclosure.width(Quantity::P_filtered);
    // An interval in the pivot of size d^2 enters P with the gain 1/d squared: at most a few times 10^(4 exponent).
    EXPECT_LE(width, std::pow(10.0, 4 * exponent + 3 - 60));
    EXPECT_GT(width, previous);
    previous = width;
  }
  Enclosure hopeless(DyerMcReynolds(Rational("1/10000000000000000000000000000000000")).problem());
  EXPECT_THROW(hopeless.advance(), ReferenceError);
}

TEST(Enclosure, RefusesShapesThatDiffer) {
  Enclosure enclosure(DyerMcReynolds(1).problem());
  enclosure.advance();
  EXPECT_FALSE(enclosure.contains(Quantity::P_filtered, Matrix<Rational>(2, 2)));
}

}  // namespace
}  // namespace kfstab::reference::testing
