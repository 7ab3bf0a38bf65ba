#include <kfstab/properties/expression.hpp>

#include <algorithm>
#include <cctype>
#include <cfenv>
#include <cmath>
#include <numbers>

#include <muParser.h>

#include <kfstab/properties/input_error.hpp>

namespace kfstab::properties {

namespace {

using Unary = double (*)(double);
using Binary = double (*)(double, double);

// log is the natural logarithm, as in C; ln says so in one more letter less.
const std::vector<std::pair<std::string, Unary>> unary = {
    {"sqrt", std::sqrt}, {"exp", std::exp},   {"log", std::log},   {"log10", std::log10}, {"sin", std::sin},
    {"cos", std::cos},   {"tan", std::tan},   {"asin", std::asin}, {"acos", std::acos},   {"atan", std::atan},
    {"sinh", std::sinh}, {"cosh", std::cosh}, {"tanh", std::tanh}, {"abs", std::fabs}};
const std::vector<std::pair<std::string, Binary>> binary = {
    {"atan2", std::atan2}, {"min", std::fmin}, {"max", std::fmax}, {"pow", std::pow}};

std::string quoted(const std::string& text) { return '"' + text + '"'; }

}  // namespace

struct Expressions::Parser {
  mu::Parser parser;
  std::vector<std::string> names;
};

Expressions::Expressions(const std::map<std::string, double>& names) : parser_(std::make_unique<Parser>()) {
  mu::Parser& parser = parser_->parser;
  parser.ClearFun();
  parser.ClearConst();
  for (const auto& [name, function] : unary) parser.DefineFun(name, function, false);
  for (const auto& [name, function] : binary) parser.DefineFun(name, function, false);
  parser.DefineConst("pi", std::numbers::pi);
  for (const auto& [name, value] : names) {
    parser.DefineConst(name, value);
    parser_->names.push_back(name);
  }
  parser_->names.push_back("pi");
}

Expressions::~Expressions() = default;

double Expressions::operator()(const std::string& text) const {
  if (text.empty()) throw ExpressionError("an empty expression");
  if (text.size() > 4000) throw ExpressionError("an expression of " + std::to_string(text.size()) + " characters (at most 4000)");
  // muParser's stack is its own, but its parser calls itself for c ? a : b and signs: nothing sane nests deeper.
  if (std::count(text.begin(), text.end(), '(') > 200) throw ExpressionError(quoted(text) + ", which nests too deep");
  mu::Parser& parser = parser_->parser;
  double value = 0;
  std::feclearexcept(FE_ALL_EXCEPT);
  try {
    parser.SetExpr(text);
    int results = 0;
    const double* all = parser.Eval(results);
    if (results != 1) throw ExpressionError(quoted(text) + ", which gives " + std::to_string(results) + " values");
    value = *all;
  } catch (const mu::Parser::exception_type& error) {
    if (error.GetCode() == mu::ecUNASSIGNABLE_TOKEN) {
      const std::string& token = error.GetToken();
      throw ExpressionError(quoted(text) + ", where " + quoted(token) + " is no parameter, constant or function",
                            did_you_mean(token, parser_->names));
    }
    throw ExpressionError(quoted(text) + " (" + error.GetMsg() + ")");
  }
  // A division by zero inside, as in 1/(1/0), leaves a finite value and a flag.
  const int raised = std::fetestexcept(FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW);
  if (raised & FE_DIVBYZERO) throw ExpressionError(quoted(text) + ", which divides by zero");
  if (raised & FE_OVERFLOW) throw ExpressionError(quoted(text) + ", which is beyond the range of double");
  if ((raised & FE_INVALID) || !std::isfinite(value)) throw ExpressionError(quoted(text) + ", which has no real value");
  return value;
}

std::vector<std::string> Expressions::names_in(const std::string& text) const {
  std::vector<std::string> names;
  const auto letter = [](char c) { return std::isalpha(static_cast<unsigned char>(c)) || c == '_'; };
  const auto digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  for (std::size_t i = 0; i < text.size();) {
    if (letter(text[i])) {
      const std::size_t begin = i;
      while (i < text.size() && (letter(text[i]) || digit(text[i]))) ++i;
      names.push_back(text.substr(begin, i - begin));
    } else if (digit(text[i]) || text[i] == '.') {
      // A number with its exponent: the e of 2e-3 is no name.
      while (i < text.size() && (digit(text[i]) || text[i] == '.')) ++i;
      if (i + 1 < text.size() && (text[i] == 'e' || text[i] == 'E') &&
          (digit(text[i + 1]) || ((text[i + 1] == '-' || text[i + 1] == '+') && i + 2 < text.size() && digit(text[i + 2]))))
        i += 2;
      while (i < text.size() && digit(text[i])) ++i;
    } else {
      ++i;
    }
  }
  return names;
}

const std::vector<std::string>& Expressions::function_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const auto& [name, function] : unary) all.push_back(name);
    for (const auto& [name, function] : binary) all.push_back(name);
    return all;
  }();
  return names;
}

bool Expressions::is_name(const std::string& text) {
  if (text.empty() || text.size() > 60 || text == "pi" || std::isdigit(static_cast<unsigned char>(text[0]))) return false;
  if (std::ranges::find(function_names(), text) != function_names().end()) return false;
  return std::ranges::all_of(text, [](char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_'; });
}

}  // namespace kfstab::properties
