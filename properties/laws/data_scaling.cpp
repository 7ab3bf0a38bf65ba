#include <kfstab/properties/comparison.hpp>

namespace kfstab::properties::laws::data_scaling {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  return compare_units(bench, with_data(system), system, {.data = 10}, true);
}

}  // namespace

Law law() {
  return {.id = "data-scaling",
          .statement = "x0, y and u times -2^10: x times -2^10, P and K as they were, bit by bit",
          .assumptions = "none",
          .source = "theory 1: x is linear in x0, y and u; multiplication by a power of 2 rounds nothing",
          .tolerance =
              "0: every bit; of a filter whose code is not known, and may sum in another order: 30 (b + b'), b the "
              "tolerance of comparison.hpp",
          .failure =
              "The state is no linear function of the data: an innovation is clipped or gated, a sign is lost (abs, a "
              "square), or a constant is added.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::data_scaling
