#include <kfstab/properties/comparison.hpp>

namespace kfstab::properties::laws::homogeneity {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  const bool single = bench.traits().roundoff > unit_roundoff<double>();
  // Rotations go on until they are small enough.
  const bool bits = bench.traits().holds != Held::covariance_root;
  return compare_units(bench, with_data(system), system, {.covariance = single ? -6 : -20}, bits);
}

}  // namespace

Law law() {
  return {
      .id = "homogeneity",
      .statement = "P0, Q and R times 4^-20: P times 4^-20, x and K as they were, bit by bit; a root of P times 2^-20",
      .assumptions =
          "none (4^-6 for a filter that computes in single precision, whose range is small); bits of filters that do "
          "not iterate (svd)",
      .source =
          "theory 1: the Riccati recursion is homogeneous; multiplication by a power of 2 rounds nothing, nor does a "
          "root of a power of 4",
      .tolerance =
          "0: every bit; of a filter whose code is not known, and may sum in another order: 30 (b + b'), b the "
          "tolerance of comparison.hpp",
      .failure =
          "Something in the filter has an absolute size that a covariance is compared with or that is added to it: a "
          "jitter, a floor, a threshold such as 1e-12, an eps without its scale.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::homogeneity
