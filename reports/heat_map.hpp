#pragma once
// Heat maps as gnuplot draws them, and as text. Cells are boxes, so that any axis will do, one with unequal steps too;
// the colours are viridis, which is even to the eye, tells its values apart for the colour-blind and in grey print.

#include <string>
#include <vector>

#include <kfstab/reports/document.hpp>
#include <kfstab/reports/scale.hpp>

namespace kfstab::reports {

/// The borders of cells around the middles, in the middle between two neighbours, on a log axis by ratio.
std::vector<double> cell_borders(const std::vector<double>& middles, bool log);

/// The blocks of ID.dat: for each panel its finite cells, then the line around those that are outlined.
std::string heat_map_data(const Figure& figure);

/// The height in pixels of a picture 800 pixels wide that has room for the panels.
int heat_map_height(const Figure& figure);

struct HeatMapStyle {
  double type = 1;  ///< the size of type relative to the screen's: what stands beside the maps takes so much more room
  bool grey = false;  ///< no colour but viridis: the line around outlined cells is black
};

/// The commands that draw the panels into a picture of that shape.
std::string heat_map_commands(const Figure& figure, PowerNotation notation, const HeatMapStyle& style);

/// The panels as tables of numbers for a terminal of that many columns; a star marks the outlined cells. Columns that
/// do not fit are left out evenly, and the text says so.
std::string heat_map_text(const Figure& figure, int width);

}  // namespace kfstab::reports
