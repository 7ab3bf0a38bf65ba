#pragma once

#include <vector>

/// Straight lines through measured points. Growth factors and slopes of the claims come from here.
namespace kfstab::experiments {

struct Line {
  double intercept = 0;
  double slope = 0;
  int points = 0;  ///< that it was fitted to; slope is NaN for fewer than 2
};

/// Least squares.
Line fit_line(const std::vector<double>& x, const std::vector<double>& y);

/// The slope of log10 y over log10 x, through the points with low < y < high: one decade of y per decade of x is 1.
Line fit_power(const std::vector<double>& x, const std::vector<double>& y, double low, double high);

/// The median; of an even number the mean of the two in the middle. NaN for none. Infinities count.
double median(std::vector<double> values);

/// A curve that grows or decays by a factor per step.
struct Growth {
  double factor = 0;  ///< per step; NaN for fewer than 8 points in the window
  int first = 0, last = 0;  ///< indices of the window's ends
};

/// exp of the slope of log y: fitted from the last time y was below `low` to the first time it exceeds `high`, without
/// the first quarter of that, which the transient may colour.
Growth fit_growth(const std::vector<double>& y, double low, double high);

}  // namespace kfstab::experiments
