#include <kfstab/reports/heat_map.hpp>

#include <cmath>
#include <sstream>
#include <stdexcept>

#include <kfstab/reports/gnuplot.hpp>
#include <kfstab/reports/plot.hpp>
#include <kfstab/reports/terminal.hpp>

#include "reports/scratch.hpp"

using namespace kfstab::reports;

namespace {

/// Three columns, two rows; the right column is outlined.
Figure sample_map() {
  Figure figure{
      .id = "map", .title = "Digits, lost & found", .caption = "", .x = {"r", true}, .y = {"q"}, .curves = {}};
  figure.maps.x = {1e-4, 1e-2, 1};
  figure.maps.y = {1, 2};
  figure.maps.color = {"error of P", true};
  figure.maps.outline = "P indefinite";
  figure.maps.panels = {{.id = "ckf",
                         .label = "ckf",
                         .values = {1e-16, 1e-12, std::nan(""), 0, 1e-8, 1e-2},
                         .outlined = {false, false, true, false, false, true}}};
  return figure;
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

class HeatMapFiles : public ScratchFolder {};

}  // namespace

TEST(CellBorders, LieInTheMiddleByDifferenceOrByRatio) {
  EXPECT_EQ(cell_borders({1, 2, 4}, false), (std::vector<double>{.5, 1.5, 3, 5}));
  EXPECT_EQ(cell_borders({3}, false), (std::vector<double>{2.5, 3.5}));
  const auto borders = cell_borders({1e-4, 1e-2, 1}, true);
  ASSERT_EQ(borders.size(), 4u);
  // pow and log10 are right to an ulp or two of numbers of size 5.
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(std::log10(borders[i]), -5 + 2. * static_cast<double>(i), 1e-14);
}

TEST(HeatMapData, HasAnEntryForEachFiniteCellAndTheLineBetweenInsideAndOutside) {
  const std::string data = heat_map_data(sample_map());
  const auto lines = lines_of(data);
  EXPECT_EQ(count(data, "\n\n\n# index"), 1u);
  EXPECT_EQ(count(data, " 1e-12 1e-12 "), 1u) << data;
  EXPECT_EQ(count(data, "nan"), 0u) << "what is not finite is left to the hatching: " << data;
  std::size_t cells = 0, ends = 0;
  for (const std::string& line : lines) {
    const std::size_t columns = line.empty() || line[0] == '#' ? 0 : count(line, " ") + 1;
    cells += columns == 9;
    ends += columns == 2;
  }
  EXPECT_EQ(cells, 5u);
  EXPECT_EQ(ends, 4u) << "two sides of cells, none along the frame: " << data;
  Figure left = sample_map();
  left.maps.panels.front().outlined = {true, false, false, true, false, false};
  ends = 0;
  for (const std::string& line : lines_of(heat_map_data(left)))
    ends += !line.empty() && line[0] != '#' && count(line, " ") == 1;
  EXPECT_EQ(ends, 4u);
}

TEST_F(HeatMapFiles, CsvReadsBackExactly) {
  const Environment no_pictures("PATH", "");
  write_figure(sample_map(), Folder(folder / "out"));
  EXPECT_EQ(read(folder / "out" / "map.csv"),
            "map,x,y,value,outlined\nckf,0.0001,1,1e-16,0\nckf,0.01,1,1e-12,0\nckf,1,1,nan,1\n"
            "ckf,0.0001,2,0,0\nckf,0.01,2,1e-08,0\nckf,1,2,0.01,1\n");
}

TEST_F(HeatMapFiles, AreDrawnWithTheirTitlesAndLabels) {
  if (!find_gnuplot()) GTEST_SKIP() << "no gnuplot here";
  const Folder out(folder / "out");
  for (const std::size_t panels : {1, 2, 5}) {
    Figure figure = sample_map();
    while (figure.maps.panels.size() < panels) {
      figure.maps.panels.push_back(figure.maps.panels.front());
      figure.maps.panels.back().id = figure.maps.panels.back().label = "f" + std::to_string(figure.maps.panels.size());
    }
    figure.id = "map-" + std::to_string(panels);
    figure.maps.numbers = panels == 1;
    const PlotResult result = write_figure(figure, out);
    EXPECT_TRUE(result.drawn) << result.warning;
    const std::string svg = read_svg(figure, out);
    for (const char* text : {"Digits, lost &amp; found", ">r<", ">q<", ">error of P<", ">P indefinite<"})
      EXPECT_GE(count(svg, text), 1u) << text;
    for (const HeatMap& panel : figure.maps.panels)
      EXPECT_EQ(count(svg, ">" + panel.label + "<"), panels > 1 ? 1u : 0u);
    EXPECT_EQ(count(svg, ">1e-12<"), panels == 1 ? 1u : 0u);
    EXPECT_GE(count(svg, "fill = 'rgb("), 5 * panels) << "a coloured cell for each number";
  }
}

TEST_F(HeatMapFiles, OddOnesAreDrawnToo) {
  if (!find_gnuplot()) GTEST_SKIP() << "no gnuplot here";
  const Folder out(folder / "out");
  for (const bool log : {false, true}) {
    Figure figure = sample_map();
    figure.id = log ? "log" : "linear";
    figure.maps.x = figure.maps.y = {1};
    figure.maps.color.log = log;
    figure.maps.matrix = true;
    figure.maps.panels.clear();
    for (const double value : {std::nan(""), 0., -1., 1e300, HUGE_VAL})
      figure.maps.panels.push_back({.id = std::to_string(value), .label = "", .values = {value}, .outlined = {}});
    EXPECT_EQ(write_figure(figure, out).warning, "");
    figure.id += "-nothing";
    figure.maps.panels.resize(1);
    EXPECT_EQ(write_figure(figure, out).warning, "");
  }
}

TEST_F(HeatMapFiles, RefusesWhatIsNone) {
  const Folder out(folder / "out");
  const auto refused = [&](auto change) {
    Figure figure = sample_map();
    change(figure);
    EXPECT_THROW(write_figure(figure, out), std::invalid_argument);
  };
  refused([](Figure& f) { f.curves = {{.id = "c", .label = "c"}}; });
  refused([](Figure& f) { f.maps.x = {1, 1, 2}; });
  refused([](Figure& f) { f.maps.x = {0, 1, 2}; });
  refused([](Figure& f) { f.maps.panels.front().values.pop_back(); });
  refused([](Figure& f) { f.maps.panels.front().outlined.pop_back(); });
  refused([](Figure& f) { f.maps.panels.push_back(f.maps.panels.front()); });
}

TEST(HeatMapText, IsATableWithTheFirstRowOfAMatrixOnTop) {
  Figure figure = sample_map();
  auto lines = lines_of(heat_map_text(figure, 80));
  ASSERT_EQ(lines.size(), 6u);
  EXPECT_EQ(lines[0], "ckf");
  EXPECT_EQ(lines[3].substr(0, 1), "2") << "y grows upwards";
  EXPECT_NE(lines[3].find("0.01*"), std::string::npos);
  EXPECT_EQ(lines[5], "* P indefinite");
  figure.maps.matrix = true;
  lines = lines_of(heat_map_text(figure, 80));
  EXPECT_EQ(lines[3].substr(0, 1), "1");
}

TEST(HeatMapText, LeavesOutColumnsThatDoNotFitAndSaysSo) {
  Figure figure = sample_map();
  figure.x.log = false;
  figure.maps.x.clear();
  for (int i = 0; i < 60; ++i) figure.maps.x.push_back(i);
  figure.maps.panels.front().values.assign(120, 1e-10);
  figure.maps.panels.front().outlined.clear();
  const std::string text = heat_map_text(figure, 80);
  for (const std::string& line : lines_of(text)) EXPECT_LE(display_width(line), 80u) << line;
  EXPECT_NE(text.find("(one column of "), text.npos);
}
