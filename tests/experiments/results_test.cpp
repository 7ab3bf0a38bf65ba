#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/results.hpp>

#include <cmath>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/context.hpp>
#include <kfstab/experiments/selection.hpp>

using namespace kfstab::experiments;
using nlohmann::json;

namespace {

void expect_context(const json& context) {
  for (const auto& [name, value] : kfstab::experiments::context()) {
    ASSERT_TRUE(context.contains(name)) << name;
    EXPECT_TRUE(name == "date" || context[name] == value) << name;
  }
  for (const char* key :
       {"kfstab", "revision", "compiler", "flags", "fused multiply-add", "u", "Eigen", "Boost", "MPFR"})
    EXPECT_FALSE(context[key].get<std::string>().empty()) << key;
}

/// A claim with numbers that JSON has no word for.
ClaimResult odd_claim() {
  ClaimResult result;
  result.claim.id = "odd";
  result.claim.number = 99;
  result.claim.title = "A title with \"quotes\", a \\ and \xc3\xa9";
  result.settings = Settings({{"r", 1.25}});
  result.findings.checks = {
      {"a", infinity, NaN, "nothing", false}, {"b", 2, -infinity, "no more", false}, {"c", .1, .3, "all", true}};
  kfstab::reports::Figure figure;
  figure.id = "odd-figure";
  figure.title = "Odd";
  figure.caption = "Is it odd?";
  figure.curves = {{"ckf", "ckf", {1, 2, 3}, {NaN, infinity, .1}, kfstab::reports::CurveRole::measured_line, 0}};
  result.findings.figures = {figure};
  result.seconds = .5;
  return result;
}

std::vector<double> numbers(const json& array) { return array.get<std::vector<double>>(); }

}  // namespace

TEST(ClaimsJson, HasTheKeysOfItsSchema) {
  const auto document = json::parse(claims_json({odd_claim()}, {{"r", 1.25}}));
  EXPECT_EQ(document["schema"], "kfstab.claims/1");
  expect_context(document["context"]);
  EXPECT_EQ(document["parameters"], (json{{"r", 1.25}}));
  ASSERT_EQ(document["claims"].size(), 1u);
  const json& claim = document["claims"][0];
  EXPECT_EQ(claim["id"], "odd");
  EXPECT_EQ(claim["number"], 99);
  EXPECT_EQ(claim["title"], "A title with \"quotes\", a \\ and \xc3\xa9");
  EXPECT_EQ(claim["verdict"], "refuted");
  EXPECT_EQ(claim["parameters"], (json{{"r", 1.25}}));
  EXPECT_EQ(claim["seconds"], .5);
  for (const char* key : {"statement", "source", "setup", "prediction"}) EXPECT_TRUE(claim[key].is_string()) << key;
  ASSERT_EQ(claim["checks"].size(), 3u);
  const json& check = claim["checks"][2];
  EXPECT_EQ(check["name"], "c");
  EXPECT_EQ(check["predicted"].get<double>(), .1);
  EXPECT_EQ(check["measured"].get<double>(), .3);
  EXPECT_EQ(check["criterion"], "all");
  EXPECT_EQ(check["holds"], true);
  ASSERT_EQ(claim["figures"].size(), 1u);
  const json& figure = claim["figures"][0];
  EXPECT_EQ(figure["id"], "odd-figure");
  EXPECT_EQ(figure["caption"], "Is it odd?");
  for (const char* file : {"odd-figure.svg", "odd-figure.png", "odd-figure.csv", "odd-figure.gp", "odd-figure.dat"})
    EXPECT_NE(std::find(figure["files"].begin(), figure["files"].end(), file), figure["files"].end()) << file;
  ASSERT_EQ(figure["curves"].size(), 1u);
  EXPECT_EQ(figure["curves"][0]["id"], "ckf");
  EXPECT_EQ(numbers(figure["curves"][0]["x"]), (std::vector<double>{1, 2, 3}));
}

TEST(ClaimsJson, WhatIsNotFiniteIsNullWithItsWordBeside) {
  const auto document = json::parse(claims_json({odd_claim()}, {}));
  const json& checks = document["claims"][0]["checks"];
  EXPECT_TRUE(checks[0]["predicted"].is_null());
  EXPECT_EQ(checks[0]["predicted_word"], "inf");
  EXPECT_TRUE(checks[0]["measured"].is_null());
  EXPECT_EQ(checks[0]["measured_word"], "nan");
  EXPECT_EQ(checks[1]["predicted"], 2);
  EXPECT_FALSE(checks[1].contains("predicted_word"));
  EXPECT_EQ(checks[1]["measured_word"], "-inf");
  EXPECT_EQ(document["claims"][0]["figures"][0]["curves"][0]["y"], (json{"nan", "inf", .1}));
}

TEST(ClaimsJson, OfNoClaimIsStillADocument) {
  const auto document = json::parse(claims_json({}, {}));
  EXPECT_TRUE(document["claims"].is_array());
  EXPECT_TRUE(document["claims"].empty());
  EXPECT_TRUE(document["parameters"].is_object());
}

