#pragma once

#include <vector>

/// Straight lines through measured points, and what is typical of many. Growth factors, slopes and medians of the
/// claims come from here.
namespace kfstab::experiments {

struct Line {
  double intercept = 0;
  double slope = 0;
  int points = 0;  ///< that it was fitted to; slope is NaN for fewer than 2
  /// Half the width of the slope's 95 % confidence interval, by Student's t from what is left beside the line: how well
  /// the points determine the slope. Infinite for fewer than 3.
  double half_width = 0;
};

/// Least squares.
Line fit_line(const std::vector<double>& x, const std::vector<double>& y);

/// The slope of log10 y over log10 x, through the points with low < y < high: one decade of y per decade of x is 1.
Line fit_power(const std::vector<double>& x, const std::vector<double>& y, double low, double high);

/// The value below which that fraction of the values lies, linear between the two that are next to it: 0 gives the
/// smallest, 1 the largest. NaN values do not count, infinities do; NaN for none.
double quantile(std::vector<double> values, double fraction);

/// The median; of an even number the mean of the two in the middle. NaN for none. Infinities count.
double median(std::vector<double> values);

/// worst = max(worst, value), and NaN from the first NaN on: what could not be measured once was not measured.
void keep_worst(double& worst, double value);

/// A curve that grows or decays by a factor per step.
struct Growth {
  double factor = 0;        ///< per step; NaN for fewer than 8 points in the window
  int first = 0, last = 0;  ///< indices of the window's ends
  double half_width = 0;    ///< of the factor, as Line has it of the slope of log y
};

/// exp of the slope of log y: fitted from the last time y was below `low` to the first time it exceeds `high`, without
/// the first quarter of that, which the transient may colour.
Growth fit_growth(const std::vector<double>& y, double low, double high);

}  // namespace kfstab::experiments
