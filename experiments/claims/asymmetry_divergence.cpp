#include <algorithm>
#include <cmath>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/run.hpp>
#include <kfstab/experiments/selection.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/reference/bounds.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::experiments::claims::asymmetry_divergence {
namespace {

properties::System unstable_system(std::int64_t steps) {
  Matrix<double> A(3, 3), B(3, 1), C(1, 3);
  A << 1.02, .25, 0, -.25, 1.02, .125, 0, 0, .9;
  B << .25, 0, .5;
  C << 1, 0, 1;
  return system_of("unstable-pair", A, B, C, Matrix<double>::Identity(1, 1), Matrix<double>::Identity(3, 3), steps);
}

/// Up to where the figure shows an error: beyond, there is nothing left to see but (ii) going on.
constexpr double shown = 1e6;

/// The factor by which a curve grows per step, between the steps `from` and `to`.
double growth_between(const Series& series, double from, double to) {
  std::vector<double> steps, logs;
  const auto points = series.points();
  for (std::size_t i = 0; i < points.step.size(); ++i)
    if (points.step[i] >= from && points.step[i] <= to) {
      steps.push_back(points.step[i]);
      logs.push_back(std::log(points.value[i]));
    }
  return std::exp(fit_line(steps, logs).slope);
}

/// The largest error of P; infinite for a filter that broke down, or whose P was not finite at some step.
double worst_error(const FilterRun& filter) {
  const auto points = filter.covariance_error.points();
  const bool whole = !filter.first_failure &&
                     std::ranges::none_of(points.value, [](double error) { return std::isnan(error); });
  return whole ? filter.covariance_error.largest() : infinity;
}

Findings measure(const Settings& set) {
  const auto system = unstable_system(static_cast<std::int64_t>(set("steps")));
  const auto problem = problem_of(system, Parametrisation::covariance);
  const auto& A = system.A.matrices.front();
  const auto steady = reference::steady_state(problem);
  const Matrix<double> KC = steady.predictor_gain * system.C.matrices.front();
  const double rate = reference::asymmetry_growth(Asymmetry::gain, false, A, KC, steady.closed_loop);

  Findings findings;
  reports::Figure figure;
  figure.id = "asymmetry-divergence-error";
  figure.title = "Rounding alone makes four codings of one formula diverge";
  figure.caption =
      "How far is the computed P from the true one? Nothing was perturbed: the first rounding that breaks symmetry grows "
      "by |l1 l2|, the product of the two largest eigenvalue moduli of A (dashed), in the codings (iii), (iv), (v), faster "
      "in (ii), whose curve is cut at 1e6, and not at all in the others.";
  figure.x = {"step k", false};
  figure.y = {"relative error of P, ||P^ - P|| / ||P||", true};

  const SystemRun result = run(system, select_filters("^(ckf.*|joseph|srcf)$"), {});
  for (const FilterRun& f : result.filters) {
    const std::string id(f.metadata->id);
    const auto points = f.covariance_error.points();
    reports::Curve curve{id, id, {}, {}, reports::CurveRole::measured_line, color_of(id)};
    for (std::size_t i = 0; i < points.step.size() && points.value[i] <= shown; ++i) {
      curve.x.push_back(points.step[i]);
      curve.y.push_back(points.value[i]);
    }
    figure.curves.push_back(std::move(curve));
    const Asymmetry coding = f.metadata->asymmetry;
    const double predicted = reference::asymmetry_growth(coding, false, A, KC, steady.closed_loop);
    if (coding == Asymmetry::gain || coding == Asymmetry::cp || coding == Asymmetry::downdate) {
      findings.checks.push_back(check_close(fmt::format("{}: growth of the error per step, k = 100..300", id), predicted,
                                            growth_between(f.covariance_error, 100, 300), .02));
    } else if (coding == Asymmetry::mixed) {
      // It has no digit left long before step 100: fitted while the error is small enough to be linear.
      const auto growth = fit_growth(points.value, 1e-14, 1e-4);
      findings.checks.push_back(
          check_growth(fmt::format("{}: growth of the error per step while it is below 1e-4", id), predicted, growth, .02));
      // Once P is nothing but asymmetry R vanishes beside C P C', so F P C' does, and F D F' with it: 2 A D A' is left.
      findings.checks.push_back(check_close(fmt::format("{}: growth of the error per step, k = 100..300", id), 2 * rate,
                                            growth_between(f.covariance_error, 100, 300), .02));
    } else {
      findings.checks.push_back(check_at_most(fmt::format("{}: worst relative error of P", id), 1e-14,
                                              worst_error(f),
                                              "rounding level, as nothing in this problem amplifies a symmetric error"));
    }
  }

  // The prediction as a line: through nothing that was measured, but for its height at k = 100.
  double height = 0;
  for (const FilterRun& f : result.filters)
    if (f.metadata->id == "ckf-gain") {
      const auto points = f.covariance_error.points();
      if (points.value.size() > 100) height = points.value[100];
    }
  reports::Curve theory{"theory", fmt::format("theory: {:.4f}^k", rate), {}, {}, reports::CurveRole::theory, -1};
  for (double k = 0; k <= static_cast<double>(result.steps_done); k += 10) {
    theory.x.push_back(k);
    theory.y.push_back(height * std::pow(rate, k - 100));
  }
  figure.curves.push_back(std::move(theory));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {.id = "asymmetry-divergence",
          .number = 4,
          .title = "An unsymmetrised filter diverges from rounding alone",
          .statement = "On an unstable system whose Kalman filter is stable, rounding makes codings (ii), (iii), (iv) and "
                       "(v) of the conventional filter lose every digit, while coding (i), the symmetric form, Joseph's "
                       "form and the square-root filter keep all of theirs.",
          .source = "derived here, after Verhaegen and Van Dooren (1986), theory (3.i)-(3.v)",
          .setup = "A = [1.02 .25 0; -.25 1.02 .125; 0 0 .9], B = [.25; 0; .5], C = [1 0 1], Q = R = 1, P0 = I, no "
                   "perturbation; relative error of P against the reference.",
          .prediction = "With one output the asymmetry D = P - P' goes by D+ = A D A' in (iii), (iv), (v): growth per step "
                        "|l1 l2| = 1.1029; in (ii) by D+ = 2 A D A' - F D F', and by 2 |l1 l2| when no digit is left.",
          .meaning = "Symmetrise P every step, compute one triangle of it, or hold a factor. A filter that passes a test "
                     "of a hundred steps may be gone after four hundred.",
          .parameters = {{"steps", 400, "number of steps", 310, 2000}},
          .measure = measure,
          .mathematics = "P+ = A P A' - K Re K' + B Q B'\n"
                         "D = P - P',  D+ = A D A' - G D G',  G = K C\n"
                         "D+ = A D A'  for p = 1:  |D| grows by |l1 l2| a step"};
}

}  // namespace kfstab::experiments::claims::asymmetry_divergence
