#include <kfstab/experiments/fit.hpp>

#include <algorithm>
#include <cmath>

#include <boost/math/distributions/students_t.hpp>

#include <kfstab/experiments/constants.hpp>

namespace kfstab::experiments {
namespace {}  // namespace

Line fit_line(const std::vector<double>& x, const std::vector<double>& y) {
  Line line;
  line.points = static_cast<int>(x.size());
  if (x.size() < 2) return {NaN, NaN, line.points, infinity};
  double mean_x = 0, mean_y = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    mean_x += x[i];
    mean_y += y[i];
  }
  mean_x /= static_cast<double>(x.size());
  mean_y /= static_cast<double>(x.size());
  double xx = 0, xy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    xx += (x[i] - mean_x) * (x[i] - mean_x);
    xy += (x[i] - mean_x) * (y[i] - mean_y);
  }
  line.slope = xy / xx;
  line.intercept = mean_y - line.slope * mean_x;

  line.half_width = infinity;
  if (x.size() > 2) {
    double left = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const double residual = y[i] - line.intercept - line.slope * x[i];
      left += residual * residual;
    }
    const double freedom = static_cast<double>(x.size() - 2);
    line.half_width = boost::math::quantile(boost::math::students_t(freedom), .975) * std::sqrt(left / freedom / xx);
  }
  return line;
}

Line fit_power(const std::vector<double>& x, const std::vector<double>& y, double low, double high) {
  std::vector<double> log_x, log_y;
  for (std::size_t i = 0; i < x.size(); ++i)
    if (y[i] > low && y[i] < high) {
      log_x.push_back(std::log10(x[i]));
      log_y.push_back(std::log10(y[i]));
    }
  return fit_line(log_x, log_y);
}

double quantile(std::vector<double> values, double fraction) {
  std::erase_if(values, [](double v) { return std::isnan(v); });
  if (values.empty()) return NaN;
  std::ranges::sort(values);
  const double place = fraction * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(place);
  const double beyond = place - static_cast<double>(below);
  if (beyond == 0) return values[below];
  const double low = values[below], high = values[below + 1];
  for (const double end : {high, low})
    if (std::isinf(end)) return end;  // where the mean of the two might be NaN
  return low + beyond * (high - low);
}

double median(std::vector<double> values) { return quantile(std::move(values), .5); }

void keep_worst(double& worst, double value) {
  if (!std::isnan(worst) && !(value <= worst)) worst = value;
}

Growth fit_growth(const std::vector<double>& y, double low, double high) {
  std::size_t end = 0;
  while (end < y.size() && y[end] <= high) ++end;
  std::size_t begin = 0;
  for (std::size_t i = 0; i < end; ++i)
    if (!(y[i] >= low)) begin = i + 1;
  begin += (end - begin) / 4;
  Growth growth{NaN, static_cast<int>(begin), static_cast<int>(end), infinity};
  if (end < begin + 8) return growth;
  std::vector<double> steps, logs;
  for (std::size_t i = begin; i < end; ++i) {
    steps.push_back(static_cast<double>(i));
    logs.push_back(std::log(y[i]));
  }
  const Line line = fit_line(steps, logs);
  growth.factor = std::exp(line.slope);
  growth.half_width = growth.factor * line.half_width;
  return growth;
}

}  // namespace kfstab::experiments
