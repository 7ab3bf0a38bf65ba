#include <kfstab/experiments/scan.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <regex>

#include <fmt/core.h>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/properties/data.hpp>
#include <kfstab/properties/expression.hpp>
#include <kfstab/reference/rounded.hpp>
#include <kfstab/reports/number.hpp>

namespace kfstab::experiments {
namespace {

using properties::InputError;
using properties::Sequence;
using properties::System;
using reference::Rounded;

constexpr std::size_t most_values = 1000;

[[noreturn]] void refuse(const std::string& field, const std::string& found, const std::string& expected) {
  properties::Place place;
  place.origin = "--scan";
  place.field = field;
  throw InputError(place, found, expected);
}

double number(const std::string& name, const std::string& text) {
  try {
    return properties::Expressions({})(text);
  } catch (const properties::ExpressionError& error) {
    refuse(name, error.what(), "a number, such as 0.01 or 2^-20" + error.hint());
  }
}

std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == at)
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

std::vector<double> spread(const std::string& name, const std::vector<std::string>& parts, bool log) {
  const double from = number(name, parts[0]), to = number(name, parts[1]), count = number(name, parts[3]);
  if (!(count >= 2 && count <= most_values) || count != std::floor(count))
    refuse(name, fmt::format("a count of {}", parts[3]), fmt::format("an integer from 2 to {}", most_values));
  if (from == to) refuse(name, fmt::format("{} from and to", parts[0]), "two different ends");
  if (log && !(from > 0 && to > 0))
    refuse(name, fmt::format("{}:{}:log", parts[0], parts[1]), "two positive ends, or lin in the place of log");
  std::vector<double> values;
  for (int i = 0; i < static_cast<int>(count); ++i) {
    const double t = i / (count - 1);
    values.push_back(log ? std::exp2(std::log2(from) * (1 - t) + std::log2(to) * t) : from * (1 - t) + to * t);
  }
  values.front() = from;
  values.back() = to;
  return values;
}

/// The covariance that a name means, and whether as its root.
struct Named {
  properties::Covariance* covariance;
  bool root;
};
Named covariance_named(System& system, const std::string& name) {
  if (name == "Q" || name == "Q_root") return {&system.Q, name != "Q"};
  if (name == "R" || name == "R_root") return {&system.R, name != "R"};
  if (name == "P0" || name == "S0") return {&system.P0, name != "P0"};
  return {nullptr, false};
}

Sequence* dynamics_named(System& system, const std::string& name) {
  if (name == "A") return &system.A;
  if (name == "B") return &system.B;
  if (name == "C") return &system.C;
  if (name == "D") return &system.D;
  return nullptr;
}

bool is_matrix(const std::string& name) {
  System none;
  return covariance_named(none, name).covariance || dynamics_named(none, name);
}

constexpr std::string_view matrices = "one of A, B, C, D, Q, R, P0, Q_root, R_root, S0";

void set_entry(System& system, const Scan& scan, double value) {
  const Named named = covariance_named(system, scan.matrix);
  const bool written_as_root = named.covariance && named.covariance->written == properties::Covariance::Written::root;
  if (named.covariance && named.root != written_as_root)
    refuse(scan.name,
           fmt::format("{}, which the system writes {}", scan.matrix, written_as_root ? "by its root" : "itself"),
           fmt::format("an entry of {} itself, or scale:{}", written_as_root ? "its root" : "the covariance",
                       scan.matrix));
  Sequence& sequence = named.covariance ? named.covariance->value : *dynamics_named(system, scan.matrix);
  if (scan.row >= sequence.rows() || scan.col >= sequence.cols())
    refuse(scan.name,
           fmt::format("entry [{},{}] of a {} x {} matrix", scan.row, scan.col, sequence.rows(), sequence.cols()),
           "an entry that there is, counted from 0");
  if (named.root && scan.col > scan.row)
    refuse(scan.name, "an entry above the diagonal of a lower root", "one on or below it");
  for (Matrix<double>& X : sequence.matrices) {
    X(scan.row, scan.col) = value;
    if (named.covariance && !named.root) X(scan.col, scan.row) = value;
  }
}

void scale(System& system, const Scan& scan, double factor) {
  const Named named = covariance_named(system, scan.matrix);
  if (named.covariance) {
    if (!(factor >= 0))
      refuse(scan.name, reports::short_number(factor), "a factor >= 0: a covariance has no negative one");
    // Of the one written by its root, and of the root of the one that is not.
    const bool written_as_root = named.covariance->written == properties::Covariance::Written::root;
    if (written_as_root && !named.root) factor = std::sqrt(factor);
    if (!written_as_root && named.root) factor *= factor;
  }
  for (Matrix<double>& X : (named.covariance ? named.covariance->value : *dynamics_named(system, scan.matrix)).matrices)
    X *= factor;
}

void require_covariances(const System& system, std::span<const Scan> scans) {
  for (const Scan& scan : scans) {
    System copy = system;
    const Named named = covariance_named(copy, scan.matrix);
    if (!named.covariance || named.covariance->written == properties::Covariance::Written::root) continue;
    for (const Matrix<double>& X : named.covariance->value.matrices)
      if (const auto wrong = properties::admissible_covariance(X))
        refuse(scan.name, *wrong, scan.matrix + " positive semidefinite at every value");
  }
}

}  // namespace

