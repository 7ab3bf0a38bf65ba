#include <kfstab/properties/comparison.hpp>

#include <algorithm>

namespace kfstab::properties::laws::monotonicity {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (!small(system)) return std::nullopt;
  const System base = first_steps(with_data(system), 2), other = raised(base);
  const Run& small = bench.run(base);
  const Run& large = bench.run(other);
  const auto before = tolerances(bench, base, system), now = tolerances(bench, other);
  Comparison comparison;
  for (std::size_t k = 0; k < std::min({small.answers.size(), large.answers.size(), before.size(), now.size()}); ++k) {
    const Matrix<double> P = values(small.answers[k]).P, P_raised = values(large.answers[k]).P;
    if (P.size() == 0 || P_raised.size() == 0) break;
    const auto step = static_cast<std::int64_t>(k);
    comparison.add_order(step, "P' - 4 P", P_raised, 4 * P, 4 * before[k].P + now[k].P,
                         "P' with 4 P0, 16 Q, 64 R in the place of P0, Q, R");
    comparison.add_order(step, "64 P - P'", 64 * P, P_raised, 64 * before[k].P + now[k].P,
                         "P' with 4 P0, 16 Q, 64 R in the place of P0, Q, R");
  }
  return comparison.worst();
}

}  // namespace

Law law() {
  return {.id = "monotonicity",
          .statement = "P of the system with 4 P0, 16 Q and 64 R lies between 4 P and 64 P",
          .assumptions = "n, m, p <= 4; the first 2 steps; steps in which 30 b is small",
          .source = "theory 1: P grows with each of P0, Q and R, and is homogeneous in the three",
          .tolerance = "30 (4 b + b') and 30 (64 b + b'), b and b' the tolerances of comparison.hpp for both systems",
          .failure =
              "More noise makes the filter more certain, or less than in proportion: P0, Q or R goes in with a wrong "
              "sign, squared, as a root, or not at all.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::monotonicity
