#include <kfstab/filters/svd.hpp>

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include <kfstab/filters/registry.hpp>

#include "filters/plain_recursion.hpp"
#include "filters/random_problem.hpp"
#include "filters/split_filter.hpp"
#include "tolerance.hpp"

namespace kfstab::test::svd {
namespace {

void expect_orthogonal_columns(const Matrix<double>& F, const char* when) {
  for (Index j = 0; j < F.cols(); ++j)
    for (Index i = 0; i < j; ++i) {
      EXPECT_LE(std::abs(F.col(i).dot(F.col(j))),
                threshold * u * static_cast<double>(F.rows()) * F.col(i).norm() * F.col(j).norm())
          << when << ": columns " << i << ", " << j;
      EXPECT_GE(F.col(i).norm() * (1 + threshold * u), F.col(j).norm()) << when;
    }
}

void expect_followed(const AnyProblem<double>& problem, int steps) {
  PlainRecursion recursion(problem, *find_filter("svd"), u);
  const auto filter = make_filter<double>("svd");
  filter->start(problem);
  const auto [n, m, p] = std::visit([](const auto& given) { return given.dimensions(); }, problem);
  Dice dice(101);
  for (int k = 0; k < steps; ++k) {
    const Vector<double> y = dice.vector(p, 48);
    recursion.step(k, &y, nullptr);
    const auto step = filter->step(k, &y, nullptr);
    ASSERT_EQ(step.report.status, Status::ok) << name(step.report.status);
    const Judgement is = recursion.judge(exact(*step.held), exact(*step.gain), exact(*step.state));
    EXPECT_LE(is.held.ratio(), threshold) << "step " << k;
    EXPECT_LE(is.gain.ratio(), threshold) << "step " << k;
    EXPECT_LE(is.state.ratio(), threshold) << "step " << k;
  }
}

Problem<RootModel<double>> dyer_mcreynolds(double d) {
  Problem<RootModel<double>> problem;
  auto& model = problem.models.emplace_back();
  model.A = problem.initial = Matrix<double>::Identity(3, 3);
  model.B = Matrix<double>::Zero(3, 1);
  model.C = Matrix<double>::Ones(2, 3);
  model.C(1, 2) += d;
  model.D.resize(3, 0);
  model.Q_root = Matrix<double>::Identity(1, 1);
  model.R_root = d * Matrix<double>::Identity(2, 2);
  problem.x0 = Vector<double>::Zero(3);
  return problem;
}

}  // namespace

TEST(SvdFilter, HoldsOrthogonalColumnsAfterEachCall) {
  for (const bool singular : {false, true})
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const auto problem =
          random_problem(Parametrisation::root, {.d = {5, 2, 3}, .period = 2, .singular = singular}, seed);
      const auto filter = make_split_filter("svd");
      filter->start(problem);
      expect_orthogonal_columns(filter->held(), "start");
      ASSERT_TRUE(filter->measurement_update(0, nullptr));
      expect_orthogonal_columns(filter->held(), "measurement update");
      ASSERT_TRUE(filter->time_update(0, nullptr));
      expect_orthogonal_columns(filter->held(), "time update");
      ASSERT_TRUE(filter->step(1, nullptr, nullptr));
      expect_orthogonal_columns(filter->held(), "step");
    }
}

TEST(SvdFilter, StartsFromARootOfTheSame) {
  for (const Index n : {0, 1, 4}) {
    const Matrix<double> S0 = Dice(102).lower_root(n);
    SvdFilter<double> filter(Dimensions{n, 0, 0});
    filter.start(S0, Vector<double>::Zero(n));
    const Matrix<double>& F = filter.covariance_root();
    EXPECT_LE((F * F.transpose() - S0 * S0.transpose()).norm(),
              threshold * u * static_cast<double>(2 * n) * S0.squaredNorm());
  }
}

