#include <kfstab/reports/scale.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

using namespace kfstab::reports;

namespace {

const Axis linear_axis{};
const Axis log_axis{.label = "", .log = true};
constexpr double none = std::numeric_limits<double>::quiet_NaN();
constexpr double endless = std::numeric_limits<double>::infinity();

std::vector<std::string> labels(const std::vector<Tick>& ticks) {
  std::vector<std::string> texts;
  for (const Tick& tick : ticks)
    if (!tick.label.empty()) texts.push_back(tick.label);
  return texts;
}

}  // namespace

TEST(LinearScale, ShowsAllThatIsFinite) {
  const Scale scale = scale_for(linear_axis, {1, none, -2, endless, 3}, {}, 0);
  EXPECT_EQ(scale.low, -2);
  EXPECT_EQ(scale.high, 3);
  EXPECT_FALSE(scale.floor);
}

TEST(LinearScale, StartsAtZeroWhenThatIsNear) {
  EXPECT_EQ(scale_for(linear_axis, {1, 10}, {}, 0.03).low, 0);
  EXPECT_GT(scale_for(linear_axis, {8, 10}, {}, 0.03).low, 7);
}

TEST(LinearScale, IsNeverEmpty) {
  const double largest = std::numeric_limits<double>::max();
  for (const auto& values : std::vector<std::vector<double>>{{}, {none}, {0}, {5, 5}, {-3}, {-largest, largest}}) {
    const Scale scale = scale_for(linear_axis, values, {}, 0.03);
    EXPECT_LT(scale.low, scale.high);
    EXPECT_TRUE(std::isfinite(scale.high - scale.low));
  }
}

TEST(LogScale, PutsWhatIsNotPositiveOnAFloorBelowAllOthers) {
  const Scale zero = scale_for(log_axis, {1e-16, 0, 1e-3}, {}, 0);
  ASSERT_TRUE(zero.floor);
  EXPECT_LT(*zero.floor, 1e-16);
  EXPECT_LT(zero.low, *zero.floor);
  EXPECT_EQ(zero.shown(0), *zero.floor);
  EXPECT_EQ(zero.shown(1e-3), 1e-3);
  EXPECT_TRUE(std::isnan(zero.shown(none)));
  EXPECT_TRUE(std::isnan(zero.shown(endless)));
  EXPECT_EQ(labels(log_ticks(zero, PowerNotation::superscript)).front(), "0");
  const Scale negative = scale_for(log_axis, {1e-16, -1, 1e-3}, {}, 0);
  EXPECT_EQ(labels(log_ticks(negative, PowerNotation::superscript)).front(), "≤ 0");
  EXPECT_FALSE(scale_for(log_axis, {1e-16, 1e-3}, {}, 0).floor);
}

TEST(LogScale, NoTickIsLabelledTooNearTheFloor) {
  const Scale scale = scale_for(log_axis, {3e-17, 0, 1e44}, {}, 0.03);
  const std::vector<Tick> ticks = log_ticks(scale, PowerNotation::superscript);
  const double height = std::log10(scale.high / scale.low);
  for (const Tick& tick : ticks)
    EXPECT_TRUE(tick.at == *scale.floor || std::log10(tick.at / *scale.floor) > 0.04 * height) << tick.at;
}

TEST(LogScale, BoundsThatAreFarDoNotSqueezeWhatWasMeasured) {
  const std::vector<double> measured{1e-16, 1e-14};
  EXPECT_GE(scale_for(log_axis, measured, {1e-15, 1e-13}, 0).high, 1e-13);
  EXPECT_LE(scale_for(log_axis, measured, {1e-15, 1e200}, 0).high, 1e-10);
  EXPECT_GE(scale_for(log_axis, measured, {1e-300}, 0).low, 1e-20);
  EXPECT_GE(scale_for(log_axis, {none}, {1e-15, 1e20}, 0).high, 1e20);
}

TEST(LogScale, CoversAllDoubles) {
  const Scale scale = scale_for(log_axis, {5e-324, 1e-299, std::numeric_limits<double>::max()}, {}, 0.03);
  EXPECT_GT(scale.low, 0);
  EXPECT_TRUE(std::isfinite(scale.high));
  ASSERT_TRUE(scale.floor);
  for (const auto& values : std::vector<std::vector<double>>{{}, {none}, {0}, {-1}, {1}, {1e-16, 1e-16}}) {
    const Scale odd = scale_for(log_axis, values, {}, 0);
    EXPECT_GT(odd.low, 0);
    EXPECT_LT(odd.low, odd.high);
  }
}

TEST(LogTicks, AreFewAndInsideAndIncludeOne) {
  for (double high : {1e-12, 1e-3, 1e0, 1e10, 1e44, 1e300})
    for (int most : {4, 8}) {
      const Scale scale = scale_for(log_axis, {1e-16, high}, {}, 0.03);
      const std::vector<Tick> ticks = log_ticks(scale, PowerNotation::superscript, most);
      EXPECT_GE(labels(ticks).size(), 2u) << high;
      EXPECT_LE(labels(ticks).size(), static_cast<std::size_t>(most)) << high;
      for (const Tick& tick : ticks) {
        EXPECT_GE(tick.at, scale.low * (1 - 1e-6));
        EXPECT_LE(tick.at, scale.high * (1 + 1e-6));
      }
      EXPECT_EQ(std::ranges::count(labels(ticks), "10^{0}"), high >= 1) << high;
    }
}

TEST(LogTicks, OfAShortAxisAreOneTwoFive) {
  const Scale scale = scale_for(log_axis, {2, 30}, {}, 0.03);
  EXPECT_EQ(labels(log_ticks(scale, PowerNotation::superscript)), (std::vector<std::string>{"2", "5", "10", "20"}));
  const Scale tiny = scale_for(log_axis, {1e-16, 9e-16}, {}, 0.03);
  EXPECT_EQ(labels(log_ticks(tiny, PowerNotation::superscript)), (std::vector<std::string>{"10^{-16}", "2·10^{-16}", "5·10^{-16}"}));
  EXPECT_EQ(labels(log_ticks(tiny, PowerNotation::plain)), (std::vector<std::string>{"1e-16", "2e-16", "5e-16"}));
}

// Left to gnuplot, these would have none at all.
TEST(LogTicks, OfLessThanAFactorOfTwoAreEquallySpaced) {
  EXPECT_EQ(labels(log_ticks(scale_for(log_axis, {3.1, 3.9}, {}, 0), PowerNotation::plain)),
            (std::vector<std::string>{"3.2", "3.4", "3.6", "3.8"}));
  EXPECT_EQ(labels(log_ticks(scale_for(log_axis, {2.2e-16, 3.1e-16}, {}, 0), PowerNotation::superscript)),
            (std::vector<std::string>{"2.4·10^{-16}", "2.6·10^{-16}", "2.8·10^{-16}", "3·10^{-16}"}));
  EXPECT_EQ(labels(log_ticks(scale_for(log_axis, {8.8e-17, 1.15e-16}, {}, 0), PowerNotation::plain)),
            (std::vector<std::string>{"9e-17", "1e-16", "1.1e-16"}));
}

TEST(LogTicks, LeaveLinearAxesToGnuplot) {
  EXPECT_TRUE(log_ticks(scale_for(linear_axis, {1, 2}, {}, 0), PowerNotation::plain).empty());
}
