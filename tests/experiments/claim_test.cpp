#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <set>
#include <sstream>

#include <gtest/gtest.h>
#include <boost/property_tree/ptree.hpp>
#include <boost/property_tree/xml_parser.hpp>

#include <kfstab/properties/input_error.hpp>
#include <kfstab/reports/mathml.hpp>

#include "experiments/claims.hpp"

using namespace kfstab::experiments;
using kfstab::reports::Check;
using kfstab::reports::Verdict;

namespace {

Verdict verdict_of(std::vector<Check> checks) {
  ClaimResult result;
  result.findings.checks = std::move(checks);
  return result.verdict();
}

const Check good{"good", 1, 1, "", true}, bad{"bad", 1, 2, "", false}, unmeasured{"unmeasured", 1, NaN, "", false};

/// A claim that measures nothing but what it is set to.
Claim made_up() {
  Claim claim;
  claim.id = "made-up";
  claim.parameters = {{"r", 1.5, "the radius", 1, 2}, {"n", 3, "the size", 1, 9}};
  claim.measure = [](const Settings& set) {
    return Findings{{check_within("r", set("r"), set("r"), 0), check_within("n", set("n"), set("n"), 0)}, {}};
  };
  return claim;
}

}  // namespace

TEST(Verdict, IsConfirmedIfAllHold) {
  EXPECT_EQ(verdict_of({good}), Verdict::confirmed);
  EXPECT_EQ(verdict_of({good, good}), Verdict::confirmed);
}

TEST(Verdict, IsRefutedIfOneFails) {
  EXPECT_EQ(verdict_of({good, bad, good}), Verdict::refuted);
  EXPECT_EQ(verdict_of({unmeasured, bad}), Verdict::refuted);
  EXPECT_EQ(verdict_of({bad, unmeasured}), Verdict::refuted);
  EXPECT_EQ(verdict_of({good, {"breakdown", 1, infinity, "", false}}), Verdict::refuted);
}

TEST(Verdict, IsInconclusiveIfOneCouldNotBeMeasuredOrThereIsNone) {
  EXPECT_EQ(verdict_of({}), Verdict::inconclusive);
  EXPECT_EQ(verdict_of({good, unmeasured}), Verdict::inconclusive);
  EXPECT_EQ(verdict_of({{"nan that says it holds", 1, NaN, "", true}, good}), Verdict::inconclusive);
}

TEST(Checks, CloseIsRelative) {
  EXPECT_TRUE(check_close("a", 200, 201.9, .01).holds);
  EXPECT_FALSE(check_close("a", 200, 202.1, .01).holds);
  EXPECT_FALSE(check_close("a", 200, 197.9, .01).holds);
  EXPECT_TRUE(check_close("a", -200, -201, .01).holds);
  EXPECT_FALSE(check_close("a", -200, 200, .01).holds);
  EXPECT_EQ(check_close("a", 200, 201, .01).criterion, "within 1 % of the prediction");
}

TEST(Checks, WithinIsAbsolute) {
  EXPECT_TRUE(check_within("a", 2, 2.125, .125).holds);
  EXPECT_FALSE(check_within("a", 2, 2.25, .125).holds);
  EXPECT_FALSE(check_within("a", 2, 1.75, .125).holds);
  EXPECT_NE(check_within("a", 2, 2, .125).criterion.find("0.125"), std::string::npos);
}

TEST(Checks, ASlopeThatItsPointsDoNotDetermineWasNotMeasured) {
  const Line sharp{0, 2.05, 5, .08}, blurred{0, 2.05, 5, .12};
  EXPECT_TRUE(check_slope("a", 2, sharp, .1).holds);
  EXPECT_FALSE(check_slope("a", 1, sharp, .1).holds);
  EXPECT_EQ(verdict_of({check_slope("a", 1, sharp, .1)}), Verdict::refuted);
  EXPECT_EQ(verdict_of({check_slope("a", 2, blurred, .1)}), Verdict::inconclusive);
  EXPECT_NE(check_slope("a", 2, sharp, .1).criterion.find("0.08, 5 points"), std::string::npos);
}

