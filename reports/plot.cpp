#include <kfstab/reports/plot.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <numeric>
#include <set>
#include <stdexcept>
#include <string_view>
#include <vector>

#include <fmt/format.h>

#include <kfstab/reports/gnuplot.hpp>
#include <kfstab/reports/number.hpp>
#include <kfstab/reports/scale.hpp>
#include <kfstab/reports/terminal.hpp>

namespace kfstab::reports {
namespace {

namespace fs = std::filesystem;

std::string_view name(CurveRole role) {
  switch (role) {
    case CurveRole::measured_points: return "measured_points";
    case CurveRole::measured_line: return "measured_line";
    case CurveRole::quartile: return "quartile";
    case CurveRole::theory: return "theory";
    case CurveRole::envelope: break;
  }
  return "envelope";
}

bool is_measured(const Curve& curve) {
  return curve.role == CurveRole::measured_points || curve.role == CurveRole::measured_line;
}

void check(const Figure& figure) {
  const auto refuse = [&](const std::string& why) { throw std::invalid_argument(fmt::format("figure {:?}: {}", figure.id, why)); };
  const auto allowed = [](unsigned char c) { return std::isalnum(c) || c == '-'; };
  if (figure.id.empty() || !std::all_of(figure.id.begin(), figure.id.end(), allowed))
    refuse("its id must be letters, digits and `-`, for it names files");
  std::set<std::string_view> ids;
  for (const Curve& curve : figure.curves) {
    if (curve.x.size() != curve.y.size())
      refuse(fmt::format("curve {:?} has {} values of x and {} of y", curve.id, curve.x.size(), curve.y.size()));
    if (!ids.insert(curve.id).second) refuse(fmt::format("two curves have the id {:?}", curve.id));
  }
}

// ---- Data files ----------------------------------------------------------------------------------------------------

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

std::string csv_of(const Figure& figure) {
  std::string text = "curve,role,x,y\n";
  for (const Curve& curve : figure.curves)
    for (std::size_t k = 0; k < curve.x.size(); ++k)
      fmt::format_to(std::back_inserter(text), "{},{},{},{}\n", csv_field(curve.id), name(curve.role), exact_number(curve.x[k]),
                     exact_number(curve.y[k]));
  return text;
}

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

std::string one_line(std::string text) {
  std::replace_if(text.begin(), text.end(), [](unsigned char c) { return c < 0x20; }, ' ');
  return text;
}

std::string data_of(const Figure& figure) {
  std::string text = fmt::format("# {}\n# x: {}\n# y: {}\n", one_line(figure.title), one_line(figure.x.label), one_line(figure.y.label));
  for (std::size_t c = 0; c < figure.curves.size(); ++c) {
    const Curve& curve = figure.curves[c];
    const auto out = std::back_inserter(text);
    fmt::format_to(out, "{}# index {}: {}, {}: {}\n", c == 0 ? "\n" : "\n\n", c, one_line(curve.id), name(curve.role), one_line(curve.label));
    // gnuplot drops a block without a line, and all later ones would move up by one.
    if (curve.x.empty()) text += "nan nan\n";
    for (std::size_t k : visible_points(curve)) fmt::format_to(out, "{} {}\n", exact_number(curve.x[k]), exact_number(curve.y[k]));
  }
  return text;
}

// ---- What is drawn, whatever the style -----------------------------------------------------------------------------

/// The curves in the order in which they are drawn and stand in the legend: envelopes beneath, quartiles, what was measured
/// from the highest end to the lowest, as the eye meets the curves at the legend's side, then theory above all.
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

struct Scales {
  Scale x, y;
};

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

std::string tick_list(const std::vector<Tick>& ticks, bool with_minor) {
  std::string list;
  for (const Tick& tick : ticks)
    if (with_minor || !tick.label.empty())
      fmt::format_to(std::back_inserter(list), "{}{} {}{}", list.empty() ? "" : ", ", gnuplot_string(tick.label), exact_number(tick.at),
                     tick.label.empty() ? " 1" : "");
  return list;
}

/// Scale, ticks and label of one axis (`x` or `y`), and the function shown_x or shown_y, which says where a value is drawn.
std::string axis_commands(char axis, const Axis& what, const Scale& scale, PowerNotation notation, int labels) {
  std::string text = fmt::format("set {0}label {1} noenhanced\nset {0}range [{2}:{3}]\n", axis, gnuplot_string(what.label),
                                 exact_number(scale.low), exact_number(scale.high));
  const auto out = std::back_inserter(text);
  if (!scale.log) {
    fmt::format_to(out, "shown_{}(v) = v\n", axis);
    return text;
  }
  const std::string floor = scale.floor ? exact_number(*scale.floor) : "NaN";
  fmt::format_to(out, "set logscale {0}\nshown_{0}(v) = v >= {1} ? v : v < {1} ? {2} : NaN\n", axis, exact_number(smallest_shown), floor);
  const std::string ticks = tick_list(log_ticks(scale, notation, labels), notation == PowerNotation::superscript);
  if (!ticks.empty()) fmt::format_to(out, "set {}tics ({})\n", axis, ticks);
  return text;
}

// ---- Pictures ------------------------------------------------------------------------------------------------------

// Okabe and Ito's colours but yellow, which does not show on white. Seven colours, five dashes, eleven markers:
// each curve differs from the others in all three for as long as that can be, in two when printed grey.
constexpr std::array<std::string_view, 7> colors{"#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"};
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
    case CurveRole::quartile: return fmt::format("lines lc rgb '{}' lw 0.5 dt 1", slot < 0 ? "#666666" : pick(colors, slot));
    case CurveRole::theory:
      return fmt::format("lines lc rgb '{}' lw 1.5 dt {}", slot < 0 ? "#333333" : pick(colors, slot), pick(theory_dashes, order));
    case CurveRole::measured_points:
      return fmt::format("points lc rgb '{}' lw 1.5 pt {} ps 1.2*marker", pick(colors, slot), pick(markers, slot));
    case CurveRole::measured_line: break;
  }
  // Intervals differ, so that the markers of curves that lie upon each other do not.
  const std::size_t points = std::min<std::size_t>(curve.x.size(), 4000);
  const std::size_t interval = points <= 16 ? 1 : points / 9 + static_cast<std::size_t>(slot % 12);
  return fmt::format("linespoints lc rgb '{}' lw 2 dt {} pt {} ps marker pi {}", pick(colors, slot), pick(dashes, slot), pick(markers, slot), interval);
}

