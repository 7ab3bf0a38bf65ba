#include <kfstab/experiments/difference.hpp>

#include <algorithm>
#include <limits>

#include <gtest/gtest.h>

#include <kfstab/properties/input_error.hpp>

using namespace kfstab;
using namespace kfstab::experiments;

namespace {

ClaimResult claim(const std::string& id, double measured, bool holds) {
  ClaimResult result;
  result.claim.id = id;
  result.claim.number = 7;
  result.settings = Settings({{"r", 1}});
  result.findings.checks = {{"slope", 1, measured, "near", holds}};
  return result;
}

StoredClaims claims(std::vector<ClaimResult> of, Context context = {{"kfstab", "0.1.0"}}) {
  return {std::move(context), {}, std::move(of)};
}

/// The rows of the section's table; none if it has none.
std::vector<std::vector<std::string>> rows(const Difference& found, const std::string& anchor) {
  const auto section = std::ranges::find(found.document.sections, anchor, &reports::Section::anchor);
  if (section == found.document.sections.end()) return {};
  const auto* table = std::get_if<reports::Table>(&section->blocks.front());
  return table ? table->rows : std::vector<std::vector<std::string>>{};
}

Difference between(const Stored& before, const Stored& after) { return difference(before, after, "a.json", "b.json"); }

const Metadata conventional{.id = "ckf", .title = "", .update = "", .statuses = {}, .operations = "", .source = ""};

/// One filter on one system, with these errors of P.
StoredRun stored_run(std::vector<double> errors) {
  SystemRun system;
  system.name = "s";
  FilterRun f;
  f.metadata = &conventional;
  for (std::size_t k = 0; k < errors.size(); ++k) f.covariance_error.add(static_cast<std::int64_t>(k), errors[k]);
  system.filters = {f};
  return {{}, {system}, nullptr};
}

}  // namespace

TEST(Difference, OfAFileFromItselfIsNothing) {
  for (const Stored& stored : {Stored(claims({claim("a", 1, true)})), Stored(stored_run({1e-16, 2e-16}))}) {
    const Difference found = between(stored, stored);
    EXPECT_FALSE(found.worse);
    for (const auto& section : found.document.sections)
      for (const auto& block : section.blocks)
        EXPECT_TRUE(std::holds_alternative<reports::Paragraph>(block)) << section.title;
  }
}

TEST(Difference, AVerdictThatGotWorseIsSaidAndOneThatGotBetterIsNoFault) {
  const auto good = claims({claim("a", 1, true)}), bad = claims({claim("a", 2, false)}),
             unsure = claims({claim("a", std::numeric_limits<double>::quiet_NaN(), false)});
  EXPECT_TRUE(between(good, bad).worse);
  EXPECT_TRUE(between(good, unsure).worse);
  EXPECT_TRUE(between(unsure, bad).worse);
  EXPECT_FALSE(between(bad, good).worse);
  EXPECT_FALSE(between(unsure, good).worse);
  const auto found = between(good, bad);
  ASSERT_EQ(rows(found, "changed-verdicts").size(), 1u);
  EXPECT_EQ(rows(found, "changed-verdicts")[0], (std::vector<std::string>{"C7", "a", "confirmed", "refuted", "worse"}));
  ASSERT_EQ(rows(found, "checks").size(), 1u);
  EXPECT_EQ(rows(found, "checks")[0], (std::vector<std::string>{"a", "slope", "1", "2", "+100 %", "yes -> no"}));
}

TEST(Difference, ChecksThatTurnedComeFirstThenTheLargestChanges) {
  const auto before = claims({claim("a", 1, true), claim("b", 1, true), claim("c", 1, true), claim("d", 1, true)});
  const auto after =
      claims({claim("a", 1.01, true), claim("b", 100, true), claim("c", 1.001, false), claim("d", 1, true)});
  const auto found = rows(between(before, after), "checks");
  ASSERT_EQ(found.size(), 3u) << "what is the same to the last bit is left out";
  EXPECT_EQ(found[0][0], "c");
  EXPECT_EQ(found[1][0], "b");
  EXPECT_EQ(found[1][4], "x 100");
  EXPECT_EQ(found[2][0], "a");
  EXPECT_EQ(found[2][4], "+1 %");
}

TEST(Difference, SaysWhatIsNewAndGoneAndUnderWhatElse) {
  auto renamed = claim("a", 1, true);
  renamed.findings.checks.front().name = "intercept";
  renamed.settings = Settings({{"r", 2}});
  const auto found =
      between(claims({claim("a", 1, true), claim("old", 1, true)}, {{"compiler", "g++ 12"}, {"u", "1e-16"}}),
              claims({renamed, claim("new", 1, true)}, {{"compiler", "clang 14"}, {"u", "1e-16"}}));
  EXPECT_FALSE(found.worse);
  EXPECT_EQ(rows(found, "new-and-gone"),
            (std::vector<std::vector<std::string>>{
                {"a: intercept", "new"}, {"new", "new"}, {"old", "gone"}, {"a: slope", "gone"}}));
  EXPECT_EQ(rows(found, "contexts"), (std::vector<std::vector<std::string>>{{"compiler", "g++ 12", "clang 14"}}));
  EXPECT_EQ(rows(found, "parameters"), (std::vector<std::vector<std::string>>{{"a", "r", "1", "2"}}));
}

TEST(Difference, OfRunsJudgesBreakdownsAndDefinitenessAndTellsNumbers) {
  const auto sound = stored_run({1e-16, 2e-16});
  auto indefinite = sound, later = sound, broken = sound, refused = sound;
  indefinite.systems[0].filters[0].first_indefinite = 3;
  later.systems[0].filters[0].first_indefinite = 7;
  broken.systems[0].filters[0].first_failure = 1;
  refused.systems[0].filters[0].refused = "it needs a regular A";
  EXPECT_TRUE(between(sound, indefinite).worse);
  EXPECT_TRUE(between(later, indefinite).worse);
  EXPECT_TRUE(between(sound, broken).worse);
  EXPECT_TRUE(between(sound, refused).worse);
  EXPECT_FALSE(between(indefinite, later).worse);
  EXPECT_FALSE(between(broken, sound).worse);
  EXPECT_FALSE(between(refused, sound).worse);
  EXPECT_EQ(rows(between(indefinite, later), "soundness")[0],
            (std::vector<std::string>{"s", "ckf", "P indefinite", "step 3", "step 7", "better"}));

  const auto found = between(sound, stored_run({1e-16, 1e-3}));
  EXPECT_FALSE(found.worse);
  ASSERT_EQ(rows(found, "numbers").size(), 2u);
  EXPECT_EQ(rows(found, "numbers")[0], (std::vector<std::string>{"s", "ckf", "P: end", "2e-16", "0.001", "x 5e12"}));
}

TEST(Difference, RunsAndClaimsDoNotCompare) { EXPECT_THROW(between(stored_run({1e-16}), claims({})), properties::InputError); }