TEST(Checks, AGrowthThatItsPointsDoNotDetermineWasNotMeasured) {
  const Growth sharp{1.21, 5, 45, .01}, blurred{1.21, 5, 45, .02};
  EXPECT_TRUE(check_growth("a", 1.2, sharp, .01).holds);
  EXPECT_EQ(verdict_of({check_growth("a", 1.3, sharp, .01)}), Verdict::refuted);
  EXPECT_EQ(verdict_of({check_growth("a", 1.2, blurred, .01)}), Verdict::inconclusive);
  EXPECT_NE(check_growth("a", 1.2, sharp, .01).criterion.find("0.01, 40 points"), std::string::npos);
}

TEST(Checks, AtMostAndAtLeast) {
  EXPECT_TRUE(check_at_most("a", 1, 1, "why").holds);
  EXPECT_FALSE(check_at_most("a", 1, 1.5, "why").holds);
  EXPECT_TRUE(check_at_least("a", 1, 1, "why").holds);
  EXPECT_FALSE(check_at_least("a", 1, .5, "why").holds);
  EXPECT_EQ(check_at_most("a", 1, 1, "why").criterion, "at most 1: why");
  EXPECT_EQ(check_at_least("a", 1, 1, "why").criterion, "at least 1: why");
}

TEST(Checks, WhatIsNotFiniteDoesNotHold) {
  for (const double measured : {NaN, infinity}) {
    EXPECT_FALSE(check_close("a", 1, measured, .01).holds) << measured;
    EXPECT_FALSE(check_within("a", 1, measured, .01).holds) << measured;
    EXPECT_FALSE(check_at_most("a", 1, measured, "").holds) << measured;
  }
  EXPECT_FALSE(check_at_least("a", 1, NaN, "").holds);
  for (const double predicted : {NaN, infinity, -infinity}) {
    EXPECT_FALSE(check_close("a", predicted, 1, .01).holds) << predicted;
    EXPECT_FALSE(check_within("a", predicted, 1, .01).holds) << predicted;
  }
}

TEST(RunClaim, QuickHasValuesOfItsOwnThatSetOverrides) {
  Claim claim = made_up();
  claim.parameters[1].quick = 2;
  EXPECT_EQ(run_claim(claim, {}).settings("n"), 3);
  EXPECT_EQ(run_claim(claim, {}, Effort::quick).settings("n"), 2);
  EXPECT_EQ(run_claim(claim, {}, Effort::quick).settings("r"), 1.5);
  EXPECT_EQ(run_claim(claim, {{"n", 7}}, Effort::quick).settings("n"), 7);
}

TEST(RunClaims, KeepTheirOrderHoweverManyRunAtOnce) {
  std::vector<Claim> claims;
  for (int number = 1; number <= 20; ++number) {
    claims.push_back(made_up());
    claims.back().number = number;
  }
  for (const int jobs : {0, 1, 3}) {
    std::atomic<int> done = 0;
    const auto results = run_claims(claims, {}, Effort::full, jobs, [&] { ++done; });
    ASSERT_EQ(results.size(), claims.size());
    for (std::size_t i = 0; i < results.size(); ++i) EXPECT_EQ(results[i].claim.number, claims[i].number);
    EXPECT_EQ(done, 20);
  }
}

TEST(RunSeeds, CountsHowOftenEachCheckHolds) {
  Claim drawn = made_up(), fixed = made_up();
  drawn.number = 1;
  fixed.number = 2;
  drawn.parameters.push_back({"seed", 1, "seed", 0, 100});
  drawn.measure = [](const Settings& set) {
    return Findings{{check_at_most("small", 3, set("seed"), ""), check_at_least("all", 0, set("seed"), "")}, {}};
  };
  const auto found = run_seeds({fixed, drawn}, {}, Effort::full, 1, 5, [] {});
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0].runs, 5);
  EXPECT_EQ(found[0].confirmed, 3);
  ASSERT_EQ(found[0].checks.size(), 2u);
  EXPECT_EQ(found[0].checks[0].check, "small");
  EXPECT_EQ(found[0].checks[0].times, 3);
  EXPECT_EQ(found[0].checks[1].times, 5);
  EXPECT_EQ(found[1].runs, 1);
  EXPECT_EQ(found[1].confirmed, 1);
}

TEST(RunClaim, UsesDefaultsAndWhatIsSet) {
  const ClaimResult defaults = run_claim(made_up(), {});
  EXPECT_EQ(defaults.settings("r"), 1.5);
  EXPECT_EQ(check_called(defaults, "n").measured, 3);
  EXPECT_EQ(defaults.verdict(), Verdict::confirmed);
  EXPECT_GE(defaults.seconds, 0);
  const ClaimResult set = run_claim(made_up(), {{"r", 2}, {"of another claim", 7}});
  EXPECT_EQ(check_called(set, "r").measured, 2) << "the range's end is in it";
  EXPECT_EQ(set.settings.values(), (std::map<std::string, double>{{"n", 3}, {"r", 2}}));
}

