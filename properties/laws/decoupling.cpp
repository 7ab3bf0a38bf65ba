#include <kfstab/properties/comparison.hpp>

#include <algorithm>
#include <cmath>

namespace kfstab::properties::laws::decoupling {

namespace {

/// X with a row and a column of zeros, and d in their corner.
Matrix<double> with_corner(const Matrix<double>& X, double d) {
  Matrix<double> Y = Matrix<double>::Zero(X.rows() + 1, X.cols() + 1);
  Y.topLeftCorner(X.rows(), X.cols()) = X;
  Y(X.rows(), X.cols()) = d;
  return Y;
}

Matrix<double> with_zeros(const Matrix<double>& X, Index rows) {
  Matrix<double> Y = Matrix<double>::Zero(rows, X.cols());
  Y.topRows(X.rows()) = X;
  return Y;
}

/// A power of 4 near the largest entry of the covariance.
double size_of(const Covariance& R) {
  const Matrix<double>& X = R.value.at(0);
  if (X.size() == 0) return 1;
  const double largest = X.cwiseAbs().maxCoeff();
  const int exponent = largest > 0 ? std::ilogb(largest) : 0;
  return std::ldexp(1.0, R.written == Covariance::Written::root ? 2 * exponent : exponent / 2 * 2);
}

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (!small(system)) return std::nullopt;
  const System base = first_steps(measured(system), 2);
  const Run& expected = bench.run(base);
  System other = base;
  const Dimensions size = system.dimensions();
  // As large as R is, so that Re is no worse conditioned than it has to be.
  const double r = size_of(base.R);
  other.A = mapped(base.A, [](const Matrix<double>& A) { return with_corner(A, 0.5); });
  other.B = mapped(base.B, [](const Matrix<double>& B) { return with_corner(B, 1); });
  other.C = mapped(base.C, [](const Matrix<double>& C) { return with_corner(C, 1); });
  other.D = mapped(base.D, [&](const Matrix<double>& D) { return with_zeros(D, size.n + 1); });
  other.Q = bordered(base.Q, 1, r);
  other.R = bordered(base.R, 1, r);
  other.P0 = bordered(base.P0, 1, r);
  other.x0 = with_zeros(base.x0, size.n + 1);
  Columns data = columns(base);
  data.y = with_zeros(data.y, size.p + 1);
  data.y.row(size.p).setOnes();
  set_columns(other, std::move(data));
  const Run& found = bench.run(other);
  const auto before = tolerances(bench, base, counted(system)), now = tolerances(bench, other);
  Comparison comparison;
  for (std::size_t k = 0; k < std::min({found.answers.size(), expected.answers.size(), before.size(), now.size()});
       ++k) {
    Values whole = values(found.answers[k]), part = values(expected.answers[k]);
    // The state of its own is compared with nothing.
    if (whole.P.size() > 0) {
      whole.P(size.n, size.n) = 0;
      part.P = with_corner(part.P, 0);
    }
    if (whole.K.size() > 0) {
      whole.K(size.n, size.p) = 0;
      part.K = with_corner(part.K, 0);
    }
    if (whole.x.size() > 0) whole.x.conservativeResize(size.n);
    comparison.add(static_cast<std::int64_t>(k), whole, part,
                   {before[k].P + now[k].P, before[k].K + now[k].K, before[k].x + now[k].x},
                   "beside a system that has nothing to do with it");
  }
  return comparison.worst();
}

}  // namespace

Law law() {
  return {.id = "decoupling",
          .statement =
              "A state with a noise and a measurement of its own, that has nothing to do with the others: P, K and x "
              "of the others as without it, and nothing of P and K between them",
          .assumptions = "n, m, p <= 4; the first 2 steps; steps in which 30 b is small",
          .source = "theory 1: block diagonal systems are filtered block by block",
          .tolerance = "30 (b + b'), b and b' the tolerances of comparison.hpp for both systems",
          .failure =
              "Blocks leak into each other: a sum over too many entries, a norm or a trace in a place where a matrix "
              "belongs, a wrong stride.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::decoupling
