#include <kfstab/properties/comparison.hpp>

namespace kfstab::properties::laws::noise_basis {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (system.B.cols() < 2) return std::nullopt;
  return compare_bases(bench, with_data(system), system, {.V = reflection(system.B.cols())},
                       "in another basis of the noise");
}

}  // namespace

Law law() {
  return {
      .id = "noise-basis",
      .statement = "The process noise in another orthonormal basis (B as B V', Q as V Q V'): P, K and x as they were",
      .assumptions = "m >= 2; steps in which 30 b is small",
      .source = "theory 1: only B Q B' matters",
      .tolerance =
          "30 (b + b), b the tolerance of comparison.hpp: the first-order bound of the form, and what rounding the "
          "turned numbers once does",
      .failure =
          "A correlated Q is not treated as one: only its diagonal is used, B Q B' is formed as B' Q B, or Q^{1/2} "
          "stands on the wrong side.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::noise_basis
