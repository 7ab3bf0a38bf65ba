#include <kfstab/properties/law.hpp>

#include <cmath>

#include <kfstab/properties/data.hpp>

namespace kfstab::properties::laws::batch {

namespace {

/// Rows first to first + count of the identity.
Precise rows_of_identity(Index first, Index count, Index size) {
  return Precise(Matrix<double>(Matrix<double>::Identity(size, size).middleRows(first, count)));
}

/// E [X; Y] for an x, Y below X.
Precise below(const Precise& X, const Precise& Y) {
  const Index rows = X.rows() + Y.rows();
  return rows_of_identity(0, X.rows(), rows).transposed() * X +
         rows_of_identity(X.rows(), Y.rows(), rows).transposed() * Y;
}

std::optional<Finding> examine(Bench& bench, const System& system) {
  constexpr Index most_states = 3, most_measurements = 8;
  const Traits& subject = bench.traits();
  const Dimensions size = system.dimensions();
  if (size.n == 0 || size.n > most_states || size.p * system.steps > most_measurements) return std::nullopt;
  const Run& run = bench.run(system);
  if (run.ending.kind != Ending::Kind::done || run.answers.empty()) return std::nullopt;
  const auto answered = covariance(run.answers.back());
  if (!answered) return std::nullopt;
  const auto last = static_cast<std::int64_t>(run.answers.size()) - 1;
  const Course& course = bench.course(system);
  const auto allowed = asymmetric_errors(bench, system);
  if (last >= static_cast<std::int64_t>(allowed.size())) return std::nullopt;

  const System complete = with_every_measurement(subject.starts_predicted ? system : delayed(system));
  const auto exact = exact_system(complete, subject.takes);
  if (!exact) return std::nullopt;
  // All is a linear function of what is random: x_0, and w and v of every step, of covariance W.
  const Index steps = complete.steps, random = size.n + steps * (size.m + size.p);
  const auto part = [&](Index first, Index count) { return rows_of_identity(first, count, random); };
  const Precise of_x0 = part(0, size.n);
  Precise W = of_x0.transposed() * exact->P0 * of_x0, state = of_x0;
  Precise measured(Matrix<double>(0, random)), innovations(Matrix<double>(0, 1)), mean = exact->x0;
  const auto data = complete.data ? complete.data->open() : nullptr;
  for (Index k = 0; k < steps; ++k) {
    const ExactModel& model = exact->at(k);
    const Precise w = part(size.n + k * (size.m + size.p), size.m),
                  v = part(size.n + k * (size.m + size.p) + size.m, size.p);
    W = W + w.transposed() * model.Q * w + v.transposed() * model.R * v;
    measured = below(measured, model.C * state + v);
    const StepData* given = data ? &data->next() : nullptr;
    if (given) innovations = below(innovations, Precise(Matrix<double>(given->y)) - model.C * mean);
    if (k + 1 == steps && subject.instant == Instant::filtered) break;
    state = model.A * state + model.B * w;
    mean = model.A * mean;
    if (given && given->u.size() > 0) mean = mean + model.D * Precise(Matrix<double>(given->u));
  }
  const Precise all = measured * W * measured.transposed(), with_state = state * W * measured.transposed();
  const auto inverse = all.inverse();
  if (!inverse) return std::nullopt;
  const Precise gain = with_state * *inverse, P = state * W * state.transposed() - gain * with_state.transposed();

  Finding finding;
  bool judged = false;
  const auto see = [&](const char* name, const Precise& found, const Precise& expected, double bound, double excused) {
    // Beyond a half of what is compared the bound, of first order, says nothing.
    if (std::isnan(bound) || expected.norm() < underflow(subject) ||
        !(largest_ratio * bound + excused <= expected.norm() / 2))
      return;
    judged = true;
    const double error = (found - expected).norm(), ratio = error <= excused ? 0 : (error - excused) / bound;
    if (ratio <= finding.ratio) return;
    finding = {ratio, last, {}};
    if (!(ratio <= largest_ratio)) finding.what = "after all steps: " + largest_difference(name, found, expected);
  };
  const double asymmetric = allowed.back();
  see("P", *answered, P, course.P_bound(last), asymmetric);
  if (data && run.answers.back().state && asymmetric <= 0x1p-30 * P.norm()) {
    const Precise x = mean + gain * innovations;
    const double excused = P.norm() > 0 ? asymmetric / P.norm() * (1 + course.truth(last).innovation_condition) : 0;
    see("x", Precise(Matrix<double>(*run.answers.back().state)), x, course.x_bound(last), excused * x.norm());
  }
  return judged ? std::optional(finding) : std::nullopt;
}

}  // namespace

Law law() {
  return {
      .id = "batch",
      .statement =
          "P and x after the last step are covariance and mean of the last state given all measurements at once, "
          "conditioned in one formula without any recursion",
      .assumptions =
          "n <= 3, at most 8 measurements in all; as far as the first-order bound is below a half of what is compared",
      .source = "theory 1: the filter computes a conditional distribution; the formula of normal distributions",
      .tolerance = "as of trajectory",
      .failure =
          "What the filter makes of the measurements is not what they say together: something is counted twice or "
          "forgotten between steps, or a step takes the model of another step.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::batch
