#include <kfstab/reports/script.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numeric>
#include <set>

#include <fmt/format.h>

#include <kfstab/reports/gnuplot.hpp>
#include <kfstab/reports/heat_map.hpp>
#include <kfstab/reports/number.hpp>

namespace kfstab::reports {
namespace {

/// The points of a curve that make a difference to the eye.
std::vector<std::size_t> visible_points(const Curve& curve) {
  constexpr std::size_t many = 4000, stretches = 1000;
  const std::size_t n = curve.y.size();
  std::vector<std::size_t> points;
  if (n <= many) {
    points.resize(n);
    std::iota(points.begin(), points.end(), std::size_t{0});
    return points;
  }
  for (std::size_t stretch = 0; stretch < stretches; ++stretch) {
    const std::size_t begin = stretch * n / stretches, end = (stretch + 1) * n / stretches;
    std::set<std::size_t> kept{begin, end - 1};
    std::size_t lowest = n, highest = n, gap = n;
    for (std::size_t k = begin; k < end; ++k) {
      if (!std::isfinite(curve.y[k])) {
        if (gap == n) gap = k;
        continue;
      }
      if (lowest == n || curve.y[k] < curve.y[lowest]) lowest = k;
      if (highest == n || curve.y[k] > curve.y[highest]) highest = k;
    }
    for (std::size_t k : {lowest, highest, gap})
      if (k < n) kept.insert(k);
    points.insert(points.end(), kept.begin(), kept.end());
  }
  return points;
}

/// The palette slot of each curve; -1 for theory and envelopes that ask for none.
std::vector<int> slots_of(const Figure& figure) {
  std::set<int> taken;
  for (const Curve& curve : figure.curves)
    if (is_measured(curve) && curve.color >= 0) taken.insert(curve.color);
  std::vector<int> slots;
  int next = 0;
  for (const Curve& curve : figure.curves) {
    int slot = std::max(curve.color, -1);
    if (slot < 0 && is_measured(curve)) {
      while (taken.contains(next)) ++next;
      slot = next++;
    }
    slots.push_back(slot);
  }
  return slots;
}

std::string tick_list(const std::vector<Tick>& ticks, bool with_minor) {
  std::string list;
  for (const Tick& tick : ticks)
    if (with_minor || !tick.label.empty())
      fmt::format_to(std::back_inserter(list), "{}{} {}{}", list.empty() ? "" : ", ", gnuplot_string(tick.label),
                     exact_number(tick.at), tick.label.empty() ? " 1" : "");
  return list;
}

// ---- Pictures ------------------------------------------------------------------------------------------------------

// Okabe and Ito's colours but yellow, which does not show on white. Seven colours, five dashes, eleven markers:
// each curve differs from the others in all three for as long as that can be, in two when printed grey.
constexpr std::array<std::string_view, 7> colors{"#0072B2", "#D55E00", "#009E73", "#CC79A7",
                                                 "#E69F00", "#56B4E9", "#000000"};
constexpr std::array<std::string_view, 5> dashes{"1", "(14,5)", "(3,4)", "(14,4,3,4)", "(7,4)"};
constexpr std::array<std::string_view, 4> theory_dashes{"(8,5)", "(2,3)", "(14,4,2,4)", "(18,8)"};
constexpr std::array<int, 11> markers{7, 5, 9, 11, 13, 6, 4, 8, 10, 12, 2};

template <class List>
auto pick(const List& list, int slot) {
  return list[static_cast<std::size_t>(slot) % list.size()];
}

/// `order` counts the theory curves before this one.
std::string style_of(const Curve& curve, int slot, int order, const Scale& y) {
  switch (curve.role) {
    case CurveRole::envelope:
      return fmt::format("filledcurves y1={} fc rgb '#e4e4e4' fs solid 1 noborder", exact_number(y.low));
    case CurveRole::quartile:
      return fmt::format("lines lc rgb '{}' lw 0.5 dt 1", slot < 0 ? "#666666" : pick(colors, slot));
    case CurveRole::theory:
      return fmt::format("lines lc rgb '{}' lw 1.5 dt {}", slot < 0 ? "#333333" : pick(colors, slot),
                         pick(theory_dashes, order));
    case CurveRole::measured_points:
      return fmt::format("points lc rgb '{}' lw 1.5 pt {} ps 1.2*marker", pick(colors, slot), pick(markers, slot));
    case CurveRole::measured_line: break;
  }
  // Intervals differ, so that the markers of curves that lie upon each other do not.
  const std::size_t points = std::min<std::size_t>(curve.x.size(), 4000);
  const std::size_t interval = points <= 16 ? 1 : points / 9 + static_cast<std::size_t>(slot % 12);
  return fmt::format("linespoints lc rgb '{}' lw 2 dt {} pt {} ps marker pi {}", pick(colors, slot), pick(dashes, slot),
                     pick(markers, slot), interval);
}

std::string plot_commands(const Figure& figure, const Scales& scales) {
  const std::vector<int> slots = slots_of(figure);
  std::string text = "plot ";
  bool first = true;
  int theories = 0;
  for (std::size_t c : drawing_order(figure)) {
    const Curve& curve = figure.curves[c];
    fmt::format_to(std::back_inserter(text), "{}{} index {} using (shown_x($1)):(shown_y($2)) with {} {}",
                   first ? "" : ", \\\n     ", gnuplot_string(figure.id + ".dat"), c,
                   style_of(curve, slots[c], curve.role == CurveRole::theory ? theories++ : 0, scales.y),
                   curve.role == CurveRole::quartile ? "notitle" : "title " + gnuplot_string(curve.label));
    first = false;
  }
  return text + (first ? "NaN notitle\n" : "\n");
}

/// The settings of a figure of curves, and the command that draws them.
std::string curve_commands(const Figure& figure, PowerNotation notation) {
  const Scales scales = scales_of(figure);
  std::string text;
  const auto out = std::back_inserter(text);
  // From the left edge of the axes, where a long title has the room above the legend too.
  fmt::format_to(out, "set label {} at graph 0, screen 0.955 left noenhanced\nset tmargin 3\n",
                 gnuplot_string(figure.title));
  text +=
      "set style line 100 lc rgb '#d8d8d8' lw 1 dt 1\nset grid back ls 100\n"
      "set key outside right top vertical Left reverse noenhanced samplen 3 spacing 1.15 textcolor rgb '#222222'\n";
  text += axis_commands("x", figure.x, scales.x, notation, 8);
  text += axis_commands("y", figure.y, scales.y, notation, 8);
  // The floor, where what is zero is drawn.
  constexpr std::string_view floor_line = "nohead front lc rgb '#888888' lw 1 dt (2,4)";
  if (const auto& floor = scales.y.floor)
    fmt::format_to(out, "set arrow from graph 0, first {0} to graph 1, first {0} {1}\n", exact_number(*floor),
                   floor_line);
  if (const auto& floor = scales.x.floor)
    fmt::format_to(out, "set arrow from first {0}, graph 0 to first {0}, graph 1 {1}\n", exact_number(*floor),
                   floor_line);
  return text + plot_commands(figure, scales);
}

}  // namespace

bool is_measured(const Curve& curve) {
  return curve.role == CurveRole::measured_points || curve.role == CurveRole::measured_line;
}

std::string one_line(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < 0x20; }, ' ');
  return text;
}

