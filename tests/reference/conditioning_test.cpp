#include <kfstab/reference/conditioning.hpp>

#include <gtest/gtest.h>

#include <kfstab/reference/exact_filter.hpp>

#include "support.hpp"

namespace kfstab::reference::testing {
namespace {

/// Time-varying, with an input and a noise of several dimensions, everything correlated with everything.
struct ConditionCase {
  ExactProblem problem;
  std::vector<StepDataOf<Rational>> data;
};

ConditionCase random_case(std::mt19937_64& random, Dimensions d, int steps, std::size_t models) {
  Problem<RootModel<double>> root;
  for (std::size_t k = 0; k < models; ++k) root.models.push_back(random_root_model(random, d));
  root.initial = few_bits_root(random, d.n);
  root.x0 = few_bits(random, d.n, 1);
  ConditionCase result{exact_problem(root), {}};
  const auto data = exact_data(root, random_data(random, d.p, 1, steps));
  const auto stream = data->open();
  for (int k = 0; k < steps; ++k) result.data.push_back(stream->next());
  return result;
}

/// A recursion and a definition, both exact: equal, not nearly equal.
TEST(Conditioning, IsWhatTheFilterComputes) {
  std::mt19937_64 random(41);
  for (const Dimensions d : {Dimensions{1, 1, 1}, {2, 1, 2}, {3, 2, 1}, {2, 0, 1}, {2, 2, 0}, {0, 1, 1}}) {
    constexpr int steps = 4;
    const ConditionCase c = random_case(random, d, steps, 2);
    ExactFilter filter(c.problem, std::make_shared<ExactListedData>(c.data));
    Rational determinant = 1, weighted = 0;
    for (int k = 0; k < steps; ++k) {
      SCOPED_TRACE(::testing::Message() << "n = " << d.n << ", m = " << d.m << ", p = " << d.p << ", k = " << k);
      filter.advance();
      const Conditioned predicted = condition(c.problem, k, k, c.data),
                        filtered = condition(c.problem, k, k + 1, c.data),
                        next = condition(c.problem, k + 1, k + 1, c.data);
      EXPECT_EQ(predicted.P, filter.step().P_predicted);
      EXPECT_EQ(filtered.P, filter.step().P_filtered);
      EXPECT_EQ(next.P, filter.step().P_next);
      EXPECT_EQ(predicted.x, filter.step().x_predicted);
      EXPECT_EQ(filtered.x, filter.step().x_filtered);
      EXPECT_EQ(next.x, filter.step().x_next);
      determinant *= filter.step().innovation_determinant;
      weighted += filter.step().weighted_innovation;
      EXPECT_EQ(filtered.determinant, determinant);
      EXPECT_EQ(filtered.weighted, weighted);
    }
  }
}

TEST(Conditioning, SmoothsAndRefuses) {
  std::mt19937_64 random(42);
  const ConditionCase c = random_case(random, {2, 1, 1}, 3, 1);
  // What comes later can only help: cov(x_1 | y_0, y_1) - cov(x_1 | y_0, y_1, y_2) is semidefinite.
  const Conditioned filtered = condition(c.problem, 1, 2), smoothed = condition(c.problem, 1, 3);
  EXPECT_GE(filtered.P(0, 0), smoothed.P(0, 0));
  EXPECT_GE(filtered.P(1, 1), smoothed.P(1, 1));
  EXPECT_NE(filtered.P, smoothed.P);
  EXPECT_EQ(filtered.x.size(), 0);

  ExactProblem singular = c.problem;
  singular.models[0].R(0, 0) = 0;
  singular.initial = Matrix<Rational>(singular.initial * Rational(0));
  EXPECT_THROW(condition(singular, 0, 1), ReferenceError);
}

}  // namespace
}  // namespace kfstab::reference::testing
