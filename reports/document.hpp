#pragma once
// What a report says, apart from how it looks: sections of prose, tables, figures and checks, each with its verdict.
// Plain aggregates; plot.hpp, html.hpp and terminal.hpp render them.

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace kfstab::reports {

/// What a curve is to its figure; it decides how the curve is drawn.
enum class CurveRole {
  measured_points,  ///< markers alone
  measured_line,    ///< a line, with a marker every few points
  quartile,         ///< a thin line in the colour of its slot, not in the legend: how far what was measured scatters
  theory,           ///< a thin dark dashed line
  envelope,         ///< a grey region from the bottom of the figure up to y: what theory excuses
};

/// "measured_points" and so on, as data files and results.json say.
constexpr std::string_view name(CurveRole role) {
  switch (role) {
    case CurveRole::measured_points: return "measured_points";
    case CurveRole::measured_line: return "measured_line";
    case CurveRole::quartile: return "quartile";
    case CurveRole::theory: return "theory";
    case CurveRole::envelope: break;
  }
  return "envelope";
}

struct Curve {
  std::string id{};     ///< unique in its figure: names the curve in data files
  std::string label{};  ///< what the legend says
  std::vector<double> x{};
  std::vector<double> y{};  ///< as long as x; a value that is not finite leaves a gap
  CurveRole role = CurveRole::measured_line;
  int color = -1;  ///< slot in the palette; equal slots have equal colour, dash and marker; -1: the next free one
};

struct Axis {
  std::string label{};  ///< with the unit
  bool log = false;     ///< zero and negative values are drawn on a marked floor below the smallest positive one
};

/// A matrix of values, each drawn as the colour of its cell.
struct HeatMap {
  std::string id{};     ///< unique in its figure: names the map in data files
  std::string label{};  ///< heads its panel
  std::vector<double>
      values{};  ///< HeatMaps::y.size() rows of x.size() values, one after the other; not finite: hatched
  std::vector<bool> outlined{};  ///< the cells within the line; as long as values, or empty
};

/// Heat maps over the same axes with one scale of colours, side by side.
struct HeatMaps {
  std::vector<double> x{}, y{};  ///< the middles of the cells, increasing; positive on a log axis
  Axis color{};                  ///< the scale of colours: dark is small, bright is large
  std::vector<HeatMap> panels{};
  std::string outline{};  ///< what the line around cells means, for the legend
  bool matrix = false;    ///< x and y count columns and rows: the first row on top
  bool numbers = false;   ///< with the value written in each cell
};

/// Curves, or heat maps.
struct Figure {
  std::string id{};       ///< unique in its document, kebab-case (letters, digits and `-`): names the files
  std::string title{};    ///< one line, at most some 80 characters
  std::string caption{};  ///< the question that the figure answers, in prose
  Axis x{};
  Axis y{};
  std::vector<Curve> curves{};
  HeatMaps maps{};  ///< if it has panels, there are no curves
};

enum class Alignment { left, right, center };

struct Table {
  std::string caption{};
  std::vector<std::string> header{};
  std::vector<std::vector<std::string>> rows{};  ///< a row may be short: the rest is empty
  std::vector<Alignment> alignment{};            ///< one a column; columns without are left-aligned
};

enum class Verdict { confirmed, refuted, inconclusive };

/// "confirmed", "refuted", "inconclusive".
constexpr std::string_view name(Verdict verdict) {
  switch (verdict) {
    case Verdict::confirmed: return "confirmed";
    case Verdict::refuted: return "refuted";
    case Verdict::inconclusive: break;
  }
  return "inconclusive";
}

/// One number that was predicted and measured. The criterion says in words what was compared and within what.
struct Check {
  std::string name{};
  double predicted = 0;
  double measured = 0;
  std::string criterion{};
  bool holds = false;
};

struct Checks {
  std::vector<Check> checks{};
};
struct Paragraph {
  std::string text{};
  std::string label{};  ///< what the paragraph is about, in bold before it: "Setup"
};
/// Equations in plain notation (mathml.hpp), each with what it belongs to.
struct Equation {
  std::string text{};
  std::string label{};
};
struct Equations {
  std::vector<Equation> equations{};
};
/// Text whose line breaks and blanks matter: a command, a matrix, a program's answer.
struct Preformatted {
  std::string text{};
};

using Block = std::variant<Paragraph, Equations, Table, Figure, Checks, Preformatted>;

struct Section {
  std::string anchor{};  ///< unique in its document, kebab-case: the section's address
  std::string title{};
  std::optional<Verdict> verdict;
  std::vector<Block> blocks{};
};

struct Document {
  std::string title{};
  std::string subtitle{};
  std::vector<Section> sections{};
  std::vector<std::pair<std::string, std::string>> context{};  ///< under what it was made: seed, machine, versions
};

}  // namespace kfstab::reports
