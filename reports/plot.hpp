#pragma once
// A figure as files and as text. One style for all figures: colours that the colour-blind can tell apart, dashes and
// markers that survive greyscale, the legend outside on the right. Drawn by gnuplot; without it the data, the script
// and the CSV are written all the same.

#include <string>

#include <kfstab/reports/document.hpp>
#include <kfstab/reports/files.hpp>

namespace kfstab::reports {

struct PlotResult {
  bool drawn = false;   ///< ID.svg and ID.png stand in the folder
  std::string warning;  ///< why not, for the user; empty if drawn
};

/// Writes to the folder, for the figure's id ID:
///   ID.csv  long format, columns curve,role,x,y; numbers read back exactly; gaps as nan or inf;
///   ID.dat  the same for gnuplot, one block a curve in the order of the figure; a curve of more than 4000 points is
///           thinned to what can be seen: the ends, the gaps and the extremes of 1000 stretches;
///   ID.gp   the script: `gnuplot ID.gp` in the folder draws the two pictures again;
///   ID.svg  the picture, offline and interactive: a click on a legend entry hides its curve;
///   ID.png  the picture, 1600 pixels wide.
/// Throws FileError if a file cannot be written, std::invalid_argument for a figure that breaks document.hpp's rules
/// (id, lengths of x and y). A missing or failing gnuplot is a warning.
PlotResult write_figure(const Figure& figure, const Folder& folder);

/// The text of ID.svg in the folder; empty if it is not there.
std::string read_svg(const Figure& figure, const Folder& folder);

struct TextPlot {
  std::string text;     ///< empty if it could not be drawn
  std::string warning;  ///< why not
};

/// The figure in characters for a terminal of that many columns and rows.
TextPlot text_plot(const Figure& figure, int width = 80, int height = 24);

}  // namespace kfstab::reports
