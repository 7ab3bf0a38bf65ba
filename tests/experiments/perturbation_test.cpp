#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/perturbation.hpp>

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/precise.hpp>
#include <kfstab/reference/trajectory.hpp>

using namespace kfstab;
using namespace kfstab::experiments;

namespace {

properties::System drawn(std::uint64_t seed, std::int64_t steps) {
  Random random(seed);
  auto system = random_system(random, {3, 2, 2}, .9, steps);
  system.P0 = {properties::Covariance::Written::covariance,
               Matrix<double>{{2., .5, .25}, {.5, 1., 0.}, {.25, 0., 1.5}}};
  return system;
}

const Matrix<double> dP{{1e-3, 2e-4, 0.}, {2e-4, -1e-3, 5e-4}, {0., 5e-4, 3e-4}};

}  // namespace

// What each filter of the registry holds after a step is, as P, the truth up to its rounding.
TEST(Perturbation, CovarianceOfWhateverIsHeld) {
  const auto system = drawn(1, 2);
  for (const Metadata& metadata : filters()) {
    if (metadata.holds == Held::gain) continue;
    const auto problem = problem_of(system, metadata.takes);
    reference::Trajectory truth(problem, nullptr);
    truth.advance();
    const auto filter = make_filter<double>(metadata.id);
    filter->start(problem);
    const auto step = filter->step(0, nullptr, nullptr);
    const auto& P = metadata.instant == Instant::predicted ? truth.truth().P_next : truth.truth().P_filtered;
    // Well conditioned: 30 u (n + m + p) times k(P) to the second power, for what holds P^{-1} and is inverted here.
    EXPECT_LT((covariance_of(metadata, *step.held) - P).norm() / P.norm(), 30 * u * 7 * 1e3) << metadata.id;
  }
}

TEST(Perturbation, NoDisturbanceNoDifference) {
  const auto system = drawn(2, 5);
  for (const Metadata* metadata : forgetful_filters())
    for (const auto& difference : deviations(*metadata, system, {}, {}, {})) {
      EXPECT_EQ(difference.P.norm(), 0) << metadata->id;
      EXPECT_EQ(difference.gain.norm(), 0) << metadata->id;
      EXPECT_EQ(difference.x.size(), 0) << "no data";
    }
}

// To first order; the residual is of second order in dP, 1e-3, relative to dP.
TEST(Perturbation, DifferencesGoByTheTransitions) {
  const auto system = drawn(3, 6);
  const auto Phi = transitions(system);
  ASSERT_EQ(Phi.predicted.size(), 6u);
  ASSERT_EQ(Phi.filtered.size(), 6u);
  for (const Metadata* metadata : forgetful_filters()) {
    const auto measured = deviations(*metadata, system, dP, {}, {});
    ASSERT_EQ(measured.size(), 6u) << metadata->id;
    for (std::size_t k = 0; k < 6; ++k) {
      const auto& T = Phi.of(metadata->instant)[k];
      const Matrix<double> predicted = carried(T, dP, T);
      EXPECT_LT((measured[k].P - predicted).norm(), 1e-2 * predicted.norm()) << metadata->id << ", step " << k;
      EXPECT_GT((measured[k].P + predicted).norm(), predicted.norm()) << "the sign counts";
    }
  }
}

// With equal P the difference of two estimates goes by the closed loops, exactly.
TEST(Perturbation, AnEstimateGoesByTheTransitionsToo) {
  const auto system = drawn(4, 4);
  Random random(1);
  const Matrix<double> y = random_normal(random, 2, 4);
  const Vector<double> dx{{1., -2., .5}};
  const auto Phi = transitions(system);
  for (const Metadata* metadata : forgetful_filters()) {
    const auto measured = deviations(*metadata, system, {}, dx, y);
    ASSERT_EQ(measured.size(), 4u);
    for (std::size_t k = 0; k < 4; ++k) {
      const Vector<double> predicted = Phi.of(metadata->instant)[k] * dx;
      EXPECT_LT((measured[k].x - predicted).norm(), 30 * u * 7 * 1e3 * dx.norm()) << metadata->id << ", step " << k;
      EXPECT_EQ(measured[k].P.norm(), 0) << metadata->id;
    }
  }
}

// However large: dP_k = Phi dP (I + W dP)^{-1} Phi', W = sum of Phi_j' C' Re^{-1} C Phi_j (theory 3).
TEST(Perturbation, ALargeErrorGoesByTheExactFormula) {
  const std::int64_t steps = 4;
  const auto system = drawn(5, steps);
  const Matrix<double> large = 700 * dP, I = Matrix<double>::Identity(3, 3);
  const auto Phi = transitions(system);
  const auto problem = problem_of(system, Parametrisation::covariance);
  reference::Trajectory truth(problem, nullptr);
  Matrix<double> W = Matrix<double>::Zero(3, 3), before = I;
  const auto measured = deviations(*find_filter("ckf"), system, large, {}, {});
  ASSERT_EQ(measured.size(), 4u);
  for (std::size_t k = 0; k < 4; ++k) {
    truth.advance();
    const Matrix<double> CPhi = system.C.matrices.front() * before;
    const properties::Precise Re(truth.truth().innovation);
    W += carried(CPhi.transpose(), Re.inverse()->rounded(), CPhi.transpose());
    before = Phi.predicted[k];
    const Matrix<double> inverse = properties::Precise(I + W * large).inverse()->rounded();
    const Matrix<double> exact = carried(before * large, inverse, before), linear = carried(before, large, before);
    EXPECT_LT((measured[k].P - exact).norm(), 30 * u * 7 * 1e3 * large.norm()) << k;
    EXPECT_GT((measured[k].P - linear).norm(), .1 * linear.norm()) << "first order is not enough here, step " << k;
  }
}

TEST(Perturbation, NoiseIsWhatIsLeftInTheEnd) {
  std::vector<double> sizes;
  for (int k = 0; k < 60; ++k) sizes.push_back(std::exp2(-k) + (k % 2) * 0x1p-38);
  EXPECT_EQ(noise(sizes), std::exp2(-41) + 0x1p-38);
  EXPECT_EQ(noise({3, 5, 4}), 5) << "all of a short run";
  EXPECT_EQ(noise({}), 0);
  sizes[50] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::isnan(noise(sizes)));
}

TEST(Perturbation, CarriedIsXYZTransposed) {
  const Matrix<double> X{{1., 2.}, {0., 1.}}, Y{{1., 0.}, {3., 1.}}, Z{{0., 1.}, {1., 1.}};
  EXPECT_EQ(carried(X, Y, Z), (Matrix<double>{{2., 9.}, {1., 4.}}));
}
