#pragma once
// A figure as files and as text. One style for all figures: colours that the colour-blind can tell apart, dashes and
// markers that survive greyscale, the legend outside on the right. Drawn by gnuplot; without it the data, the script
// and the CSV are written all the same.

#include <string>
#include <vector>

#include <kfstab/reports/document.hpp>
#include <kfstab/reports/files.hpp>
#include <kfstab/reports/script.hpp>

namespace kfstab::reports {

struct PlotResult {
  bool drawn = false;   ///< all pictures stand in the folder
  std::string warning;  ///< why not, for the user; empty if drawn
};

/// The files of a figure, for its id ID:
///   ID.csv  long format, columns curve,role,x,y, or map,x,y,value,outlined; numbers read back exactly; gaps as nan or inf;
///   ID.dat  the same for gnuplot, one block a curve in the order of the figure; a curve of more than 4000 points is
///           thinned to what can be seen: the ends, the gaps and the extremes of 1000 stretches;
///   ID.gp   the script: `gnuplot ID.gp` in the folder draws the pictures again;
///   ID.svg  the picture, offline and interactive: a click on a legend entry hides its curve;
///   ID.png  the picture, 1600 pixels wide;
///   ID.pdf, ID.tex  where the drawing has them: see pictures_of.
std::vector<std::string> files_of(const Figure& figure, const Drawing& drawing = {});

/// Writes data and script, and enters the pictures in the folder's list. Throws FileError if a file cannot be written,
/// std::invalid_argument for a figure that breaks document.hpp's rules (id, lengths of x and y).
void write_sources(const Figure& figure, const Folder& folder, const Drawing& drawing = {});

/// Draws the pictures from what write_sources wrote. A missing or failing gnuplot is a warning. Figures of a folder may
/// be drawn at once by several threads.
PlotResult draw_figure(const Figure& figure, const Folder& folder, const Drawing& drawing = {});

/// Both.
PlotResult write_figure(const Figure& figure, const Folder& folder, const Drawing& drawing = {});

/// The text of ID.svg in the folder; empty if it is not there.
std::string read_svg(const Figure& figure, const Folder& folder);

struct TextPlot {
  std::string text;     ///< empty if it could not be drawn
  std::string warning;  ///< why not
};

/// The figure in characters for a terminal of that many columns and rows.
TextPlot text_plot(const Figure& figure, int width = 80, int height = 24);

}  // namespace kfstab::reports