std::string data_of(const Figure& figure) {
  std::string text = fmt::format("# {}\n# x: {}\n# y: {}\n", one_line(figure.title), one_line(figure.x.label),
                                 one_line(figure.y.label));
  if (!figure.maps.panels.empty()) return text + heat_map_data(figure);
  for (std::size_t c = 0; c < figure.curves.size(); ++c) {
    const Curve& curve = figure.curves[c];
    const auto out = std::back_inserter(text);
    fmt::format_to(out, "{}# index {}: {}, {}: {}\n", c == 0 ? "\n" : "\n\n", c, one_line(curve.id), name(curve.role),
                   one_line(curve.label));
    // gnuplot drops a block without a line, and all later ones would move up by one.
    if (curve.x.empty()) text += "nan nan\n";
    for (std::size_t k : visible_points(curve))
      fmt::format_to(out, "{} {}\n", exact_number(curve.x[k]), exact_number(curve.y[k]));
  }
  return text;
}

std::vector<std::size_t> drawing_order(const Figure& figure) {
  const auto rank = [&](std::size_t c) {
    const Curve& curve = figure.curves[c];
    return curve.role == CurveRole::envelope ? 0 : curve.role == CurveRole::quartile ? 1 : is_measured(curve) ? 2 : 3;
  };
  const auto last_value = [&](std::size_t c) {
    const std::vector<double>& y = figure.curves[c].y;
    const auto last = std::find_if(y.rbegin(), y.rend(), [](double value) { return std::isfinite(value); });
    return last == y.rend() ? -HUGE_VAL : *last;
  };
  std::vector<std::size_t> order(figure.curves.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    if (rank(a) != rank(b)) return rank(a) < rank(b);
    return rank(a) == 2 && last_value(a) > last_value(b);
  });
  return order;
}