TEST(RunClaim, RefusesASettingOutOfRange) {
  for (const double value : {.999, 2.001, NaN, infinity, -infinity}) {
    try {
      run_claim(made_up(), {{"r", value}});
      ADD_FAILURE() << value << " passed";
    } catch (const kfstab::properties::InputError& error) {
      const std::string what = error.what();
      EXPECT_EQ(what.find("--set: r: found "), 0u) << what;
      EXPECT_NE(what.find("expected the radius of claim made-up from 1 to 2"), what.npos) << what;
    }
  }
}

TEST(AllClaims, AreInTheLedgersOrderAndSayWhatTheyAre) {
  const auto claims = all_claims();
  std::set<std::string> ids;
  int number = 0;
  for (const Claim& claim : claims) {
    EXPECT_GT(claim.number, number) << claim.id;
    number = claim.number;
    EXPECT_TRUE(ids.insert(claim.id).second) << claim.id;
    for (const std::string* text : {&claim.title, &claim.statement, &claim.source, &claim.setup, &claim.prediction,
                                    &claim.meaning, &claim.mathematics})
      EXPECT_FALSE(text->empty()) << claim.id;
    for (const Parameter& p : claim.parameters) {
      EXPECT_FALSE(p.name.empty() || p.meaning.empty()) << claim.id;
      EXPECT_TRUE(p.least <= p.value && p.value <= p.most) << claim.id << ": " << p.name;
    }
  }
  for (const char* id : {"asymmetry-growth", "asymmetry-divergence", "innovation-conditioning", "dyer-mcreynolds"})
    EXPECT_TRUE(ids.contains(id)) << id;
}

/// Whether the equation became text as a whole, as what cannot be read does. Throws unless its MathML is well-formed.
bool is_text_as_a_whole(const std::string& equation) {
  std::istringstream mathml(kfstab::reports::render_mathml(equation));
  boost::property_tree::ptree set;
  boost::property_tree::read_xml(mathml, set);
  for (const char* path : {"math.mtext", "math.mrow.mtext"})
    if (set.get<std::string>(path, "") == equation) return true;
  return false;
}

TEST(AllClaims, HaveEquationsThatCanBeSet) {
  ASSERT_TRUE(is_text_as_a_whole("(a < b"));
  for (const Claim& claim : all_claims()) {
    std::istringstream equations(claim.mathematics);
    for (std::string equation; std::getline(equations, equation);)
      EXPECT_FALSE(is_text_as_a_whole(equation)) << claim.id << ": " << equation;
  }
}

// The four claims, with fewer systems than by default; their randomness must not matter.

TEST(Claims, AsymmetryGrowthIsConfirmedWhateverTheSeed) {
  for (const double seed : {1, 100, 4711}) {
    const auto result = run_claim(claim_called("asymmetry-growth"), {{"seed", seed}, {"systems", 3}});
    EXPECT_EQ(result.verdict(), Verdict::confirmed) << "seed " << seed << "\n" << failing(result);
    expect_well_made(result);
  }
}

TEST(Claims, InnovationConditioningIsConfirmedWhateverTheSeed) {
  for (const double seed : {1, 100, 4711}) {
    const auto result = run_claim(claim_called("innovation-conditioning"), {{"seed", seed}, {"frames", 10}});
    EXPECT_EQ(result.verdict(), Verdict::confirmed) << "seed " << seed << "\n" << failing(result);
    expect_well_made(result);
  }
}

TEST(Claims, AsymmetryDivergenceIsConfirmed) {
  const auto result = run_claim(claim_called("asymmetry-divergence"), {});
  EXPECT_EQ(result.verdict(), Verdict::confirmed) << failing(result);
  expect_well_made(result);
  // |l1 l2| of the rotating pair is its determinant, 1.02^2 + .25^2.
  for (const char* id : {"ckf-gain", "ckf-cp", "ckf-downdate"})
    EXPECT_NEAR(check_called(result, std::string(id) + ":").predicted, 1.02 * 1.02 + .0625, 1e-9) << id;
  EXPECT_NEAR(check_called(result, "ckf-mixed: growth of the error per step, k").predicted, 2 * (1.02 * 1.02 + .0625),
              1e-9);
  for (const char* id : {"ckf:", "ckf-textbook:", "joseph:", "srcf:"})
    EXPECT_NE(check_called(result, id).name.find("worst"), std::string::npos) << id;
}

