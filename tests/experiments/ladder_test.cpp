#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/ladder.hpp>

#include <cmath>

#include <gtest/gtest.h>

#include <kfstab/experiments/models.hpp>

using namespace kfstab::experiments;
using kfstab::reports::CurveRole;

namespace {

/// Three draws a rung of value = difficulty^2, one of each three ten times as large and one a tenth.
Ladder squares(int rungs) {
  Ladder ladder;
  for (int r = 0; r < rungs; ++r)
    for (const double scatter : {10., 1., .1})
      ladder.add(static_cast<std::size_t>(r), std::exp2(r), std::exp2(2 * r) * scatter);
  return ladder;
}

}  // namespace

TEST(Ladder, MediansAndQuantilesRungByRung) {
  const Ladder ladder = squares(3);
  EXPECT_EQ(ladder.rungs(), 3u);
  EXPECT_EQ(ladder.difficulties(), (std::vector<double>{1, 2, 4}));
  EXPECT_EQ(ladder.medians(), (std::vector<double>{1, 4, 16}));
  EXPECT_EQ(ladder.quantiles(1), (std::vector<double>{10, 40, 160}));
  EXPECT_EQ(ladder.growth(), 16);
}

TEST(Ladder, PowerIsTheSlopeOfTheMedians) {
  EXPECT_NEAR(squares(8).power(0, 1e9).slope, 2, 1e-12);
  EXPECT_EQ(squares(8).power(2, 100).points, 3) << "4, 16, 64";
}

TEST(Ladder, AMinorityOfBreakdownsDoesNotMoveTheMedianAMajorityEndsIt) {
  Ladder ladder;
  for (const double value : {1., 2., infinity}) ladder.add(0, 1, value);
  for (const double value : {1., infinity, infinity}) ladder.add(1, 1, value);
  EXPECT_EQ(ladder.medians(), (std::vector<double>{2, infinity}));
}

TEST(Ladder, ARungWithoutDrawsIsNoNumber) {
  Ladder ladder;
  EXPECT_TRUE(std::isnan(ladder.growth()));
  ladder.add(1, 1, 1);
  EXPECT_TRUE(std::isnan(ladder.medians().front()));
}

TEST(Ladder, IsDrawnAsPointsBetweenQuartiles) {
  kfstab::reports::Figure figure;
  add_curves(figure, squares(4), "srcf");
  ASSERT_EQ(figure.curves.size(), 3u);
  EXPECT_EQ(figure.curves[0].role, CurveRole::measured_points);
  for (const auto& curve : figure.curves) EXPECT_EQ(curve.color, color_of("srcf"));
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_LT(figure.curves[1].y[i], figure.curves[0].y[i]);
    EXPECT_GT(figure.curves[2].y[i], figure.curves[0].y[i]);
  }
}
