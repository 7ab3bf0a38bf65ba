#include <kfstab/reports/plot.hpp>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <regex>
#include <sstream>
#include <stdexcept>

#include <kfstab/reports/gnuplot.hpp>

#include "reports/scratch.hpp"

using namespace kfstab::reports;
namespace fs = std::filesystem;

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
const double gap = std::nan("");

Figure sample_figure() {
  return {.id = "error-of-p",
          .title = "Error of P's <factor> & \"gain\"",
          .caption = "",
          .x = {"step k"},
          .y = {"relative_error", true},
          .curves = {{.id = "bound", .label = "30 u κ", .x = {0, 2}, .y = {1e-14, 1e-13}, .role = CurveRole::envelope},
                     {.id = "ckf", .label = "ckf, `symmetric`", .x = {0, 1, 2, 3}, .y = {1.0 / 3, gap, infinity, 1e-16}},
                     {.id = "s,\"r", .label = "srcf", .x = {0, 1, 2}, .y = {0, 5e-324, 1e-15}, .role = CurveRole::measured_points},
                     {.id = "none", .label = "broke down at once"},
                     {.id = "line", .label = "u k", .x = {0, 3}, .y = {1e-16, 1e-15}, .role = CurveRole::theory}}};
}

class Plot : public ScratchFolder {};

/// The script's lines that draw a curve, in the legend's order.
std::vector<std::string> plotted(const std::string& script) {
  std::vector<std::string> lines;
  std::istringstream text(script);
  for (std::string line; std::getline(text, line);)
    if (line.find(" index ") != line.npos) lines.push_back(line);
  return lines;
}

std::string after(const std::string& line, const std::string& word) {
  const std::size_t at = line.find(" " + word + " ");
  if (at == line.npos) return "";
  std::istringstream rest(line.substr(at + word.size() + 2));
  std::string value;
  rest >> value;
  return value;
}

}  // namespace

TEST_F(Plot, CsvReadsBackExactly) {
  const Environment no_pictures("PATH", "");
  const Figure figure = sample_figure();
  const Folder out(folder / "out");
  write_figure(figure, out);
  std::istringstream csv(read(folder / "out" / "error-of-p.csv"));
  std::string line;
  std::getline(csv, line);
  EXPECT_EQ(line, "curve,role,x,y");
  for (const Curve& curve : figure.curves)
    for (std::size_t k = 0; k < curve.x.size(); ++k) {
      ASSERT_TRUE(std::getline(csv, line));
      const std::string id = curve.id == "s,\"r" ? "\"s,\"\"r\"" : curve.id;
      EXPECT_EQ(line.find(id + ","), 0u) << line;
      const double y = std::strtod(line.substr(line.rfind(',') + 1).c_str(), nullptr);
      if (std::isnan(curve.y[k])) EXPECT_TRUE(std::isnan(y));
      else EXPECT_EQ(std::bit_cast<std::uint64_t>(y), std::bit_cast<std::uint64_t>(curve.y[k])) << line;
    }
  EXPECT_FALSE(std::getline(csv, line));
}

TEST_F(Plot, DataHasABlockForEachCurve) {
  const Environment no_pictures("PATH", "");
  const Folder out(folder / "out");
  write_figure(sample_figure(), out);
  const std::string data = read(folder / "out" / "error-of-p.dat");
  EXPECT_EQ(count(data, "\n\n\n# index"), 4u);
  EXPECT_NE(data.find("# index 1: ckf, measured_line: ckf, `symmetric`\n0 0.3333333333333333\n1 nan\n2 inf\n3 1e-16\n\n\n"), data.npos) << data;
  EXPECT_NE(data.find("# index 3: none, measured_line: broke down at once\nnan nan\n"), data.npos);
}

