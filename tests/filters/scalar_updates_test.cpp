// UdFilter, PotterFilter, CarlsonFilter: the updates that they are made of, and what they add to the recursion that
// every filter follows (instances_*_test.cpp): correlated noise, shapes, a covariance without full rank.
#include <kfstab/filters/scalar_updates.hpp>

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>

#include <kfstab/filters/carlson.hpp>
#include <kfstab/filters/potter.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/filters/ud.hpp>

#include "filters/guarded.hpp"
#include "filters/high_precision.hpp"
#include "filters/plain_recursion.hpp"
#include "filters/random_problem.hpp"
#include "filters/split_filter.hpp"
#include "tolerance.hpp"

namespace kfstab::test::scalar_updates {
namespace {

constexpr std::array<std::string_view, 3> ids{"ud", "potter", "carlson"};

using High = Matrix<HighPrecision>;

/// L D L' of high precision, D = I if there is none.
template <class S>
High square(const Matrix<S>& L, const Vector<S>* D = nullptr) {
  High P = High::Zero(L.rows(), L.rows());
  for (Index k = 0; k < L.cols(); ++k)
    for (Index j = 0; j < L.rows(); ++j)
      for (Index i = 0; i < L.rows(); ++i)
        P(i, j) += HighPrecision(L(i, k)) * (D ? HighPrecision((*D)(k)) : HighPrecision(1)) * HighPrecision(L(j, k));
  return P;
}

template <class S>
High covariance_of_ud(const Matrix<S>& UD) {
  Matrix<S> U = UD;
  Vector<S> D(UD.rows());
  for (Index j = 0; j < UD.rows(); ++j) {
    D(j) = UD(j, j);
    U(j, j) = S(1);
    for (Index i = j + 1; i < UD.rows(); ++i) U(i, j) = S(0);
  }
  return square(U, &D);
}

double distance(const High& X, const High& Y) {
  HighPrecision sum = 0;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) {
      const HighPrecision d = X(i, j) - Y(i, j);
      sum += d * d;
    }
  return static_cast<double>(HighPrecision(sqrt(sum)));
}

/// P - k phi' P and k, exactly.
struct Updated {
  High P, k;
  double alpha;
};
Updated updated(const High& P, const Vector<double>& phi) {
  const Index n = P.rows();
  High Pphi = High::Zero(n, 1);
  HighPrecision alpha = 1;
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < n; ++j) Pphi(i, 0) += P(i, j) * HighPrecision(phi(j));
    alpha += HighPrecision(phi(i)) * Pphi(i, 0);
  }
  Updated to{P, Pphi, static_cast<double>(alpha)};
  for (Index i = 0; i < n; ++i) {
    to.k(i, 0) /= alpha;
    for (Index j = 0; j < n; ++j) to.P(i, j) -= Pphi(i, 0) * Pphi(j, 0) / alpha;
  }
  return to;
}

/// The bounds of one scalar update, u n (1 + |S| |phi|) against |S|^2 and |S| (reasons: plain_recursion_test.cpp).
template <class S>
void expect_updated(const Updated& truth, const High& P, const Vector<S>& k, const S& alpha, const High& P0,
                    const Vector<double>& phi) {
  double trace = 0;
  for (Index i = 0; i < P0.rows(); ++i) trace += static_cast<double>(P0(i, i));
  const double s = std::sqrt(trace), loss = 1 + s * phi.norm();
  const double unit = static_cast<double>(unit_roundoff<S>()) * static_cast<double>(P0.rows() + 1);
  High gain(k.size(), 1);
  for (Index i = 0; i < k.size(); ++i) gain(i, 0) = HighPrecision(k(i));
  EXPECT_LE(distance(P, truth.P), threshold * unit * loss * s * s);
  EXPECT_LE(distance(gain, truth.k), threshold * unit * loss * s);
  EXPECT_NEAR(static_cast<double>(alpha), truth.alpha, threshold * unit * loss * loss);
}

