#include <kfstab/properties/comparison.hpp>

#include <algorithm>
#include <limits>

namespace kfstab::properties::laws::split_prediction {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  const Traits& traits = bench.traits();
  if (traits.measurement_every_step || traits.needs.time_invariant) return std::nullopt;
  const System base = first_steps(measured(system), 4);
  const Index n = system.A.rows();
  Matrix<double> T = cycle(n);
  for (Index j = 0; j < n; j += 2) T.col(j) *= -1;
  const Columns data = columns(base);
  Columns split{Matrix<double>(system.C.rows(), 2 * base.steps), Matrix<double>::Zero(system.inputs(), 2 * base.steps)};
  split.y.setConstant(std::numeric_limits<double>::quiet_NaN());
  Steps halves;
  for (Index k = 0; k < base.steps; ++k) {
    halves.A.push_back(T.lazyProduct(base.A.at(k)));
    halves.A.push_back(T.transpose());
    halves.B.push_back(T.lazyProduct(base.B.at(k)));
    halves.B.push_back(Matrix<double>::Zero(n, system.B.cols()));
    halves.D.push_back(T.lazyProduct(base.D.at(k)));
    halves.D.push_back(base.D.at(k));
    for (const int half : {0, 1}) {
      halves.C.push_back(base.C.at(k));
      halves.Q.push_back(base.Q.value.at(k));
      halves.R.push_back(base.R.value.at(k));
      if (half == (traits.starts_predicted ? 0 : 1)) split.y.col(2 * k + half) = data.y.col(k);
    }
    split.u.col(2 * k) = data.u.col(k);
  }
  const System other = with_steps(base, std::move(halves), std::move(split));
  const Run& expected = bench.run(base);
  const Run& found = bench.run(other);
  const auto tolerance = tolerances(bench, base, counted(system));
  // P_{k|k} of a filter that starts predicted is there after the first half already.
  const bool late = traits.starts_predicted && traits.instant == Instant::filtered;
  Comparison comparison;
  for (std::size_t k = 0; k < std::min(expected.answers.size(), tolerance.size()); ++k) {
    const std::size_t half = late ? 2 * k : 2 * k + 1;
    if (half >= found.answers.size()) break;
    Values whole = values(expected.answers[k]);
    whole.K.resize(0, 0);
    comparison.add(static_cast<std::int64_t>(k), values(found.answers[half]), whole,
                   {2 * tolerance[k].P, 0, 2 * tolerance[k].x}, "in two steps instead of one");
  }
  return comparison.worst();
}

}  // namespace

Law law() {
  return {.id = "split-prediction",
          .statement =
              "A step in two: to T A x with T a permutation of the states and their signs, and then back by A = T', B "
              "= 0, without a measurement: P and x as from the step",
          .assumptions =
              "filters that take a missing measurement; missing entries of y count as 0; steps in which 30 b is small",
          .source = "theory 1; T x is x in another order, so that no condition number changes",
          .tolerance = "30 (b + b), b the tolerance of comparison.hpp",
          .failure =
              "A step without measurement is not just a time update: A or B of another step is used, the measurement "
              "before is used once more, or nothing is done at all.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::split_prediction
