#include <kfstab/properties/comparison.hpp>

namespace kfstab::properties::laws::purity {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  const System base = first_steps(with_data(system), 3);
  const Run first = bench.rerun(base), second = bench.rerun(base);
  return compare_again(bench, base, system, second, first, "in a second run");
}

}  // namespace

Law law() {
  return {.id = "purity",
          .statement = "The same run twice in a row gives the same answers, bit by bit",
          .assumptions = "none",
          .source = "a filter is a function of its problem",
          .tolerance = "0: every bit; of a filter whose code is not known 30 b, b the tolerance of comparison.hpp",
          .failure =
              "The filter remembers: something is not set anew when a problem starts, or is read before it is written. "
              "Or chance or time goes in.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::purity
