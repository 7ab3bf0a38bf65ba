#include <kfstab/properties/comparison.hpp>

#include <algorithm>

namespace kfstab::properties::laws::root_freedom {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (bench.traits().takes != Parametrisation::root) return std::nullopt;
  const System base = with_data(system);
  const auto numbers = problem(base, Parametrisation::root);
  if (!std::holds_alternative<AnyProblem<double>>(numbers)) return std::nullopt;
  const auto& roots = std::get<Problem<RootModel<double>>>(std::get<AnyProblem<double>>(numbers));
  System other = base;
  const auto flipped = [](Matrix<double> L, Index odd) {
    for (Index j = 0; j < L.cols(); ++j)
      if ((j + odd) % 2 == 1) L.col(j) *= -1;
    return L;
  };
  const auto set = [](Covariance& Q, auto root) {
    Q.written = Covariance::Written::root;
    Q.value.exact.clear();
    for (std::size_t k = 0; k < Q.value.matrices.size(); ++k) Q.value.matrices[k] = root(static_cast<std::int64_t>(k));
  };
  set(other.Q, [&](std::int64_t k) { return flipped(roots.model(k).Q_root, 1); });
  set(other.R, [&](std::int64_t k) { return flipped(roots.model(k).R_root, 0); });
  set(other.P0, [&](std::int64_t) { return flipped(roots.initial, 1); });
  const Run& expected = bench.run(base);
  const Run& found = bench.run(other);
  const auto tolerance = tolerances(bench, base, system);
  Comparison comparison;
  for (std::size_t k = 0; k < std::min({found.answers.size(), expected.answers.size(), tolerance.size()}); ++k) {
    const Tolerance& b = tolerance[k];
    comparison.add(static_cast<std::int64_t>(k), values(found.answers[k]), values(expected.answers[k]),
                   {2 * b.P, 2 * b.K, 2 * b.x}, "from roots of the other sign");
  }
  return comparison.worst();
}

}  // namespace

Law law() {
  return {
      .id = "root-freedom",
      .statement =
          "Roots S0 X, Q^{1/2} Y, R^{1/2} Z with X, Y, Z diagonal, of entries 1 and -1, in the place of S0, Q^{1/2}, "
          "R^{1/2}: P, K and x as they were",
      .assumptions = "filters that take roots; steps in which 30 b is small",
      .source =
          "theory 2: a root is known up to an orthogonal factor, of a lower triangular one the signs of its columns",
      .tolerance =
          "30 (b + b), b the tolerance of comparison.hpp: the first-order bound of the form, and what rounding the "
          "turned numbers once does",
      .failure =
          "A root is taken for something with a positive diagonal: a square root of a diagonal entry, a logarithm, a "
          "sign that is dropped.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::root_freedom
