#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/series.hpp>

#include <algorithm>
#include <cmath>

#include <malloc.h>

#include <gtest/gtest.h>

using namespace kfstab::experiments;

namespace {

/// Distinct values without order: the golden ratio's multiples, modulo 1.
double scattered(std::int64_t k) { return std::fmod(static_cast<double>(k) * .6180339887498949, 1.); }

Series scattered_series(std::int64_t length) {
  Series series;
  for (std::int64_t k = 0; k < length; ++k) series.add(k, scattered(k));
  return series;
}

void expect_rising_steps(const Series::Points& points) {
  ASSERT_EQ(points.step.size(), points.value.size());
  for (std::size_t i = 1; i < points.step.size(); ++i) ASSERT_LT(points.step[i - 1], points.step[i]) << "point " << i;
}

bool holds_point(const Series::Points& points, double step, double value) {
  const auto at = std::ranges::find(points.step, step);
  return at != points.step.end() && points.value[static_cast<std::size_t>(at - points.step.begin())] == value;
}

}  // namespace

TEST(Series, OfNothingHasNoPointsAndNoNumbers) {
  const Series series;
  EXPECT_EQ(series.count(), 0);
  EXPECT_TRUE(series.points().step.empty());
  EXPECT_TRUE(series.points().value.empty());
  EXPECT_TRUE(std::isnan(series.last()));
  EXPECT_TRUE(std::isnan(series.largest()));
  EXPECT_TRUE(std::isnan(series.smallest()));
}

TEST(Series, OfOnePointIsThatPoint) {
  Series series;
  series.add(3, -2.5);
  EXPECT_EQ(series.points().step, std::vector<double>{3});
  EXPECT_EQ(series.points().value, std::vector<double>{-2.5});
  EXPECT_EQ(series.last(), -2.5);
  EXPECT_EQ(series.largest(), -2.5);
  EXPECT_EQ(series.smallest(), -2.5);
}

TEST(Series, KeepsEveryPointUpToItsCapacity) {
  const auto length = static_cast<std::int64_t>(Series::capacity);
  const auto points = scattered_series(length).points();
  ASSERT_EQ(points.step.size(), Series::capacity);
  for (std::int64_t k = 0; k < length; ++k) {
    ASSERT_EQ(points.step[static_cast<std::size_t>(k)], static_cast<double>(k));
    ASSERT_EQ(points.value[static_cast<std::size_t>(k)], scattered(k));
  }
}

TEST(Series, KeepsEqualValuesAndGapsUpToItsCapacity) {
  Series series;
  for (std::size_t k = 0; k < Series::capacity; ++k) series.add(static_cast<std::int64_t>(k), k % 3 == 1 ? NaN : 7);
  const auto points = series.points();
  ASSERT_EQ(points.step.size(), Series::capacity);
  for (std::size_t k = 0; k < Series::capacity; ++k) ASSERT_EQ(std::isnan(points.value[k]), k % 3 == 1) << k;
}

TEST(Series, StepsNeedNotStartAtZeroNorBeNeighbours) {
  Series series;
  for (std::int64_t k = 5; k < 30000; k += 2) series.add(k, static_cast<double>(k));
  const auto points = series.points();
  expect_rising_steps(points);
  EXPECT_EQ(points.step.front(), 5);
  EXPECT_EQ(points.step.back(), 29999);
  EXPECT_EQ(points.value, points.step);
}

TEST(Series, ThinsToTheFirstTheLastAndTheExtremes) {
  // Lengths on both sides of each thinning, and in the middle of a stretch.
  for (const std::int64_t length : {10001, 12345, 15000, 20000, 20001, 99999, 160007}) {
    SCOPED_TRACE(length);
    Series series;
    const std::int64_t low = length / 3, high = length / 2 + 1;
    for (std::int64_t k = 0; k < length; ++k)
      series.add(k, k == low ? -100 : k == high ? 100 : k == 0 ? .25 : k + 1 == length ? .75 : scattered(k));
    const auto points = series.points();
    expect_rising_steps(points);
    EXPECT_EQ(series.count(), length);
    EXPECT_LE(points.step.size(), Series::capacity + 2);
    EXPECT_GE(points.step.size(), Series::capacity / 4);
    EXPECT_EQ(points.step.front(), 0);
    EXPECT_EQ(points.value.front(), .25);
    EXPECT_EQ(points.step.back(), static_cast<double>(length - 1));
    EXPECT_EQ(points.value.back(), .75);
    EXPECT_TRUE(holds_point(points, static_cast<double>(low), -100));
    EXPECT_TRUE(holds_point(points, static_cast<double>(high), 100));
    EXPECT_EQ(series.smallest(), -100);
    EXPECT_EQ(series.largest(), 100);
    EXPECT_EQ(series.last(), .75);
  }
}

