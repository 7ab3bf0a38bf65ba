#pragma once
// What part of an axis a figure shows, and where its ticks are.

#include <optional>
#include <string>
#include <vector>

#include <kfstab/reports/document.hpp>

namespace kfstab::reports {

struct Scale {
  bool log = false;
  double low = 0;
  double high = 1;
  /// On a log axis that has to show values that are not positive: where they are drawn, below all others.
  std::optional<double> floor{};
  bool has_negative = false;  ///< some value on the floor is negative, not zero

  /// Where a value is drawn; NaN if nowhere.
  double shown(double value) const;
};

/// What a log axis cannot tell from zero.
constexpr double smallest_shown = 1e-300;

/// The scale that shows all of `measured`, and of `bounds` (theory, envelopes) what is not so far away that it would
/// squeeze the measured values into a corner. Values that are not finite do not count.
/// `margin` is the part of the axis that is left free at both ends.
Scale scale_for(const Axis& axis, const std::vector<double>& measured, const std::vector<double>& bounds, double margin);

struct Tick {
  double at = 0;
  std::string label;  ///< empty for a minor tick
};

/// 10^{-5} as gnuplot sets it, $10^{-5}$ as LaTeX does, or 1e-5.
enum class PowerNotation { superscript, latex, plain };

/// The ticks of a log axis, at most about `most` of them labelled; none of an axis that is not.
std::vector<Tick> log_ticks(const Scale& scale, PowerNotation notation, int most = 8);

}  // namespace kfstab::reports
