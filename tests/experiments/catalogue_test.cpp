#include <kfstab/experiments/catalogue.hpp>

#include <algorithm>
#include <cmath>

#include "reports/scratch.hpp"

#include <kfstab/experiments/run.hpp>
#include <kfstab/experiments/selection.hpp>
#include <kfstab/filters/registry.hpp>

using namespace kfstab::experiments;
using kfstab::properties::InputError;

namespace {

class Catalogue : public ScratchFolder {};

std::string refusal_of(const std::string& word) {
  try {
    find_system(word);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

const std::string small = "name = \"small\"\nA = 0.5\nB = 1\nC = 1\nQ = 1\nR = 1\nP0 = 1\nsteps = 2\n";

/// Every system of the catalogue, a test each.
class EverySystem : public ::testing::TestWithParam<std::string> {};

std::vector<std::string> names() {
  std::vector<std::string> all;
  for (const CatalogueEntry& entry : catalogue()) all.emplace_back(entry.name);
  return all;
}

std::string test_name(const ::testing::TestParamInfo<std::string>& info) {
  std::string name = info.param;
  std::ranges::replace(name, '-', '_');
  return name;
}

}  // namespace

TEST_F(Catalogue, IsSortedAndHoldsTheFilesAsTheyAre) {
  ASSERT_GE(catalogue().size(), 20u);
  EXPECT_TRUE(std::ranges::is_sorted(names()));
  const std::filesystem::path systems = std::filesystem::path(KFSTAB_SOURCE_DIR) / "experiments" / "systems";
  EXPECT_EQ(catalogue().size(), entries(systems));
  for (const CatalogueEntry& entry : catalogue())
    EXPECT_EQ(entry.toml, read(systems / (std::string(entry.name) + ".toml"))) << entry.name;
}

TEST_F(Catalogue, OverridesReachTheSystem) {
  const auto system = find_system("local-level", {{{"q", "2^-3"}}, 7, {}});
  EXPECT_EQ(system.parameters.at("q"), .125);
  EXPECT_EQ(system.steps, 7);
}

TEST_F(Catalogue, AnUnknownNameIsToldItsNearMisses) {
  const std::string near = refusal_of("dyer-mcreynold");
  EXPECT_NE(near.find("no system called 'dyer-mcreynold'"), near.npos) << near;
  EXPECT_NE(near.find("did you mean 'dyer-mcreynolds'?"), near.npos) << near;
  EXPECT_NE(near.find("kfstab list systems"), near.npos) << near;
  const std::string far = refusal_of("xyzzy");
  EXPECT_NE(far.find("no system called 'xyzzy'"), far.npos) << far;
  EXPECT_EQ(far.find("did you mean"), far.npos) << far;
}

TEST_F(Catalogue, ASlashOrAnEndingMakesAPath) {
  put(folder / "local-level", small);
  put(folder / "mine.toml", small);
  put(folder / "mine.json", R"({"name": "small", "A": 0.5, "B": 1, "C": 1, "Q": 1, "R": 1, "P0": 1, "steps": 3})");
  EXPECT_EQ(find_system((folder / "local-level").string()).name, "small");
  EXPECT_EQ(find_system((folder / "mine.toml").string()).steps, 2);
  EXPECT_EQ(find_system((folder / "mine.json").string()).steps, 3);

  const auto here = std::filesystem::current_path();
  std::filesystem::current_path(folder);
  EXPECT_EQ(find_system("mine.toml").name, "small") << "no slash, but the ending";
  EXPECT_EQ(find_system("mine.json").steps, 3);
  EXPECT_EQ(find_system("./local-level").name, "small");
  EXPECT_EQ(find_system("local-level").name, "local-level") << "a file of that name does not count";
  std::filesystem::current_path(here);

  EXPECT_NE(refusal_of("local-level.toml").find("no such file"), std::string::npos);
  EXPECT_NE(refusal_of("./dyer-mcreynolds").find("no such file"), std::string::npos);
}

TEST_P(EverySystem, SaysWhatItIs) {
  const auto system = find_system(GetParam());
  EXPECT_EQ(system.name, GetParam());
  EXPECT_FALSE(system.description.empty());
  EXPECT_FALSE(system.source.empty());
  EXPECT_GE(system.dimensions().n, 1);
  EXPECT_GE(system.steps, 1);
}

TEST_P(EverySystem, TwentyStepsOfEveryFilterThatApplies) {
  const auto own = find_system(GetParam()).steps;
  const auto steps = std::min<std::int64_t>(20, own);
  const SystemRun result = run(find_system(GetParam(), {{}, steps, {}}), select_filters(""), {});
  EXPECT_FALSE(result.reference_error) << *result.reference_error;
  EXPECT_FALSE(result.interrupted);
  EXPECT_EQ(result.steps_done, steps);
  EXPECT_GE(result.certified_digits, 30);
  ASSERT_EQ(result.filters.size(), kfstab::filters().size());
  for (const FilterRun& f : result.filters) {
    const std::string id(f.metadata->id);
    SCOPED_TRACE(id);
    if (f.refused) {
      // "srif needs a positive definite P0: P0 is singular"
      const auto& needs = f.metadata->needs;
      EXPECT_TRUE(needs.invertible_A || needs.positive_definite_Q || needs.positive_definite_R ||
                  needs.positive_definite_P0 || needs.time_invariant);
      EXPECT_EQ(f.refused->find(id + " needs "), 0u) << *f.refused;
      EXPECT_NE(f.refused->find(": "), std::string::npos) << *f.refused;
      EXPECT_EQ(f.covariance_error.count(), 0);
      continue;
    }
    if (id == "information" && (GetParam() == "kaminski" || GetParam() == "radar")) {
      // Their variances are up to 1e22 apart, and that filter solves with P^{-1}: it says so.
      ASSERT_TRUE(f.first_failure);
      EXPECT_EQ(f.failure, kfstab::Status::singular_information);
      continue;
    }
    if (id == "csrf" && GetParam() == "kaminski") {
      // The first measurement takes away all but 2^-60 of a variance, and the increment of P with it, |t| = 1 to u.
      ASSERT_TRUE(f.first_failure);
      EXPECT_EQ(f.failure, kfstab::Status::hyperbolic_breakdown);
      continue;
    }
    EXPECT_FALSE(f.first_failure) << "at step " << *f.first_failure << ": " << name(f.failure);
    EXPECT_EQ(f.gain_error.count(), steps);
    EXPECT_TRUE(std::isfinite(f.gain_error.largest()) && std::isfinite(f.gain_error.last()));
    if (f.metadata->holds == kfstab::Held::gain) continue;
    EXPECT_EQ(f.covariance_error.count(), steps);
    for (const Series* series : {&f.covariance_error, &f.asymmetry, &f.smallest_eigenvalue, &f.bound})
      EXPECT_TRUE(std::isfinite(series->largest()) && std::isfinite(series->last()));
    EXPECT_LT(f.covariance_error.largest(), 1) << "not a digit is left";
  }
}

INSTANTIATE_TEST_SUITE_P(Catalogue, EverySystem, ::testing::ValuesIn(names()), test_name);

TEST_F(Catalogue, WhatIsSingularIsRefusedToTheInformationFilterAlone) {
  const auto refused = [](const char* name) {
    return run(find_system(name, {{}, 1, {}}), select_filters("^srif$"), {}).filters.front().refused;
  };
  for (const char* name : {"slicot-fb01qd", "unexcited-mode"}) {
    ASSERT_TRUE(refused(name)) << name;
    EXPECT_EQ(*refused(name), "srif needs a positive definite P0: P0 is singular");
  }
  for (const char* name : {"local-level", "double-integrator", "radar"}) EXPECT_FALSE(refused(name)) << *refused(name);
}