TEST(Claims, DyerMcReynoldsIsConfirmed) {
  const auto result = run_claim(claim_called("dyer-mcreynolds"), {{"steps", 5}});
  EXPECT_EQ(result.verdict(), Verdict::confirmed) << failing(result);
  expect_well_made(result);
}

/// A claim with less work than by default.
struct Reduced {
  const char* id;
  std::map<std::string, double> settings;
};

class ReducedClaim : public testing::TestWithParam<Reduced> {};

TEST_P(ReducedClaim, IsConfirmedWhateverTheSeed) {
  const auto& [id, settings] = GetParam();
  const bool random = settings.contains("seed");
  for (const double seed : random ? std::vector<double>{1, 4711} : std::vector<double>{0}) {
    auto set = settings;
    if (random) set["seed"] = seed;
    const auto result = run_claim(claim_called(id), set);
    EXPECT_EQ(result.verdict(), Verdict::confirmed) << "seed " << seed << "\n" << failing(result);
    expect_well_made(result);
  }
}

INSTANTIATE_TEST_SUITE_P(, ReducedClaim,
                         testing::Values(Reduced{"forgetting", {{"seed", 1}, {"systems", 2}}},
                                         Reduced{"first-order", {{"seed", 1}, {"systems", 1}}},
                                         Reduced{"steady-state-level", {}}, Reduced{"non-normal-transient", {}},
                                         Reduced{"chandrasekhar-memory", {{"seed", 1}, {"systems", 5}}},
                                         Reduced{"joseph-second-order", {{"seed", 1}, {"systems", 3}}},
                                         Reduced{"post-array-angle", {{"seed", 1}, {"frames", 30}}},
                                         Reduced{"state-estimate", {{"seed", 1}, {"frames", 11}}},
                                         Reduced{"information-conditioning", {{"seed", 1}, {"frames", 11}}},
                                         Reduced{"exact-forgetting", {{"seed", 1}, {"systems", 2}}},
                                         Reduced{"one-triangle", {{"seed", 1}, {"systems", 3}}},
                                         Reduced{"rls-forgetting", {{"seed", 1}}}),
                         [](const auto& reduced) {
                           std::string name = reduced.param.id;
                           std::ranges::replace(name, '-', '_');
                           return name;
                         });

// Predictions follow the parameters.

TEST(Claims, FirstOrderNeedsDigitsBelowTheSmallestError) {
  const auto result = run_claim(claim_called("first-order"), {{"smallest", 60}, {"systems", 1}});
  EXPECT_NE(result.verdict(), Verdict::confirmed) << "50 digits show nothing of an error of 1e-60";
}

TEST(Claims, NonNormalTransientFollowsTheShear) {
  const auto result = run_claim(claim_called("non-normal-transient"), {{"shear", 5}});
  EXPECT_EQ(result.verdict(), Verdict::confirmed) << failing(result);
  // F is nearly A, whose power k has the entry shear (.9^k - .85^k) / .05 off its diagonal.
  double largest = 0;
  for (int k = 1; k < 30; ++k) largest = std::max(largest, std::pow(5 * (std::pow(.9, k) - std::pow(.85, k)) / .05, 2));
  const auto& theory = curve_called(result.findings.figures.front(), "theory-powers");
  EXPECT_NEAR(*std::ranges::max_element(theory.y) / largest, 1, .05);
}

TEST(Claims, RlsForgettingFollowsItsFactor) {
  const auto result = run_claim(claim_called("rls-forgetting"), {{"factor", .8}, {"n", 3}});
  EXPECT_EQ(result.verdict(), Verdict::confirmed) << failing(result);
  EXPECT_EQ(check_called(result, "(iii) at f = 0.8").predicted, 1 / .8);
  expect_well_made(result);
}

