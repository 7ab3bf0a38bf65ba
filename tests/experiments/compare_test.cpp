#include <kfstab/experiments/compare.hpp>

#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <kfstab/experiments/compare_page.hpp>
#include <kfstab/experiments/results.hpp>
#include <kfstab/experiments/selection.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/input_error.hpp>

#include <nlohmann/json.hpp>

using namespace kfstab;
using namespace kfstab::experiments;

namespace {

Fare kept(double P, double K) {
  Fare fare;
  fare.P = {P, P};
  fare.K = {K, K};
  return fare;
}
Fare kept(double digits) { return kept(digits, digits); }
Fare indefinite(std::int64_t step) {
  Fare fare = kept(10);
  fare.first_indefinite = step;
  return fare;
}
Fare broken(std::int64_t step) {
  Fare fare = kept(10);
  fare.first_failure = step;
  fare.failure = Status::singular_innovation;
  return fare;
}

/// Three states, one noise, one output: ckf takes 58.5 operations, srcf 67.5, joseph 108, csrf 57.
Comparison made_up(const std::vector<std::string>& filters, const std::string& scan,
                   const std::vector<std::vector<Fare>>& fares) {
  Comparison c;
  c.as_written.dimensions = {3, 1, 1};
  for (const auto& id : filters) c.filters.push_back(find_filter(id));
  c.scans = {parse_scan(scan)};
  for (std::size_t i = 0; i < fares.size(); ++i) {
    Point& point = c.points.emplace_back();
    point.at = {c.scans[0].values[i]};
    point.bits = scanned_bits(c.scans, point.at);
    point.done = true;
    point.filters = fares[i];
    for (std::size_t f = 0; f < fares[i].size(); ++f) point.filters[f].filter = c.filters[f];
  }
  return c;
}

std::string text(const Recommendation& recommendation) {
  std::string all;
  for (const auto& sentence : recommendation.sentences) all += sentence + "\n";
  return all;
}

void expect_says(const Recommendation& recommendation, const std::vector<std::string>& words) {
  for (const auto& word : words)
    EXPECT_NE(text(recommendation).find(word), std::string::npos) << "no '" << word << "' in " << text(recommendation);
}

Comparison compare_catalogue(const std::string& system, const std::string& filters,
                             const std::vector<std::string>& scans, int jobs = 0) {
  CompareOptions options;
  options.system = system;
  options.filters = select_filters(filters);
  for (const auto& scan : scans) options.scans.push_back(parse_scan(scan));
  options.jobs = jobs;
  return compare(options);
}

}  // namespace

TEST(Fare, KeepsTheFewestDigitsOfPAndK) {
  EXPECT_EQ(kept(9, 7).kept(), 7);
  EXPECT_EQ(kept(5, 7).kept(), 5);
  EXPECT_EQ(kept(std::numeric_limits<double>::quiet_NaN(), 7).kept(), 7);
  EXPECT_EQ(indefinite(3).kept(), 0);
  EXPECT_EQ(broken(3).kept(), 0);
}

TEST(Fare, IsReadFromARun) {
  FilterRun run;
  run.metadata = find_filter("ckf");
  for (const double error : {1e-12, 1e-3, 1e-9}) run.covariance_error.add(run.covariance_error.count(), error);
  run.gain_error.add(0, 0);
  run.bound.add(0, 1e-5);
  const Fare f = fare(run, 24);
  EXPECT_DOUBLE_EQ(f.P.worst, 3);
  EXPECT_DOUBLE_EQ(f.P.end, 24 * std::log10(2));  // a word holds no more
  EXPECT_DOUBLE_EQ(f.K.worst, 24 * std::log10(2));
  EXPECT_TRUE(std::isnan(f.x.worst));
  EXPECT_DOUBLE_EQ(f.bound, 5);
  EXPECT_DOUBLE_EQ(fare(run, 53).P.end, 9);
  EXPECT_TRUE(f.sound());
}

TEST(Recommend, TheCheapestWhereAllKeepTheDigits) {
  const auto c = made_up({"ckf", "srcf", "joseph"}, "d=1e-6,1",
                         {{kept(13), kept(13.9), kept(13.5)}, {kept(15), kept(15), kept(15)}});
  const Recommendation r = recommend(c);
  ASSERT_TRUE(r.filter);
  EXPECT_EQ(r.filter->id, "ckf");
  expect_says(r, {"Take ckf", "at all 2 points", "at least 13.0 digits", "fewest at d = 1e-6", "0.9 behind the best",
                  "The next, srcf", "keeps no more that counts"});
}

TEST(Recommend, WhatTheCheaperOneLosesAndWhere) {
  const auto c =
      made_up({"ckf", "srcf", "joseph"}, "d=1e-6,1", {{kept(8), kept(14), kept(8)}, {kept(15), kept(15), kept(15)}});
  const Recommendation r = recommend(c);
  ASSERT_TRUE(r.filter);
  EXPECT_EQ(r.filter->id, "srcf");
  expect_says(r, {"Take srcf", "ckf would take 87 % of that", "loses 6.0 digits more at d = 1e-6"});
}

