#include <kfstab/experiments/selection.hpp>

#include <gtest/gtest.h>

#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/input_error.hpp>

using namespace kfstab::experiments;

namespace {

std::vector<std::string> ids(const std::string& expression) {
  std::vector<std::string> names;
  for (const kfstab::Metadata* metadata : select_filters(expression)) names.emplace_back(metadata->id);
  return names;
}

}  // namespace

TEST(Selection, FindsTheExpressionAnywhereInAName) {
  const Selection selects("ckf", "here");
  EXPECT_TRUE(selects("ckf"));
  EXPECT_TRUE(selects("ckf-gain"));
  EXPECT_TRUE(selects("not-ckf"));
  EXPECT_FALSE(selects("srcf"));
}

TEST(Selection, AnchorsAlternativesAndClasses) {
  const Selection selects("^(ckf|sr[ci]f)$", "here");
  EXPECT_TRUE(selects("ckf"));
  EXPECT_TRUE(selects("srif"));
  EXPECT_FALSE(selects("ckf-gain"));
}

TEST(Selection, ALeadingMinusTakesTheOthers) {
  const Selection selects("-ckf", "here");
  EXPECT_FALSE(selects("ckf-gain"));
  EXPECT_TRUE(selects("srcf"));
  const Selection anchored("-^ckf$", "here");
  EXPECT_FALSE(anchored("ckf"));
  EXPECT_TRUE(anchored("ckf-gain"));
}

TEST(Selection, AMinusElsewhereIsAMinus) {
  const Selection selects("f-g", "here");
  EXPECT_TRUE(selects("ckf-gain"));
  EXPECT_FALSE(selects("ckf"));
}

TEST(Selection, NothingAskedForIsEverything) {
  EXPECT_TRUE(Selection("", "here")("srcf"));
  EXPECT_TRUE(Selection("-", "here")("srcf"));
}

TEST(Selection, WhatIsNoExpressionIsRefusedWithItsPlace) {
  for (const std::string bad : {"(", "[a", "a{2", "*"}) {
    try {
      Selection selects(bad, "--filters");
      ADD_FAILURE() << bad << " passed";
    } catch (const kfstab::properties::InputError& error) {
      const std::string what = error.what();
      EXPECT_EQ(what.find("--filters: found '" + bad + "', expected a regular expression ("), 0u) << what;
      EXPECT_EQ(what.find('\n'), what.npos);
    }
  }
}

TEST(SelectFilters, InTheOrderOfTheRegistry) {
  std::vector<std::string> all;
  for (const kfstab::Metadata& metadata : kfstab::filters()) all.emplace_back(metadata.id);
  EXPECT_EQ(ids(""), all);
  EXPECT_EQ(ids("^srcf$|^ckf$|^joseph$"), (std::vector<std::string>{"ckf", "joseph", "srcf"}));
}

TEST(SelectFilters, WithAndWithoutMakeTheWhole) {
  EXPECT_EQ(ids("ckf").size() + ids("-ckf").size(), kfstab::filters().size());
  for (const std::string& id : ids("-ckf")) EXPECT_EQ(id.find("ckf"), id.npos);
}

TEST(SelectFilters, NothingIsAnErrorThatSaysWhereToLook) {
  try {
    select_filters("no-such-filter");
    ADD_FAILURE() << "something was selected";
  } catch (const NothingSelected& error) {
    const std::string what = error.what();
    EXPECT_NE(what.find("'no-such-filter'"), what.npos) << what;
    EXPECT_NE(what.find("kfstab list filters"), what.npos) << what;
  }
  EXPECT_THROW(select_filters("-."), NothingSelected);
}
