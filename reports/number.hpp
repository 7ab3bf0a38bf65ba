#pragma once
// How numbers are written, for people and for programs.

#include <string>

namespace kfstab::reports {

/// For people: `digits` significant digits, no trailing zeros, scientific below 1e-3 and from 1e5 on:
/// 2.3e-14, 0.5, 12, 1234, 1.2e5, 0 (for -0 too), inf, -inf, nan. The integer part is never rounded away.
std::string short_number(double value, int digits = 2);

/// For programs: the shortest text that reads back as the same double, 17 digits where it needs them;
/// inf, -inf and nan as strtod reads them.
std::string exact_number(double value);

}  // namespace kfstab::reports
