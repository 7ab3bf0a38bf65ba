#include <kfstab/properties/comparison.hpp>

#include <algorithm>

namespace kfstab::properties::laws::augmentation {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (!small(system)) return std::nullopt;
  const Index n = system.A.rows();
  if (n == 0) return std::nullopt;
  const System base = first_steps(with_data(system), 2);
  System other = base;
  const auto with_zeros = [](const Matrix<double>& X, Index rows, Index cols) {
    Matrix<double> Y = Matrix<double>::Zero(rows, cols);
    Y.topLeftCorner(X.rows(), X.cols()) = X;
    return Y;
  };
  other.A = mapped(base.A, [&](const Matrix<double>& A) {
    Matrix<double> more = with_zeros(A, n + 1, n + 1);
    more(n, 0) = 1;
    more(n, n) = 0.5;
    return more;
  });
  other.B = mapped(base.B, [&](const Matrix<double>& B) { return with_zeros(B, n + 1, B.cols()); });
  other.C = mapped(base.C, [&](const Matrix<double>& C) { return with_zeros(C, C.rows(), n + 1); });
  other.D = mapped(base.D, [&](const Matrix<double>& D) { return with_zeros(D, n + 1, D.cols()); });
  other.P0 = bordered(base.P0, 1, 1);
  other.x0 = with_zeros(base.x0, n + 1, 1);
  const Run& expected = bench.run(base);
  const Run& found = bench.run(other);
  const auto before = tolerances(bench, base, system), now = tolerances(bench, other);
  Comparison comparison;
  for (std::size_t k = 0; k < std::min({found.answers.size(), expected.answers.size(), before.size(), now.size()});
       ++k) {
    Values part = values(found.answers[k]);
    if (part.P.size() > 0) part.P = Matrix<double>(part.P.topLeftCorner(n, n));
    if (part.K.size() > 0) part.K = Matrix<double>(part.K.topRows(n));
    if (part.x.size() > 0) part.x.conservativeResize(n);
    comparison.add(static_cast<std::int64_t>(k), part, values(expected.answers[k]),
                   {before[k].P + now[k].P, before[k].K + now[k].K, before[k].x + now[k].x},
                   "with one more state that only follows");
  }
  return comparison.worst();
}

}  // namespace

Law law() {
  return {.id = "augmentation",
          .statement =
              "One more state that only follows, x_{n+1}(k+1) = x_1(k) + x_{n+1}(k) / 2, and that nothing depends on: "
              "P, K and x of the others as without it",
          .assumptions = "n, m, p <= 4, n >= 1; the first 2 steps; steps in which 30 b is small",
          .source = "theory 1: the state without it is Markov, and measured as before",
          .tolerance = "30 (b + b'), b and b' the tolerances of comparison.hpp for both systems",
          .failure =
              "A state is changed by one that it does not depend on: A is used transposed, a column of P for a row, or "
              "K is not n x p but something square.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::augmentation
