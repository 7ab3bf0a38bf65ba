#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/fit.hpp>

#include <cmath>

#include <boost/random/mersenne_twister.hpp>
#include <boost/random/normal_distribution.hpp>
#include <gtest/gtest.h>

using namespace kfstab::experiments;

namespace {

/// y[k] = scale factor^k.
std::vector<double> powers(double scale, double factor, int length) {
  std::vector<double> y;
  for (int k = 0; k < length; ++k) y.push_back(scale * std::pow(factor, k));
  return y;
}

}  // namespace

TEST(FitLine, ThroughPointsOfALineIsThatLine) {
  const Line line = fit_line({-2, 0, 1, 5}, {8, 2, -1, -13});
  EXPECT_DOUBLE_EQ(line.slope, -3);
  EXPECT_DOUBLE_EQ(line.intercept, 2);
  EXPECT_EQ(line.points, 4);
}

TEST(FitLine, LeastSquaresByHand) {
  // Means 1 and 4/3: slope (1 * (1/3) + 1 * (5/3)) / 2.
  const Line line = fit_line({0, 1, 2}, {1, 0, 3});
  EXPECT_DOUBLE_EQ(line.slope, 1);
  EXPECT_NEAR(line.intercept, 1. / 3, 4e-16);
}

TEST(FitLine, ConfidenceIntervalByHand) {
  // Squares of the residuals 8/3 on one degree of freedom, of x - mean 2; t = tan(.95 pi/2).
  const Line line = fit_line({0, 1, 2}, {1, 0, 3});
  EXPECT_NEAR(line.half_width, std::tan(.95 * std::acos(-1.) / 2) * std::sqrt(8. / 3 / 2), 1e-9);
  EXPECT_EQ(fit_line({0, 1, 2}, {1, 2, 3}).half_width, 0) << "exactly a line";
  EXPECT_EQ(fit_line({0, 1}, {1, 2}).half_width, infinity) << "any two points are";
}

TEST(FitLine, ConfidenceIntervalHoldsTheSlopeNineteenTimesOutOfTwenty) {
  boost::random::mt19937_64 random(1);
  boost::random::normal_distribution<double> noise;
  int inside = 0;
  const int trials = 2000;
  for (int t = 0; t < trials; ++t) {
    std::vector<double> x, y;
    for (int i = 0; i < 8; ++i) {
      x.push_back(i);
      y.push_back(2 * i + noise(random));
    }
    const Line line = fit_line(x, y);
    inside += std::abs(line.slope - 2) <= line.half_width;
  }
  // Binomial: within five standard deviations.
  EXPECT_NEAR(inside, .95 * trials, 5 * std::sqrt(.95 * .05 * trials));
}

TEST(Quantile, IsLinearBetweenNeighbours) {
  EXPECT_EQ(quantile({4, 1, 3, 2}, 0), 1);
  EXPECT_EQ(quantile({4, 1, 3, 2}, 1), 4);
  EXPECT_EQ(quantile({1, 2, 3, 4, 5}, .25), 2);
  EXPECT_EQ(quantile({10, 20}, .75), 17.5);
  EXPECT_EQ(quantile({1, 2, infinity, infinity}, .25), 1.75);
  EXPECT_EQ(quantile({7}, .3), 7);
  EXPECT_TRUE(std::isnan(quantile({NaN}, .5)));
}

TEST(KeepWorst, NanStays) {
  double worst = 0;
  for (const double value : {1., 3., 2.}) keep_worst(worst, value);
  EXPECT_EQ(worst, 3);
  for (const double value : {NaN, 5.}) keep_worst(worst, value);
  EXPECT_TRUE(std::isnan(worst));
}

TEST(FitLine, OfFewerThanTwoPointsHasNoSlope) {
  EXPECT_TRUE(std::isnan(fit_line({}, {}).slope));
  EXPECT_TRUE(std::isnan(fit_line({1}, {2}).slope));
  EXPECT_EQ(fit_line({1}, {2}).points, 1);
}

TEST(FitLine, OfPointsAboveOneAnotherHasNoSlope) { EXPECT_FALSE(std::isfinite(fit_line({1, 1}, {0, 2}).slope)); }

TEST(FitPower, SlopeIsTheExponent) {
  std::vector<double> x, y;
  for (double d = 1; d < 1e6; d *= 10) {
    x.push_back(d);
    y.push_back(1e-16 * d * d);
  }
  const Line line = fit_power(x, y, 0, 1);
  EXPECT_NEAR(line.slope, 2, 1e-12);
  EXPECT_NEAR(line.intercept, -16, 1e-12);
}

TEST(FitPower, TakesNothingFromOutsideTheWindow) {
  // A floor below, a ceiling above: both ends of the window are left out.
  const std::vector<double> x{1, 10, 100, 1e3, 1e4, 1e5};
  const std::vector<double> y{1e-10, 1e-10, 1e-8, 1e-6, 1e-4, 1e-4};
  const Line line = fit_power(x, y, 1e-10, 1e-4);
  EXPECT_EQ(line.points, 2);
  EXPECT_NEAR(line.slope, 2, 1e-12);
}

TEST(FitPower, IgnoresWhatIsNoNumber) {
  const Line line = fit_power({1, 10, 100, 1e3, 1e4}, {1, NaN, 100, infinity, 1e4}, .1, 1e300);
  EXPECT_EQ(line.points, 3);
  EXPECT_NEAR(line.slope, 1, 1e-12);
}

