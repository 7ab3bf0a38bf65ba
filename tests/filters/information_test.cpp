#include <kfstab/filters/information.hpp>

#include <gtest/gtest.h>

#include <cmath>

#include <kfstab/filters/registry.hpp>

#include "filters/plain_recursion.hpp"
#include "filters/random_problem.hpp"
#include "tolerance.hpp"

namespace kfstab::test::information {
namespace {

using Model = InformationModel<double>;

Problem<Model> ordinary(std::uint64_t seed, Case c = {.d = {3, 2, 2}, .period = 3, .inputs = 1}) {
  return std::get<Problem<Model>>(random_problem(Parametrisation::information, c, seed));
}

/// d = Y x to the rounding of a Cholesky solve and of a product: u n k(Y) at most, of |Y| |x|.
void expect_consistent(const InformationFilter<double>& filter) {
  const Matrix<double>& Y = filter.information();
  EXPECT_EQ(Y, Matrix<double>(Y.transpose()));
  const double n = static_cast<double>(Y.rows());
  EXPECT_LE((Y * filter.state() - filter.information_state()).norm(),
            threshold * u * n * Y.norm() * filter.state().norm());
}

}  // namespace

TEST(InformationFilter, KeepsTheInformationStateTrue) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const auto problem = ordinary(seed);
    InformationFilter<double> filter(problem.dimensions());
    filter.start(problem.initial, problem.x0);
    expect_consistent(filter);
    Dice dice(seed);
    const Vector<double> y = dice.vector(2, 32), input = dice.vector(1, 32);
    ASSERT_TRUE(filter.measurement_update(problem.model(0), &y));
    expect_consistent(filter);
    ASSERT_TRUE(filter.step(problem.model(0), problem.model(1), &y, &input));
    expect_consistent(filter);
    ASSERT_TRUE(filter.time_update(problem.model(1), &input));
    expect_consistent(filter);
    // A step without data: the state stays what it was, and so does what d says of it.
    const Vector<double> x = filter.state();
    ASSERT_TRUE(filter.measurement_update(problem.model(2)));
    EXPECT_EQ(filter.state(), x);
    expect_consistent(filter);
    ASSERT_TRUE(filter.step(problem.model(2), problem.model(0)));
    EXPECT_EQ(filter.state(), x);
    expect_consistent(filter);
  }
}

// Data after a step without: the state stayed, as if what was measured had been what was expected.
TEST(InformationFilter, GoesOnFromTheStateOfAStepWithoutData) {
  const auto problem = ordinary(91);
  const Vector<double> y = Dice(92).vector(2, 32), input = Dice(93).vector(1, 32);
  const Vector<double> expected = problem.models[0].C * problem.x0;  // few bits: exact
  InformationFilter<double> filter(problem.dimensions());
  filter.start(problem.initial, problem.x0);
  ASSERT_TRUE(filter.measurement_update(problem.model(0)));
  ASSERT_TRUE(filter.step(problem.model(0), problem.model(1), &y, &input));

  PlainRecursion recursion(problem, *find_filter("information"), u);
  recursion.step(0, &expected, &input);
  recursion.step(1, &y, nullptr);
  const Judgement is = recursion.judge(exact(filter.information()), exact(filter.filter_gain()), exact(filter.state()));
  EXPECT_LE(is.held.ratio(), threshold);
  EXPECT_LE(is.gain.ratio(), threshold);
  EXPECT_LE(is.state.ratio(), threshold);
}

TEST(InformationFilter, StartsFromTheSquareOfTheRoot) {
  const auto problem = ordinary(94);
  InformationFilter<double> filter(problem.dimensions());
  filter.start(problem.initial, problem.x0);
  EXPECT_EQ(filter.information(), Matrix<double>(problem.initial.transpose() * problem.initial));  // few bits: exact
}

