#include <kfstab/experiments/cost.hpp>

#include <gtest/gtest.h>

#include <kfstab/filters/registry.hpp>

using namespace kfstab;
using namespace kfstab::experiments;

namespace {

double operations_of(const char* id, Dimensions d) { return operations(*find_filter(id), d); }

}  // namespace

// The formulas of theory (5), worked out by hand.
TEST(Operations, AreThoseOfTheFormula) {
  EXPECT_DOUBLE_EQ(operations_of("ckf", {2, 1, 1}), 1.5 * 8 + 4 * (3 + 1) / 2.0);
  EXPECT_DOUBLE_EQ(operations_of("srcf", {2, 1, 1}), 7 / 6.0 * 8 + 4 * (2.5 + 1) + 2 * (1 + 0.5));
  EXPECT_DOUBLE_EQ(operations_of("csrf", {3, 1, 2}), 3 * 9 + 3 * 3 * 3 * 2 + 3 * 4);
  EXPECT_DOUBLE_EQ(operations_of("svd", {2, 1, 1}), (7 / 3.0 + 42) * 8 + 4 * 5 + 2 * 8 / 2.0 + (2 / 3.0 + 21));
  EXPECT_DOUBLE_EQ(operations_of("joseph", {0, 0, 0}), 0);
}

// A formula that is read wrongly most likely loses a factor or a term.
TEST(Operations, OfEveryFilterGrowWithEachSize) {
  for (const Metadata& filter : filters()) {
    SCOPED_TRACE(filter.id);
    const double here = operations(filter, {3, 2, 2});
    EXPECT_GT(here, 27.0 / 6);  // 1/6 n^3, the least of all
    EXPECT_GT(operations(filter, {4, 2, 2}), here);
    EXPECT_GT(operations(filter, {3, 2, 3}), here);
    if (filter.holds != Held::gain) {
      EXPECT_GT(operations(filter, {3, 3, 2}), here);
    }
  }
}