TEST(Recommend, NoneThatLosesDefinitenessSomewhere) {
  const auto c = made_up({"ckf", "srcf"}, "d=1e-6,1", {{indefinite(3), kept(8)}, {kept(15), kept(15)}});
  const Recommendation r = recommend(c);
  ASSERT_TRUE(r.filter);
  EXPECT_EQ(r.filter->id, "srcf");
  expect_says(r, {"ckf would take", "not positive semidefinite at d = 1e-6 after step 3"});
}

TEST(Recommend, ThatWhichLastsLongestWhereNoneIsSoundEverywhere) {
  const auto c =
      made_up({"ckf", "srcf"}, "d=1e-6,1e-3,1", {{broken(2), broken(7)}, {broken(2), kept(8)}, {kept(15), kept(15)}});
  const Recommendation r = recommend(c);
  ASSERT_TRUE(r.filter);
  EXPECT_EQ(r.filter->id, "srcf");
  expect_says(r, {"No filter is sound at all 3 points", "srcf lasts longest, at 2", "step 7 (singular_innovation)"});
}

TEST(Recommend, NothingWhereNothingHolds) {
  const Recommendation none = recommend(made_up({"ckf"}, "d=1,2", {{broken(0)}, {broken(0)}}));
  EXPECT_EQ(none.filter, nullptr);
  expect_says(none, {"None of these filters"});
  EXPECT_EQ(recommend(Comparison{}).filter, nullptr);
}

TEST(Recommend, NeitherWhatHoldsNoPNorWhatDoesNotApply) {
  Fare refused;
  refused.refused = "srcf-hessenberg needs a time-invariant system";
  const auto c = made_up({"csrf", "srcf-hessenberg", "joseph"}, "d=1,2",
                         {{kept(15), refused, kept(15)}, {kept(15), kept(15), kept(15)}});
  const Recommendation r = recommend(c);
  ASSERT_TRUE(r.filter);
  EXPECT_EQ(r.filter->id, "joseph");
}

TEST(Recommend, ForDoubleWhereBitsAreScanned) {
  const auto c = made_up({"ckf", "srcf"}, "bits=12,24,53,113",
                         {{broken(0), kept(2)}, {broken(1), kept(5)}, {kept(6), kept(12)}, {kept(24), kept(30)}});
  const Recommendation r = recommend(c);
  ASSERT_TRUE(r.filter);
  EXPECT_EQ(r.filter->id, "srcf");
  expect_says(r,
              {"ckf would take", "6.0 digits more at bits = 53", "right to 3 digits", "ckf from 53", "srcf from 24"});
}

TEST(FewestBits, AreThoseFromWhichOnAllIsWell) {
  const auto c = made_up({"ckf", "srcf", "joseph"}, "bits=12,24,53",
                         {{kept(3), kept(2.9), kept(9)}, {broken(1), kept(6), kept(9)}, {kept(9), kept(12), kept(1)}});
  EXPECT_EQ(fewest_bits(c, 0), 53) << "it holds with 12 bits too, but not with 24";
  EXPECT_EQ(fewest_bits(c, 1), 24);
  EXPECT_EQ(fewest_bits(c, 2), std::nullopt);
}

// (6.1)-(6.3): every form that holds P is at its end near d = 2^-26, srcf goes on to 2^-52.
TEST(Compare, DyerAndMcReynoldsTakesARoot) {
  const auto c = compare_catalogue("dyer-mcreynolds", "^(ckf|joseph|srcf)$", {"d=2^-30:2^-6:log:5"});
  ASSERT_EQ(c.points.size(), 5u);
  EXPECT_FALSE(c.points[0].filters[0].sound());
  EXPECT_FALSE(c.points[0].filters[1].sound());
  EXPECT_TRUE(c.points[0].filters[2].sound());
  // What (6.3) takes from P's forms, k(Re) = 4.5/d^2, less luck: at d = 2^-12 that is 7.9 digits.
  EXPECT_LT(c.points[3].filters[0].kept(), 15.95 - std::log10(4.5 * 0x1p24) + 2);
  ASSERT_TRUE(c.recommendation.filter);
  EXPECT_EQ(c.recommendation.filter->id, "srcf");
  EXPECT_EQ(c.base.filters[2].filter->id, "srcf");
  EXPECT_GT(c.as_written.filters[2].seconds_per_step, 0);
}

// The same numbers whatever the jobs, and at 53 bits whether they are scanned or not.
TEST(Compare, IsDeterministic) {
  const std::vector<std::string> scans = {"q=2^-8,2^-4", "bits=20,53"};
  const auto one = compare_catalogue("double-integrator", "^(ckf|srcf|srif)$", scans, 1);
  const auto two = compare_catalogue("double-integrator", "^(ckf|srcf|srif)$", scans, 2);
  ASSERT_EQ(one.points.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t f = 0; f < 3; ++f) {
      EXPECT_EQ(one.points[i].filters[f].P.worst, two.points[i].filters[f].P.worst);
      EXPECT_EQ(one.points[i].filters[f].K.worst, two.points[i].filters[f].K.worst);
    }
  EXPECT_EQ(one.points[1].bits, 53);
  EXPECT_EQ(one.points[1].filters[0].P.worst, one.base.filters[0].P.worst);
  // 33 bits less are ten digits less; a digit or two either way is luck.
  EXPECT_NEAR(one.points[1].filters[1].kept() - one.points[0].filters[1].kept(), 33 * std::log10(2), 2);
}

