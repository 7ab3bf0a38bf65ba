#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <kfstab/reports/document.hpp>

/// The curves that claims draw: all at once, or to be filled point by point.
namespace kfstab::experiments {

/// A slot of the palette that is a black cross; filters are few and have the first ones.
inline constexpr int black_cross = 76;
/// Small multiples, where filters would hide one another.
inline constexpr std::size_t panels_a_figure = 6;

/// What was measured of a filter of the registry, in the filter's name and colour.
reports::Curve measured(std::string_view filter, std::vector<double> x, std::vector<double> y,
                        reports::CurveRole role = reports::CurveRole::measured_points);
/// Measured, as points in the colour of a filter, under a name of their own.
reports::Curve measured_points(std::string id, std::string label, const std::string& filter);

/// A line of the theory: f at each x where it is in (0, most].
reports::Curve theory_line(std::string id, std::string label, const std::vector<double>& x,
                           const std::function<double(double)>& f, double most = 1);
reports::Curve theory_line(std::string id, std::string label);

void add_point(reports::Curve& curve, double x, double y);

}  // namespace kfstab::experiments