std::string plot_commands(const Figure& figure, const Scales& scales) {
  const std::vector<int> slots = slots_of(figure);
  std::string text = "plot ";
  bool first = true;
  int theories = 0;
  for (std::size_t c : drawing_order(figure)) {
    const Curve& curve = figure.curves[c];
    fmt::format_to(std::back_inserter(text), "{}{} index {} using (shown_x($1)):(shown_y($2)) with {} {}", first ? "" : ", \\\n     ",
                   gnuplot_string(figure.id + ".dat"), c, style_of(curve, slots[c], curve.role == CurveRole::theory ? theories++ : 0, scales.y),
                   curve.role == CurveRole::quartile ? "notitle" : "title " + gnuplot_string(curve.label));
    first = false;
  }
  return text + (first ? "NaN notitle\n" : "\n");
}

std::string script_of(const Figure& figure) {
  const Scales scales = scales_of(figure);
  std::string svg_name = "figure_" + figure.id;
  std::replace(svg_name.begin(), svg_name.end(), '-', '_');

  std::string text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out, "# {0}\n# `gnuplot {1}.gp` in this folder draws {1}.svg and {1}.png from {1}.dat.\n\n", one_line(figure.title), figure.id);
  // From the left edge of the axes, where a long title has the room above the legend too.
  fmt::format_to(out, "reset\nset encoding utf8\nset label {} at graph 0, screen 0.955 left noenhanced\nset tmargin 3\n", gnuplot_string(figure.title));
  text += "set border 3 lc rgb '#666666'\nset tics nomirror out scale 0.6 textcolor rgb '#222222'\n"
          "set style line 100 lc rgb '#d8d8d8' lw 1 dt 1\nset grid back ls 100\nset format '%h'\n"
          "set key outside right top vertical Left reverse noenhanced samplen 3 spacing 1.15 textcolor rgb '#222222'\n";
  text += axis_commands('x', figure.x, scales.x, PowerNotation::superscript, 8);
  text += axis_commands('y', figure.y, scales.y, PowerNotation::superscript, 8);
  // The floor, where what is zero is drawn.
  if (const auto& floor = scales.y.floor)
    fmt::format_to(out, "set arrow from graph 0, first {0} to graph 1, first {0} nohead front lc rgb '#888888' lw 1 dt (2,4)\n", exact_number(*floor));
  if (const auto& floor = scales.x.floor)
    fmt::format_to(out, "set arrow from first {0}, graph 0 to first {0}, graph 1 nohead front lc rgb '#888888' lw 1 dt (2,4)\n", exact_number(*floor));

  // High enough for the legend to stand in one column.
  const std::size_t height = std::max<std::ptrdiff_t>(
      520, 180 + 24 * std::ranges::count_if(figure.curves, [](const Curve& c) { return c.role != CurveRole::quartile; }));
  fmt::format_to(out, "\nmarker = 0.6\nset terminal svg mouse standalone name '{}' size 800,{} dynamic font 'sans-serif,15' background rgb 'white'\n",
                 svg_name, height);
  fmt::format_to(out, "set output '{}.svg'\n{}", figure.id, plot_commands(figure, scales));
  fmt::format_to(out, "\nmarker = 0.8\nset terminal pngcairo size 1600,{} font 'sans,21' linewidth 2 pointscale 1.8 background rgb 'white'\n", 2 * height);
  fmt::format_to(out, "set output '{}.png'\nreplot\nunset output\n", figure.id);
  return text;
}

