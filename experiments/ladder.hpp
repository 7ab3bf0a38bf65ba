#pragma once

#include <string_view>
#include <vector>

#include <kfstab/experiments/fit.hpp>
#include <kfstab/reports/document.hpp>

namespace kfstab::experiments {

/// One quantity of one filter on a ladder of difficulties, drawn several times on each rung. The median is what a claim
/// fits and judges, so that no one lucky draw decides; the quartiles show how far the draws scatter.
class Ladder {
 public:
  /// @param difficulty  of this draw: a rung's is the median of its draws
  void add(std::size_t rung, double difficulty, double value);

  std::size_t rungs() const { return values_.size(); }
  std::vector<double> difficulties() const;
  /// The value below which that fraction of a rung's draws lies, rung by rung; NaN for an empty one.
  std::vector<double> quantiles(double fraction) const;
  std::vector<double> medians() const { return quantiles(.5); }

  /// The slope of log10 of the medians over log10 of the difficulties, where low < median < high.
  Line power(double low, double high) const { return fit_power(difficulties(), medians(), low, high); }
  /// The largest median over that of the first rung.
  double growth() const;

 private:
  std::vector<std::vector<double>> difficulties_, values_;
};

/// Adds the medians as points and the quartiles as thin lines, in the filter's colour.
void add_curves(reports::Figure& figure, const Ladder& ladder, std::string_view filter);

}  // namespace kfstab::experiments
