#include <kfstab/experiments/pages.hpp>

#include <algorithm>
#include <cmath>
#include <set>

#include "reports/scratch.hpp"

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/selection.hpp>

using namespace kfstab;
using namespace kfstab::experiments;

namespace {

class Pages : public ScratchFolder {};

SystemRun run_of(const std::string& system, std::int64_t steps, const std::string& filters,
                 const std::map<std::string, std::string>& set = {}) {
  return run(find_system(system, {set, steps, {}}), select_filters(filters), {});
}

template <class Block>
std::vector<Block> blocks_of(const reports::Section& section) {
  std::vector<Block> found;
  for (const auto& block : section.blocks)
    if (const auto* one = std::get_if<Block>(&block)) found.push_back(*one);
  return found;
}

std::string text_of(const reports::Section& section) {
  std::string text;
  for (const auto& paragraph : blocks_of<reports::Paragraph>(section)) text += paragraph.text + "\n";
  return text;
}

const reports::Figure& figure_ending(const std::vector<reports::Figure>& figures, const std::string& end) {
  for (const auto& figure : figures)
    if (figure.id.ends_with(end)) return figure;
  throw std::invalid_argument("no figure " + end);
}

ClaimResult small_claim() {
  ClaimResult result;
  result.claim = {.id = "made-up",
                  .number = 7,
                  .title = "A title",
                  .statement = "A statement.",
                  .source = "A source",
                  .setup = "A setup",
                  .prediction = "A prediction",
                  .meaning = "A meaning",
                  .parameters = {{"r", .2, "a radius", 0, 1}, {"n", 3, "a number", 1, 9}},
                  .measure = {},
                  .mathematics = "D+ = A D A'\nF = A - K C"};
  result.settings = Settings({{"r", .1}, {"n", 3}});
  result.findings.checks = {{"one", 1, 1, "equal", true}, {"two", 1, 3, "equal", false}};
  result.findings.figures = {{"made-up-figure",
                              "Figure",
                              "What is it?",
                              {"x", false},
                              {"y", true},
                              {{"a", "a", {1, 2}, {3, 4}, reports::CurveRole::measured_line, 0}}}};
  return result;
}

}  // namespace

TEST_F(Pages, TableHasARowAFilter) {
  const auto table = run_table(run_of("unexcited-mode", 6, "^(ckf|srcf|srif)$"));
  EXPECT_NE(table.caption.find("unexcited-mode: n = 2, m = 1, p = 1, 6 steps, reference certified to "),
            std::string::npos)
      << table.caption;
  EXPECT_EQ(table.header.front(), "filter");
  ASSERT_EQ(table.rows.size(), 3u);
  EXPECT_EQ(table.rows[0][0], "ckf");
  EXPECT_EQ(table.rows[0].size(), table.header.size());
  EXPECT_EQ(table.rows[0][5], "-") << "no data, no state";
  EXPECT_EQ(table.rows[1][0], "srcf");
  EXPECT_EQ(table.rows[2][0], "srif");
  EXPECT_EQ(table.rows[2][1], "refused: srif needs a positive definite P0: P0 is singular");
  EXPECT_EQ(table.rows[1][9], "never");
  EXPECT_GT(std::stod(table.rows[1][10]), 14);
  EXPECT_GT(std::stod(table.rows[1][11]), 0);
}

TEST_F(Pages, TableSaysWhatBrokeDown) {
  const auto broken = run_of("dyer-mcreynolds", 3, "^(ckf|srcf)$", {{"d", "2^-30"}});
  const auto table = run_table(broken);
  const auto says = [&](std::size_t row) {
    return std::ranges::any_of(table.rows[row], [&](const std::string& cell) {
      return cell == std::string(name(broken.filters[row].failure)) + " at 0";
    });
  };
  ASSERT_EQ(table.rows.size(), 2u);
  EXPECT_TRUE(says(0)) << "ckf: " << table.rows[0].back();
  EXPECT_FALSE(says(1));
}

