#include <kfstab/reports/scale.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <limits>

#include <fmt/format.h>

#include <kfstab/reports/number.hpp>

namespace kfstab::reports {
namespace {

/// Lowest and highest of some values; empty at first.
struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();

  bool empty() const { return low > high; }
  double span() const { return high - low; }
  void add(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
};

Range shown_of(const Range& measured, const Range& bounds, double least_reach) {
  if (measured.empty() || bounds.empty()) return measured.empty() ? bounds : measured;
  const double reach = std::max(least_reach, measured.span() / 2);
  return {std::min(measured.low, std::max(bounds.low, measured.low - reach)),
          std::max(measured.high, std::min(bounds.high, measured.high + reach))};
}

double power_of_ten(double exponent) {
  const double power = std::pow(10.0, std::max(exponent, -306.0));
  return std::min(power, std::numeric_limits<double>::max());
}

Scale linear_scale(const std::vector<double>& measured, const std::vector<double>& bounds, double margin) {
  Range inner, outer;
  // Halved, so that the span of the largest doubles is finite.
  constexpr double largest = std::numeric_limits<double>::max() / 4;
  for (double value : measured)
    if (std::isfinite(value)) inner.add(std::clamp(value, -largest, largest));
  for (double value : bounds)
    if (std::isfinite(value)) outer.add(std::clamp(value, -largest, largest));
  Range range = shown_of(inner, outer, 0);
  if (range.empty()) return {};
  if (range.span() == 0) {
    const double half = range.low == 0 ? 1 : std::abs(range.low) / 2;
    return {.low = range.low - half, .high = range.high + half};
  }
  // An axis of values that are positive and not far from zero starts at zero.
  const bool from_zero = margin > 0 && range.low >= 0 && range.low < 0.3 * range.high;
  const double free = margin * range.span();
  return {.low = from_zero ? 0 : range.low - free, .high = range.high + free};
}

Scale log_scale(const std::vector<double>& measured, const std::vector<double>& bounds, double margin) {
  Range inner, outer;
  bool on_floor = false, negative = false;
  for (double value : measured) {
    if (!std::isfinite(value)) continue;
    if (value >= smallest_shown) inner.add(std::log10(value));
    else on_floor = true;
    negative = negative || value < 0;
  }
  for (double value : bounds)
    if (std::isfinite(value) && value >= smallest_shown) outer.add(std::log10(value));

  Range range = shown_of(inner, outer, 2);
  if (range.empty()) range = {-1, 0};
  if (range.span() > 3) range = {std::floor(range.low), std::ceil(range.high)};
  else if (range.span() == 0) range = {range.low - 0.5, range.high + 0.5};

  Scale scale{.log = true};
  if (on_floor) {
    range.low = std::floor(range.low) - std::max(1.0, std::ceil(0.05 * range.span()));
    scale.floor = power_of_ten(range.low);
    scale.has_negative = negative;
  }
  const double free = std::max(margin, on_floor ? 0.02 : 0.0) * range.span();
  scale.low = power_of_ten(range.low - free);
  scale.high = power_of_ten(range.high + free);
  return scale;
}

/// A small number times a power of ten.
std::string power_label(double digit, int exponent, PowerNotation notation) {
  if (notation == PowerNotation::plain) return fmt::format("{:g}e{}", digit, exponent);
  if (notation == PowerNotation::latex)
    return fmt::format("${}10^{{{}}}$", digit == 1 ? "" : fmt::format("{:g}\\cdot", digit), exponent);
  return fmt::format("{}10^{{{}}}", digit == 1 ? "" : fmt::format("{:g}·", digit), exponent);
}

/// Of a range of less than a few units of its leading digit: equal steps of that, as few as show where one is.
std::vector<Tick> close_ticks(double low, double high, PowerNotation notation) {
  const int exponent = static_cast<int>(std::floor(std::log10(low)));
  const double unit = power_of_ten(exponent);
  for (const double step : {1., .5, .2, .1, .05, .02, .01}) {
    std::vector<Tick> ticks;
    for (double n = std::ceil(low / unit / step); n * step * unit <= high; ++n) {
      const int up = n * step < 10 ? 0 : 1;
      ticks.push_back({n * step * unit, std::abs(exponent) <= 3
                                            ? short_number(n * step * unit)
                                            : power_label(n * step / (up ? 10 : 1), exponent + up, notation)});
    }
    if (ticks.size() >= 3) return ticks;
  }
  return {};
}

}  // namespace

double Scale::shown(double value) const {
  if (!std::isfinite(value)) return std::numeric_limits<double>::quiet_NaN();
  if (!log || value >= smallest_shown) return value;
  return floor.value_or(std::numeric_limits<double>::quiet_NaN());
}

Scale scale_for(const Axis& axis, const std::vector<double>& measured, const std::vector<double>& bounds, double margin) {
  return axis.log ? log_scale(measured, bounds, margin) : linear_scale(measured, bounds, margin);
}

std::vector<Tick> log_ticks(const Scale& scale, PowerNotation notation, int most) {
  if (!scale.log) return {};
  std::vector<Tick> ticks;
  if (scale.floor) ticks.push_back({*scale.floor, !scale.has_negative ? "0" : notation == PowerNotation::latex ? "$\\le 0$" : "≤ 0"});

  const double bottom = std::log10(scale.low), top = std::log10(scale.high);
  // Above the floor a label needs room, and a tick that is lower than what is measured means nothing.
  const double low = scale.floor ? std::log10(*scale.floor) + std::max(0.3, 0.05 * (top - bottom)) : bottom;
  constexpr double rounding = 1e-9;
  const int first = static_cast<int>(std::ceil(low - rounding));
  const int last = static_cast<int>(std::floor(top + rounding));
  const auto add_multiples = [&](std::initializer_list<int> digits, auto label) {
    for (int exponent = first - 1; exponent <= last; ++exponent)
      for (int digit : digits)
        if (const double at = std::log10(digit) + exponent; at >= low - rounding && at <= top + rounding)
          ticks.push_back({digit * power_of_ten(exponent), label(digit, exponent)});
  };

  if (top - low < 2) {
    // 1, 2 and 5 times a power.
    add_multiples({1, 2, 5}, [&](int digit, int exponent) {
      return std::abs(exponent) <= 3 ? short_number(digit * power_of_ten(exponent)) : power_label(digit, exponent, notation);
    });
    if (ticks.size() < 3 && !scale.floor) return close_ticks(scale.low, scale.high, notation);
    add_multiples({3, 4, 6, 7, 8, 9}, [](int, int) { return std::string(); });
    return ticks;
  }

  // Labels every so many decades, minor ticks every so many.
  constexpr std::array<std::array<int, 2>, 8> steps{
      {{1, 1}, {2, 1}, {5, 1}, {10, 2}, {20, 5}, {50, 10}, {100, 20}, {200, 50}}};
  const auto fits = [&](const std::array<int, 2>& step) { return (last - first) / step[0] + 1 <= most; };
  const auto found = std::find_if(steps.begin(), steps.end(), fits);
  const auto [labelled, minor] = found == steps.end() ? steps.back() : *found;
  for (int exponent = first; exponent <= last; ++exponent) {
    if (exponent % labelled == 0) ticks.push_back({power_of_ten(exponent), power_label(1, exponent, notation)});
    else if (exponent % minor == 0) ticks.push_back({power_of_ten(exponent), {}});
  }
  if (last - first <= 4) add_multiples({2, 3, 4, 5, 6, 7, 8, 9}, [](int, int) { return std::string(); });
  return ticks;
}

}  // namespace kfstab::reports
