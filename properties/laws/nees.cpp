#include <kfstab/properties/law.hpp>

#include <cmath>

#include <fmt/format.h>

namespace kfstab::properties::laws::nees {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (!long_run_innovations(bench, system)) return std::nullopt;
  const auto simulation = long_run(bench.traits(), system);
  double sum = 0;
  int count = 0;
  for (const ObservedStep& s : observed_steps(bench, simulation->system)) {
    // A state that is known exactly has no error to be judged by.
    const auto inverse = s.prior.inverse();
    if (!inverse || !(largest_ratio * s.rounding() * s.amplification() * inverse->norm() <= 0.1)) continue;
    const Precise error = Precise(Matrix<double>(simulation->x.col(s.k))) - *s.x_prior;
    sum += (error.transposed() * *inverse * error).rounded()(0, 0);
    ++count;
  }
  if (count == 0) return std::nullopt;
  const auto n = static_cast<double>(system.A.rows());
  const double mean = sum / count;
  // A mean of chi-squared numbers, dependent as they may be, has no heavier a tail than one of them: exp(-s^2/2).
  const double sigma = mean <= n ? 0 : std::sqrt(mean - n - n * std::log(mean / n));
  return Finding{largest_ratio * sigma / 6, -1,
                 fmt::format("over {} steps (x^ - x)' P^-1 (x^ - x) has the mean {:.3g}, expected {}", count, mean, n)};
}

}  // namespace

Law law() {
  return {
      .id = "nees",
      .statement =
          "(x^ - x)' P^{-1} (x^ - x), x the state that the data were drawn with, is n on the average, and not many "
          "times as much",
      .assumptions = "as of nis; steps whose P is regular",
      .source = "Bar-Shalom, Li, Kirubarajan 2001, 5.4; Chernoff's bound, whatever the correlation from step to step",
      .tolerance = "6 sigma: Chernoff's bound of the probability, exp(-s^2/2), at s = 6; the ratio is 5 s",
      .failure =
          "The filter is far more sure of its state than it may be: P goes down while x does not follow, noise is "
          "forgotten, or x is of another step than P.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::nees
