#include <kfstab/reports/script.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numeric>
#include <set>
#include <utility>

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
constexpr int cross = 2;
constexpr std::array<int, 11> markers{7, 5, 9, 11, 13, 6, 4, 8, 10, 12, cross};

// Lightness apart; dashes and markers tell the rest.
constexpr std::array<std::string_view, 4> greys{"#000000", "#6e6e6e", "#3c3c3c", "#949494"};

template <class List>
auto pick(const List& list, int slot) {
  return list[static_cast<std::size_t>(slot) % list.size()];
}

/// `order` counts the theory curves before this one.
std::string style_of(const Curve& curve, int slot, int order, const Scale& y, bool grey) {
  const auto color = [&] { return grey ? pick(greys, slot) : pick(colors, slot); };
  switch (curve.role) {
    case CurveRole::envelope:
      return fmt::format("filledcurves y1={} fc rgb '#e4e4e4' fs solid 1 noborder", exact_number(y.low));
    case CurveRole::quartile: return fmt::format("lines lc rgb '{}' lw 0.5 dt 1", slot < 0 ? "#666666" : color());
    case CurveRole::theory:
      return fmt::format("lines lc rgb '{}' lw 1.5 dt {}", slot < 0 ? "#333333" : color(), pick(theory_dashes, order));
    case CurveRole::measured_points:
      // A cross marks what other curves have a marker at, too: its arms must be seen.
      return fmt::format("points lc rgb '{}' lw 1.5 pt {} ps {}*marker", color(), pick(markers, slot),
                         pick(markers, slot) == cross ? 2.2 : 1.2);
    case CurveRole::measured_line: break;
  }
  // Intervals differ, so that the markers of curves that lie upon each other do not.
  const std::size_t points = std::min<std::size_t>(curve.x.size(), 4000);
  const std::size_t interval = points <= 16 ? 1 : points / 9 + static_cast<std::size_t>(slot % 12);
  return fmt::format("linespoints lc rgb '{}' lw 2 dt {} pt {} ps marker pi {}", color(), pick(dashes, slot),
                     pick(markers, slot), interval);
}

/// What stands in the legend.
int entries_of(const Figure& figure) {
  return static_cast<int>(
      std::ranges::count_if(figure.curves, [](const Curve& curve) { return curve.role != CurveRole::quartile; }));
}

std::string plot_commands(const Figure& figure, const Scales& scales, PowerNotation notation, bool grey) {
  const std::vector<int> slots = slots_of(figure);
  std::string text = "plot ";
  bool first = true;
  int theories = 0;
  for (std::size_t c : drawing_order(figure)) {
    const Curve& curve = figure.curves[c];
    fmt::format_to(std::back_inserter(text), "{}{} index {} using (shown_x($1)):(shown_y($2)) with {} {}",
                   first ? "" : ", \\\n     ", gnuplot_string(figure.id + ".dat"), c,
                   style_of(curve, slots[c], curve.role == CurveRole::theory ? theories++ : 0, scales.y, grey),
                   curve.role == CurveRole::quartile ? "notitle" : "title " + label_string(curve.label, notation));
    first = false;
  }
  return text + (first ? "NaN notitle\n" : "\n");
}

/// The size of a picture: in pixels, with its type, the width of its lines relative to the screen's, and printed.
struct Look {
  int width, height;
  double font, line, centimetres;
};
constexpr std::array<Look, 4> looks{
    {{800, 520, 15, 1, 20}, {960, 540, 22, 1.8, 25.4}, {640, 416, 14, 1, 12}, {640, 416, 14, 1, 12}}};

/// The settings of a figure of curves, and the command that draws them.
std::string curve_commands(const Figure& figure, PowerNotation notation, bool grey) {
  const Scales scales = scales_of(figure);
  std::string text;
  const auto out = std::back_inserter(text);
  // From the left edge of the axes, where a long title has the room above the legend too.
  fmt::format_to(out, "set label {} at graph 0, screen 0.955 left noenhanced\nset tmargin 3\n",
                 label_string(figure.title, notation));
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
  return text + plot_commands(figure, scales, notation, grey);
}

}  // namespace

bool is_measured(const Curve& curve) {
  return curve.role == CurveRole::measured_points || curve.role == CurveRole::measured_line;
}