TEST(RunJson, HasTheKeysOfItsSchema) {
  const auto result = run(find_system("local-level", {{{"q", "0.1"}}, 7, {}}), select_filters("^(ckf|srif)$"), {});
  const auto document = json::parse(run_json({result}));
  EXPECT_EQ(document["schema"], "kfstab.run/1");
  expect_context(document["context"]);
  EXPECT_EQ(document["context"]["seed"], 7);
  ASSERT_EQ(document["systems"].size(), 1u);
  const json& system = document["systems"][0];
  EXPECT_EQ(system["name"], "local-level");
  EXPECT_EQ(system["n"], 1);
  EXPECT_EQ(system["m"], 1);
  EXPECT_EQ(system["p"], 1);
  EXPECT_EQ(system["parameters"]["q"].get<double>(), .1);
  EXPECT_EQ(system["steps"], 7);
  EXPECT_EQ(system["steps_asked"], 7);
  EXPECT_EQ(system["interrupted"], false);
  EXPECT_GE(system["reference"]["certified_digits"].get<int>(), 30);
  EXPECT_FALSE(system["reference"].contains("error"));
  ASSERT_EQ(system["filters"].size(), 2u);

  const json& ckf = system["filters"][0];
  EXPECT_EQ(ckf["id"], "ckf");
  EXPECT_EQ(ckf["instant"], "predicted");
  EXPECT_EQ(system["filters"][1]["instant"], "filtered");
  EXPECT_TRUE(ckf["first_indefinite"].is_null());
  EXPECT_TRUE(ckf["failure"].is_null());
  EXPECT_GT(ckf["seconds_per_step"].get<double>(), 0);
  const FilterRun& measured = result.filters[0];
  EXPECT_EQ(ckf["worst"]["covariance_error"].get<double>(), measured.covariance_error.largest());
  EXPECT_EQ(ckf["worst"]["smallest_eigenvalue"].get<double>(), measured.smallest_eigenvalue.smallest());
  EXPECT_EQ(ckf["last"]["gain_error"].get<double>(), measured.gain_error.last());
  EXPECT_EQ(ckf["last"]["state_error"].get<double>(), measured.state_error.last());
  for (const auto& [key, series] : {std::pair{"covariance_error", &measured.covariance_error},
                                    {"bound", &measured.bound},
                                    {"gain_error", &measured.gain_error},
                                    {"gain_bound", &measured.gain_bound},
                                    {"state_error", &measured.state_error},
                                    {"asymmetry", &measured.asymmetry},
                                    {"smallest_eigenvalue", &measured.smallest_eigenvalue}}) {
    SCOPED_TRACE(key);
    const json& curve = ckf["curves"][key];
    EXPECT_EQ(curve["count"], 7);
    EXPECT_EQ(numbers(curve["step"]), series->points().step);
    EXPECT_EQ(numbers(curve["value"]), series->points().value) << "numbers read back exactly";
  }
  for (const auto& [key, series] : {std::pair{"gamma", &result.analysis.gamma},
                                    {"log10_amplification", &result.analysis.log10_amplification},
                                    {"innovation_condition", &result.analysis.innovation_condition},
                                    {"cosine", &result.analysis.cosine}}) {
    SCOPED_TRACE(key);
    EXPECT_EQ(system["analysis"][key]["count"], 7);
    EXPECT_EQ(numbers(system["analysis"][key]["value"]), series->points().value);
  }
}

TEST(RunJson, SaysWhatWasRefusedWhatBrokeDownAndWhatIsMissing) {
  const auto refused = run(find_system("unexcited-mode", {{}, 2, {}}), select_filters("^srif$"), {});
  const auto broken = run(find_system("dyer-mcreynolds", {{{"d", "2^-30"}}, 2, {}}), select_filters("^ckf$"), {});
  const auto document = json::parse(run_json({refused, broken}));
  EXPECT_TRUE(document["context"]["seed"].is_null());
  ASSERT_EQ(document["systems"].size(), 2u);
  const json& srif = document["systems"][0]["filters"][0];
  EXPECT_EQ(srif["refused"], "srif needs a positive definite P0: P0 is singular");
  EXPECT_FALSE(srif.contains("curves"));
  const json& ckf = document["systems"][1]["filters"][0];
  EXPECT_EQ(ckf["failure"]["step"], 0);
  EXPECT_EQ(ckf["failure"]["status"], name(broken.filters[0].failure));
  EXPECT_TRUE(ckf["seconds_per_step"].is_null());
  EXPECT_EQ(ckf["seconds_per_step_word"], "nan");
  EXPECT_TRUE(ckf["last"]["covariance_error"].is_null()) << "no step was done";
  EXPECT_EQ(ckf["worst"]["covariance_error_word"], "nan");
  EXPECT_EQ(ckf["curves"]["covariance_error"]["count"], 0);
  EXPECT_FALSE(ckf["curves"].contains("state_error")) << "a run without data";
  EXPECT_FALSE(ckf["last"].contains("state_error"));
}

TEST(RunJson, SaysWhyTheReferenceStoppedAndWhereCurvesAreNotFinite) {
  SystemRun odd;
  odd.name = "odd";
  odd.steps_asked = 9;
  odd.steps_done = 2;
  odd.interrupted = true;
  odd.reference_error = "step 2: \"no\" answer";
  FilterRun filter;
  filter.metadata = select_filters("^ckf$").front();
  filter.covariance_error.add(0, infinity);
  filter.covariance_error.add(1, NaN);
  filter.first_indefinite = 1;
  odd.filters = {filter};
  const auto document = json::parse(run_json({odd}));
  const json& system = document["systems"][0];
  EXPECT_EQ(system["steps"], 2);
  EXPECT_EQ(system["steps_asked"], 9);
  EXPECT_EQ(system["interrupted"], true);
  EXPECT_EQ(system["reference"]["error"], "step 2: \"no\" answer");
  EXPECT_EQ(system["filters"][0]["first_indefinite"], 1);
  EXPECT_EQ(system["filters"][0]["curves"]["covariance_error"]["value"], (json{"inf", "nan"}));
  EXPECT_TRUE(system["filters"][0]["worst"]["covariance_error"].is_null());
  EXPECT_EQ(system["filters"][0]["worst"]["covariance_error_word"], "inf");
}
