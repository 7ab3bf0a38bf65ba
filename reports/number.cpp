#include <kfstab/reports/number.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>

#include <fmt/format.h>

namespace kfstab::reports {
namespace {

std::string without_trailing_zeros(std::string digits) {
  if (digits.find('.') == std::string::npos) return digits;
  digits.erase(digits.find_last_not_of('0') + 1);
  if (digits.back() == '.') digits.pop_back();
  return digits;
}

}  // namespace

std::string short_number(double value, int digits) {
  if (value == 0) return "0";
  if (!std::isfinite(value)) return exact_number(value);
  digits = std::clamp(digits, 1, 17);

  // The exponent is read from the rounded text: 9.99 with two digits is 10.
  const std::string scientific = fmt::format("{:.{}e}", value, digits - 1);
  const std::size_t e = scientific.find('e');
  int exponent = 0;
  const char* first = scientific.data() + e + 1;
  if (*first == '+') ++first;
  std::from_chars(first, scientific.data() + scientific.size(), exponent);

  if (exponent >= -3 && exponent < 5)
    return without_trailing_zeros(fmt::format("{:.{}f}", value, std::max(0, digits - 1 - exponent)));
  return fmt::format("{}e{}", without_trailing_zeros(scientific.substr(0, e)), exponent);
}

std::string exact_number(double value) {
  if (std::isnan(value)) return "nan";
  return fmt::format("{}", value);
}

}  // namespace kfstab::reports
