#pragma once

#include <limits>

namespace kfstab::experiments {

inline constexpr double NaN = std::numeric_limits<double>::quiet_NaN();
inline constexpr double infinity = std::numeric_limits<double>::infinity();
/// The unit roundoff of double.
inline constexpr double u = std::numeric_limits<double>::epsilon() / 2;
inline constexpr int bits_of_double = std::numeric_limits<double>::digits;

}  // namespace kfstab::experiments
