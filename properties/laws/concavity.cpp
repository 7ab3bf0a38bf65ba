#include <kfstab/properties/comparison.hpp>

#include <algorithm>

namespace kfstab::properties::laws::concavity {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (!small(system)) return std::nullopt;
  const System base = first_steps(with_data(system), 2), other = raised(base);
  System mean = base;
  mean.P0 = multiplied(base.P0, 2.5);
  mean.Q = multiplied(base.Q, 8.5);
  mean.R = multiplied(base.R, 32.5);
  const Run& small = bench.run(base);
  const Run& large = bench.run(other);
  const Run& middle = bench.run(mean);
  const auto b = tolerances(bench, base, system), b_large = tolerances(bench, other),
             b_middle = tolerances(bench, mean);
  const std::size_t steps = std::min(
      {small.answers.size(), large.answers.size(), middle.answers.size(), b.size(), b_large.size(), b_middle.size()});
  Comparison comparison;
  for (std::size_t k = 0; k < steps; ++k) {
    const Matrix<double> P = values(small.answers[k]).P, P_raised = values(large.answers[k]).P;
    const Matrix<double> P_mean = values(middle.answers[k]).P;
    if (P.size() == 0 || P_raised.size() == 0 || P_mean.size() == 0) break;
    comparison.add_order(static_cast<std::int64_t>(k), "P of the mean - the mean of P", P_mean, (P + P_raised) / 2,
                         (b[k].P + b_large[k].P) / 2 + b_middle[k].P, "of P0, Q, R and 4 P0, 16 Q, 64 R");
  }
  return comparison.worst();
}

}  // namespace

Law law() {
  return {.id = "concavity",
          .statement = "P of the mean of (P0, Q, R) and (4 P0, 16 Q, 64 R) is at least the mean of their P",
          .assumptions = "n, m, p <= 4; the first 2 steps; steps in which 30 b is small",
          .source = "theory 1: P is the least of what linear filters reach, each of which is linear in P0, Q and R",
          .tolerance = "30 ((b + b')/2 + b''), the tolerances of comparison.hpp for the three systems",
          .failure =
              "P is not the covariance of an optimal filter: the term that is subtracted is too small, or it is not "
              "quadratic as it should be.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::concavity
