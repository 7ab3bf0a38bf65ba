#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <kfstab/reports/document.hpp>

/// The curves that claims draw.
namespace kfstab::experiments {

/// What was measured of a filter of the registry, in the filter's colour.
reports::Curve measured(std::string_view filter, std::vector<double> x, std::vector<double> y,
                        reports::CurveRole role = reports::CurveRole::measured_points);

/// A line of the theory: f at each x where it is in (0, most].
reports::Curve theory_line(std::string id, std::string label, const std::vector<double>& x,
                           const std::function<double(double)>& f, double most = 1);

}  // namespace kfstab::experiments
