#include <kfstab/properties/comparison.hpp>

namespace kfstab::properties::laws::measurement_units {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  std::vector<int> e(static_cast<std::size_t>(system.C.rows()));
  if (e.empty()) return std::nullopt;
  for (std::size_t i = 0; i < e.size(); ++i) e[i] = static_cast<int>((5 * i + 9) % 11) - 5;
  const Traits& traits = bench.traits();
  const bool bits =
      traits.asymmetry == Asymmetry::none && traits.holds != Held::covariance_root && !traits.needs.time_invariant;
  return compare_units(bench, bits ? with_data(system) : first_steps(with_data(system), 3), system, {.measurement = e},
                       bits);
}

}  // namespace

Law law() {
  return {.id = "measurement-units",
          .statement =
              "Measurement i in a unit that is 2^e_i times smaller (C as E C, R as E R E, y as E y, E = diag(2^e)): P "
              "and x as they were, K as K E^-1; bit by bit",
          .assumptions =
              "bits of filters of the registry that factor Re or R without pivots; others within the tolerances of "
              "both systems",
          .source = "theory 1; multiplication by a power of 2 rounds nothing",
          .tolerance = "0: every bit; else 30 (b + b'), b and b' the tolerances of comparison.hpp for both systems",
          .failure =
              "Something treats the measurements as if they were of one size: R taken for a multiple of I, a jitter on "
              "Re, a gate on |y - C x|, a pseudo-inverse with an absolute threshold.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::measurement_units
