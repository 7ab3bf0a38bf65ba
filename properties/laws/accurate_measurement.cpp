#include <kfstab/properties/comparison.hpp>

#include <cmath>

namespace kfstab::properties::laws::accurate_measurement {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (system.C.rows() == 0 || system.A.rows() == 0) return std::nullopt;
  const bool single = bench.traits().roundoff > unit_roundoff<double>();
  System other = first_steps(measured(system), 1);
  other.R = multiplied(other.R, std::ldexp(1.0, single ? -4 : -16));
  other.A = Sequence(Matrix<double>(Matrix<double>::Identity(system.A.rows(), system.A.rows())));
  other.B = Sequence(Matrix<double>(Matrix<double>::Zero(system.B.rows(), system.B.cols())));
  Comparison comparison;
  for (const ObservedStep& s : observed_steps(bench, other)) {
    const double c = s.C.norm();
    const double tolerance = s.rounding() * (c * c * s.amplification() + s.R.norm());
    const Precise left = s.C * s.P * s.C.transposed();
    if (tolerance < s.R.norm())
      comparison.add_order(s.k, "R - C P+ C'", s.R.rounded(), left.rounded(), tolerance, "with 4^-8 R, A = I, B = 0");
  }
  return comparison.worst();
}

}  // namespace

Law law() {
  return {
      .id = "accurate-measurement",
      .statement = "C P_{k|k} C' <= R, tried with 4^-8 R and a step that lets no time go by (A = I, B = 0)",
      .assumptions = "one step; 4^-2 R for a filter that computes in single precision",
      .source = "theory 1: C P_{k|k} C' = R - R Re^{-1} R",
      .tolerance =
          "30 u (n+m+p) (|C|^2 times how large the rounding error of P may be for a form of the kind, theory 4, + |R|)",
      .failure =
          "An accurate measurement is not believed: R is limited from below, an eps is added to Re, or R goes in as "
          "its root.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::accurate_measurement