std::string label_string(std::string_view text, PowerNotation notation) {
  if (notation != PowerNotation::latex) return gnuplot_string(text);
  constexpr std::array<std::pair<std::string_view, std::string_view>, 20> special{{{"\\", "\\textbackslash{}"},
                                                                                   {"{", "\\{"},
                                                                                   {"}", "\\}"},
                                                                                   {"$", "\\$"},
                                                                                   {"&", "\\&"},
                                                                                   {"#", "\\#"},
                                                                                   {"_", "\\_"},
                                                                                   {"%", "\\%"},
                                                                                   {"^", "\\textasciicircum{}"},
                                                                                   {"~", "\\textasciitilde{}"},
                                                                                   {"<", "$<$"},
                                                                                   {">", "$>$"},
                                                                                   {"|", "$|$"},
                                                                                   {"κ", "$\\kappa$"},
                                                                                   {"λ", "$\\lambda$"},
                                                                                   {"ρ", "$\\rho$"},
                                                                                   {"≤", "$\\le$"},
                                                                                   {"≥", "$\\ge$"},
                                                                                   {"·", "$\\cdot$"},
                                                                                   {"×", "$\\times$"}}};
  std::string escaped;
  while (!text.empty()) {
    const auto found = std::ranges::find_if(special, [&](const auto& one) { return text.starts_with(one.first); });
    escaped += found == special.end() ? text.substr(0, 1) : found->second;
    text.remove_prefix(found == special.end() ? 1 : found->first.size());
  }
  return gnuplot_string(escaped);
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
                                 label_string(what.label, notation), exact_number(scale.low), exact_number(scale.high));
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

std::vector<std::string> pictures_of(const Figure& figure, const Drawing& drawing) {
  std::vector<std::string> names{figure.id + ".svg", figure.id + ".png"};
  if (drawing.medium == Medium::paper) names.push_back(figure.id + ".tex");
  if (drawing.medium != Medium::screen || drawing.pdf) names.push_back(figure.id + ".pdf");
  return names;
}

std::string script_of(const Figure& figure, const Drawing& drawing) {
  const bool maps = !figure.maps.panels.empty();
  const Look& look = looks[static_cast<std::size_t>(drawing.medium)];
  const bool grey = drawing.medium == Medium::print;
  const std::vector<std::string> pictures = pictures_of(figure, drawing);
  const auto draw = [&](PowerNotation notation) {
    return maps
               ? heat_map_commands(figure, notation,
                                   {.type = notation == PowerNotation::latex ? 1.55 : look.font / look.width * 800 / 15,
                                    .grey = grey})
               : curve_commands(figure, notation, grey);
  };
  std::string svg_name = "figure_" + figure.id;
  std::replace(svg_name.begin(), svg_name.end(), '-', '_');

  std::string text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out, "# {0}\n# `gnuplot {1}.gp` in this folder draws {2} from {1}.dat.\n\n", one_line(figure.title),
                 figure.id, fmt::join(pictures, ", "));
  const std::string_view settings =
      "reset\nset encoding utf8\nset border 3 lc rgb '#666666'\nset tics nomirror out scale 0.6 textcolor rgb "
      "'#222222'\n"
      "set format '%h'\n";
  text += settings;

  // High enough for the legend to stand in one column; a slide has its shape, and a long legend smaller type.
  int height = look.height;
  if (maps)
    height = heat_map_height(figure) * look.width / 800;
  else if (drawing.medium != Medium::slide)
    height = std::max(height, static_cast<int>(look.font * (10.5 + 1.9 * entries_of(figure))));
  const double legend = std::min(1., (height - 9.5 * look.font) / (1.9 * look.font * std::max(1, entries_of(figure))));
  const auto picture = [&](double marker, double font, const std::string& terminal, std::string_view ending,
                           const std::string& commands) {
    fmt::format_to(out, "\nmarker = {}\n{}set terminal {}\nset output '{}.{}'\n{}", marker,
                   legend < 1 ? fmt::format("set key font ',{:.3g}'\n", legend * font) : "", terminal, figure.id,
                   ending, commands);
  };

  const std::string drawn = draw(PowerNotation::superscript), again = maps ? drawn : "replot\n";
  picture(
      0.6, look.font,
      fmt::format("svg {} name '{}' size {},{} dynamic font 'sans-serif,{}' linewidth {} background rgb 'white'",
                  maps ? "standalone rounded" : "mouse standalone", svg_name, look.width, height, look.font, look.line),
      "svg", drawn);
  const double type = look.font * 1.4 * 800 / look.width;
  picture(0.8, type,
          fmt::format("pngcairo rounded size 1600,{} font 'sans,{:.3g}' linewidth {} pointscale {:.3g} background rgb "
                      "'white'",
                      1600 * height / look.width, type, 2 * look.line, 1.8 * look.line),
          "png", again);
  const std::string size = fmt::format("{:.2f}cm,{:.2f}cm", look.centimetres, look.centimetres * height / look.width);
  if (drawing.medium == Medium::paper) {
    text += "\n" + std::string(settings);
    fmt::format_to(out,
                   "marker = 0.5\nset terminal cairolatex pdf input color colortext rounded size {}\nset output "
                   "'{}.tex'\n{}",
                   size, figure.id, draw(PowerNotation::latex));
  } else if (pictures.size() > 2) {
    constexpr double points_per_centimetre = 72 / 2.54, cairo = 0.7;  // its own size for a font of so many points
    const double points = cairo * look.font * look.centimetres / look.width * points_per_centimetre;
    picture(0.6, points,
            fmt::format("pdfcairo rounded size {} font 'sans,{:.3g}' fontscale 1 linewidth {} background rgb 'white'",
                        size, points, 1.5 * look.line),
            "pdf", again);
  }
  return text + "unset output\n";
}

}  // namespace kfstab::reports
