#pragma once

#include <string>

#include <kfstab/reports/document.hpp>

/// The curves of the claims' figures, to be filled point by point.
namespace kfstab::experiments {

/// Measured, as points in the colour of a filter.
reports::Curve measured_points(std::string id, std::string label, const std::string& filter);

/// What the theory says, as a dashed line.
reports::Curve theory_line(std::string id, std::string label);

void add_point(reports::Curve& curve, double x, double y);

}  // namespace kfstab::experiments
