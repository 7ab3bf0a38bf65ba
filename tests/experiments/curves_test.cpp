#include <kfstab/experiments/curves.hpp>

#include <gtest/gtest.h>

#include <kfstab/experiments/models.hpp>

using namespace kfstab::experiments;
using kfstab::reports::CurveRole;

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