TEST_F(Plot, DrawsBothPicturesAndTheScriptAloneDrawsThemAgain) {
  if (!find_gnuplot()) GTEST_SKIP() << "no gnuplot here";
  const Folder out(folder / "out");
  const PlotResult result = write_figure(sample_figure(), out);
  EXPECT_TRUE(result.drawn) << result.warning;
  EXPECT_EQ(result.warning, "");
  EXPECT_EQ(read(folder / "out" / "error-of-p.png").substr(1, 3), "PNG");
  const std::string svg = read_svg(sample_figure(), out);
  for (const Curve& curve : sample_figure().curves) EXPECT_NE(svg.find(">" + curve.label + "<"), svg.npos) << curve.label;
  EXPECT_NE(svg.find("Error of P's &lt;factor> &amp; \"gain\""), svg.npos);
  EXPECT_NE(svg.find("figure_error_of_p_plot_1"), svg.npos);

  fs::create_directory(folder / "elsewhere");
  for (const char* name : {"error-of-p.gp", "error-of-p.dat"}) fs::copy_file(folder / "out" / name, folder / "elsewhere" / name);
  ASSERT_EQ(std::system(("cd '" + (folder / "elsewhere").string() + "' && gnuplot error-of-p.gp").c_str()), 0);
  EXPECT_EQ(read(folder / "elsewhere" / "error-of-p.svg"), svg);
  EXPECT_GT(fs::file_size(folder / "elsewhere" / "error-of-p.png"), 1000u);
}

TEST_F(Plot, EachMediumHasItsPicturesAndTheyAreWhole) {
  if (!find_gnuplot()) GTEST_SKIP() << "no gnuplot here";
  const auto starts = [&](const std::string& name, const std::string& with) {
    EXPECT_EQ(read(folder / "out" / name).substr(0, with.size()), with) << name;
  };
  const Folder out(folder / "out");
  EXPECT_EQ(pictures_of(sample_figure(), {}), (std::vector<std::string>{"error-of-p.svg", "error-of-p.png"}));
  for (const Medium medium : {Medium::slide, Medium::print, Medium::paper}) {
    const Drawing drawing{medium};
    const PlotResult result = write_figure(sample_figure(), out, drawing);
    EXPECT_TRUE(result.drawn) << result.warning;
    for (const std::string& name : files_of(sample_figure(), drawing)) EXPECT_TRUE(fs::exists(folder / "out" / name)) << name;
    starts("error-of-p.pdf", "%PDF");
  }
  EXPECT_NE(read(folder / "out" / "error-of-p.tex").find("\\includegraphics"), std::string::npos);
}

TEST_F(Plot, PrintHasNoColour) {
  const Environment no_pictures("PATH", "");
  const Folder out(folder / "out");
  write_figure(sample_figure(), out, {Medium::print});
  const std::string script = read(folder / "out" / "error-of-p.gp");
  const std::regex color("rgb '#(..)(..)(..)'");
  for (auto match = std::sregex_iterator(script.begin(), script.end(), color); match != std::sregex_iterator(); ++match)
    EXPECT_TRUE((*match)[1] == (*match)[2] && (*match)[2] == (*match)[3]) << match->str();
}

TEST(LabelString, EscapesWhatLatexWouldTakeForMarkup) {
  EXPECT_EQ(label_string("100 % of a_b's {x}^2, \\ $ & # ~", PowerNotation::latex),
            "'100 \\% of a\\_b''s \\{x\\}\\textasciicircum{}2, \\textbackslash{} \\$ \\& \\# \\textasciitilde{}'");
  EXPECT_EQ(label_string("κ ≤ |λ|", PowerNotation::latex), "'$\\kappa$ $\\le$ $|$$\\lambda$$|$'");
  EXPECT_EQ(label_string("a_b", PowerNotation::superscript), "'a_b'");
}

TEST_F(Plot, QuartilesAreDrawnButNotInTheLegendNorInText) {
  const Environment no_pictures("PATH", "");
  Figure figure = sample_figure();
  figure.curves.push_back({.id = "lower", .label = "not shown", .x = {1, 2}, .y = {1e-15, 1e-14}, .role = CurveRole::quartile, .color = 3});
  const Folder out(folder / "out");
  write_figure(figure, out);
  const std::string script = read(folder / "out" / "error-of-p.gp");
  EXPECT_NE(script.find("index " + std::to_string(figure.curves.size() - 1) +
                        " using (shown_x($1)):(shown_y($2)) with lines lc rgb '#CC79A7' lw 0.5 dt 1 notitle"),
            script.npos) << script;
  EXPECT_EQ(script.find("not shown"), script.npos);
  EXPECT_NE(read(folder / "out" / "error-of-p.csv").find("\nlower,quartile,1,"), std::string::npos);
}

TEST_F(Plot, ASecondRunReplacesAllFiles) {
  const Environment no_pictures("PATH", "");
  { write_figure(sample_figure(), Folder(folder / "out")); }
  const Folder again(folder / "out");
  EXPECT_EQ(entries(folder / "out"), 1u);
}

