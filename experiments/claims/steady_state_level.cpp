#include <algorithm>
#include <cmath>
#include <map>
#include <span>
#include <string_view>
#include <variant>
#include <vector>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/perturbation.hpp>
#include <kfstab/filters/batch.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/precise.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::experiments::claims::steady_state_level {
namespace {

constexpr std::int64_t watched = 200;  // the last steps of a run
constexpr int csrf_at = 16;            // the Chandrasekhar filter is judged at q = 2^-16

/// Holds T of a rotated state: what the steady P^{-1} of an integrator owes to its grading, small entries with small
/// errors, is lost.
constexpr std::string_view condensed_information = "srif-hessenberg";

/// The double integrator, driven by noise of size q and started from P0 = I, until exp(-90) of the start is left.
struct Integrator {
  properties::System system;
  reference::SteadyState limit;
  double amplification;  ///< 1 / (1 - rho(F)^2)
};
Integrator integrator(double exponent) {
  const double q = round_to(Matrix<double>{{std::exp2(-exponent)}}, 40)(0, 0);
  const Matrix<double> A{{1., .5}, {0., 1.}}, B{{.125 * q}, {.5 * q}}, C{{1., 0.}}, one{{1.}};
  auto system = system_of("integrator", A, B, C, one, Matrix<double>::Identity(2, 2), 1);
  auto limit = reference::steady_state(problem_of(system, Parametrisation::covariance));
  const double rho = limit.spectral_radius;
  system.steps = static_cast<std::int64_t>(std::ceil(45 / (1 - rho)));
  return {std::move(system), std::move(limit), 1 / (1 - rho * rho)};
}

/// The worst error of P in the last steps, relative to the steady state.
double level(const Metadata& metadata, const Integrator& what) {
  Matrix<double> truth = what.limit.P;
  if (metadata.instant == Instant::filtered) {
    const properties::Precise C(what.system.C.matrices.front());
    truth = (properties::Precise(truth).inverse().value() + C.transposed() * C).inverse()->rounded();
  }
  const auto problem = problem_of(what.system, metadata.takes);
  const auto filter = make_filter<double>(metadata.id);
  filter->start(problem);
  double worst = 0;
  for (std::int64_t k = 0; k < what.system.steps; ++k) {
    const auto step = filter->step(k, nullptr, nullptr);
    if (!step.report) return infinity;
    if (k >= what.system.steps - watched)
      keep_worst(worst, (covariance_of(metadata, *step.held) - truth).norm() / truth.norm());
  }
  return worst;
}

/// The levels of srcf for some at once, of which the last has the most steps: all do as many. The plain text, where that is in
/// use, steps no batches: they are then left to the kernels that every machine has.
std::vector<double> levels(std::span<const Integrator> some) {
  const auto count = static_cast<Index>(some.size());
  const std::int64_t steps = some.back().system.steps;
  Batch<SquareRootCovarianceFilter<double>> batch(count, some.back().system.dimensions());
  if (!kernels::in_use()) batch.use(kernels::everywhere());
  for (Index i = 0; i < count; ++i) {
    const auto any = problem_of(some[static_cast<std::size_t>(i)].system, Parametrisation::root);
    const auto& problem = std::get<Problem<RootModel<double>>>(any);
    batch.start(i, problem.initial, problem.x0);
    batch.set_model(i, problem.models.front());
  }
  std::vector<double> worst(some.size(), 0.);
  for (std::int64_t k = 0; k < steps; ++k) {
    batch.step(false, Wanted::factor);
    for (Index i = 0; i < count; ++i) {
      const auto at = static_cast<std::size_t>(i);
      if (!batch.report(i)) worst[at] = infinity;
      if (k < steps - watched) continue;
      const Matrix<double>& truth = some[at].limit.P;
      keep_worst(worst[at], (covariance_of(*find_filter("srcf"), batch.held(i)) - truth).norm() / truth.norm());
    }
  }
  return worst;
}

/// Of the gain, after the last step.
double chandrasekhar_level(const Integrator& what) {
  const auto problem = problem_of(what.system, Parametrisation::root);
  const auto filter = make_filter<double>("csrf");
  filter->start(problem);
  for (std::int64_t k = 0; k < what.system.steps; ++k)
    if (!filter->step(k, nullptr, nullptr).report) return infinity;
  const Matrix<double> gain = *filter->step(what.system.steps, nullptr, nullptr).gain;
  return (gain - what.limit.predictor_gain).norm() / what.limit.predictor_gain.norm();
}

Findings measure(const Settings& set) {
  const int finest = static_cast<int>(set("finest"));
  std::map<std::string, reports::Curve> curves;
  auto bound = theory_line("theory-20", "20 u / (1 - rho^2)"), unit = theory_line("theory-1", "u / (1 - rho^2)");
  auto chandrasekhar = measured_points("csrf", "csrf, K", "csrf");
  double csrf_ratio = NaN;
  std::vector<double> conditions;  // of P, for each q
  for (int exponent = 8; exponent <= finest && going_on(); exponent += 2) {
    const auto what = integrator(exponent);
    conditions.push_back(properties::Precise(what.limit.P).condition());
    for (const Metadata* filter : forgetful_filters()) {
      const std::string id(filter->id);
      auto& curve = curves.try_emplace(id, measured_points(id, id, id)).first->second;
      add_point(curve, what.amplification, level(*filter, what));
    }
    add_point(bound, what.amplification, 20 * u * what.amplification);
    add_point(unit, what.amplification, u * what.amplification);
    if (exponent > csrf_at) continue;
    const double error = chandrasekhar_level(what);
    if (exponent == csrf_at) csrf_ratio = error / (20 * u * what.amplification);
    add_point(chandrasekhar, what.amplification, error);
  }

  Findings findings;
  for (const auto& [id, curve] : curves) {
    const bool condensed = id == condensed_information;
    double ratio = 0;
    for (std::size_t i = 0; i < curve.y.size(); ++i)
      keep_worst(ratio, curve.y[i] / (u * curve.x[i] * (condensed ? conditions[i] : 1)));
    findings.checks.push_back(check_at_most(
        fmt::format("{}: worst level over u / (1 - rho^2){}", id, condensed ? ", over k(P)" : ""), 20, ratio,
        condensed ? "theory (4.4) has k(P) where T is held; the rotated state does not spare it"
                  : "theory (4.4): what one step commits, added up; 20 is for its constant"));
  }
  // One run's last bits decide where between two powers of ten its level is: many runs, each at its own q.
  constexpr std::size_t at_once = 16;  // so few that they have about as many steps
  std::vector<double> amplifications, of_srcf;
  std::vector<Integrator> some;
  for (double exponent = 8; exponent <= finest && going_on(); exponent += .03125) {
    some.push_back(integrator(exponent));
    if (some.size() < at_once && exponent + .03125 <= finest) continue;
    for (const double of_one : levels(some)) of_srcf.push_back(of_one);
    for (const auto& one : some) amplifications.push_back(one.amplification);
    some.clear();
  }
  findings.checks.push_back(check_slope("srcf, in batches: slope of the level in 1/(1 - rho^2)", 1,
                                        fit_power(amplifications, of_srcf, 0, 1), .2));
  findings.checks.push_back(
      check_at_least(fmt::format("csrf at q = 2^-{}: error of K over 20 u / (1 - rho^2)", csrf_at), 1, csrf_ratio,
                     "it forgets no error, so that they do not settle at this level"));

  reports::Figure figure;
  figure.id = "steady-state-level";
  figure.title = "The slower a filter forgets, the higher the floor of its error";
  figure.caption =
      "Where does the error of P settle, if a filter forgets ever more slowly? Double integrator with process noise from "
      "q = 2^-8 (left) down (right); worst relative error of the last 200 steps of a run that is long enough to "
      "forget its start. Dashed: the level at which rounding of size u a step settles, and 20 times that. Above it "
      "are the Chandrasekhar filter, which forgets no error (drawn to 2^-16), and the condensed information filter, "
      "which mixes the large and the small entries of P^-1.";
  figure.x = {"1 / (1 - rho(F)^2)", true};
  figure.y = {"relative error of P (of K for csrf)", true};
  for (auto& [id, curve] : curves) figure.curves.push_back(std::move(curve));
  figure.curves.push_back(std::move(chandrasekhar));
  figure.curves.push_back(std::move(bound));
  figure.curves.push_back(std::move(unit));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {.id = "steady-state-level",
          .number = 5,
          .title = "The steady error is at most of size u / (1 - rho(F)^2)",
          .statement =
              "What rounding commits in each step and the closed loop forgets settles at a level of u / (1 - "
              "rho(F)^2) of P, in every form that holds P and keeps it symmetric, or a root of P or of its inverse. "
              "Two exceed it: the Chandrasekhar filter, which forgets no error, and the condensed information "
              "filter, which may lose k(P) more.",
          .source = "derived here, after Verhaegen and Van Dooren (1986), theory (4.4)",
          .setup =
              "A = [1 .5; 0 1], B = q [.125; .5], C = [1 0], Q = R = 1, P0 = I, q = 2^-8 ... 2^-22, 45 / (1 - "
              "rho(F)) steps, the worst error of P in the last 200, against the stabilising solution of the Riccati "
              "equation. For the slope srcf is run as a batch, many systems at once.",
          .prediction =
              "At most 20 u / (1 - rho(F)^2), and 20 k(P) u / (1 - rho(F)^2) in srif-hessenberg; slope 1 within .2 "
              "for srcf, over q in steps of a factor 2^(1/32); csrf's gain, from P0 = I, above 20 u / (1 - rho(F)^2) "
              "at q = 2^-16.",
          .meaning =
              "A filter with little process noise is slow to forget: expect its floor higher by 1 / (1 - rho(F)^2), "
              "whatever the form. More process noise lowers it.",
          .parameters = {{"finest", 22, "least process noise q, as a power of 1/2", 16, 24}},
          .measure = measure,
          .mathematics =
              "W_{k+1} = F_k W_k F_k' + delta_k I,  W_0 = 0,  -W_k <= dP_k <= W_k\n"
              "||W_k|| -> delta / (1 - rho(F)^2),  F normal\n"
              "||dP|| <= c u ||P|| / (1 - rho(F)^2)"};
}

}  // namespace kfstab::experiments::claims::steady_state_level
