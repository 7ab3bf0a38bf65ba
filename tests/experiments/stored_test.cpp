#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/stored.hpp>

#include <cmath>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/pages.hpp>
#include <kfstab/experiments/results.hpp>
#include <kfstab/experiments/selection.hpp>
#include <kfstab/properties/input_error.hpp>
#include <kfstab/reports/html.hpp>

using namespace kfstab::experiments;
using kfstab::properties::InputError;

namespace {

std::string page_of(const kfstab::reports::Document& document) {
  return kfstab::reports::render_html(document, nullptr);
}

SystemRun run_to_store(const std::string& system, std::int64_t steps, const std::string& filters,
                 const std::map<std::string, std::string>& set = {}) {
  return run(find_system(system, {set, steps, {}}), select_filters(filters), {});
}

/// A claim with all that a figure can have, and numbers that JSON has no word for.
ClaimResult full_claim() {
  using namespace kfstab::reports;
  ClaimResult result;
  result.claim = {.id = "made-up",
                  .number = 7,
                  .title = "A title with \"quotes\" and é",
                  .statement = "A statement",
                  .source = "A source",
                  .setup = "A setup",
                  .prediction = "A prediction",
                  .meaning = "A meaning",
                  .parameters = {{"r", .25, "a radius", 0, infinity}},
                  .measure = {},
                  .mathematics = "D+ = A D A'\nF = A - K C"};
  result.settings = Settings({{"r", .125}});
  result.findings.checks = {{"a", infinity, NaN, "nothing", false}, {"b", .1, .3, "all", true}};
  result.seconds = 1.5;
  Figure curves{.id = "curves", .title = "Curves", .caption = "Which?", .x = {"k"}, .y = {"error", true}, .curves = {}};
  for (const CurveRole role : {CurveRole::measured_points, CurveRole::quartile, CurveRole::theory, CurveRole::envelope})
    curves.curves.push_back({std::string(name(role)), "label", {1, 2, 3}, {NaN, infinity, .1}, role, 3});
  Figure map{.id = "map", .title = "Map", .caption = "Where?", .x = {"r", true}, .y = {"q"}, .curves = {}};
  map.maps = {{1, 10},      {1, 2}, {"lost"}, {{"ckf", "the ckf", {1, NaN, -infinity, 4}, {true, false, false, true}}},
              "indefinite", true,   true};
  result.findings.figures = {curves, map};
  return result;
}

/// The complaint about a text that is no result.
std::string complaint(const std::string& text) {
  try {
    read_results(text, "file.json");
  } catch (const InputError& error) {
    return error.what();
  }
  return "read";
}

}  // namespace

TEST(Stored, ARunReadBackIsTheSamePageAndTheSameFile) {
  const Context made{{"kfstab", "0.1.0"}, {"date", "2026-01-01T00:00:00Z"}};
  // Refused, broken down at once, with data and without.
  const std::vector<SystemRun> runs{run_to_store("unexcited-mode", 6, "^(ckf|srcf|srif)$"),
                                    run_to_store("local-level", 9, "^(ckf|csrf|srcf)$"),
                                    run_to_store("dyer-mcreynolds", 3, "^(ckf|srcf)$", {{"d", "2^-30"}})};
  const std::string text = run_json(runs, made);
  const auto stored = std::get<StoredRun>(read_results(text, "file.json"));
  EXPECT_EQ(page_of(run_document(stored.systems, stored.context)), page_of(run_document(runs, made)));
  EXPECT_EQ(run_json(stored.systems, stored.context), text);
}

TEST(Stored, ClaimsReadBackAreTheSamePageAndTheSameFile) {
  const Context made{{"kfstab", "0.1.0"}};
  const std::vector<ClaimResult> claims{full_claim()};
  const std::string text = claims_json(claims, {{"r", .125}}, made);
  const auto stored = std::get<StoredClaims>(read_results(text, "file.json"));
  EXPECT_EQ(page_of(claims_document(stored.claims, stored.context)), page_of(claims_document(claims, made)));
  EXPECT_EQ(claims_json(stored.claims, stored.parameters, stored.context), text);
  const auto& figures = stored.claims.front().findings.figures;
  EXPECT_EQ(figures[0].curves[3].role, kfstab::reports::CurveRole::envelope);
  EXPECT_EQ(figures[1].maps.panels[0].outlined, (std::vector<bool>{true, false, false, true}));
}

TEST(Stored, AFilterThatThisKfstabDoesNotHaveIsShownAllTheSame) {
  auto file = nlohmann::ordered_json::parse(run_json({run_to_store("local-level", 3, "^ckf$")}));
  file["systems"][0]["filters"][0]["id"] = "of-yesterday";
  const auto stored = std::get<StoredRun>(read_results(file.dump(), "file.json"));
  EXPECT_EQ(run_table(stored.systems[0]).rows[0][0], "of-yesterday");
}

TEST(Stored, AFileFromBeforeTheKeysThatCameLaterIsRead) {
  auto file = nlohmann::ordered_json::parse(claims_json({full_claim()}, {}));
  for (const char* key : {"mathematics", "meaning", "variable"}) file["claims"][0].erase(key);
  for (auto& figure : file["claims"][0]["figures"]) {
    for (const char* key : {"x", "y", "maps"}) figure.erase(key);
    for (auto& curve : figure["curves"]) curve.erase("role"), curve.erase("color");
  }
  const auto stored = std::get<StoredClaims>(read_results(file.dump(), "file.json"));
  EXPECT_EQ(stored.claims[0].claim.title, full_claim().claim.title);
  EXPECT_EQ(stored.claims[0].findings.figures[0].curves[0].role, kfstab::reports::CurveRole::measured_line);
}

TEST(Stored, RubbishIsRefusedInALineThatSaysWhereAndWhatWasExpected) {
  const auto says = [](const std::string& text, const std::vector<std::string>& words) {
    const std::string line = complaint(text);
    EXPECT_EQ(line.find("file.json"), 0u) << line;
    EXPECT_EQ(line.find('\n'), line.npos) << line;
    for (const std::string& word : words) EXPECT_NE(line.find(word), line.npos) << word << " not in: " << line;
  };
  says("", {"no JSON"});
  says("{\"schema\": ", {"no JSON"});
  says("[1]", {"expected an object"});
  says("{}", {"expected an object with 'schema'"});
  says(R"({"schema": 3})", {"/schema", "found 3", "expected a text"});
  says(R"({"schema": "kfstab.list/1"})", {"/schema", "kfstab.list/1", "kfstab.run/1 or kfstab.claims/1"});
  says(R"({"schema": "kfstab.runs/1"})", {"kfstab.run/1 or kfstab.claims/1"});
  says(R"({"schema": "kfstab.claims/2"})", {"kfstab.claims/2", "version 1"});
  says(R"({"schema": "kfstab.run/1", "context": {}})", {"'systems'"});
  auto file = nlohmann::ordered_json::parse(claims_json({full_claim()}, {}));
  file["claims"][0]["checks"][1]["measured"] = "many";
  says(file.dump(), {"/claims/0/checks/1/measured", "found \"many\"", "a number"});
  file = nlohmann::ordered_json::parse(claims_json({full_claim()}, {}));
  file["claims"][0]["figures"][0]["curves"][0]["y"] = {1};
  says(file.dump(), {"/claims/0/figures/0/curves/0", "as many values"});
}
