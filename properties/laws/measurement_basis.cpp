#include <kfstab/properties/comparison.hpp>

namespace kfstab::properties::laws::measurement_basis {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (system.C.rows() < 2) return std::nullopt;
  return compare_bases(bench, measured(system), counted(system), {.M = reflection(system.C.rows())},
                       "turned back into the first basis");
}

}  // namespace

Law law() {
  return {.id = "measurement-basis",
          .statement =
              "The measurement in another orthonormal basis (y as M y, C as M C, R as M R M'): P and x as they were, K "
              "as K M'",
          .assumptions = "p >= 2; missing entries of y count as 0; steps in which 30 b is small",
          .source = "theory 1",
          .tolerance =
              "30 (b + b), b the tolerance of comparison.hpp: the first-order bound of the form, and what rounding the "
              "turned numbers once does",
          .failure =
              "A correlated R is not treated as one: only its diagonal is used, rows are processed one by one without "
              "whitening, or R^{1/2} stands on the wrong side.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::measurement_basis