Scales scales_of(const Figure& figure) {
  std::vector<double> x, y, bounds;
  bool points = false;
  for (const Curve& curve : figure.curves) {
    x.insert(x.end(), curve.x.begin(), curve.x.end());
    std::vector<double>& values = is_measured(curve) ? y : bounds;
    values.insert(values.end(), curve.y.begin(), curve.y.end());
    points = points || curve.role == CurveRole::measured_points;
  }
  // Lines may run from edge to edge; markers need room.
  return {scale_for(figure.x, x, {}, points ? 0.03 : 0), scale_for(figure.y, y, bounds, 0.03)};
}

std::string axis_commands(std::string_view axis, const Axis& what, const Scale& scale, PowerNotation notation,
                          int labels) {
  std::string text = fmt::format("set {0}label {1} noenhanced\nset {0}range [{2}:{3}]\n", axis,
                                 gnuplot_string(what.label), exact_number(scale.low), exact_number(scale.high));
  const auto out = std::back_inserter(text);
  if (!scale.log) {
    fmt::format_to(out, "shown_{}(v) = v\n", axis);
    return text;
  }
  const std::string floor = scale.floor ? exact_number(*scale.floor) : "NaN";
  fmt::format_to(out, "set logscale {0}\nshown_{0}(v) = v >= {1} ? v : v < {1} ? {2} : NaN\n", axis,
                 exact_number(smallest_shown), floor);
  const std::string ticks = tick_list(log_ticks(scale, notation, labels), notation == PowerNotation::superscript);
  if (!ticks.empty()) fmt::format_to(out, "set {}tics ({})\n", axis, ticks);
  return text;
}

std::string script_of(const Figure& figure) {
  const bool maps = !figure.maps.panels.empty();
  std::string svg_name = "figure_" + figure.id;
  std::replace(svg_name.begin(), svg_name.end(), '-', '_');

  std::string text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out, "# {0}\n# `gnuplot {1}.gp` in this folder draws {1}.svg and {1}.png from {1}.dat.\n\n",
                 one_line(figure.title), figure.id);
  text +=
      "reset\nset encoding utf8\nset border 3 lc rgb '#666666'\nset tics nomirror out scale 0.6 textcolor rgb "
      "'#222222'\n"
      "set format '%h'\n";
  const std::string drawing =
      maps ? heat_map_commands(figure, PowerNotation::superscript) : curve_commands(figure, PowerNotation::superscript);

  // High enough for the legend to stand in one column.
  const int height = maps ? heat_map_height(figure) : std::max(520, 180 + 24 * static_cast<int>(figure.curves.size()));
  fmt::format_to(
      out,
      "\nmarker = 0.6\nset terminal svg {} name '{}' size 800,{} dynamic font 'sans-serif,15' background rgb "
      "'white'\nset output '{}.svg'\n{}",
      maps ? "standalone rounded" : "mouse standalone", svg_name, height, figure.id, drawing);
  fmt::format_to(out,
                 "\nmarker = 0.8\nset terminal pngcairo rounded size 1600,{} font 'sans,21' linewidth 2 pointscale 1.8 "
                 "background rgb 'white'\nset output '{}.png'\n{}unset output\n",
                 2 * height, figure.id, maps ? drawing : "replot\n");
  return text;
}

}  // namespace kfstab::reports
