#include <kfstab/properties/comparison.hpp>

#include <algorithm>

namespace kfstab::properties::laws::duplicate_measurement {

namespace {

Matrix<double> twice(const Matrix<double>& X) {
  Matrix<double> Y(2 * X.rows(), X.cols());
  Y.topRows(X.rows()) = Y.bottomRows(X.rows()) = X;
  return Y;
}

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (!small(system)) return std::nullopt;
  const Index p = system.C.rows();
  if (p == 0) return std::nullopt;
  const System base = first_steps(measured(system), 3);
  System other = base;
  other.C = mapped(base.C, twice);
  const Covariance R = multiplied(base.R, 2);
  other.R = {R.written, mapped(R.value, [p](const Matrix<double>& X) {
               Matrix<double> Y = Matrix<double>::Zero(2 * p, 2 * p);
               Y.topLeftCorner(p, p) = Y.bottomRightCorner(p, p) = X;
               return Y;
             })};
  Columns data = columns(base);
  data.y = twice(data.y);
  set_columns(other, std::move(data));
  const Run& expected = bench.run(base);
  const Run& found = bench.run(other);
  const auto before = tolerances(bench, base, counted(system)), now = tolerances(bench, other);
  Comparison comparison;
  for (std::size_t k = 0; k < std::min({found.answers.size(), expected.answers.size(), before.size(), now.size()});
       ++k) {
    Values once = values(expected.answers[k]);
    if (once.K.size() > 0) once.K = twice(once.K.transpose() / 2).transpose().eval();
    comparison.add(static_cast<std::int64_t>(k), values(found.answers[k]), once,
                   {before[k].P + now[k].P, before[k].K + now[k].K, before[k].x + now[k].x},
                   "from every measurement twice");
  }
  return comparison.worst();
}

}  // namespace

Law law() {
  return {.id = "duplicate-measurement",
          .statement =
              "Every measurement twice, each of the two with 2 R and noise of its own: P and x as from one with R, K "
              "half of that, twice",
          .assumptions = "n, m, p <= 4, p >= 1; the first 3 steps; steps in which 30 b is small",
          .source = "theory 1: C'R^{-1}C and C'R^{-1}y are what the measurement tells",
          .tolerance = "30 (b + b'), b and b' the tolerances of comparison.hpp for both systems",
          .failure =
              "With more measurements than states, or with rows that say the same, the update is not that of theory 1: "
              "a pseudo-inverse that cuts off, a rank that is assumed, C taken for square.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::duplicate_measurement
