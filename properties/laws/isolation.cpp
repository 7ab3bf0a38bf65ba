#include <kfstab/properties/comparison.hpp>

namespace kfstab::properties::laws::isolation {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  const System base = first_steps(with_data(system), 3);
  const System another = in_units(base, {.covariance = 2, .data = 3});
  bench.rerun(base);
  const Run expected = bench.rerun(base);
  bench.rerun(another);
  Comparison comparison;
  if (auto after = compare_again(bench, base, system, bench.rerun(base), expected, "after another problem"))
    comparison.add(*std::move(after));
  if (bench.at_once() > 1)
    if (auto beside =
            compare_again(bench, base, system, bench.rerun(base, {another, base}), expected, "beside another problem"))
      comparison.add(*std::move(beside));
  return comparison.worst();
}

}  // namespace

Law law() {
  return {.id = "isolation",
          .statement =
              "A run after one of another problem, or beside it where many are run at once, gives the same answers as a "
              "run after itself, bit by bit",
          .assumptions = "none",
          .source = "a filter is a function of its problem",
          .tolerance = "0: every bit; of a filter whose code is not known 30 b, b the tolerance of comparison.hpp",
          .failure =
              "Something of the problem before is left: a static variable, a cached matrix, a gain or a factorisation "
              "that is only computed once. Beside another: lanes that are mixed up.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::isolation
