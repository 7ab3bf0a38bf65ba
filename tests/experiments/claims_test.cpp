// The claims of experiments/claims, with less work than by default: what they find must depend neither on their seed
// nor on how many systems they draw, and their predictions must follow their parameters.

#include "experiments/claims.hpp"

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <kfstab/experiments/interruption.hpp>
#include <kfstab/filters/kernels.hpp>

using namespace kfstab::experiments;
using kfstab::reports::Verdict;

namespace {

struct Reduced {
  const char* id;
  std::map<std::string, double> settings;
};

class ReducedClaims : public testing::TestWithParam<Reduced> {};

TEST_P(ReducedClaims, AreConfirmedWhateverTheSeed) {
  const auto& [id, settings] = GetParam();
  const Claim claim = claim_called(id);
  const bool random =
      std::ranges::any_of(claim.parameters, [](const Parameter& parameter) { return parameter.name == "seed"; });
  for (const double seed : random ? std::vector<double>{1, 4711} : std::vector<double>{0}) {
    auto set = settings;
    if (random) set["seed"] = seed;
    const auto result = run_claim(claim, set);
    EXPECT_EQ(result.verdict(), Verdict::confirmed) << "seed " << seed << "\n" << failing(result);
    expect_well_made(result);
  }
}

INSTANTIATE_TEST_SUITE_P(
    , ReducedClaims,
    testing::Values(Reduced{"weak-prior", {{"steps", 5}}}, Reduced{"half-word-length", {{"systems", 9}, {"steps", 10}}},
                    Reduced{"noise-free-modes", {{"steps", 1000}}}, Reduced{"rounded-decimals", {{"steps", 10}}},
                    Reduced{"condensed-forms", {{"systems", 5}, {"n", 4}}},
                    Reduced{"operation-counts", {{"m", 1}, {"p", 3}}}, Reduced{"ordinary-models", {{"steps", 100}}},
                    Reduced{"backward-error", {{"systems", 40}}}, Reduced{"unexcited-mode", {}},
                    Reduced{"row-order", {{"draws", 20}}}, Reduced{"downdated-root", {{"draws", 15}}},
                    Reduced{"normal-equations", {{"draws", 15}}}, Reduced{"units", {{"steps", 20}}},
                    Reduced{"scalar-roots", {{"steps", 10}}}, Reduced{"asymmetry-without-bound", {}},
                    Reduced{"re-cholesky", {{"steps", 10}}}),
    [](const auto& reduced) {
      std::string name = reduced.param.id;
      std::ranges::replace(name, '-', '_');
      return name;
    });

}  // namespace

/// Every claim, interrupted at its first step, in a process of its own: the request stays for ever.
TEST(ClaimsDeathTest, InterruptedAreNotJudged) {
  const auto interrupted_claims = [] {
    watch_for_interruption();
    std::raise(SIGINT);
    bool untouched = true;
    for (const Claim& claim : all_claims()) {
      try {
        run_claim(claim, {}, Effort::quick);
        untouched = false;
      } catch (const Interrupted&) {
      }
    }
    std::_Exit(untouched && run_claims(all_claims(), {}, Effort::quick, 1, [] {}).empty() ? 0 : 1);
  };
  EXPECT_EXIT(interrupted_claims(), ::testing::ExitedWithCode(0), "");
}

// Experiments are made with the plain text, and what they find must not hang on it.
TEST(Claims, DoNotDependOnTheKernels) {
  for (const auto& kernels : kfstab::kernels::available()) {
    kfstab::kernels::use(kernels.isa);
    for (const auto& result : run_claims(all_claims(), {}, Effort::quick, 0, [] {}))
      EXPECT_EQ(result.verdict(), Verdict::confirmed) << result.claim.id << " with " << kernels.isa << "\n" << failing(result);
  }
  kfstab::kernels::use("plain");
}

TEST(Claims, UnexcitedModeFollowsTheMode) {
  const auto result = run_claim(claim_called("unexcited-mode"), {{"mode", 1.375}});
  EXPECT_EQ(result.verdict(), Verdict::confirmed) << failing(result);
  const double steps = 53 * std::log(2.) / (2 * std::log(1.375));
  EXPECT_NEAR(check_called(result, "ckf: step at which the error of P exceeds .1, mode 1.375").predicted, steps, 1e-9);
  EXPECT_NEAR(check_called(result, "srcf: step at which the error of P exceeds .1, mode 1.375").predicted, 2 * steps,
              1e-9);
}

TEST(Claims, AsymmetryWithoutBoundFollowsR) {
  const auto result = run_claim(claim_called("asymmetry-without-bound"), {{"r", 1.4}, {"steps", 120}});
  EXPECT_EQ(result.verdict(), Verdict::confirmed) << failing(result);
  EXPECT_NEAR(check_called(result, "ckf-gain: growth").predicted, 1.96, 1e-5);  // A is rounded to 20 bits
  EXPECT_NEAR(check_called(result, "ckf-gain: log10").predicted, 240 * std::log10(1.4) - 53 * std::log10(2.), 1e-3);
}

TEST(Claims, UnitsFollowTheSpread) {
  const auto result = run_claim(claim_called("units"), {{"spread", 20}});
  EXPECT_EQ(result.verdict(), Verdict::confirmed) << failing(result);
  EXPECT_NEAR(check_called(result, "log10 of the factor").predicted, 80 * std::log10(2.), 1e-9);
}

TEST(Claims, HalfWordLengthFollowsRho) {
  const auto result =
      run_claim(claim_called("half-word-length"), {{"rho", .9}, {"systems", 9}, {"steps", 10}, {"seed", 7}});
  EXPECT_EQ(result.verdict(), Verdict::confirmed) << failing(result);
}

TEST(Claims, CondensedFormsFollowTheirSizes) {
  const auto result = run_claim(claim_called("condensed-forms"), {{"systems", 5}, {"n", 9}, {"steps", 20}});
  EXPECT_EQ(result.verdict(), Verdict::confirmed) << failing(result);
  EXPECT_EQ(curve_called(result.findings.figures.front(), "srcf").x.size(), 5u);
  EXPECT_NE(result.findings.figures.front().caption.find("with 9 states"), std::string::npos);
}

TEST(Claims, OperationCountsKnowTheRoutinesOfTheFiltersMetadata) {
  const auto result = run_claim(claim_called("operation-counts"), {});
  // 7/6 n^3 + n^2 (5p/2 + m) of srcf.
  EXPECT_EQ(check_called(result, "srcf: multiplications per n^3").predicted, 7. / 6);
  EXPECT_EQ(check_called(result, "srcf: multiplications per n^2 m").predicted, 1);
  EXPECT_EQ(check_called(result, "srcf: multiplications per n^2 p").predicted, 2.5);
}