TEST_F(Plot, WithoutGnuplotAllElseIsWritten) {
  const Environment path("PATH", "");
  const Folder out(folder / "out");
  const PlotResult result = write_figure(sample_figure(), out);
  EXPECT_FALSE(result.drawn);
  EXPECT_NE(result.warning.find("gnuplot was not found"), std::string::npos) << result.warning;
  for (const char* ending : {".csv", ".dat", ".gp"}) EXPECT_TRUE(fs::exists(folder / "out" / (std::string("error-of-p") + ending))) << ending;
  EXPECT_FALSE(fs::exists(folder / "out" / "error-of-p.svg"));
  EXPECT_EQ(read_svg(sample_figure(), out), "");
  const TextPlot text = text_plot(sample_figure());
  EXPECT_EQ(text.text, "");
  EXPECT_NE(text.warning, "");
}

TEST_F(Plot, AFailingGnuplotLeavesNoHalfPictures) {
  fs::create_directory(folder / "bin");
  put(folder / "bin" / "gnuplot", "#!/bin/sh\nread cd; read load\ncd '" + (folder / "out").string() + "'\necho '<svg' > error-of-p.svg\n");
  fs::permissions(folder / "bin" / "gnuplot", fs::perms::owner_all);
  const Environment path("PATH", (folder / "bin").string());
  const Folder out(folder / "out");
  const PlotResult result = write_figure(sample_figure(), out);
  EXPECT_FALSE(result.drawn);
  EXPECT_NE(result.warning.find("no complete picture"), std::string::npos) << result.warning;
  EXPECT_FALSE(fs::exists(folder / "out" / "error-of-p.svg"));
}

TEST_F(Plot, ZeroOnALogAxisIsOnTheFloorNotLost) {
  const Environment no_pictures("PATH", "");
  const Folder out(folder / "out");
  write_figure(sample_figure(), out);
  const std::string script = read(folder / "out" / "error-of-p.gp");
  EXPECT_NE(script.find("set ytics ('0' "), script.npos);
  EXPECT_NE(script.find("nohead front"), script.npos);
  EXPECT_NE(script.find("shown_y(v) = v >= 1e-300 ? v : v < 1e-300 ? "), script.npos);
  Figure positive = sample_figure();
  positive.id = "positive";
  positive.curves.erase(positive.curves.begin() + 2);
  write_figure(positive, out);
  EXPECT_EQ(read(folder / "out" / "positive.gp").find("'0'"), script.npos);
}

TEST_F(Plot, EnvelopesAreBeneathTheoryAboveAndTheLegendFollowsTheEnds) {
  const Environment no_pictures("PATH", "");
  const Folder out(folder / "out");
  Figure figure{.id = "order", .title = "", .caption = "", .x = {}, .y = {}, .curves = {}};
  for (double end : {1.0, 3.0, gap, 2.0}) {
    const std::string id = "c" + std::to_string(figure.curves.size());
    figure.curves.push_back({.id = id, .label = id, .x = {0, 1}, .y = {0.5, end}});
  }
  figure.curves.push_back({.id = "t", .label = "t", .x = {0, 1}, .y = {0, 9}, .role = CurveRole::theory});
  figure.curves.push_back({.id = "e", .label = "e", .x = {0, 1}, .y = {0, 0}, .role = CurveRole::envelope});
  write_figure(figure, out);
  std::string order;
  for (const std::string& line : plotted(read(folder / "out" / "order.gp"))) order += after(line, "title");
  EXPECT_EQ(order, "'e','c1','c3','c0','c2','t'");
}

TEST_F(Plot, TwelveCurvesDifferWithoutColour) {
  const Environment no_pictures("PATH", "");
  const Folder out(folder / "out");
  Figure figure{.id = "many", .title = "", .caption = "", .x = {}, .y = {}, .curves = {}};
  for (int c = 0; c < 12; ++c) {
    const std::string id = "c" + std::to_string(c);
    figure.curves.push_back({.id = id, .label = id, .x = {0, 1}, .y = {0, 1}});
  }
  figure.curves[3].color = 0;  // asked for: the others make room
  write_figure(figure, out);
  std::vector<std::string> styles, colored;
  for (const std::string& line : plotted(read(folder / "out" / "many.gp"))) {
    styles.push_back(after(line, "dt") + after(line, "pt"));
    colored.push_back(styles.back() + after(line, "rgb"));
    EXPECT_EQ(line.find("#F0E442"), line.npos);
  }
  for (auto* list : {&styles, &colored}) {
    std::sort(list->begin(), list->end());
    EXPECT_EQ(std::unique(list->begin(), list->end()), list->end());
    EXPECT_EQ(list->size(), 12u);
  }
}

