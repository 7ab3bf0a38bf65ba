#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace kfstab::properties::laws::nis {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  const auto innovations = long_run_innovations(bench, system);
  if (!innovations) return std::nullopt;
  double sum = 0;
  for (const Vector<double>& z : *innovations) sum += z.squaredNorm();
  const auto count = static_cast<double>(innovations->size()) * static_cast<double>(system.C.rows());
  // Chernoff's bound of chi-squared, either tail: exp(-s^2/2).
  const double mean = sum / count, sigma = std::sqrt(count * std::max(0.0, mean - 1 - std::log(mean)));
  return Finding{
      largest_ratio * sigma / 6, -1,
      fmt::format("over {} steps e' Re^-1 e / p has the mean {:.3g}, expected 1", innovations->size(), mean)};
}

}  // namespace

Law law() {
  return {.id = "nis",
          .statement =
              "e' Re^{-1} e, e = y - C x_{k|k-1}, has the mean p over a run: chi-squared, if the data are of the model",
          .assumptions =
              "runs with states; time-invariant systems with n, m, p <= 2, run for 60 steps with data drawn from the "
              "system; no step beyond the reach of first-order bounds",
          .source = "Bar-Shalom, Li, Kirubarajan 2001, 5.4; Chernoff's bound of chi-squared",
          .tolerance = "6 sigma: Chernoff's bound of the probability, exp(-s^2/2), at s = 6; the ratio is 5 s",
          .failure =
              "The filter is more sure, or less, of the next measurement than it may be: Re is too small or too large, "
              "or the innovation is not of the state that P is of.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::nis
