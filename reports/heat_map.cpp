#include <kfstab/reports/heat_map.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <optional>
#include <string_view>

#include <fmt/format.h>

#include <kfstab/reports/gnuplot.hpp>
#include <kfstab/reports/number.hpp>
#include <kfstab/reports/script.hpp>
#include <kfstab/reports/terminal.hpp>

namespace kfstab::reports {
namespace {

// van der Walt's and Smith's viridis at ten equal steps.
constexpr std::array<std::string_view, 10> viridis{"#440154", "#482878", "#3e4989", "#31688e", "#26828e",
                                                   "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"};

Scale color_scale(const HeatMaps& maps) {
  std::vector<double> values;
  for (const HeatMap& panel : maps.panels) values.insert(values.end(), panel.values.begin(), panel.values.end());
  return scale_for(maps.color, values, {}, 0);
}

/// Black on bright colours, white on dark ones.
int text_color(double value, const Scale& scale) {
  const auto at = [&](double v) { return scale.log ? std::log10(v) : v; };
  const double part = (at(scale.shown(value)) - at(scale.low)) / (at(scale.high) - at(scale.low));
  return part > 0.55 ? 0x000000 : 0xffffff;
}

/// The sides of cells between what is outlined and what is not, as pieces of line.
std::string outline_of(const HeatMap& panel, const std::vector<double>& x, const std::vector<double>& y) {
  const std::size_t columns = x.size() - 1, rows = y.size() - 1;
  const auto inside = [&](std::size_t row, std::size_t column) { return panel.outlined[row * columns + column]; };
  std::string text;
  const auto piece = [&](double x1, double y1, double x2, double y2) {
    fmt::format_to(std::back_inserter(text), "{}{} {}\n{} {}\n", text.empty() ? "" : "\n", exact_number(x1),
                   exact_number(y1), exact_number(x2), exact_number(y2));
  };
  if (panel.outlined.empty()) return text;
  for (std::size_t row = 0; row < rows; ++row)
    for (std::size_t column = 0; column < columns; ++column) {
      if (!inside(row, column)) continue;  // no line along the frame: the frame is one
      if (column > 0 && !inside(row, column - 1)) piece(x[column], y[row], x[column], y[row + 1]);
      if (column + 1 < columns && !inside(row, column + 1)) piece(x[column + 1], y[row], x[column + 1], y[row + 1]);
      if (row > 0 && !inside(row - 1, column)) piece(x[column], y[row], x[column + 1], y[row]);
      if (row + 1 < rows && !inside(row + 1, column)) piece(x[column], y[row + 1], x[column + 1], y[row + 1]);
    }
  return text;
}

std::size_t columns_of_panels(std::size_t panels) {
  return std::min<std::size_t>(4, static_cast<std::size_t>(std::ceil(std::sqrt(static_cast<double>(panels)))));
}

}  // namespace

std::vector<double> cell_borders(const std::vector<double>& middles, bool log) {
  if (middles.empty()) return {0};
  std::vector<double> at = middles;
  if (log) std::transform(at.begin(), at.end(), at.begin(), [](double v) { return std::log10(v); });
  std::vector<double> borders;
  const double first = at.size() > 1 ? at[1] - at[0] : 1, last = at.size() > 1 ? at.back() - at[at.size() - 2] : 1;
  borders.push_back(at.front() - first / 2);
  for (std::size_t i = 1; i < at.size(); ++i) borders.push_back(at[i - 1] + (at[i] - at[i - 1]) / 2);
  borders.push_back(at.back() + last / 2);
  if (log) std::transform(borders.begin(), borders.end(), borders.begin(), [](double v) { return std::pow(10, v); });
  return borders;
}

std::string heat_map_data(const Figure& figure) {
  const HeatMaps& maps = figure.maps;
  const std::vector<double> x = cell_borders(maps.x, figure.x.log), y = cell_borders(maps.y, figure.y.log);
  const Scale scale = color_scale(maps);
  std::string text;
  const auto out = std::back_inserter(text);
  int index = 0;
  for (const HeatMap& panel : maps.panels) {
    fmt::format_to(out, "{}# index {}: {}: {}: x y left right bottom top value label color\n",
                   index == 0 ? "\n" : "\n\n", index, one_line(panel.id), one_line(panel.label));
    bool empty = true;
    for (std::size_t row = 0; row < maps.y.size(); ++row)
      for (std::size_t column = 0; column < maps.x.size(); ++column) {
        const double value = panel.values[row * maps.x.size() + column];
        if (!std::isfinite(value)) continue;
        fmt::format_to(out, "{} {} {} {} {} {} {} {} {}\n", exact_number(maps.x[column]), exact_number(maps.y[row]),
                       exact_number(x[column]), exact_number(x[column + 1]), exact_number(y[row]),
                       exact_number(y[row + 1]), exact_number(value), short_number(value), text_color(value, scale));
        empty = false;
      }
    // gnuplot drops a block without a line, and all later ones would move up by one.
    if (empty) text += "nan nan nan nan nan nan nan nan nan\n";
    const std::string outline = outline_of(panel, x, y);
    fmt::format_to(out, "\n\n# index {}: the line around what is outlined\n{}", index + 1,
                   outline.empty() ? "nan nan\n" : outline);
    index += 2;
  }
  return text;
}

int heat_map_height(const Figure& figure) {
  const std::size_t panels = figure.maps.panels.size(), columns = columns_of_panels(panels);
  if (panels <= 1) return 560;
  return 110 + static_cast<int>((panels + columns - 1) / columns) * (columns == 2 ? 290 : 240);
}

std::string heat_map_commands(const Figure& figure, PowerNotation notation, const HeatMapStyle& style) {
  const HeatMaps& maps = figure.maps;
  const std::size_t columns = columns_of_panels(maps.panels.size());
  const std::size_t rows = (maps.panels.size() + columns - 1) / columns;
  const std::vector<double> x = cell_borders(maps.x, figure.x.log), y = cell_borders(maps.y, figure.y.log);
  const bool several = maps.panels.size() > 1;

  std::string text = "unset label\nset palette defined (";
  const auto out = std::back_inserter(text);
  for (std::size_t i = 0; i < viridis.size(); ++i) fmt::format_to(out, "{}{} '{}'", i == 0 ? "" : ", ", i, viridis[i]);
  text += ")\nset border 15 lc rgb '#666666'\nunset grid\n";
  // What has no number is hatched.
  text +=
      "set object 1 rectangle from graph 0, graph 0 to graph 1, graph 1 behind fc rgb '#999999' fs pattern 4 "
      "noborder\n";
  const int most = several ? 4 : 8;
  text += axis_commands("x", figure.x, {.log = figure.x.log, .low = x.front(), .high = x.back()}, notation, most);
  text += axis_commands("y", figure.y, {.log = figure.y.log, .low = y.front(), .high = y.back()}, notation, most);
  text += axis_commands("cb", maps.color, color_scale(maps), notation, 8);
  if (maps.matrix) {
    const auto step = [&](std::size_t count) { return std::max<std::size_t>(1, (count + most - 1) / most); };
    fmt::format_to(out, "set yrange [{}:{}]\nset xtics {}\nset ytics {}\n", exact_number(y.back()),
                   exact_number(y.front()), step(maps.x.size()), step(maps.y.size()));
  }

  // Lengths in pixels of a picture 800 wide.
  const double height = heat_map_height(figure) / style.type, width = 800 / style.type;
  const double top = 1 - ((maps.outline.empty() ? 44 : 66) + (several ? 26 : 0)) / height, bottom = 62 / height;
  const double left = 88 / width, right = 1 - 114 / width;
  const double gap = several ? 50 / width : 0, rise = 62 / height;
  const double wide = (right - left - gap * static_cast<double>(columns - 1)) / static_cast<double>(columns);
  const double high = (top - bottom - rise * static_cast<double>(rows - 1)) / static_cast<double>(rows);
  fmt::format_to(out, "set colorbox user origin screen {:.4f}, screen {:.4f} size screen 0.02, screen {:.4f}\n",
                 right + 0.015, bottom, top - bottom);
  fmt::format_to(out,
                 "set key at screen {:.4f}, screen {:.4f} right top horizontal noenhanced textcolor rgb '#222222'\n",
                 right, 1 - 40 / height);
  fmt::format_to(out, "set label {} at screen {:.4f}, screen {:.4f} left noenhanced\n",
                 label_string(figure.title, notation), left, 1 - 22 / height);
  // One label an axis for all panels.
  fmt::format_to(out,
                 "set label {} at screen {:.4f}, screen {:.4f} center noenhanced\n"
                 "set label {} at screen 0.025, screen {:.4f} center rotate noenhanced\nunset xlabel\nunset ylabel\n",
                 label_string(figure.x.label, notation), (left + right) / 2, 12 / height,
                 label_string(figure.y.label, notation), (top + bottom) / 2);
  text += "set multiplot\n";
  const std::string data = gnuplot_string(figure.id + ".dat");
  for (std::size_t i = 0; i < maps.panels.size(); ++i) {
    const std::size_t row = i / columns, column = i % columns;
    const double at_x = left + static_cast<double>(column) * (wide + gap);
    const double at_y = top - static_cast<double>(row) * (high + rise);
    fmt::format_to(out,
                   "set lmargin at screen {:.4f}; set rmargin at screen {:.4f}; set tmargin at screen {:.4f}; set "
                   "bmargin at screen {:.4f}\n",
                   at_x, at_x + wide, at_y, at_y - high);
    if (several)
      fmt::format_to(out, "set title {} noenhanced offset 0,-0.6\n", label_string(maps.panels[i].label, notation));
    if (i == 1) text += "unset label\nunset colorbox\n";  // once is enough
    fmt::format_to(
        out, "plot {} index {} using 1:2:3:4:5:6:(shown_cb($7)) with boxxyerror lc palette fs solid 1 border notitle",
        data, 2 * i);
    if (maps.numbers)
      fmt::format_to(out, ", \\\n     {} index {} using 1:2:8:9 with labels tc rgb variable noenhanced notitle", data,
                     2 * i);
    if (!maps.outline.empty())
      fmt::format_to(out,
                     ", \\\n     {0} index {1} with lines lc rgb '#ffffff' lw 5 notitle, \\\n     {0} index {1} with "
                     "lines lc rgb '{3}' lw 2.5 title {2}",
                     data, 2 * i + 1, label_string(i == 0 ? maps.outline : "", notation),
                     style.grey ? "#000000" : "#d55e00");
    text += '\n';
  }
  return text + "unset multiplot\n";
}

std::string heat_map_text(const Figure& figure, int width) {
  const HeatMaps& maps = figure.maps;
  std::string text;
  for (const HeatMap& panel : maps.panels) {
    for (std::size_t stride = 1;; ++stride) {
      Table table{.caption = panel.label, .header = {""}, .rows = {}, .alignment = {Alignment::right}};
      for (std::size_t column = 0; column < maps.x.size(); column += stride) {
        table.header.push_back(short_number(maps.x[column]));
        table.alignment.push_back(Alignment::right);
      }
      for (std::size_t r = 0; r < maps.y.size(); ++r) {
        const std::size_t row = maps.matrix ? r : maps.y.size() - 1 - r;
        table.rows.push_back({short_number(maps.y[row])});
        for (std::size_t column = 0; column < maps.x.size(); column += stride) {
          const std::size_t cell = row * maps.x.size() + column;
          const bool outlined = !panel.outlined.empty() && panel.outlined[cell];
          table.rows.back().push_back(short_number(panel.values[cell]) + (outlined ? "*" : ""));
        }
      }
      const std::string rendered = render_text(table);
      const std::string grid = rendered.substr(panel.label.empty() ? 0 : rendered.find('\n') + 1);
      const bool fits =
          display_width(std::string_view(grid).substr(0, grid.find('\n'))) <= static_cast<std::size_t>(width);
      if (!fits && stride < maps.x.size()) continue;
      text += rendered;
      if (stride > 1) text += fmt::format("(one column of {})\n", stride);
      break;
    }
  }
  if (!maps.outline.empty()) text += fmt::format("* {}\n", one_line(maps.outline));
  return text;
}

}  // namespace kfstab::reports