TEST_F(Pages, RunHasAFigureForEachQuestionWithCaptionAndLabels) {
  const auto run = run_of("local-level", 8, "^(ckf|srcf|srif)$");
  const auto document = run_document({run});
  EXPECT_NE(document.title.find("local-level"), std::string::npos);
  EXPECT_FALSE(document.context.empty());
  ASSERT_EQ(document.sections.size(), 2u);
  const auto& section = document.sections.front();
  EXPECT_EQ(section.title, "local-level");
  EXPECT_NE(text_of(section).find(run.description), std::string::npos);
  EXPECT_NE(text_of(section).find(run.source), std::string::npos);
  ASSERT_EQ(blocks_of<reports::Table>(section).size(), 1u);
  EXPECT_EQ(blocks_of<reports::Table>(section).front().rows.size(), 3u);

  const auto figures = blocks_of<reports::Figure>(section);
  for (const auto& [end, of] : {std::pair{"-covariance-error", &FilterRun::covariance_error},
                                {"-gain-error", &FilterRun::gain_error},
                                {"-asymmetry", &FilterRun::asymmetry},
                                {"-smallest-eigenvalue", &FilterRun::smallest_eigenvalue}}) {
    SCOPED_TRACE(end);
    const auto& figure = figure_ending(figures, end);
    EXPECT_EQ(figure.id, std::string("local-level") + end);
    EXPECT_FALSE(figure.title.empty());
    EXPECT_NE(figure.caption.find('?'), std::string::npos) << "a caption asks what the figure answers";
    EXPECT_FALSE(figure.x.label.empty());
    EXPECT_FALSE(figure.y.label.empty());
    EXPECT_TRUE(figure.y.log);
    for (const FilterRun& f : run.filters) {
      const auto curve = std::ranges::find(figure.curves, f.metadata->id, &reports::Curve::id);
      ASSERT_NE(curve, figure.curves.end()) << f.metadata->id;
      EXPECT_EQ(curve->y, (f.*of).points().value) << f.metadata->id;
      EXPECT_EQ(curve->x.front(), 0);
    }
  }
}

TEST_F(Pages, ErrorStandsOverItsBoundAndAFiltersColourIsTheSameEverywhere) {
  const auto run = run_of("local-level", 8, "^(ckf|srcf)$");
  const auto figures = blocks_of<reports::Figure>(run_document({run}).sections.front());
  const auto& error = figure_ending(figures, "-covariance-error");
  const auto envelope = std::ranges::find(error.curves, reports::CurveRole::envelope, &reports::Curve::role);
  ASSERT_NE(envelope, error.curves.end());
  EXPECT_EQ(envelope->y, run.filters[0].bound.points().value);
  std::set<int> ckf, srcf;
  for (const auto& figure : figures)
    for (const auto& curve : figure.curves) {
      if (curve.id == "ckf") ckf.insert(curve.color);
      if (curve.id == "srcf") srcf.insert(curve.color);
    }
  EXPECT_EQ(ckf.size(), 1u);
  EXPECT_EQ(srcf.size(), 1u);
  EXPECT_NE(*ckf.begin(), *srcf.begin());
}

TEST_F(Pages, WhatTheSystemDoesToAnErrorIsDrawnInDecades) {
  const auto run = run_of("local-level", 8, "^ckf$");
  const auto figures = blocks_of<reports::Figure>(run_document({run}).sections.front());
  const auto& figure = figure_ending(figures, "-error-analysis");
  EXPECT_FALSE(figure.y.log);
  const auto curve = [&](const char* id) { return *std::ranges::find(figure.curves, id, &reports::Curve::id); };
  ASSERT_EQ(figure.curves.size(), 4u);
  EXPECT_EQ(curve("amplification").y, run.analysis.log10_amplification.points().value);
  EXPECT_EQ(curve("gamma").y.back(), 2 * std::log10(run.analysis.gamma.last()));
  EXPECT_EQ(curve("innovation-condition").y.back(), 0);  // p = 1
  EXPECT_GT(curve("angle").y.back(), 0);

  // the gain's error stands over its bound too
  const auto& gain = figure_ending(figures, "-gain-error");
  const auto envelope = std::ranges::find(gain.curves, reports::CurveRole::envelope, &reports::Curve::role);
  ASSERT_NE(envelope, gain.curves.end());
  EXPECT_EQ(envelope->y, run.filters[0].gain_bound.points().value);
}