std::string read_file(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// gnuplot does not tell of a full disk: a picture is there if its end is.
bool is_complete(const fs::path& picture, std::string_view end) {
  const std::string content = read_file(picture);
  const std::size_t at = content.rfind(end);
  return at != std::string::npos && content.size() - at < end.size() + 16;
}

}  // namespace

PlotResult write_figure(const Figure& figure, const Folder& folder) {
  check(figure);
  folder.write(figure.id + ".csv", csv_of(figure));
  folder.write(figure.id + ".dat", data_of(figure));
  folder.write(figure.id + ".gp", script_of(figure));
  const fs::path svg = folder.claim(figure.id + ".svg");
  const fs::path png = folder.claim(figure.id + ".png");

  std::string reason = run_gnuplot(folder.path(), figure.id + ".gp");
  if (reason.empty() && !(is_complete(svg, "</svg>") && is_complete(png, "IEND"))) reason = "gnuplot failed: it left no complete picture";
  if (reason.empty()) return {.drawn = true, .warning = {}};

  std::error_code ignored;
  fs::remove(svg, ignored);
  fs::remove(png, ignored);
  return {.drawn = false, .warning = fmt::format("no picture of {}: {}; its data and script are in {}", figure.id, reason, folder.path().string())};
}

std::string read_svg(const Figure& figure, const Folder& folder) { return read_file(folder.path() / (figure.id + ".svg")); }

// ---- Terminal ------------------------------------------------------------------------------------------------------

