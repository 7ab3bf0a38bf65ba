#include <kfstab/properties/comparison.hpp>

#include <limits>

namespace kfstab::properties::laws::missing_measurement {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  const Traits& traits = bench.traits();
  if (traits.measurement_every_step || traits.needs.time_invariant || system.C.rows() == 0) return std::nullopt;
  System other = first_steps(with_data(system), 4);
  Columns data = columns(other);
  data.y.setConstant(std::numeric_limits<double>::quiet_NaN());
  set_columns(other, std::move(data));
  const Run& run = bench.run(other);
  const auto converted = problem(other, Parametrisation::covariance);
  if (!std::holds_alternative<AnyProblem<double>>(converted)) return std::nullopt;
  const auto& numbers = std::get<Problem<CovarianceModel<double>>>(std::get<AnyProblem<double>>(converted));
  const bool inverts = traits.holds == Held::information || traits.holds == Held::information_factor;
  const auto first_order = inverts ? tolerances(bench, other) : std::vector<Tolerance>();
  const Dimensions size = system.dimensions();
  const double u = traits.roundoff * static_cast<double>(size.n + size.m + size.p);
  const Columns given = columns(other);
  const bool late = traits.starts_predicted && traits.instant == Instant::filtered;
  Precise P(numbers.initial), x = Precise(Matrix<double>(numbers.x0));
  double P_error = u * numbers.initial.norm(), x_error = u * numbers.x0.norm();
  Comparison comparison;
  for (std::size_t k = 0; k < run.answers.size(); ++k) {
    // A filter that starts predicted and answers P_{k|k} has no time update in its first step.
    if (!late || k > 0) {
      const auto step = static_cast<std::int64_t>(late ? k - 1 : k);
      const CovarianceModel<double>& model = numbers.model(step);
      const double a = model.A.norm(), b = model.B.norm();
      P_error = a * a * P_error + u * (a * a * P.norm() + b * b * model.Q.norm());
      x_error = a * x_error + u * a * x.norm();
      const Precise A(model.A), B(model.B);
      P = A * P * A.transposed() + B * Precise(model.Q) * B.transposed();
      x = A * x;
      if (given.u.rows() > 0) {
        x = x + Precise(model.D) * Precise(Matrix<double>(given.u.col(step)));
        x_error += u * model.D.norm() * given.u.col(step).norm();
      }
    }
    Tolerance tolerance{P_error + u * P.norm(), 0, x_error + u * x.norm()};
    if (inverts) {
      if (k >= first_order.size()) break;
      tolerance.P += first_order[k].P;
      tolerance.x += first_order[k].x;
    }
    Values found = values(run.answers[k]);
    found.K.resize(0, 0);
    comparison.add(static_cast<std::int64_t>(k), found, {P.rounded(), {}, Vector<double>(x.rounded())}, tolerance,
                   "with nothing measured");
  }
  return comparison.worst();
}

}  // namespace

Law law() {
  return {.id = "missing-measurement",
          .statement =
              "With every measurement missing, P and x are those of time updates alone: P+ = A P A' + B Q B', x+ = A x "
              "+ D u, from P0 and x0 on",
          .assumptions = "filters that take missing measurements; steps in which 30 times the tolerance is small",
          .source = "theory 1",
          .tolerance =
              "30 u (n+m+p) (sum of the steps' |A|^2 |P| + |B|^2 |Q|, carried on by |A|^2); x likewise; for a filter "
              "that holds P^{-1} 30 b, b the tolerance of comparison.hpp",
          .failure =
              "A missing measurement is taken for one: y = 0 or NaN is used, or the covariance is updated although "
              "nothing was measured.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::missing_measurement