TEST(Claims, OneTriangleFollowsR) {
  // Theory section 3: .683 at r = .9, where nothing grows.
  const auto stable = run_claim(claim_called("one-triangle"), {{"r", .9}, {"systems", 1}});
  EXPECT_EQ(stable.verdict(), Verdict::confirmed) << failing(stable);
  EXPECT_EQ(check_called(stable, "(i) at r = 0.9, one triangle").predicted, 1) << "an upper limit";
  const auto unstable = run_claim(claim_called("one-triangle"), {{"r", 1.2}, {"systems", 1}});
  EXPECT_EQ(unstable.verdict(), Verdict::confirmed) << failing(unstable);
  EXPECT_GT(check_called(unstable, "(i) at r = 1.2, one triangle").predicted, 1.03);
}

TEST(Claims, SlopesAreThoseOfWhatIsHeld) {
  const auto angle = run_claim(claim_called("post-array-angle"), {{"frames", 10}});
  const auto state = run_claim(claim_called("state-estimate"), {{"frames", 5}});
  EXPECT_EQ(check_called(angle, "ckf: slope").predicted, 2);
  EXPECT_EQ(check_called(angle, "srcf: slope").predicted, 1);
  EXPECT_EQ(check_called(state, "joseph: slope").predicted, 2);
  EXPECT_EQ(check_called(state, "srif: slope").predicted, 1);
}

TEST(Claims, AsymmetryGrowthFollowsRAndTheNumberOfSystems) {
  const auto result = run_claim(claim_called("asymmetry-growth"), {{"r", 1.3}, {"systems", 2}});
  EXPECT_EQ(result.verdict(), Verdict::confirmed) << failing(result);
  // A is rounded to 20 bits: its determinant is r^2 to 2^-19 or so.
  for (const char* coding : {"(iii)", "(iv)", "(v)"})
    EXPECT_NEAR(check_called(result, std::string(coding) + " at r = 1.3: growth").predicted, 1.69, 1e-5) << coding;
  check_called(result, "(iii), p = 2, 2 systems");
  const auto& theory = curve_called(result.findings.figures.front(), "theory");
  EXPECT_NEAR(theory.y[11] / theory.y[10], 1.69, 1e-5);
  EXPECT_NEAR(theory.y[0], std::sqrt(2.) * 1e-12, 1e-20);
}

TEST(Claims, AsymmetryGrowthTakesAnRThatItMeasuresAnyway) {
  for (const double r : {1.02, 1.1, 1.5}) {
    const auto result = run_claim(claim_called("asymmetry-growth"), {{"r", r}, {"systems", 1}});
    EXPECT_EQ(result.verdict(), Verdict::confirmed) << "r = " << r << "\n" << failing(result);
    expect_well_made(result);
  }
}

TEST(Claims, AsymmetryDivergenceFollowsItsSteps) {
  const auto result = run_claim(claim_called("asymmetry-divergence"), {{"steps", 310}});
  EXPECT_EQ(result.verdict(), Verdict::confirmed) << failing(result);
  EXPECT_EQ(curve_called(result.findings.figures.front(), "srcf").x.back(), 309);
  EXPECT_EQ(curve_called(result.findings.figures.front(), "theory").x.back(), 310);
}

TEST(Claims, InnovationConditioningFollowsItsDecadesAndFrames) {
  const auto result = run_claim(claim_called("innovation-conditioning"), {{"decades", 4}, {"frames", 7}});
  const auto& figure = result.findings.figures.front();
  // k(Re^1/2) is near the ladder's 10^c.
  const auto& x = curve_called(figure, "srcf").x;
  EXPECT_EQ(x.size(), 17u);
  EXPECT_NEAR(std::log10(x.back()), 4, .3);
  EXPECT_NE(figure.caption.find("Medians of 7 random frames"), std::string::npos) << figure.caption;
  EXPECT_EQ(check_called(result, "ckf: slope of the error of K").predicted, 2);
  EXPECT_EQ(check_called(result, "srcf: slope of the error of K").predicted, 1);
}

TEST(Claims, DyerMcReynoldsFollowsItsSteps) {
  const auto result = run_claim(claim_called("dyer-mcreynolds"), {{"steps", 1}});
  const auto& figure = result.findings.figures.front();
  EXPECT_NE(figure.caption.find("in 1 steps"), std::string::npos) << figure.caption;
  EXPECT_EQ(curve_called(figure, "srcf").x.size(), 25u);
  EXPECT_EQ(curve_called(figure, "srcf").x.front(), 16);
  EXPECT_EQ(curve_called(figure, "srcf").x.back(), std::exp2(52));
}
