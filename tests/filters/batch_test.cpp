#include <kfstab/filters/batch.hpp>

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "filters/random_problem.hpp"
#include "filters/with_kernels.hpp"
#include "tolerance.hpp"

namespace kfstab::test {
namespace {

struct Given {
  RootModel<double> model;
  Matrix<double> S0;
  Vector<double> x0, y, Du;
};

Given random_filter(const Dimensions& d, std::uint64_t seed) {
  Dice dice(seed);
  Given is;
  is.model.A = dice.matrix(d.n, d.n, 16);
  is.model.B = dice.matrix(d.n, d.m, 16);
  is.model.C = dice.matrix(d.p, d.n, 16);
  is.model.D.setIdentity(d.n, d.n);
  is.model.Q_root = dice.lower_root(d.m);
  is.model.R_root = dice.lower_root(d.p);
  is.S0 = dice.lower_root(d.n);
  is.x0 = dice.vector(d.n, 16);
  is.y = dice.vector(d.p, 48);
  is.Du = dice.vector(d.n, 16);
  return is;
}

std::vector<Given> random_filters(const Dimensions& d, std::uint64_t count) {
  std::vector<Given> all;
  for (std::uint64_t i = 0; i < count; ++i) all.push_back(random_filter(d, 100 + i));
  return all;
}

SquareRootCovarianceBatch batch_of(const std::vector<Given>& all) {
  SquareRootCovarianceBatch batch(static_cast<Index>(all.size()), all.front().model.dimensions());
  for (Index i = 0; i < batch.count(); ++i) {
    const Given& is = all[static_cast<std::size_t>(i)];
    batch.start(i, is.S0, is.x0);
    batch.set_model(i, is.model);
    batch.set_data(i, is.y, &is.Du);
  }
  return batch;
}

/// Filter i of the batch beside the same filter by itself, after one step of each: S S' to the backward error of two
/// factorisations, the gain and the state to that times the condition number of Re.
void expect_alike(const SquareRootCovarianceBatch& batch, Index i, const Given& is, bool with_data, Wanted wanted) {
  SquareRootCovarianceFilter<double> filter(is.model.dimensions());
  filter.start(is.S0, is.x0);
  const WithKernels with("plain");
  const auto report = filter.step(is.model, with_data ? &is.y : nullptr, with_data ? &is.Du : nullptr, wanted);
  ASSERT_EQ(batch.report(i).status, report.status);
  const auto [n, m, p] = is.model.dimensions();
  const double unit = 0x1p-53 * static_cast<double>(n + m + p);
  const auto differ = [&](const Matrix<double>& X, const Matrix<double>& Y) {
    const double error = (X - Y).norm();
    return error == 0 ? 0 : error / (unit * std::max(X.norm(), Y.norm()));
  };
  const auto squared = [](const Matrix<double>& X) { return Matrix<double>(X.lazyProduct(X.transpose())); };
  SquareRootCovarianceFilter<double> asked(is.model.dimensions());
  asked.start(is.S0, is.x0);
  const double rcond = asked.step(is.model).rcond, kappa = report ? 1 / (rcond * rcond) : 1;
  EXPECT_LE(differ(squared(batch.factor(i)), squared(filter.factor())), threshold * kappa);
  EXPECT_LE(differ(squared(batch.innovation_root(i)), squared(filter.innovation_root())), threshold);
  EXPECT_LE(differ(batch.predictor_gain(i), filter.predictor_gain()), threshold * kappa);
  EXPECT_LE(differ(batch.state(i), filter.state()), threshold * kappa);
  if (wanted == Wanted::all) {
    // An estimate, which signs of columns lead astray, and seldom by more than a factor 3.
    EXPECT_LE(batch.report(i).rcond, 3 * report.rcond);
    EXPECT_GE(3 * batch.report(i).rcond, report.rcond);
  } else {
    EXPECT_TRUE(std::isnan(batch.report(i).rcond));
  }
}

TEST(SquareRootCovarianceBatch, IsSoManyFilters) {
  for (const std::string& isa : all_kernels())
    for (const Dimensions& d : {Dimensions{4, 2, 2}, Dimensions{1, 1, 1}, Dimensions{5, 3, 7}, Dimensions{3, 0, 2},
                                Dimensions{6, 2, 0}, Dimensions{0, 0, 1}, Dimensions{9, 4, 3}})
      for (const bool with_data : {true, false})
        for (const Wanted wanted : {Wanted::all, Wanted::gain, Wanted::factor}) {
          if (with_data && wanted == Wanted::factor) continue;
          SCOPED_TRACE(isa + " n=" + std::to_string(d.n) + " m=" + std::to_string(d.m) + " p=" + std::to_string(d.p));
          const WithKernels with(isa);
          const std::vector<Given> all = random_filters(d, 11);  // one group of eight, and one that is not full
          SquareRootCovarianceBatch batch = batch_of(all);
          batch.step(with_data, wanted);
          for (Index i = 0; i < batch.count(); ++i)
            expect_alike(batch, i, all[static_cast<std::size_t>(i)], with_data, wanted);
        }
}

// Not an estimate: 1 / (|L|_1 |L^{-1}|_1) of the root that it shows. L^{-1} is rounded by p u k(L), rcond by p u.
TEST(SquareRootCovarianceBatch, ComputesTheConditionOfTheInnovations) {
  for (const std::string& isa : all_kernels()) {
    if (isa == "plain") continue;  // does every filter alone, and that estimates
    const WithKernels with(isa);
    for (const Dimensions& d : {Dimensions{4, 2, 2}, Dimensions{1, 1, 1}, Dimensions{5, 3, 7}, Dimensions{9, 4, 3}}) {
      SCOPED_TRACE(isa + " p=" + std::to_string(d.p));
      SquareRootCovarianceBatch batch = batch_of(random_filters(d, 11));
      batch.step();
      for (Index i = 0; i < batch.count(); ++i) {
        const Matrix<double> L = batch.innovation_root(i);
        Matrix<double> inverse = Matrix<double>::Identity(d.p, d.p);
        L.triangularView<Eigen::Lower>().solveInPlace(inverse);
        const auto norm = [](const Matrix<double>& X) { return X.cwiseAbs().colwise().sum().maxCoeff(); };
        const double rcond = 1 / (norm(L) * norm(inverse));
        EXPECT_NEAR(batch.report(i).rcond, rcond, threshold * u * static_cast<double>(d.p)) << i;
      }
    }
  }
}

// One with a NaN, one with a singular Re, one whose squares leave the range and one that is all zeros, among sound ones.
TEST(SquareRootCovarianceBatch, LetsEveryFilterFailForItself) {
  for (const std::string& isa : all_kernels()) {
    SCOPED_TRACE(isa);
    const WithKernels with(isa);
    std::vector<Given> all = random_filters({4, 2, 2}, 10);
    all[1].model.A(2, 1) = std::nan("");
    all[2].model.C.row(1).setZero();
    all[2].model.R_root.row(1).setZero();
    all[4].model.A *= 1e-100;
    all[4].model.B *= 1e-100;
    all[5].model.A.setZero();
    all[5].model.B.setZero();
    all[6].model.A *= 1e100;
    all[6].model.B *= 1e100;
    SquareRootCovarianceBatch batch = batch_of(all);
    batch.step(true);
    for (Index i = 0; i < batch.count(); ++i) {
      SCOPED_TRACE(i);
      const auto at = static_cast<std::size_t>(i);
      if (i == 1 || i == 2) {
        EXPECT_EQ(batch.report(i).status, i == 1 ? Status::non_finite_input : Status::singular_innovation);
        EXPECT_EQ(batch.factor(i), all[at].S0);
        EXPECT_EQ(batch.state(i), all[at].x0);
      } else {
        expect_alike(batch, i, all[at], true, Wanted::all);
      }
    }
  }
}

}  // namespace
}  // namespace kfstab::test
