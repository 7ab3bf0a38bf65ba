#include <kfstab/properties/comparison.hpp>

#include <cmath>

namespace kfstab::properties::laws::noisy_measurement {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (system.C.rows() == 0 || system.A.rows() == 0) return std::nullopt;
  const bool single = bench.traits().roundoff > unit_roundoff<double>();
  System other = first_steps(measured(system), 1);
  other.R = multiplied(other.R, std::ldexp(1.0, single ? 8 : 40));
  Comparison comparison;
  for (const ObservedStep& s : observed_steps(bench, other)) {
    const auto R_inverse = s.R.inverse();
    if (!R_inverse) continue;
    const Precise CP = s.C * s.prior;
    const Precise open = s.after(s.prior), least = s.after(s.prior - CP.transposed() * *R_inverse * CP);
    const double tolerance = s.rounding() * (s.amplification() + open.norm());
    comparison.add_order(s.k, "P+ - (open loop - P C' R^-1 C P)", s.P.rounded(), least.rounded(), tolerance,
                         "with 4^20 R");
    comparison.add_order(s.k, "open loop - P+", open.rounded(), s.P.rounded(), tolerance, "with 4^20 R");
  }
  return comparison.worst();
}

}  // namespace

Law law() {
  return {.id = "noisy-measurement",
          .statement =
              "With 4^20 R in the place of R the first step hardly measures: open loop P - P C' R^{-1} C P <= P_{k|k} "
              "<= P (and so with A and B Q B' where P_{k+1|k} is answered)",
          .assumptions = "one step; 4^4 R for a filter that computes in single precision",
          .source = "theory 1: (R + C P C')^{-1} <= R^{-1}",
          .tolerance = "30 u (n+m+p) times how large the rounding error of P may be for a form of the kind: theory 4",
          .failure =
              "With a large R the filter does not go over to prediction alone: R is not used, or is limited from "
              "above; its inverse or root is taken for it.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::noisy_measurement
