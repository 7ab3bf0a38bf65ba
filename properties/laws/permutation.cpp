#include <kfstab/properties/comparison.hpp>

namespace kfstab::properties::laws::permutation {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  const Dimensions size = system.dimensions();
  if (size.n < 2 && size.m < 2 && size.p < 2) return std::nullopt;
  return compare_bases(bench, measured(system), counted(system),
                       {.T = cycle(size.n), .M = cycle(size.p), .V = cycle(size.m)}, "in another order");
}

}  // namespace

Law law() {
  return {
      .id = "permutation",
      .statement = "States, noises and measurements in another order: P, K and x in that order, and the same numbers",
      .assumptions = "missing entries of y count as 0; steps in which 30 b is small",
      .source = "theory 1",
      .tolerance =
          "30 (b + b), b the tolerance of comparison.hpp: the first-order bound of the form, and what rounding the "
          "turned numbers once does",
      .failure =
          "Indices are mixed up: a state, an input or a measurement has a place of its own in the code, or a triangle "
          "is read that holds something else.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::permutation
