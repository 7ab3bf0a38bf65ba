#include <kfstab/properties/comparison.hpp>

#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace kfstab::properties::laws::singular_innovation {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  const Traits& traits = bench.traits();
  const Dimensions size = system.dimensions();
  if (traits.needs.positive_definite_R || size.p == 0 || size.n == 0) return std::nullopt;
  System other = first_steps(measured(system), 1);
  other.A = Sequence(Matrix<double>(Matrix<double>::Identity(size.n, size.n)));
  other.B = Sequence(Matrix<double>(Matrix<double>::Zero(size.n, size.m)));
  Matrix<double> C(2, size.n);
  C.row(0) = C.row(1) = system.C.at(0).row(0);
  other.C = Sequence(C);
  other.R = {Covariance::Written::covariance, Sequence(Matrix<double>(Matrix<double>::Zero(2, 2)))};
  set_columns(other, {Matrix<double>::Zero(2, 1), columns(other).u});
  const auto converted = problem(other, Parametrisation::covariance);
  if (!std::holds_alternative<AnyProblem<double>>(converted)) return std::nullopt;
  const Matrix<double> P = std::get<Problem<CovarianceModel<double>>>(std::get<AnyProblem<double>>(converted)).initial;
  const double seen = C.row(0).lazyProduct(P).lazyProduct(C.row(0).transpose())(0, 0);
  if (!(seen >= std::ldexp(C.row(0).squaredNorm() * P.norm(), -10)) || seen == 0) return std::nullopt;
  const Run& run = bench.run(other);
  if (run.answers.empty()) return Finding{0, 0, {}};
  const Matrix<double> answered = values(run.answers.front()).P;
  if (answered.size() == 0) return std::nullopt;
  const double u = traits.roundoff * static_cast<double>(size.n + size.m + 2);
  if ((answered - P).norm() > largest_ratio * u * P.norm()) return Finding{0, 0, {}};
  return Finding{std::numeric_limits<double>::infinity(), 0,
                 fmt::format("Re = C P C' is singular, c P c' = {:.6g}, and the answer is P as it was: P[0,0] = {:.6g}",
                             seen, answered(0, 0))};
}

}  // namespace

Law law() {
  return {.id = "singular-innovation",
          .statement =
              "With R = 0 and a measurement that is there twice, Re is singular: the filter says so, or answers a P in "
              "which what was measured is known; never the P of no measurement",
          .assumptions =
              "systems whose C sees some of P0; filters that do not ask for a positive definite R; a step that lets no "
              "time go by (A = I, B = 0)",
          .source = "theory 2; a failed Cholesky factorisation is an answer",
          .tolerance =
              "a P is the one of no measurement if |P+ - P| <= 30 u (n+m+p) |P| although c P c' >= 2^-10 |c|^2 |P|",
          .failure = "Where Re cannot be factored the update is skipped in silence.",
          .hostile = true,
      .examine = examine};
}

}  // namespace kfstab::properties::laws::singular_innovation