/// Of full rank, with columns of zeros, and none.
Matrix<double> root(Dice& dice, Index n, int kind) {
  Matrix<double> S = dice.lower_root(n);
  if (kind == 1 && n > 0) S.col(n / 2).setZero();
  if (kind == 2) S.setZero();
  return S;
}

}  // namespace

template <class S>
class ScalarUpdate : public ::testing::Test {};
using Scalars = ::testing::Types<float, double, long double, HighPrecision>;
TYPED_TEST_SUITE(ScalarUpdate, Scalars);

TYPED_TEST(ScalarUpdate, OfPotterCarlsonAndBiermanIsTheKalmanUpdate) {
  using S = TypeParam;
  for (std::uint64_t seed = 1; seed <= 5; ++seed)
    for (const Index n : {0, 1, 2, 3, 7})
      for (const int kind : {0, 1, 2}) {
        SCOPED_TRACE("n=" + std::to_string(n) + " seed=" + std::to_string(seed) + " kind=" + std::to_string(kind));
        Dice dice(seed);
        const Matrix<double> L = root(dice, n, kind), full = dice.matrix(n, n, 16);
        Vector<double> phi = dice.vector(n, 48);
        if (seed == 5) phi *= 1024;
        const Vector<S> phi_rounded = cast<S>(phi);
        Vector<S> f(n), k(n);

        Matrix<S> F = cast<S>(full);
        S alpha = potter_update(phi_rounded, F, f, k);
        expect_updated(updated(square(full), phi), square(F), k, alpha, square(full), phi);

        Guarded<S> lower(cast<S>(L), Allowed::lower);
        alpha = carlson_update(phi_rounded, lower, f, k);
        expect_updated(updated(square(L), phi), square(lower.values()), k, alpha, square(L), phi);

        Matrix<double> UD = L.transpose();
        UD.diagonal() = UD.diagonal().cwiseAbs();
        const High P0 = covariance_of_ud(UD);
        Guarded<S> upper(cast<S>(UD), Allowed::upper);
        alpha = bierman_update(phi_rounded, upper, f, k);
        expect_updated(updated(P0, phi), covariance_of_ud(upper.values()), k, alpha, P0, phi);
        for (Index j = 0; j < n; ++j) EXPECT_GE(upper(j, j), S(0));
      }
}

TYPED_TEST(ScalarUpdate, GramSchmidtInWeightsGivesUAndD) {
  using S = TypeParam;
  for (std::uint64_t seed = 1; seed <= 5; ++seed)
    for (const Index n : {0, 1, 3, 6})
      for (const Index extra : {0, 1, 4})
        for (const int kind : {0, 1, 2, 3}) {
          Dice dice(seed);
          const Index c = n + extra;
          Matrix<double> W = dice.matrix(n, c, 16);
          Vector<double> D = dice.vector(c, 16).cwiseAbs();
          if (kind == 1) D.head(n / 2).setZero();
          if (kind == 2 && n > 1) W.row(0) = W.row(n - 1);
          if (kind == 3) D.setZero();
          Matrix<S> work = cast<S>(W);
          const Vector<S> weights = cast<S>(D);
          Matrix<S> UD = Matrix<S>::Constant(n, n, S(7));
          weighted_gram_schmidt(work, weights, UD);
          for (Index j = 0; j < n; ++j) {
            EXPECT_GE(UD(j, j), S(0));
            for (Index i = j + 1; i < n; ++i) EXPECT_EQ(UD(i, j), S(0));
          }
          const High P = square(W, &D);
          double trace = 0;
          for (Index i = 0; i < n; ++i) trace += static_cast<double>(P(i, i));
          EXPECT_LE(distance(covariance_of_ud(UD), P),
                    threshold * static_cast<double>(unit_roundoff<S>()) * static_cast<double>(n + c) * trace);
          if (kind == 3) {
            EXPECT_EQ(UD, Matrix<S>::Zero(n, n));
          }
        }
}

