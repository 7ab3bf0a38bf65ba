#include <kfstab/properties/comparison.hpp>

#include <algorithm>

namespace kfstab::properties::laws::superposition {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  const System base = first_steps(measured(system), 3), whole = counted(system);
  System second = base, both = base;
  Columns data = columns(base), other{data.y.rowwise().reverse(), data.u.rowwise().reverse()};
  other.y = other.y.unaryExpr([](double y) { return 1 - y / 2; });
  other.u = other.u.unaryExpr([](double u) { return 2 - u; });
  second.x0 = base.x0.unaryExpr([](double x) { return 3 - x / 4; });
  both.x0 = base.x0 + second.x0;
  set_columns(both, {data.y + other.y, data.u + other.u});
  set_columns(second, std::move(other));
  const Run& run = bench.run(base);
  const Run& run_second = bench.run(second);
  const Run& run_both = bench.run(both);
  const auto b = tolerances(bench, base, whole), b_second = tolerances(bench, second, whole),
             b_both = tolerances(bench, both, whole);
  Comparison comparison;
  for (std::size_t k = 0; k < std::min({run.answers.size(), run_second.answers.size(), run_both.answers.size(),
                                        b.size(), b_second.size(), b_both.size()});
       ++k) {
    const auto &x = run.answers[k].state, &x_second = run_second.answers[k].state, &x_both = run_both.answers[k].state;
    if (!x || !x_second || !x_both) break;
    comparison.add(static_cast<std::int64_t>(k), "x", *x_both, *x + *x_second, b[k].x + b_second[k].x + b_both[k].x,
                   "from the sum of two sets of data");
  }
  return comparison.worst();
}

}  // namespace

Law law() {
  return {.id = "superposition",
          .statement = "x from the sum of two sets of data (x0, y, u) is the sum of the x from each",
          .assumptions =
              "filters that answer x; missing entries of y count as 0; the first 3 steps; steps in which 30 b is small",
          .source = "theory 1: x is linear in x0, y and u",
          .tolerance = "30 (b + b' + b''), the tolerances of comparison.hpp for the three sets of data",
          .failure =
              "The state is no linear function of the data: a constant is added, an innovation is limited, or the gain "
              "depends on what was measured.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::superposition
