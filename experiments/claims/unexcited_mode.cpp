#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/traces.hpp>
#include <kfstab/filters/registry.hpp>

namespace kfstab::experiments::claims::unexcited_mode {
namespace {

using reference::Errors;

/// Modes .5 along e, which noise and prior excite, and `mode`, which nothing does. All exact for a mode of few bits.
properties::System system_with(double mode, std::int64_t steps) {
  const double mean = (.5 + mode) / 2, half = (.5 - mode) / 2;
  const Matrix<double> T{{1., 0.}, {.375, 1.}}, T_inverse{{1., 0.}, {-.375, 1.}};
  const Matrix<double> A = T * Matrix<double>{{mean, half}, {half, mean}} * T_inverse;
  const Matrix<double> e = T * Matrix<double>{{1.}, {1.}};
  Matrix<double> S0 = Matrix<double>::Zero(2, 2);
  S0.col(0) = 1.25 * e;
  return system_of("unexcited-mode", A, .75 * e, Matrix<double>{{1., .3125}}, Matrix<double>::Identity(1, 1), S0,
                   steps);
}

Findings measure(const Settings& set) {
  Findings findings;
  const auto studied = filter_ids([](const Metadata& m) { return m.holds == Held::covariance || holds_root(m.holds); });
  const double shown = std::round(256 * set("mode")) / 256;
  for (const double mode : std::set{shown, 1.25}) {
    const double half_life = std::log(1 / u) / (2 * std::log(mode));
    const auto traced = traces(system_with(mode, static_cast<std::int64_t>(2.4 * half_life)), studied);
    reports::Figure figure;
    for (const std::string& id : studied) {
      const auto& errors = traced.at(id).errors;
      double lost = NaN;
      std::vector<double> x, y;
      for (std::size_t k = 0; k < errors.size(); ++k) {
        x.push_back(static_cast<double>(k + 1));
        y.push_back(errors[k].covariance);
        if (std::isnan(lost) && !(errors[k].covariance <= .1)) lost = static_cast<double>(k + 1);
      }
      const double predicted = find_filter(id)->holds == Held::covariance ? half_life : 2 * half_life;
      findings.checks.push_back(check_close(
          fmt::format("{}: step at which the error of P exceeds .1, mode {:g}", id, mode), predicted, lost, .15));
      figure.curves.push_back(measured(id, std::move(x), std::move(y), reports::CurveRole::measured_line));
    }
    if (mode != shown) continue;
    figure.id = "unexcited-mode-error";
    figure.title = "A growing mode that no noise excites: every filter diverges, a root lasts twice as long";
    figure.caption = fmt::format(
        "Who forgets an error in a direction that the model holds to be exactly known? A mode of {:g} that neither "
        "prior nor noise excites leaves F = A there, so rounding grows: in P by {:g}^2 a step, in a root by {:g}, "
        "which only its square brings into P. Dashed: u growing so, and its square. No filter is at fault: the model "
        "is.",
        mode, mode, mode);
    figure.x = {"step k", false};
    figure.y = {"relative error of P", true};
    std::vector<double> k;
    for (int i = 0; i <= static_cast<int>(2.4 * half_life); ++i) k.push_back(i);
    figure.curves.push_back(theory_line("theory-covariance", fmt::format("theory: u {:g}^(2k)", mode), k,
                                        [&](double i) { return u * std::pow(mode, 2 * i); }));
    figure.curves.push_back(theory_line("theory-root", fmt::format("theory: (u {:g}^k)^2", mode), k,
                                        [&](double i) { return std::pow(u * std::pow(mode, i), 2); }));
    findings.figures.push_back(std::move(figure));
  }
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "unexcited-mode",
      .number = 25,
      .title = "A growing mode that no noise excites makes every filter diverge; a root lasts twice as long",
      .statement =
          "Where a growing mode of A is excited neither by noise nor by the prior, the closed loop is no more stable "
          "than A: symmetric errors too grow, by rho(F)^2 a step where P is held. A root has the error of its own, "
          "which grows by rho(F), and so lasts twice as many steps.",
      .source = "derived here, after Verhaegen and Van Dooren (1986), theory (3.1), (3.4)",
      .setup =
          "A = T [.8125 -.3125; -.3125 .8125] T^-1 (modes .5 and 1.125; again with 1.25), T = [1 0; .375 1], C = [1 "
          ".3125], R = 1, e = T [1; 1], B = .75 e, P0 = 1.5625 e e': all exact.",
      .prediction =
          "The error of P exceeds .1 after ln(1/u) / (2 ln mode) steps where P is held, after twice as many for a "
          "root, within 15 %.",
      .meaning =
          "No form saves a model that calls a growing direction exactly known: give it noise. The control of claim C1.",
      // Below 1.125 an error of an ulp or two grows by less than half an ulp a step, and may be rounded away for ever.
      .parameters = {{"mode", 1.125, "the growing mode, rounded to 1/256", 1.125, 1.5}},
      .measure = measure,
      .mathematics =
          "w'A = l1 w',  w'B = 0,  w'P0 = 0:  w'K = 0,  w'F = l1 w'\n"
          "P held:  w'dP_k w = l1^{2k} w'dP_0 w ~ u l1^{2k}\n"
          "S held:  w'dP_k w = ||w'dS_k||^2 ~ (u l1^k)^2\n"
          "u l1^{2k} = 1  at k = log(1/u) / (2 log l1),  (u l1^k)^2 = 1  at k = log(1/u) / (log l1)"};
}

}  // namespace kfstab::experiments::claims::unexcited_mode