namespace {

/// A folder that is gone when this is.
class Scratch {
 public:
  Scratch() {
    std::error_code error;
    const fs::path temporary = fs::temp_directory_path(error);
    std::string name = (temporary / "kfstab-plot-XXXXXX").string();
    if (!error && ::mkdtemp(name.data()) != nullptr) path_ = name;
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  ~Scratch() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

/// How the dumb terminal draws one curve, and the character by which the legend names it.
struct TextStyle {
  std::string commands;
  char key;
};

/// In the order of the figure: letters for what was measured, lines of = or % or @ or # for theory, of + for envelopes.
std::vector<TextStyle> text_styles(const Figure& figure, int width) {
  constexpr std::array<std::pair<int, char>, 4> theory_lines{{{7, '='}, {4, '%'}, {5, '@'}, {2, '#'}}};
  int letters = 0;
  std::size_t theories = 0;
  std::vector<TextStyle> styles;
  for (const Curve& curve : figure.curves) {
    if (curve.role == CurveRole::envelope) {
      styles.push_back({"lines lt 0", '+'});
    } else if (curve.role == CurveRole::theory) {
      const auto& [type, key] = theory_lines[theories++ % theory_lines.size()];
      styles.push_back({fmt::format("lines lt {}", type), key});
    } else {
      const int letter = letters++ % 26;
      const bool joined = curve.role == CurveRole::measured_line && static_cast<int>(curve.x.size()) < width / 2;
      styles.push_back({fmt::format("{} lt 1 pt {}", joined ? "linespoints" : "points", letter + 1), static_cast<char>('A' + letter)});
    }
  }
  return styles;
}

/// The legend in as many columns as fit.
std::string text_legend(const Figure& figure, const std::vector<TextStyle>& styles, int width) {
  std::vector<std::string> entries;
  std::size_t widest = 0;
  for (std::size_t c = 0; c < styles.size(); ++c) {
    entries.push_back(fmt::format("{} {}", styles[c].key, one_line(figure.curves[c].label)));
    widest = std::max(widest, display_width(entries.back()));
  }
  constexpr std::size_t indent = 2, between = 3;
  const std::size_t columns = std::max<std::size_t>(1, (static_cast<std::size_t>(width) - indent + between) / (widest + between));
  std::string text;
  for (std::size_t e = 0; e < entries.size(); ++e) {
    const bool last = (e + 1) % columns == 0 || e + 1 == entries.size();
    if (e % columns == 0) text.append(indent, ' ');
    text += entries[e];
    if (last) text += '\n';
    else text.append(widest - display_width(entries[e]) + between, ' ');
  }
  return text;
}

/// Without gnuplot's form feed, trailing blanks and empty lines at both ends.
std::string trimmed(const std::string& drawing) {
  std::string text, line, pending;
  for (char c : drawing) {
    if (c == '\f') continue;
    if (c != '\n') {
      line += c;
      continue;
    }
    line.erase(line.find_last_not_of(" \r") + 1);
    pending += line + '\n';
    if (!line.empty()) text += text.empty() ? line + '\n' : pending;
    if (!line.empty() || text.empty()) pending.clear();
    line.clear();
  }
  return text;
}

}  // namespace

TextPlot text_plot(const Figure& whole, int width, int height) {
  check(whole);
  Figure figure = whole;  // of letters, quartiles would be no more than a confusion
  std::erase_if(figure.curves, [](const Curve& curve) { return curve.role == CurveRole::quartile; });
  width = std::clamp(width, 40, 400);
  const std::vector<TextStyle> styles = text_styles(figure, width);
  const std::string legend = text_legend(figure, styles, width);
  // gnuplot would put the label of y across the plot; above the axis it has room.
  const std::string heading = fmt::format("{}\n{}\n", one_line(figure.title), one_line(figure.y.label));
  const auto lines = [](const std::string& text) { return static_cast<int>(std::count(text.begin(), text.end(), '\n')); };
  const int rows = std::clamp(height - lines(heading) - lines(legend), 12, 200);

  const Scratch scratch;
  if (scratch.path().empty()) return {.text = {}, .warning = "no folder could be made for gnuplot's output"};

  const Scales scales = scales_of(figure);
  std::string script = fmt::format("reset\nset encoding utf8\nset terminal dumb mono noenhanced size {},{}\nset output 'text'\n", width, rows);
  script += "set border 3\nset tics nomirror\nset format '%g'\nunset key\n";
  script += axis_commands('x', figure.x, scales.x, PowerNotation::plain, width / 12);
  script += axis_commands('y', figure.y, scales.y, PowerNotation::plain, rows / 3) + "unset ylabel\n";
  bool first = true;
  for (std::size_t c : drawing_order(figure)) {
    script += fmt::format("{}'data' index {} using (shown_x($1)):(shown_y($2)) with {}", first ? "plot " : ", ", c, styles[c].commands);
    first = false;
  }
  script += first ? "plot NaN\n" : "\n";
  try {
    write_file(scratch.path() / "data", data_of(figure));
    write_file(scratch.path() / "script", script);
  } catch (const FileError& error) {
    return {.text = {}, .warning = error.what()};
  }
  if (std::string reason = run_gnuplot(scratch.path(), "script"); !reason.empty()) return {.text = {}, .warning = std::move(reason)};
  std::string text = trimmed(read_file(scratch.path() / "text"));
  if (text.empty()) return {.text = {}, .warning = "gnuplot failed: it drew nothing"};
  return {.text = heading + text + legend, .warning = {}};
}

}  // namespace kfstab::reports
