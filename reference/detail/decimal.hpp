#pragma once

#include <algorithm>
#include <string>

#include <kfstab/reference/detail/agreement.hpp>

namespace kfstab::reference::detail {

/// `digits` significant decimal digits of x, x != 0: "0.00125", "-31.4", "1.5e-30".
template <class T>
std::string significant(const T& x, int digits) {
  mpfr_exp_t point = 0;  // x = 0.d1 d2 ... * 10^point
  char* raw = mpfr_get_str(nullptr, &point, 10, static_cast<std::size_t>(digits), x.backend().data(), MPFR_RNDN);
  std::string text(raw);
  mpfr_free_str(raw);
  const std::string sign = text.front() == '-' ? "-" : "";
  if (!sign.empty()) text.erase(0, 1);
  if (point > -5 && point <= 0) return sign + "0." + std::string(static_cast<std::size_t>(-point), '0') + text;
  if (point > 0 && point < digits) return sign + text.insert(static_cast<std::size_t>(point), ".");
  const std::string exponent = point == 1 ? "" : "e" + std::to_string(point - 1);
  return sign + text.substr(0, 1) + (digits > 1 ? "." + text.substr(1) : "") + exponent;
}

/// An entry of the truth with the digits that its witness vouches for, most_digits at most: each printed digit is right, the
/// last one to a unit. "0" where both say 0. "0e-72", zero to 72 places, where they share no digit: the entry is then
/// below 10^-72.
template <class T, class U>
std::string decimal(const T& truth, const U& witness, int most_digits, int most_certified) {
  if (truth == 0 && witness == 0) return "0";
  Size error = distance(truth, witness), value = distance(truth, U(0));
  // Four times what they differ by: half a unit of the last digit is for its rounding.
  error.factor *= 4;
  const int digits = std::min(digits_of(error, value, most_certified), most_digits);
  if (digits > 0) return significant(truth, digits);
  const double most = std::max(value.log10(), distance(witness, U(0)).log10());
  return "0e" + std::to_string(static_cast<long>(std::ceil(most + 1e-9)) + 1);
}

}  // namespace kfstab::reference::detail