// Rows that are small in all come out with digits of their own: d_1 is 2^-120 of d_2, and right to a few u.
TEST(GramSchmidt, KeepsSmallRows) {
  Matrix<double> W(2, 3), UD(2, 2);
  W << 0x1p-60, 0, 0x1p-60, 1, 2, 0;
  const Vector<double> D = Vector<double>::Ones(3);
  weighted_gram_schmidt(W, D, UD);
  EXPECT_EQ(UD(1, 1), 5);
  EXPECT_NEAR(UD(0, 1), 0x1p-60 / 5, 4 * u * 0x1p-60);
  EXPECT_NEAR(UD(0, 0), 0x1p-120 * 9 / 5, 16 * u * 0x1p-120);
}

TEST(ScalarUpdates, FollowTheRecursionUnderCorrelatedAndIllConditionedNoise) {
  for (const auto id : ids)
    for (const int exponent : {0, 10, 20, 30})
      for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        SCOPED_TRACE(std::string(id) + " 2^-" + std::to_string(exponent) + " seed=" + std::to_string(seed));
        AnyProblem<double> problem =
            random_problem(Parametrisation::root, {.d = {4, 2, 3}, .period = 3, .inputs = 1, .singular = true}, seed);
        for (auto& model : std::get<Problem<RootModel<double>>>(problem).models) {
          model.R_root << 1, 0, 0, .75, std::ldexp(1., -exponent), 0, -.5, .25, .5;
        }
        PlainRecursion recursion(problem, *find_filter(id), u);
        const auto filter = make_filter<double>(id);
        filter->start(problem);
        Dice dice(81);
        for (int k = 0; k < 5; ++k) {
          const Vector<double> y = dice.vector(3, 48), input = dice.vector(1, 16);
          recursion.step(k, &y, &input);
          const auto step = filter->step(k, &y, &input);
          ASSERT_TRUE(step.report);
          const Judgement is = recursion.judge(exact(*step.held), exact(*step.gain), exact(*step.state));
          EXPECT_LE(is.held.ratio(), threshold) << "step " << k;
          EXPECT_LE(is.gain.ratio(), threshold) << "step " << k;
          EXPECT_LE(is.state.ratio(), threshold) << "step " << k;
        }
      }
}

// The update of Dyer and McReynolds, where each form that holds P fails from d = 2^-26 on: factored forms are alike,
// and lose 1/d. The recursion gives the truth here, its bounds play no part.
TEST(ScalarUpdates, LoseTheRootOfWhatCovarianceFiltersLose) {
  for (const auto id : ids)
    for (const int exponent : {8, 16, 26, 35, 44}) {
      const double d = std::ldexp(1., -exponent);
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
      const AnyProblem<double> any = problem;
      PlainRecursion recursion(any, *find_filter(id), u);
      const auto filter = make_filter<double>(id);
      filter->start(any);
      recursion.step(0, nullptr, nullptr);
      const auto step = filter->step(0, nullptr, nullptr);
      ASSERT_TRUE(step.report);
      const Judgement is = recursion.judge(exact(*step.held), exact(*step.gain), {});
      SCOPED_TRACE(std::string(id) + ", d = 2^-" + std::to_string(exponent));
      // n + m + p = 6; |P|, |Phi| |S| of order 1, 4/d.
      EXPECT_LE(is.held.error / recursion.covariance().norm(), threshold * 6 * u * 4 / d);
      EXPECT_LE(is.gain.error / recursion.gain().norm(), threshold * 6 * u * 4 / d);
    }
}

