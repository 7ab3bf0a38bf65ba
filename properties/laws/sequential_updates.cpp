#include <kfstab/properties/comparison.hpp>

#include <algorithm>
#include <limits>

namespace kfstab::properties::laws {

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
  System other = base;
  const Index p = size.p;
  other.steps = base.steps * p;
  Columns data = columns(base),
          one_by_one{Matrix<double>(p, other.steps), Matrix<double>::Zero(system.inputs(), other.steps)};
  one_by_one.y.setConstant(std::numeric_limits<double>::quiet_NaN());
  // Time goes by after the last measurement of a step; before the first for a filter that predicts first.
  const Index moving = traits.starts_predicted ? p - 1 : 0;
  std::vector<Matrix<double>> A, B, C, D, Q, R;
  for (std::int64_t k = 0; k < base.steps; ++k)
    for (Index i = 0; i < p; ++i) {
      const bool moves = i == moving;
      A.push_back(moves ? base.A.at(k) : Matrix<double>(Matrix<double>::Identity(size.n, size.n)));
      B.push_back(moves ? base.B.at(k) : Matrix<double>(Matrix<double>::Zero(size.n, size.m)));
      C.push_back(base.C.at(k));
      D.push_back(base.D.at(k));
      Q.push_back(base.Q.value.at(k));
      R.push_back(base.R.value.at(k));
      one_by_one.y(i, k * p + i) = data.y(i, k);
      if (moves) one_by_one.u.col(k * p + i) = data.u.col(k);
    }
  const auto list = [](std::vector<Matrix<double>> all) { return Sequence(Sequence::Kind::list, std::move(all)); };
  other.A = list(std::move(A));
  other.B = list(std::move(B));
  other.C = list(std::move(C));
  other.D = list(std::move(D));
  other.Q.value = list(std::move(Q));
  other.R.value = list(std::move(R));
  set_columns(other, std::move(one_by_one));
  const Run& expected = bench.run(base);
  const Run& found = bench.run(other);
  const auto before = tolerances(bench, base, counted(system)), now = tolerances(bench, other);
  Comparison comparison;
  for (std::size_t k = 0; k < expected.answers.size(); ++k) {
    const std::size_t last = (k + 1) * static_cast<std::size_t>(p) - 1;
    if (last >= std::min(found.answers.size(), now.size()) || k >= before.size()) break;
    Values one = values(found.answers[last]);
    one.K.resize(0, 0);
    comparison.add(static_cast<std::int64_t>(k), one, values(expected.answers[k]),
                   {before[k].P + now[last].P, 0, before[k].x + now[last].x}, "measurement by measurement");
  }
  return comparison.worst();
}

}  // namespace

Law sequential_updates() {
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

}  // namespace kfstab::properties::laws
