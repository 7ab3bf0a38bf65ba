#include <kfstab/properties/comparison.hpp>

namespace kfstab::properties::laws::data_independence {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  System base = with_data(system), other = base;
  Columns data = columns(base);
  data.y = data.y.unaryExpr([](double y) { return 1 - 1024 * y; });
  data.u = data.u.unaryExpr([](double u) { return 1 - 1024 * u; });
  set_columns(other, std::move(data));
  other.x0 = other.x0.unaryExpr([](double x) { return 1 - 1024 * x; });
  Run found = bench.run(other), expected = bench.run(base);
  for (Run* run : {&found, &expected})
    for (Answer& answer : run->answers) answer.state.reset();
  return compare_again(bench, base, system, found, expected, "with other data");
}

}  // namespace

Law law() {
  return {.id = "data-independence",
          .statement =
              "P and K do not depend on x0, y and u: bit by bit the same with all of them multiplied by -2^10 and "
              "moved by 1",
          .assumptions = "entries of y that are missing stay missing",
          .source = "theory 1: the Riccati recursion knows no data",
          .tolerance = "0: every bit; of a filter whose code is not known 30 b, b the tolerance of comparison.hpp",
          .failure =
              "The covariance is changed by what was measured: an adaptive R or Q, a gate that skips updates, a reset, "
              "or x and P share memory.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::data_independence
