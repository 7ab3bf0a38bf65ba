#include <kfstab/experiments/curves.hpp>

#include <gtest/gtest.h>

#include <kfstab/experiments/models.hpp>

using namespace kfstab::experiments;
using kfstab::reports::CurveRole;

TEST(Curves, MeasuredOfAFilterHaveItsNameAndColour) {
  const auto curve = measured("srcf", {1, 2}, {3, 4});
  EXPECT_EQ(curve.id, "srcf");
  EXPECT_EQ(curve.label, "srcf");
  EXPECT_EQ(curve.x, (std::vector<double>{1, 2}));
  EXPECT_EQ(curve.y, (std::vector<double>{3, 4}));
  EXPECT_EQ(curve.role, CurveRole::measured_points);
  EXPECT_EQ(curve.color, color_of("srcf"));
  EXPECT_EQ(measured("srcf", {}, {}, CurveRole::measured_line).role, CurveRole::measured_line);
}

TEST(Curves, ATheoryLineLeavesOutWhatIsBeyondItsRange) {
  const auto line = theory_line(
      "t", "theory", {-1, 0, 1, 2, 3}, [](double x) { return x; }, 2);
  EXPECT_EQ(line.role, CurveRole::theory);
  EXPECT_EQ(line.x, (std::vector<double>{1, 2}));
  EXPECT_EQ(line.y, (std::vector<double>{1, 2}));
}

TEST(Curves, KnowTheirRoleAndColour) {
  auto points = measured_points("p", "points", "srcf");
  add_point(points, 1, 2);
  add_point(points, 3, 4);
  EXPECT_EQ(points.x, (std::vector<double>{1, 3}));
  EXPECT_EQ(points.y, (std::vector<double>{2, 4}));
  EXPECT_EQ(points.role, CurveRole::measured_points);
  EXPECT_EQ(points.color, color_of("srcf"));
  EXPECT_EQ(theory_line("t", "theory").role, CurveRole::theory);
  EXPECT_EQ(theory_line("t", "theory").color, -1);
}
