#pragma once
// A figure as gnuplot reads it: the data and the script. plot.hpp writes them and has them drawn.

#include <string>
#include <string_view>
#include <vector>

#include <kfstab/reports/document.hpp>
#include <kfstab/reports/scale.hpp>

namespace kfstab::reports {

/// What a figure is drawn for: it decides its size, its type and its lines.
enum class Medium {
  screen,  ///< a page in a browser
  slide,   ///< 16:9, large type, thick lines
  print,   ///< small, in greys
  paper,   ///< small, its text set by LaTeX, in the document's type
};

struct Drawing {
  Medium medium = Medium::screen;
  bool pdf = false;  ///< a PDF too; slide, print and paper have one in any case
};

/// The names of the pictures of a figure, ID.svg and ID.png first. For paper ID.tex is what a document inputs, and
/// ID.pdf are its lines.
std::vector<std::string> pictures_of(const Figure& figure, const Drawing& drawing);

/// What stands in ID.dat: a block a curve in the order of the figure, columns x and y; of heat maps two blocks a panel,
/// its cells and the line around those that are outlined.
std::string data_of(const Figure& figure);

/// What stands in ID.gp.
std::string script_of(const Figure& figure, const Drawing& drawing);

// ---- What all styles share -----------------------------------------------------------------------------------------

bool is_measured(const Curve& curve);

/// The curves in the order in which they are drawn and stand in the legend: envelopes beneath, quartiles, what was
/// measured from the highest end to the lowest, as the eye meets the curves at the legend's side, then theory above all.
std::vector<std::size_t> drawing_order(const Figure& figure);

struct Scales {
  Scale x, y;
};
Scales scales_of(const Figure& figure);

/// Scale, ticks and label of one axis (x, y or cb), and the function shown_x, shown_y or shown_cb, which says where a
/// value is drawn. At most about so many ticks have labels.
std::string axis_commands(std::string_view axis, const Axis& what, const Scale& scale, PowerNotation notation,
                          int labels);

/// A text as a gnuplot string in which nothing is markup: set noenhanced, or in LaTeX's notation escaped.
std::string label_string(std::string_view text, PowerNotation notation);

/// The text without line breaks and other control characters.
std::string one_line(std::string text);

}  // namespace kfstab::reports
