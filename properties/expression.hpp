#pragma once

#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace kfstab::properties {

/// What is wrong with an expression, and a hint for the end of a message: "; did you mean 'dt'?" or nothing.
class ExpressionError : public std::runtime_error {
 public:
  explicit ExpressionError(const std::string& what, std::string hint = {}) : std::runtime_error(what), hint_(std::move(hint)) {}

  const std::string& hint() const { return hint_; }

 private:
  std::string hint_;
};

/// Evaluates what system files write in quotes: "q*dt^3/3". Numbers, names, pi, + - * / ^ ( ), comparisons, c ? a : b and
/// the functions of function_names(), in double, each operation rounded.
class Expressions {
 public:
  explicit Expressions(const std::map<std::string, double>& names);
  ~Expressions();

  /// Throws ExpressionError for what cannot be read, for an unknown name, and where the value or anything on the way
  /// to it is not finite (a division by zero, the root of a negative number, an overflow).
  double operator()(const std::string& text) const;

  /// The names that the text uses, known or not.
  std::vector<std::string> names_in(const std::string& text) const;

  static const std::vector<std::string>& function_names();
  /// Letters, digits and underscores, no digit first; neither pi nor a function.
  static bool is_name(const std::string& text);

 private:
  struct Parser;
  std::unique_ptr<Parser> parser_;
};

}  // namespace kfstab::properties