Scan parse_scan(const std::string& text) {
  const auto equals = text.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == text.size())
    refuse("", fmt::format("'{}'", text), "name=from:to:log:count, name=from:to:lin:count or name=value,value,...");
  Scan scan;
  scan.name = text.substr(0, equals);
  const std::string values = text.substr(equals + 1);

  static const std::regex entry(R"(([A-Za-z]\w*)\[(\d{1,4}),(\d{1,4})\])");
  std::smatch match;
  if (scan.name == "bits") {
    scan.of = Scan::Of::bits;
  } else if (scan.name.starts_with("scale:")) {
    scan.of = Scan::Of::scale;
    scan.matrix = scan.name.substr(6);
  } else if (std::regex_match(scan.name, match, entry)) {
    scan.of = Scan::Of::entry;
    scan.matrix = match[1];
    scan.row = std::stol(match[2]);
    scan.col = std::stol(match[3]);
  } else if (!properties::Expressions::is_name(scan.name)) {
    refuse(scan.name, fmt::format("the name '{}'", scan.name), "a parameter, an entry as R[0,0], scale:R or bits");
  }
  if (!scan.matrix.empty() && !is_matrix(scan.matrix))
    refuse(scan.name, fmt::format("'{}'", scan.matrix), std::string(matrices));
  if (scan.of == Scan::Of::scale && scan.matrix.empty()) refuse(scan.name, "no matrix", std::string(matrices));

  const auto parts = split(values, ':');
  if (parts.size() == 4 && (parts[2] == "log" || parts[2] == "lin")) {
    scan.log = parts[2] == "log";
    scan.values = spread(scan.name, parts, scan.log);
    if (scan.of == Scan::Of::bits)
      for (double& value : scan.values) value = std::round(value);
  } else if (parts.size() == 1) {
    for (const std::string& value : split(values, ',')) scan.values.push_back(number(scan.name, value));
    const auto [least, most] = std::ranges::minmax(scan.values);
    scan.log = least > 0 && most >= 100 * least;
  } else {
    refuse(scan.name, fmt::format("'{}'", values), "from:to:log:count, from:to:lin:count or value,value,...");
  }
  std::ranges::sort(scan.values);
  scan.values.erase(std::unique(scan.values.begin(), scan.values.end()), scan.values.end());
  if (scan.values.size() < 2 || scan.values.size() > most_values)
    refuse(scan.name, fmt::format("{} different values", scan.values.size()), fmt::format("2 to {}", most_values));
  if (scan.of == Scan::Of::bits)
    for (const double bits : scan.values)
      if (bits != std::floor(bits) || bits < Rounded::least_bits || bits > Rounded::most_bits)
        refuse(scan.name, reports::short_number(bits, 6),
               fmt::format("integers from {} to {}", Rounded::least_bits, Rounded::most_bits));
  return scan;
}

properties::System scanned_system(const std::string& word, properties::Overrides overrides, std::span<const Scan> scans,
                                  std::span<const double> values) {
  for (std::size_t i = 0; i < scans.size(); ++i)
    if (scans[i].of == Scan::Of::parameter) overrides.parameters[scans[i].name] = reports::exact_number(values[i]);
  System system = find_system(word, overrides);
  bool changed = false;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    if (scans[i].of == Scan::Of::entry) set_entry(system, scans[i], values[i]);
    if (scans[i].of == Scan::Of::scale) scale(system, scans[i], values[i]);
    changed = changed || !scans[i].matrix.empty();
  }
  if (!changed) return system;
  require_covariances(system, scans);
  if (const auto* simulated = dynamic_cast<const properties::Simulated*>(system.data.get()))
    system.data = std::make_shared<properties::Simulated>(system, simulated->seed(), simulated->inputs(),
                                                          simulated->exact_inputs());
  return system;
}

int scanned_bits(std::span<const Scan> scans, std::span<const double> values) {
  for (std::size_t i = 0; i < scans.size(); ++i)
    if (scans[i].of == Scan::Of::bits) return static_cast<int>(values[i]);
  return std::numeric_limits<double>::digits;
}

}  // namespace kfstab::experiments