// ||F^k||^{1/k} tends to rho(F) < 1, and is off by a factor k(V)^{1/k} of F's eigenvectors at most.
TEST(Compare, ForgettingIsTheClosedLoops) {
  const auto c = compare_catalogue("double-integrator", "^srcf$", {});
  EXPECT_GT(c.base.forgetting, 0.5);
  EXPECT_LT(c.base.forgetting, 1);
}

TEST(CheckScans, RefusesWhatTheSystemDoesNotTakeAtOneOfTheEnds) {
  const auto check = [](const std::string& scan) {
    CompareOptions options;
    options.system = "double-integrator";
    options.scans = {parse_scan(scan)};
    check_scans(options);
  };
  EXPECT_NO_THROW(check("R[0,0]=0.5,2"));
  EXPECT_THROW(check("unknown=1,2"), properties::InputError);
  EXPECT_THROW(check("R[5,5]=1,2"), properties::InputError);
  EXPECT_THROW(check("R[0,0]=-1,1"), properties::InputError);
  EXPECT_THROW(check("P0[0,1]=1,3"), properties::InputError);
}

TEST(CompareJson, HasWhatTheComparisonHas) {
  const auto c = made_up({"ckf", "srcf"}, "d=1e-6,1", {{broken(2), kept(8)}, {kept(15), kept(15)}});
  Comparison full = c;
  full.as_written.filters.resize(2);
  full.recommendation = recommend(full);
  const auto root = nlohmann::json::parse(compare_json(full));
  EXPECT_EQ(root.at("schema"), "kfstab.compare/1");
  EXPECT_EQ(root.at("scans").at(0).at("values"), (std::vector<double>{1e-6, 1}));
  const auto& point = root.at("points").at(0);
  EXPECT_EQ(point.at("at").at("d"), 1e-6);
  EXPECT_EQ(point.at("filters").at(0).at("sound"), false);
  EXPECT_EQ(point.at("filters").at(0).at("failure").at("status"), "singular_innovation");
  EXPECT_EQ(point.at("filters").at(1).at("digits").at("P").at("worst"), 8);
  EXPECT_TRUE(point.at("filters").at(1).at("digits").at("x").at("worst").is_null());
  EXPECT_EQ(root.at("recommendation").at("filter"), "srcf");
}

namespace {

std::vector<reports::Figure> figures(const reports::Document& document) {
  std::vector<reports::Figure> all;
  for (const auto& section : document.sections)
    for (const auto& block : section.blocks)
      if (const auto* figure = std::get_if<reports::Figure>(&block)) all.push_back(*figure);
  return all;
}

}  // namespace

TEST(ComparePage, DrawsCurvesOverOneScan) {
  auto c = made_up({"ckf", "srcf"}, "d=1e-6,1", {{indefinite(3), kept(8)}, {kept(15), kept(15)}});
  const auto drawn = figures(comparison_document(c));
  ASSERT_EQ(drawn.size(), 2u) << "P and K; there are no states";
  EXPECT_TRUE(drawn[0].x.log);
  ASSERT_EQ(drawn[0].curves.size(), 3u) << "two filters, and where they are not definite; bounds are not known";
  EXPECT_EQ(drawn[0].curves[1].id, "srcf");
  EXPECT_DOUBLE_EQ(drawn[0].curves[1].y[0], 53 * std::log10(2) - 8);
  EXPECT_EQ(drawn[0].curves[2].id, "indefinite");
  EXPECT_EQ(drawn[0].curves[2].x, std::vector<double>{1e-6});
}

TEST(ComparePage, DrawsHeatMapsOverTwo) {
  auto c = made_up({"ckf", "srcf"}, "d=1e-6,1", {{indefinite(3), kept(8)}, {kept(15), kept(15)}});
  c.scans.push_back(parse_scan("e=1,2,3"));
  const auto points = c.points;
  c.points.clear();
  for (const Point& point : points)
    for (const double e : c.scans[1].values) {
      c.points.push_back(point);
      c.points.back().at.push_back(e);
    }
  const auto drawn = figures(comparison_document(c));
  ASSERT_EQ(drawn.size(), 2u);
  const auto& maps = drawn[0].maps;
  EXPECT_EQ(maps.x, (std::vector<double>{1, 2, 3}));
  EXPECT_EQ(maps.y, (std::vector<double>{1e-6, 1}));
  ASSERT_EQ(maps.panels.size(), 2u);
  EXPECT_EQ(maps.panels[0].outlined, (std::vector<bool>{true, true, true, false, false, false}));
  EXPECT_DOUBLE_EQ(maps.panels[1].values[2], 53 * std::log10(2) - 8);
  EXPECT_DOUBLE_EQ(maps.panels[1].values[3], 53 * std::log10(2) - 15);
}