TEST_F(Pages, RunEndsWithWhatEachFilterComputes) {
  const auto document = run_document({run_of("unexcited-mode", 3, "^(ckf|srcf|srif)$"), run_of("local-level", 3, "^ckf$")});
  const auto equations = blocks_of<reports::Equations>(document.sections.back());
  ASSERT_EQ(equations.size(), 1u);
  ASSERT_EQ(equations[0].equations.size(), 2u) << "srif is refused, ckf there twice";
  EXPECT_EQ(equations[0].equations[0].label, "ckf");
  EXPECT_EQ(equations[0].equations[1].text, select_filters("^srcf$").front()->update);
}

TEST_F(Pages, RefusedFiltersHaveNoCurveAndOthersDo) {
  const auto document = run_document({run_of("unexcited-mode", 4, "^(ckf|srif)$")});
  for (const auto& figure : blocks_of<reports::Figure>(document.sections.front()))
    for (const auto& curve : figure.curves) EXPECT_NE(curve.id, "srif") << figure.id;
}

TEST_F(Pages, SaysWhatWasInterruptedAndWhereTheReferenceStopped) {
  SystemRun run = run_of("local-level", 5, "^ckf$");
  run.interrupted = true;
  run.steps_asked = 1000;
  EXPECT_NE(text_of(run_document({run}).sections[0]).find("Interrupted after 5 of 1000 steps"), std::string::npos);
  run.interrupted = false;
  run.reference_error = "step 5: Re is not positive definite";
  EXPECT_NE(
      text_of(run_document({run}).sections[0]).find("The reference has no answer: step 5: Re is not positive definite"),
      std::string::npos);
}

TEST_F(Pages, SystemsOfOneNameDoNotMixTheirFigures) {
  const auto one = run_of("local-level", 3, "^ckf$"), two = run_of("local-level", 5, "^ckf$");
  SystemRun alike = run_of("double-integrator", 2, "^ckf$");
  alike.name = "Local.level";
  const auto document = run_document({one, two, alike});
  std::set<std::string> anchors, figures;
  for (const auto& section : document.sections) {
    EXPECT_TRUE(anchors.insert(section.anchor).second) << section.anchor;
    for (const auto& figure : blocks_of<reports::Figure>(section))
      EXPECT_TRUE(figures.insert(figure.id).second) << figure.id;
  }
  EXPECT_EQ(anchors.size(), 4u);
  EXPECT_EQ(figure_ending(blocks_of<reports::Figure>(document.sections[1]), "-gain-error").curves.front().x.size(), 5u);
}

TEST_F(Pages, ClaimSaysAllThatItIs) {
  const auto document = claims_document({small_claim()});
  ASSERT_EQ(document.sections.size(), 1u);
  const auto& section = document.sections.front();
  EXPECT_EQ(section.anchor, "made-up");
  EXPECT_EQ(section.verdict, reports::Verdict::refuted);
  for (const char* words : {"A statement.", "A source", "A setup", "A prediction", "A meaning"})
    EXPECT_NE(text_of(section).find(words), std::string::npos) << words;
  ASSERT_EQ(blocks_of<reports::Figure>(section).size(), 1u);
  ASSERT_EQ(blocks_of<reports::Checks>(section).size(), 1u);
  EXPECT_EQ(blocks_of<reports::Checks>(section)[0].checks.size(), 2u);
  ASSERT_EQ(blocks_of<reports::Preformatted>(section).size(), 1u);
  EXPECT_EQ(blocks_of<reports::Preformatted>(section)[0].text, "kfstab claim '^made-up$' --set n=3 --set r=0.1");
  ASSERT_EQ(blocks_of<reports::Equations>(section).size(), 1u);
  EXPECT_EQ(blocks_of<reports::Equations>(section)[0].equations[1].text, "F = A - K C");
  ASSERT_EQ(blocks_of<reports::Table>(section).size(), 1u);
  EXPECT_EQ(blocks_of<reports::Table>(section)[0].rows[0],
            (std::vector<std::string>{"r", "0.1", "0.2", "0", "1", "a radius"}));
}

