#include <kfstab/properties/comparison.hpp>

namespace kfstab::properties::laws::state_units {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  std::vector<int> d(static_cast<std::size_t>(system.A.rows()));
  for (std::size_t i = 0; i < d.size(); ++i) d[i] = static_cast<int>((5 * i + 3) % 13) - 6;
  const Traits& traits = bench.traits();
  const bool bits = traits.holds != Held::covariance_root && !traits.needs.time_invariant;
  return compare_units(bench, bits ? with_data(system) : first_steps(with_data(system), 3), system, {.state = d}, bits);
}

}  // namespace

Law law() {
  return {
      .id = "state-units",
      .statement =
          "State i in a unit that is 2^d_i times smaller (A as E A E^-1, B as E B, C as C E^-1, P0 as E P0 E, E = "
          "diag(2^d)): P as E P E, K as E K, x as E x; bit by bit",
      .assumptions =
          "bits of filters of the registry that neither turn the state (condensed forms, svd) nor remember their "
          "model; others within the tolerances of both systems",
      .source = "theory 1; multiplication by a power of 2 rounds nothing",
      .tolerance = "0: every bit; else 30 (|E|^2 b + b'), b and b' the tolerances of comparison.hpp for both systems",
      .failure =
          "Something treats the states as if they were of one size: a jitter or a limit on the diagonal of P, a norm "
          "of x or P as a threshold, a matrix taken for a multiple of I.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::state_units