TEST(ScalarUpdates, KeepTheShapeAfterEachCall) {
  const auto any = random_problem(Parametrisation::root, {.d = {4, 2, 3}}, 82);
  for (const auto id : ids) {
    const auto filter = make_split_filter(id);
    filter->start(any);
    const auto check = [&](const char* when) {
      const Matrix<double>& X = filter->held();
      for (Index j = 0; j < 4; ++j)
        for (Index i = 0; i < j; ++i) EXPECT_EQ(id == "ud" ? X(j, i) : X(i, j), 0) << id << " " << when;
    };
    check("start");
    ASSERT_TRUE(filter->measurement_update(0, nullptr));
    check("measurement update");
    ASSERT_TRUE(filter->time_update(0, nullptr));
    check("time update");
    ASSERT_TRUE(filter->step(0, nullptr, nullptr));
    check("step");
  }
}

// U and D of S0 come without S0 S0': 1 + 2^-60 would be 1.
TEST(UdFilter, StartsFromTheRoot) {
  Matrix<double> S0(2, 2);
  S0 << 0x1p-30, 0, 1, 1;
  UdFilter<double> filter(Dimensions{2, 0, 0});
  filter.start(S0, Vector<double>::Zero(2));
  // P0 = [2^-60 2^-30; 2^-30 2].
  const Matrix<double>& UD = filter.ud_factors();
  EXPECT_EQ(UD(1, 1), 2);
  EXPECT_EQ(UD(0, 1), 0x1p-31);
  EXPECT_EQ(UD(0, 0), 0x1p-61);
  EXPECT_EQ(UD(1, 0), 0);

  filter.start(Matrix<double>::Zero(2, 2), Vector<double>::Zero(2));
  EXPECT_EQ(filter.ud_factors(), Matrix<double>::Zero(2, 2));
}

TEST(ScalarUpdates, ReportTheConditionOfTheNoise) {
  for (const auto id : ids) {
    AnyProblem<double> any = random_problem(Parametrisation::root, {.d = {3, 1, 2}}, 83);
    std::get<Problem<RootModel<double>>>(any).models[0].R_root << 1, 0, 0, 0x1p-20;
    const auto filter = make_filter<double>(id);
    filter->start(any);
    const auto report = filter->step(0, nullptr, nullptr).report;
    EXPECT_EQ(report.status, Status::ok);
    EXPECT_EQ(report.rcond, 0x1p-20);
  }
}

template <class Filter>
void tolerance_counts() {
  const auto any = random_problem(Parametrisation::root, {.d = {3, 1, 2}}, 84);
  auto problem = std::get<Problem<RootModel<double>>>(any);
  problem.models[0].R_root << 1, 0, 0, .5;
  Filter strict({3, 1, 2}, .6), usual({3, 1, 2});
  strict.start(problem.initial, problem.x0);
  usual.start(problem.initial, problem.x0);
  EXPECT_EQ(strict.step(problem.models[0]).status, Status::singular_measurement_noise);
  EXPECT_EQ(strict.measurement_update(problem.models[0]).status, Status::singular_measurement_noise);
  EXPECT_EQ(usual.step(problem.models[0]).status, Status::ok);
}

TEST(ScalarUpdates, ToleranceOfTheConstructorReplacesTheDefault) {
  tolerance_counts<UdFilter<double>>();
  tolerance_counts<PotterFilter<double>>();
  tolerance_counts<CarlsonFilter<double>>();
}

// f'f overflows where neither f nor S does. Divided by it the gain would be 0, and P what it was.
TEST(ScalarUpdates, AnInfiniteVarianceIsAnOverflow) {
  Problem<RootModel<double>> problem;
  auto& model = problem.models.emplace_back();
  model.A = model.C = model.Q_root = model.R_root = problem.initial = Matrix<double>::Identity(2, 2);
  model.C(0, 0) = 0x1p+600;
  model.B = Matrix<double>::Zero(2, 2);
  model.D.resize(2, 0);
  problem.x0 = Vector<double>::Zero(2);
  const AnyProblem<double> any = problem;
  for (const auto id : ids) {
    const auto filter = make_filter<double>(id);
    filter->start(any);
    EXPECT_EQ(filter->step(0, nullptr, nullptr).report.status, Status::overflow) << id;
  }
}

}  // namespace kfstab::test::scalar_updates