TEST(Series, EveryThinnedPointWasAdded) {
  const auto points = scattered_series(54321).points();
  for (std::size_t i = 0; i < points.step.size(); ++i)
    ASSERT_EQ(points.value[i], scattered(static_cast<std::int64_t>(points.step[i])));
}

TEST(Series, ASpikeIsSeenWhereverItStands) {
  for (std::int64_t spike = 0; spike < 30011; spike += 997) {
    Series series;
    for (std::int64_t k = 0; k < 30011; ++k) series.add(k, k == spike ? 5 : 1);
    EXPECT_TRUE(holds_point(series.points(), static_cast<double>(spike), 5)) << spike;
  }
}

TEST(Series, TenMillionPointsTakeBoundedMemory) {
  const std::size_t before = mallinfo2().uordblks;
  Series series;
  for (std::int64_t k = 0; k < 10'000'000; ++k) series.add(k, static_cast<double>(k % 1000));
  const std::size_t after = mallinfo2().uordblks;
  EXPECT_LE(after, before + (std::size_t{1} << 20)) << "bytes in use, before " << before;
  EXPECT_LE(series.points().step.size(), Series::capacity + 2);
  EXPECT_GE(series.points().step.size(), Series::capacity / 4);
  EXPECT_EQ(series.count(), 10'000'000);
  EXPECT_EQ(series.points().step.back(), 9'999'999);
}

TEST(Series, NanCountsInNoExtreme) {
  for (const bool first : {false, true}) {
    Series series;
    std::int64_t k = 0;
    if (first) series.add(k++, NaN);
    series.add(k++, 2);
    series.add(k++, NaN);
    series.add(k++, -1);
    EXPECT_EQ(series.largest(), 2);
    EXPECT_EQ(series.smallest(), -1);
    series.add(k++, NaN);
    EXPECT_TRUE(std::isnan(series.last()));
  }
  Series nothing_else;
  nothing_else.add(0, NaN);
  EXPECT_TRUE(std::isnan(nothing_else.largest()));
  EXPECT_TRUE(std::isnan(nothing_else.smallest()));
}

TEST(Series, AmongManyPointsNanHidesNoValueAndInfinitiesAreExtremes) {
  Series series;
  for (std::int64_t k = 0; k < 100'000; ++k)
    series.add(k, k == 40'000 ? 3 : k == 41'000 ? infinity : k == 42'000 ? -infinity : k % 2 == 0 ? NaN : 1);
  const auto points = series.points();
  expect_rising_steps(points);
  EXPECT_TRUE(holds_point(points, 40'000, 3));
  EXPECT_TRUE(holds_point(points, 41'000, infinity));
  EXPECT_TRUE(holds_point(points, 42'000, -infinity));
  EXPECT_EQ(series.largest(), infinity);
  EXPECT_EQ(series.smallest(), -infinity);
}

TEST(Series, ALongStretchOfNanStaysAGap) {
  Series series;
  for (std::int64_t k = 0; k < 100'000; ++k) series.add(k, k >= 30'000 && k < 60'000 ? NaN : 1);
  const auto points = series.points();
  for (std::size_t i = 0; i < points.step.size(); ++i)
    ASSERT_TRUE(std::isnan(points.value[i]) || points.step[i] < 30'100 || points.step[i] >= 59'900) << points.step[i];
  EXPECT_GT(std::ranges::count_if(points.value, [](double v) { return std::isnan(v); }), 100);
}

TEST(Series, ComesBackFromItsPoints) {
  Series series;
  for (std::int64_t k = 0; k < 25'000; ++k) series.add(k, k % 7 == 3 ? NaN : std::sin(static_cast<double>(k)));
  const Series again(series.points(), series.count());
  const auto points = series.points(), same = again.points();
  EXPECT_EQ(again.count(), series.count());
  EXPECT_EQ(same.step, points.step);
  ASSERT_EQ(same.value.size(), points.value.size());
  for (std::size_t i = 0; i < points.value.size(); ++i)
    EXPECT_TRUE(same.value[i] == points.value[i] || (std::isnan(same.value[i]) && std::isnan(points.value[i])));
  EXPECT_EQ(again.last(), series.last());
  EXPECT_EQ(again.largest(), series.largest());
  EXPECT_EQ(again.smallest(), series.smallest());
  EXPECT_EQ(Series(Series().points(), 0).count(), 0);
}