TEST_F(Plot, ThinsForTheEyeAndKeepsTheExtremes) {
  const Environment no_pictures("PATH", "");
  Curve curve{.id = "long", .label = "long"};
  for (int k = 0; k < 100000; ++k) {
    curve.x.push_back(k);
    curve.y.push_back(k == 54321 ? 1e9 : k == 777 ? gap : std::sin(k));
  }
  const Folder out(folder / "out");
  write_figure({.id = "long", .title = "", .caption = "", .x = {}, .y = {}, .curves = {curve}}, out);
  const std::string data = read(folder / "out" / "long.dat");
  EXPECT_LT(count(data, "\n"), 6000u);
  EXPECT_NE(data.find("\n54321 1000000000\n"), data.npos);
  EXPECT_NE(data.find("\n777 nan\n"), data.npos);
  EXPECT_NE(data.find("\n99999 "), data.npos);
  EXPECT_EQ(count(read(folder / "out" / "long.csv"), "\n"), 100001u);
}

TEST_F(Plot, RefusesWhatIsNoFigure) {
  const Folder out(folder / "out");
  for (const char* id : {"", "a b", "../a", "a_b", "ü"}) {
    Figure figure = sample_figure();
    figure.id = id;
    EXPECT_THROW(write_figure(figure, out), std::invalid_argument) << id;
  }
  Figure uneven = sample_figure();
  uneven.curves[0].x.push_back(1);
  EXPECT_THROW(write_figure(uneven, out), std::invalid_argument);
  Figure twice = sample_figure();
  twice.curves[0].id = "ckf";
  EXPECT_THROW(text_plot(twice), std::invalid_argument);
  EXPECT_EQ(entries(folder / "out"), 1u);
}

TEST_F(Plot, DrawsOddFiguresToo) {
  if (!find_gnuplot()) GTEST_SKIP() << "no gnuplot here";
  const Folder out(folder / "out");
  const std::vector<std::vector<double>> values{{}, {gap, gap}, {0, 0}, {-1, -2}, {7, 7}, {1e300, 5e-324}, {infinity, 1}};
  for (std::size_t k = 0; k < values.size(); ++k)
    for (bool log : {false, true}) {
      Figure figure{.id = "odd-" + std::to_string(k) + (log ? "-log" : ""), .title = "odd", .caption = "", .x = {"x", log}, .y = {"y", log}, .curves = {}};
      for (CurveRole role : {CurveRole::measured_points, CurveRole::measured_line, CurveRole::quartile, CurveRole::theory,
                             CurveRole::envelope})
        figure.curves.push_back({.id = std::to_string(figure.curves.size()), .label = "l", .x = std::vector<double>(values[k].size(), 1.0), .y = values[k], .role = role});
      EXPECT_EQ(write_figure(figure, out).warning, "");
      EXPECT_EQ(text_plot(figure).warning, "");
    }
  EXPECT_EQ(write_figure({.id = "no-curves", .title = "", .caption = "", .x = {}, .y = {}, .curves = {}}, out).warning, "");
}

TEST(TextPlot, FitsTheTerminalAndNamesItsCurves) {
  if (!find_gnuplot()) GTEST_SKIP() << "no gnuplot here";
  for (const auto& [width, height] : {std::pair{80, 24}, std::pair{100, 30}}) {
    const TextPlot plot = text_plot(sample_figure(), width, height);
    ASSERT_EQ(plot.warning, "");
    EXPECT_LE(count(plot.text, "\n"), static_cast<std::size_t>(height));
    EXPECT_GE(count(plot.text, "\n"), static_cast<std::size_t>(height - 4));
    std::istringstream lines(plot.text);
    for (std::string line; std::getline(lines, line);) EXPECT_LE(line.size(), static_cast<std::size_t>(width) + 8) << line;
    EXPECT_EQ(plot.text.find('\f'), plot.text.npos);
    for (const char* entry : {"A ckf, `symmetric`", "B srcf", "= u k", "+ 30 u κ", "relative_error", "step k", "1e-10"})
      EXPECT_NE(plot.text.find(entry), plot.text.npos) << entry << '\n' << plot.text;
  }
}