// What its numbers cost it: T of condition 1/d, of which T'T has the square. One measurement update, C and R as those
// of Dyer and McReynolds: the square-root form is right where this one has nothing left.
TEST(InformationFilter, LosesTheSquareOfWhatTheRootLoses) {
  for (const int exponent : {8, 16, 22}) {
    const double d = std::ldexp(1., -exponent);
    Problem<Model> problem;
    auto& model = problem.models.emplace_back();
    model.A_inverse = problem.initial = Matrix<double>::Identity(3, 3);
    model.A_inverse_B = Matrix<double>::Zero(3, 1);
    model.C = Matrix<double>::Ones(2, 3);
    model.C(1, 2) += d;
    model.D.resize(3, 0);
    model.Q_inverse_root = Matrix<double>::Identity(1, 1);
    model.R_inverse_root = Matrix<double>::Identity(2, 2) / d;
    problem.x0 = Vector<double>::Zero(3);
    const AnyProblem<double> any = problem;
    double error[2];
    for (const bool root : {false, true}) {
      const char* id = root ? "srif" : "information";
      PlainRecursion recursion(any, *find_filter(id), u);
      recursion.step(0, nullptr, nullptr);
      const auto filter = make_filter<double>(id);
      filter->start(any);
      const auto step = filter->step(0, nullptr, nullptr);
      ASSERT_TRUE(step.report);
      error[root] = (*step.gain - recursion.gain()).norm() / recursion.gain().norm();
    }
    // k(Y) is about 6/d^2 here, k(T) its root; n + m + p = 6.
    EXPECT_LE(error[0], threshold * 6 * u * 6 / (d * d)) << exponent;
    EXPECT_LE(error[1], threshold * 6 * u * 3 / d) << exponent;
    if (exponent == 22) {
      EXPECT_GT(error[0], 100 * error[1]);
    }
  }
}

TEST(InformationFilter, RefusesANoiseOfWhichNothingIsKnown) {
  auto problem = ordinary(95);
  for (auto& model : problem.models) {
    model.Q_inverse_root.setZero();  // Q^{-1} = 0 is all right as long as G'Y G is definite
    model.w_mean.resize(0);
  }
  InformationFilter<double> filter(problem.dimensions());
  filter.start(problem.initial, problem.x0);
  ASSERT_TRUE(filter.measurement_update(problem.model(0)));
  EXPECT_EQ(filter.step(problem.model(0), problem.model(1)).status, Status::ok);
  problem.models[1].A_inverse_B.col(1).setZero();
  const Matrix<double> before = filter.information();
  EXPECT_EQ(filter.step(problem.model(1), problem.model(2)).status, Status::not_positive_definite);
  EXPECT_EQ(filter.time_update(problem.model(1)).status, Status::not_positive_definite);
  EXPECT_EQ(filter.information(), before);
}

// rcond of Y = diag(1, 4^-e) and its limit n^2 u = 4u = 2^-51, which 4^-25 is above and 4^-26 below; with a zero there
// is no Cholesky factorisation.
TEST(InformationFilter, SingularInformationIsToldByRcond) {
  for (const int exponent : {20, 25, 26}) {
    Problem<Model> problem;
    auto& model = problem.models.emplace_back();
    model.A_inverse = Matrix<double>::Identity(2, 2);
    model.A_inverse_B = model.D = Matrix<double>::Zero(2, 0);
    model.Q_inverse_root.resize(0, 0);
    model.C = Matrix<double>::Zero(1, 2);
    model.R_inverse_root = Matrix<double>::Identity(1, 1);
    Matrix<double> T0 = Matrix<double>::Identity(2, 2);
    T0(1, 1) = std::ldexp(1., -exponent);
    InformationFilter<double> filter(model.dimensions());
    filter.start(T0, Vector<double>::Zero(2));
    const auto report = filter.measurement_update(model);
    const double rcond = std::ldexp(1., -2 * exponent);
    EXPECT_EQ(report.status, rcond < 4 * u ? Status::singular_information : Status::ok) << exponent;
    EXPECT_EQ(report.rcond, rcond);
    T0(1, 1) = 0;
    filter.start(T0, Vector<double>::Zero(2));
    EXPECT_EQ(filter.measurement_update(model).status, Status::not_positive_definite);
  }
  const auto problem = ordinary(96);
  InformationFilter<double> strict(problem.dimensions(), .999);
  strict.start(problem.initial, problem.x0);
  EXPECT_EQ(strict.measurement_update(problem.model(0)).status, Status::singular_information);
}

}  // namespace kfstab::test::information
