#include <algorithm>
#include <cmath>

#include <fmt/core.h>

#include <kfstab/experiments/asymmetry.hpp>
#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/registry.hpp>

namespace kfstab::experiments::claims::rls_forgetting {
namespace {

constexpr double seed_size = 1e-12;

/// Least squares with forgetting factor f as a Kalman filter: A = f^{-1/2} I, no noise, a random row of regressors a
/// step. Long enough for an asymmetry to grow by 24 e-folds.
properties::System least_squares(double f, Index n, std::uint64_t seed) {
  Random random(seed);
  const auto steps = static_cast<std::int64_t>(std::ceil(24 / -std::log(f)));
  const Matrix<double> I = Matrix<double>::Identity(n, n);
  auto system = system_of("least-squares", I / std::sqrt(f), Matrix<double>::Zero(n, 1), Matrix<double>::Zero(1, n),
                          Matrix<double>::Identity(1, 1), I, steps);
  std::vector<Matrix<double>> C;
  for (std::int64_t k = 0; k < steps; ++k) C.push_back(random_normal(random, 1, n));
  system.C = {properties::Sequence::Kind::list, std::move(C)};
  return system;
}

Findings measure(const Settings& set) {
  const auto n = static_cast<Index>(set("n"));
  const double shown = set("factor");
  Findings findings;
  reports::Figure figure;
  figure.id = "rls-forgetting-asymmetry";
  figure.title = "Recursive least squares that forgets: four codings of five lose the symmetry of P";
  figure.caption = fmt::format(
      "What does a forgetting factor f = {:g} do to an asymmetry of 1e-12 in P? Recursive least squares is a Kalman "
      "filter with A = f^(-1/2) I and no noise: the codings (iii), (iv), (v) multiply the asymmetry by 1/f a step "
      "(dashed, nothing fitted), as fast as they forget data; (ii) is worse, (i) harmless.",
      shown);
  figure.x = {"step k", false};
  figure.y = {"asymmetry, ||P - P'|| / 2", true};

  for (const double f : {.9, .95, .98, shown}) {
    if (f == shown && !figure.curves.empty()) break;  // it is one of the three
    const auto system = least_squares(f, n, static_cast<std::uint64_t>(set("seed")));
    auto problem = problem_of(system, Parametrisation::covariance);
    auto& P0 = std::get<Problem<CovarianceModel<double>>>(problem).initial;
    const double start = seed_size * std::sqrt(static_cast<double>(n * (n - 1)));
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i)
        if (i != j) P0(i, j) += i < j ? seed_size : -seed_size;

    auto filters = codings();
    for (const char* id : {"ckf", "joseph"}) filters.push_back(find_filter(id));
    for (const Metadata* filter : filters) {
      const auto curve = norms(asymmetries(*filter, problem, static_cast<int>(system.steps), 1e-2));
      const std::string coding = coding_of(*filter), name = coding == "symmetric" ? std::string(filter->id) : coding;
      const double last = curve.empty() ? NaN : curve.back();
      if (follows_A(filter->asymmetry))
        findings.checks.push_back(check_growth(fmt::format("{} at f = {:g}: growth of the asymmetry a step", name, f),
                                               1 / f, fit_growth(curve, 1e-13, 1e-4), .01));
      else if (filter->asymmetry != Asymmetry::mixed)
        findings.checks.push_back(check_at_most(
            fmt::format("{} at f = {:g}: asymmetry after the last step over that of P0", name, f), 1, last / start,
            filter->asymmetry == Asymmetry::none ? "one triangle is computed" : "D+ = F D F', theory (3.i)"));
      if (f != shown || filter->asymmetry == Asymmetry::none) continue;
      auto points =
          measured_points(std::string(filter->id), fmt::format("{}  {}", coding, filter->id), std::string(filter->id));
      points.role = reports::CurveRole::measured_line;
      for (const double value : curve) add_point(points, static_cast<double>(points.x.size() + 1), value);
      figure.curves.push_back(std::move(points));
    }
    if (f != shown) continue;
    auto line = theory_line("theory", fmt::format("theory: (1/{:g})^k", f));
    for (std::int64_t k = 0; k <= system.steps && start * std::pow(f, -k) < 1e-2; ++k)
      add_point(line, static_cast<double>(k), start * std::pow(f, -static_cast<double>(k)));
    figure.curves.push_back(std::move(line));
  }
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {.id = "rls-forgetting",
          .number = 24,
          .title = "Least squares with a forgetting factor loses the symmetry of P as fast as it forgets",
          .statement =
              "Recursive least squares with forgetting factor f is a Kalman filter with A = f^(-1/2) I: codings "
              "(iii), (iv) and (v) multiply an asymmetry of P by 1/f a step, however well excited the filter is; (i) "
              "and forms that compute one triangle do not.",
          .source = "Verhaegen (1989) on recursive least squares; derived here, theory (3.7)",
          .setup =
              "n = 4, A = f^(-1/2) I, B = 0, R = 1, a new random row C_k at each step, P0 = I with an asymmetry of "
              "1e-12; f = .9, .95, .98.",
          .prediction =
              "Growth of the asymmetry 1/f a step within 1 %, fitted between 1e-13 and 1e-4 after the first quarter; "
              "no growth in (i), ckf and joseph.",
          .meaning = "An adaptive filter runs for ever: symmetrise its P, or compute one triangle, or hold a root.",
          .parameters = {{"factor", .95, "forgetting factor in the figure", .7, .99},
                         {"n", 4, "number of coefficients", 2, 16},
                         {"seed", 1, "seed of the random regressors", 0, 1e15}},
          .measure = measure,
          .mathematics =
              "A = f^{-1/2} I,  p = 1:  D+ = A D A' = f^{-1} D  in (iii), (iv), (v)\n"
              "||D_k|| = f^{-k} ||D_0||\n"
              "D+ = F D F'  in (i)"};
}

}  // namespace kfstab::experiments::claims::rls_forgetting
