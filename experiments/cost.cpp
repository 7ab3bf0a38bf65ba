#include <kfstab/experiments/cost.hpp>

#include <cctype>
#include <string>

#include <kfstab/experiments/constants.hpp>
#include <kfstab/properties/expression.hpp>

namespace kfstab::experiments {
namespace {

/// "n^2 (3p + m)/2, s Jacobi sweeps" as an expression: what stands side by side is multiplied, what follows a comma is
/// prose.
std::string with_products(std::string_view formula) {
  const auto ends_factor = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == ')'; };
  const auto begins_factor = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '('; };
  const auto is_digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  std::string text;
  bool blank = false;
  for (const char c : formula.substr(0, formula.find(','))) {
    if (c == ' ') {
      blank = true;
      continue;
    }
    const char before = text.empty() ? '+' : text.back();
    const bool apart = blank || before == ')' || c == '(' || (is_digit(before) && !is_digit(c));
    if (ends_factor(before) && begins_factor(c) && apart) text += '*';
    text += c;
    blank = false;
  }
  return text;
}

}  // namespace

double operations(const Metadata& filter, Dimensions dimensions) {
  if (filter.operations.empty()) return NaN;
  const auto n = static_cast<double>(dimensions.n), m = static_cast<double>(dimensions.m),
             p = static_cast<double>(dimensions.p);
  return properties::Expressions({{"n", n}, {"m", m}, {"p", p}, {"alpha", n}, {"s", 6}})(
      with_products(filter.operations));
}

}  // namespace kfstab::experiments