// Nothing but Re is inverted: R without full rank, or 0, no noise at all, nothing unknown.
TEST(SvdFilter, TakesSingularCovariances) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const AnyProblem<double> any = random_problem(Parametrisation::root, {.d = {4, 2, 2}, .period = 2}, seed);
    for (const char* what : {"R", "half of R", "P0", "Q", "A"}) {
      SCOPED_TRACE(std::string(what) + " seed=" + std::to_string(seed));
      auto problem = std::get<Problem<RootModel<double>>>(any);
      if (what[0] == 'P') problem.initial.setZero();
      for (auto& model : problem.models) {
        if (what[0] == 'R') model.R_root.setZero();
        if (what[0] == 'h') model.R_root.row(0).setZero();
        if (what[0] == 'Q') model.Q_root.setZero();
        if (what[0] == 'A') model.A.setZero();
      }
      if (what[0] == 'R') problem.models[1].R_root = Dice(seed).lower_root(2);
      expect_followed(problem, what[0] == 'R' ? 1 : 4);
    }
  }
}

// With R = 0 the measured directions are known for certain: P_{k|k} has none of them left but rounding.
TEST(SvdFilter, AnExactMeasurementLeavesNothingOfWhatItMeasured) {
  const auto any = random_problem(Parametrisation::root, {.d = {4, 2, 2}}, 103);
  auto problem = std::get<Problem<RootModel<double>>>(any);
  auto& model = problem.models[0];
  model.R_root.setZero();
  SvdFilter<double> filter(problem.dimensions());
  filter.start(problem.initial, problem.x0);
  const double before = filter.covariance_root().norm();
  const auto report = filter.measurement_update(model);
  ASSERT_TRUE(report);
  const Matrix<double> CF = model.C * filter.covariance_root();
  EXPECT_LE(CF.norm(), threshold * u * 8 * model.C.norm() * before / report.rcond);  // n + m + p = 8, k(Re^{1/2})
}

// rcond is s_p/s_1 of Re^{1/2}: of [R^{1/2} C S] = [r I  C], C = diag(c1, c2).
TEST(SvdFilter, ReportsTheRatioOfTheSingularValues) {
  Problem<RootModel<double>> problem;
  auto& model = problem.models.emplace_back();
  model.A = model.B = model.Q_root = problem.initial = Matrix<double>::Identity(2, 2);
  model.C = Matrix<double>::Zero(2, 2);
  model.C(0, 1) = 4;
  model.D.resize(2, 0);
  model.R_root = 3 * Matrix<double>::Identity(2, 2);
  problem.x0 = Vector<double>::Zero(2);
  SvdFilter<double> filter(problem.dimensions()), strict(problem.dimensions(), .7);
  filter.start(problem.initial, problem.x0);
  strict.start(problem.initial, problem.x0);
  const auto report = filter.step(model);
  EXPECT_EQ(report.status, Status::ok);
  EXPECT_NEAR(report.rcond, .6, 16 * u);
  EXPECT_EQ(strict.step(model).status, Status::singular_innovation);
}

// As a square-root filter's, the error goes with k(Re^{1/2}), about 4/d here, and not with its square.
TEST(SvdFilter, LosesTheRootOfWhatCovarianceFiltersLose) {
  for (const int exponent : {8, 16, 26, 35, 44}) {
    const double d = std::ldexp(1., -exponent);
    const AnyProblem<double> any = dyer_mcreynolds(d);
    PlainRecursion recursion(any, *find_filter("svd"), u);
    const auto filter = make_filter<double>("svd");
    filter->start(any);
    recursion.step(0, nullptr, nullptr);
    const auto step = filter->step(0, nullptr, nullptr);
    ASSERT_TRUE(step.report);
    const Judgement is = recursion.judge(exact(*step.held), exact(*step.gain), {});
    SCOPED_TRACE("d = 2^-" + std::to_string(exponent));
    EXPECT_LE(is.held.error / recursion.covariance().norm(), threshold * 6 * u * 4 / d);
    EXPECT_LE(is.gain.error / recursion.gain().norm(), threshold * 6 * u * 4 / d);
  }
}

}  // namespace kfstab::test::svd