TEST_F(Pages, VerdictTableHasARowAClaim) {
  const auto table = verdict_table({small_claim(), small_claim()});
  ASSERT_EQ(table.rows.size(), 2u);
  EXPECT_EQ(table.rows[0], (std::vector<std::string>{"C7", "made-up", "refuted", "1 of 2", "A title"}));
  EXPECT_EQ(table.rows[0].size(), table.header.size());
}

TEST_F(Pages, FormatsAreWrittenThatWereAskedForAndAMissingBrowserIsAWarning) {
  const Environment path("PATH", folder.string());
  ::testing::internal::CaptureStderr();
  write_results(claims_document({small_claim()}), "{}\n", folder / "out",
                {.html = false, .markdown = true, .pdf = true, .medium = reports::Medium::slide});
  const std::string warning = ::testing::internal::GetCapturedStderr();
  EXPECT_EQ(count(warning, "no report.pdf: chromium was not found in PATH"), 1u) << warning;
  EXPECT_FALSE(std::filesystem::exists(folder / "out" / "index.html"));
  const std::string markdown = read(folder / "out" / "report.md");
  for (const char* text : {"| [C7  A title](#made-up) | refuted |", "D+ = A D A'", "**Setup.** A setup", "| two | 1 | 3 | no | equal |",
                           "## Environment", "| kfstab |"})
    EXPECT_NE(markdown.find(text), std::string::npos) << text << '\n' << markdown;
  EXPECT_NE(read(folder / "out" / "made-up-figure.gp").find("pdfcairo"), std::string::npos);
}

TEST_F(Pages, FolderHoldsThePageTheJsonAndEveryFigure) {
  const Environment path("PATH", folder.string());  // no gnuplot: what is written without it
  ::testing::internal::CaptureStderr();
  write_results(run_document({run_of("unexcited-mode", 3, "^(ckf|srif)$")}), "{\"a\": 1}\n", folder / "out");
  const std::string warning = ::testing::internal::GetCapturedStderr();
  EXPECT_EQ(count(warning, "gnuplot was not found"), 1u) << warning;
  EXPECT_EQ(count(warning, "\n"), 1u) << "told once: " << warning;
  EXPECT_EQ(read(folder / "out" / "results.json"), "{\"a\": 1}\n");
  for (const char* figure : {"covariance-error", "gain-error", "asymmetry", "smallest-eigenvalue"})
    for (const char* ending : {".csv", ".gp", ".dat"})
      EXPECT_TRUE(std::filesystem::exists(folder / "out" / (std::string("unexcited-mode-") + figure + ending)))
          << figure << ending;
  const std::string page = read(folder / "out" / "index.html");
  EXPECT_NE(page.find("refused: srif needs a positive definite P0"), page.npos);
  for (const char* title :
       {"Relative error of P", "Relative error of the gain", "Asymmetry of P", "Smallest eigenvalue of P"})
    EXPECT_NE(page.find(title), page.npos) << title;
}

TEST_F(Pages, ARunWithNothingToDrawIsWrittenAllTheSame) {
  const Environment path("PATH", folder.string());
  ::testing::internal::CaptureStderr();
  EXPECT_NO_THROW(write_results(run_document({run_of("unexcited-mode", 2, "^srif$")}), "{}", folder / "out"));
  ::testing::internal::GetCapturedStderr();
  EXPECT_TRUE(std::filesystem::exists(folder / "out" / "index.html"));
}
