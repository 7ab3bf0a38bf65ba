#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace kfstab::properties::laws::whiteness {

namespace {

/// Chernoff's bound of P(sum over k < N of z_k z_{k-1} >= s), p such chains in a row, z standard normal: the least over t of
/// exp(-t s) det(I - t M)^{-p/2}, M = 1 beside the diagonal, N x N. As sigma: (-2 log)^{1/2}.
double sigma(double s, std::size_t steps, double p) {
  double least = 0;
  for (int i = 1; i < 200; ++i) {
    const double t = i / 400.0;
    // Principal minors: d_k = d_{k-1} - t^2 d_{k-2}; in logarithms, by their quotient.
    double log_det = 0, quotient = 1;
    for (std::size_t k = 1; k < steps; ++k) {
      quotient = 1 - t * t / quotient;
      log_det += std::log(quotient);
    }
    least = std::min(least, -t * s - p / 2 * log_det);
  }
  return std::sqrt(-2 * least);
}

std::optional<Finding> examine(Bench& bench, const System& system) {
  const auto innovations = long_run_innovations(bench, system);
  if (!innovations || innovations->size() < 2) return std::nullopt;
  double sum = 0;
  for (std::size_t k = 1; k < innovations->size(); ++k) sum += (*innovations)[k].dot((*innovations)[k - 1]);
  const auto p = static_cast<double>(system.C.rows()), count = static_cast<double>(innovations->size() - 1) * p;
  return Finding{largest_ratio * sigma(std::abs(sum), innovations->size(), p) / 6, -1,
                 fmt::format("from one step to the next, Re^-1/2 e correlates by {:.3g}, expected 0", sum / count)};
}

}  // namespace

Law law() {
  return {.id = "whiteness",
          .statement =
              "innovations Re^{-1/2} (y - C x_{k|k-1}) of different steps are not correlated: what is left is noise",
          .assumptions = "as of nis",
          .source = "Kailath 1968; Mehra 1970",
          .tolerance = "6 sigma: Chernoff's bound of the probability, exp(-s^2/2), at s = 6; the ratio is 5 s",
          .failure =
              "The innovations still tell something that the filter has not used: the gain is wrong, or the model of "
              "another step.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::whiteness
