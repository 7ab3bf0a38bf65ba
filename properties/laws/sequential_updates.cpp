#include <kfstab/properties/comparison.hpp>

#include <algorithm>
#include <limits>

namespace kfstab::properties::laws::sequential_updates {

namespace {

bool diagonal(const Covariance& R) {
  for (const Matrix<double>& X : R.value.matrices)
    for (Index j = 0; j < X.cols(); ++j)
      for (Index i = 0; i < X.rows(); ++i)
        if (i != j && X(i, j) != 0) return false;
  return true;
}

std::optional<Finding> examine(Bench& bench, const System& system) {
  const Dimensions size = system.dimensions();
  const Traits& traits = bench.traits();
  if (size.p < 2 || traits.measurement_every_step || traits.needs.time_invariant || !diagonal(system.R))
    return std::nullopt;
  const System base = first_steps(measured(system), 2);
  const Index p = size.p;
  const Columns data = columns(base);
  Columns one_by_one{Matrix<double>(p, base.steps * p), Matrix<double>::Zero(system.inputs(), base.steps * p)};
  one_by_one.y.setConstant(std::numeric_limits<double>::quiet_NaN());
  // Time goes by after the last measurement of a step; before the first for a filter that predicts first.
  const Index moving = traits.starts_predicted ? p - 1 : 0;
  Steps one;
  for (std::int64_t k = 0; k < base.steps; ++k)
    for (Index i = 0; i < p; ++i) {
      const bool moves = i == moving;
      one.A.push_back(moves ? base.A.at(k) : Matrix<double>(Matrix<double>::Identity(size.n, size.n)));
      one.B.push_back(moves ? base.B.at(k) : Matrix<double>(Matrix<double>::Zero(size.n, size.m)));
      one.C.push_back(base.C.at(k));
      one.D.push_back(base.D.at(k));
      one.Q.push_back(base.Q.value.at(k));
      one.R.push_back(base.R.value.at(k));
      one_by_one.y(i, k * p + i) = data.y(i, k);
      if (moves) one_by_one.u.col(k * p + i) = data.u.col(k);
    }
  const System other = with_steps(base, std::move(one), std::move(one_by_one));
  const Run& expected = bench.run(base);
  const Run& found = bench.run(other);
  const auto before = tolerances(bench, base, counted(system)), now = tolerances(bench, other);
  Comparison comparison;
  for (std::size_t k = 0; k < expected.answers.size(); ++k) {
    const std::size_t last = (k + 1) * static_cast<std::size_t>(p) - 1;
    if (last >= std::min(found.answers.size(), now.size()) || k >= before.size()) break;
    Values last_of = values(found.answers[last]);
    last_of.K.resize(0, 0);
    comparison.add(static_cast<std::int64_t>(k), last_of, values(expected.answers[k]),
                   {before[k].P + now[last].P, 0, before[k].x + now[last].x}, "measurement by measurement");
  }
  return comparison.worst();
}

}  // namespace

Law law() {
  return {
      .id = "sequential-updates",
      .statement =
          "Uncorrelated measurements one after the other, in p steps of which p - 1 let no time go by (A = I, B = 0) "
          "and each of which has one measurement, the others missing: P and x as from all of them at once",
      .assumptions =
          "R diagonal, p >= 2, filters that take missing measurements; the first 2 steps; steps in which 30 b is small",
      .source = "theory 2; Kaminski, Bryson, Schmidt 1971",
      .tolerance = "30 (b + b'), b and b' the tolerances of comparison.hpp for both systems",
      .failure =
          "With several measurements, or with some of them missing, the update is not the one of theory 1: C, R or y "
          "of the missing rows are used, or the rows left belong to different measurements.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::sequential_updates
