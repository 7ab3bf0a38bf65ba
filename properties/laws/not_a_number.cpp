#include <kfstab/properties/comparison.hpp>

#include <limits>
#include <utility>

#include <fmt/format.h>

namespace kfstab::properties::laws::not_a_number {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (system.A.rows() == 0 || system.C.rows() == 0) return std::nullopt;
  System other = first_steps(measured(system), 1);
  Matrix<double> C = other.C.at(0);
  C(0, 0) = std::numeric_limits<double>::quiet_NaN();
  other.C = Sequence(std::move(C));
  const Run& run = bench.run(other);
  if (run.answers.empty()) return Finding{0, 0, {}};
  const Values values_then = values(run.answers.front());
  for (const auto& [name, X] : {std::pair<const char*, Matrix<double>>("P", values_then.P), {"K", values_then.K}})
    if (X.size() > 0 && X.allFinite())
      return Finding{std::numeric_limits<double>::infinity(), 0,
                     fmt::format("C[0,0] is NaN, and {}[0,0] = {:.6g}", name, X(0, 0))};
  return Finding{0, 0, {}};
}

}  // namespace

Law law() {
  return {
      .id = "not-a-number",
      .statement = "A NaN in C is no number to compute with: the filter says so, or answers NaNs; never finite numbers",
      .assumptions = "n, p >= 1; a NaN in y means that it is missing, one in C means nothing",
      .source = "conventions: what is not finite is reported",
      .tolerance = "none: an answer is one or is not",
      .failure =
          "Numbers that are not finite are passed over: by comparisons that a NaN makes false, by a skipped update, by "
          "a maximum or minimum that drops a NaN.",
      .hostile = true,
      .examine = examine};
}

}  // namespace kfstab::properties::laws::not_a_number