TEST(FitPower, OfNothingInTheWindowHasNoSlope) { EXPECT_TRUE(std::isnan(fit_power({1, 10}, {1, 10}, 20, 30).slope)); }

TEST(Median, OddEvenAndOrder) {
  EXPECT_EQ(median({3, 1, 2}), 2);
  EXPECT_EQ(median({4, 1, 3, 2}), 2.5);
  EXPECT_EQ(median({5}), 5);
}

TEST(Median, InfinitiesCount) {
  EXPECT_EQ(median({1, infinity, infinity}), infinity);
  EXPECT_EQ(median({1, 2, infinity}), 2);
  EXPECT_EQ(median({1, 2, 3, infinity}), 2.5);
  EXPECT_EQ(median({1, infinity}), infinity);
  EXPECT_EQ(median({-infinity, 1}), -infinity);
  EXPECT_EQ(median({1, 2, infinity, infinity}), infinity);
  EXPECT_EQ(median({infinity, infinity}), infinity);
}

TEST(Median, NanDoesNotCountAndNothingIsNan) {
  EXPECT_EQ(median({NaN, 2, NaN, 4, 9}), 4);
  EXPECT_TRUE(std::isnan(median({})));
  EXPECT_TRUE(std::isnan(median({NaN})));
}

TEST(FitGrowth, OfAnExactPowerIsItsFactor) {
  EXPECT_NEAR(fit_growth(powers(1e-12, 1.1, 200), 1e-13, 1e-4).factor, 1.1, 1e-13);
  EXPECT_NEAR(fit_growth(powers(1e-5, .9, 50), 1e-13, 1e-4).factor, .9, 1e-13);
}

TEST(FitGrowth, SaysHowWellThePointsDetermineIt) {
  EXPECT_LT(fit_growth(powers(1e-12, 1.1, 200), 1e-13, 1e-4).half_width, 1e-12);
  // A log that is off by a alternately: as the line of these points has it, times the factor.
  const double a = .3;
  std::vector<double> y = powers(1e-12, 1.1, 80), x, logs;
  for (std::size_t k = 0; k < y.size(); ++k) y[k] *= std::exp(k % 2 ? a : -a);
  const Growth growth = fit_growth(y, 1e-13, 1e-4);
  for (int k = growth.first; k < growth.last; ++k) {
    x.push_back(k);
    logs.push_back(std::log(y[static_cast<std::size_t>(k)]));
  }
  EXPECT_DOUBLE_EQ(growth.half_width, growth.factor * fit_line(x, logs).half_width);
  EXPECT_GT(growth.half_width, 1e-4);
  EXPECT_EQ(fit_growth({}, .5, 1e9).half_width, infinity) << "nothing is known of it";
}

TEST(FitGrowth, WindowIsFromTheLastTimeBelowLowToTheFirstAboveHigh) {
  // 20 steps of noise at 1e-15, 40 of growth from 1e-12 on, then a plateau at 1.
  std::vector<double> y(20, 1e-15);
  for (const double v : powers(1e-12, 1.5, 40)) y.push_back(v);
  y.insert(y.end(), 100, 1.);
  const Growth growth = fit_growth(y, 1e-13, 1e-3);
  EXPECT_EQ(growth.first, 30);  // a quarter of the 40 is left out
  EXPECT_EQ(growth.last, 60);
  EXPECT_NEAR(growth.factor, 1.5, 1e-13);
}

TEST(FitGrowth, ADipBelowLowStartsTheWindowAnew) {
  std::vector<double> y = powers(1e-12, 1.2, 60);
  y[19] = 1e-20;
  const Growth growth = fit_growth(y, 1e-13, 1);
  EXPECT_EQ(growth.first, 20 + (60 - 20) / 4);
  EXPECT_NEAR(growth.factor, 1.2, 1e-13);
}

TEST(FitGrowth, ATransientInTheFirstQuarterDoesNotColourIt) {
  std::vector<double> y = powers(1e-12, 1.2, 80);
  for (std::size_t k = 0; k < 20; ++k) y[k] *= 1 + 5 / (1. + static_cast<double>(k));
  EXPECT_NEAR(fit_growth(y, 1e-13, 1).factor, 1.2, 1e-13);
}

TEST(FitGrowth, NanAndInfinityEndTheWindow) {
  for (const double end : {NaN, infinity}) {
    std::vector<double> y = powers(1e-12, 1.2, 60);
    y[40] = end;
    const Growth growth = fit_growth(y, 1e-13, 1);
    EXPECT_EQ(growth.last, 40);
    EXPECT_NEAR(growth.factor, 1.2, 1e-13);
  }
}

TEST(FitGrowth, NeedsEightPoints) {
  // 10 points less a quarter are 8, 9 less a quarter 7.
  EXPECT_NEAR(fit_growth(powers(1, 2, 10), .5, 1e9).factor, 2, 1e-12);
  EXPECT_TRUE(std::isnan(fit_growth(powers(1, 2, 9), .5, 1e9).factor));
  EXPECT_TRUE(std::isnan(fit_growth({}, .5, 1e9).factor));
  EXPECT_TRUE(std::isnan(fit_growth(powers(1e-20, 1.1, 100), 1e-13, 1).factor)) << "never above low";
}
