#include <algorithm>
#include <cmath>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/traces.hpp>
#include <kfstab/filters/registry.hpp>

namespace kfstab::experiments::claims::asymmetry_without_bound {
namespace {

Findings measure(const Settings& set) {
  const double r = set("r");
  const auto steps = static_cast<std::int64_t>(set("steps"));
  const auto system =
      system_of("pair", round_to(rotation(r, .7), 20), Matrix<double>{{1.}, {.5}}, Matrix<double>{{1., .25}},
                Matrix<double>::Identity(1, 1), Matrix<double>{{2., 0.}, {0., 1.}}, steps);
  const auto& A = system.A.matrices.front();
  const double growth = A(0, 0) * A(1, 1) - A(0, 1) * A(1, 0);
  const auto studied =
      filter_ids([](const Metadata& m) { return m.holds == Held::covariance && m.asymmetry != Asymmetry::mixed; });
  auto ids = studied;
  ids.push_back("srcf");
  const auto traced = traces(system, ids);

  Findings findings;
  reports::Figure figure;
  figure.id = "asymmetry-without-bound-error";
  figure.title = fmt::format("Rounding alone: {} steps, and P is wrong by {:.0f} decades", steps,
                             std::log10(u * std::pow(growth, steps)));
  figure.caption = fmt::format(
      "How wrong can P become with no perturbation but rounding? A fast unstable pair, modes of modulus {:g}, whose "
      "Kalman filter is stable. An asymmetry of size u grows by {:g} a step (dashed) in the codings (iii), (iv), (v), "
      "without bound, for nothing nonlinear stops it; the other forms of the same filter stay at rounding level.",
      r, growth);
  figure.x = {"step k", false};
  figure.y = {"relative error of P, ||P^ - P|| / ||P||", true};
  for (const std::string& id : ids) {
    const Trace& trace = traced.at(id);
    std::vector<double> k, error, late, logs;
    for (std::size_t i = 0; i < trace.errors.size(); ++i) {
      k.push_back(static_cast<double>(i + 1));
      error.push_back(trace.errors[i].covariance);
      if (3 * i < trace.errors.size()) continue;
      late.push_back(k.back());
      logs.push_back(std::log(trace.errors[i].asymmetry));
    }
    const Asymmetry coding = find_filter(id)->asymmetry;
    if (coding == Asymmetry::none || coding == Asymmetry::textbook) {
      findings.checks.push_back(check_at_most(fmt::format("{}: worst relative error of P", id), 1e-14,
                                              trace.worst(&reference::Errors::covariance), "rounding level"));
    } else {
      findings.checks.push_back(check_close(fmt::format("{}: growth of P - P' per step, in the later two thirds", id),
                                            growth, std::exp(fit_line(late, logs).slope), .01));
      findings.checks.push_back(check_within(fmt::format("{}: log10 of the error of P after {} steps", id, steps),
                                             std::log10(u) + static_cast<double>(steps) * std::log10(growth),
                                             error.empty() ? NaN : std::log10(error.back()), 3));
    }
    figure.curves.push_back(measured(id, std::move(k), std::move(error), reports::CurveRole::measured_line));
  }
  std::vector<double> k;
  for (std::int64_t i = 0; i <= steps; ++i) k.push_back(static_cast<double>(i));
  figure.curves.push_back(theory_line(
      "theory", fmt::format("theory: u {:.3g}^k", growth), k, [&](double i) { return u * std::pow(growth, i); },
      infinity));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "asymmetry-without-bound",
      .number = 31,
      .title = "An asymmetry that rounding sowed grows without bound",
      .statement =
          "On a fast unstable pair, whose filter is stable, P in the codings (iii), (iv), (v) is wrong by more than "
          "forty decades after 150 steps, from rounding alone, and nothing stops it; the symmetric forms, coding (i) "
          "and srcf are at rounding level.",
      .source = "derived here, after Verhaegen and Van Dooren (1986), theory (3.7)",
      .setup = "A = 1.6 rotation(.7), B = [1; .5], C = [1 .25], R = 1, P0 = diag(4, 1), no perturbation, 150 steps.",
      .prediction =
          "||P - P'|| grows by det A = r^2 a step (within 1 %); an asymmetry of size u at the start is u r^(2k) after "
          "k steps, "
          "within three decades.",
      .meaning =
          "What claim asymmetry-growth measures under a microscope, to the naked eye: symmetrise, or compute one "
          "triangle.",
      .parameters = {{"r", 1.6, "modulus of the eigenvalues of A", 1.3, 2}, {"steps", 150, "number of steps", 60, 300}},
      .measure = measure,
      .mathematics =
          "p = 1:  D+ = A D A'  in (iii), (iv), (v)\n"
          "n = 2:  D+ = D det A,  det A = l1 l2 = r^2,  ||D_k|| ~ u r^{2k}\n"
          "D+ = F D F' = D det F  in (i)"};
}

}  // namespace kfstab::experiments::claims::asymmetry_without_bound
