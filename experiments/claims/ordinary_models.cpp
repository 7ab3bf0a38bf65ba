#include <algorithm>
#include <array>

#include <fmt/core.h>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/traces.hpp>
#include <kfstab/filters/registry.hpp>

namespace kfstab::experiments::claims::ordinary_models {
namespace {

using reference::Errors;

constexpr std::array<const char*, 5> models = {"rts-satellite", "ecg", "radar", "resonator", "navigation"};

/// The error of what a filter holds.
double Errors::*error_of(const Metadata& metadata) {
  const bool information = metadata.holds == Held::information_factor || metadata.holds == Held::information;
  return information ? &Errors::information : &Errors::covariance;
}

/// Whether the asymmetry goes by A, not by F: theory (3.iii)-(3.v). What these do here is no news.
bool follows_A(const Metadata& m) { return m.asymmetry != Asymmetry::none && m.asymmetry != Asymmetry::textbook; }

Findings measure(const Settings& set) {
  const auto steps = static_cast<std::int64_t>(set("steps"));
  const auto studied = filter_ids([](const Metadata& m) {
    return m.holds != Held::gain && m.holds != Held::information && m.asymmetry != Asymmetry::mixed;
  });
  std::map<std::string, std::vector<double>> worst;
  std::vector<double> number;
  std::string names;
  for (const char* model : models) {
    going_on();
    properties::Overrides overrides;
    overrides.steps = steps;
    auto system = find_system(model, overrides);
    system.data = nullptr;
    number.push_back(static_cast<double>(number.size() + 1));
    names += fmt::format("{}{:g} {}", names.empty() ? "" : ", ", number.back(), model);
    for (const auto& [id, trace] : traces(system, studied))
      worst[id].push_back(trace.worst(error_of(*find_filter(id))));
  }

  Findings findings;
  const double limit = 4 * static_cast<double>(steps) * u;
  for (const std::string& id : studied)
    if (!follows_A(*find_filter(id)))
      findings.checks.push_back(check_at_most(fmt::format("{}: worst error over the models", id), limit,
                                              *std::ranges::max_element(worst[id]),
                                              "4 u a step, were none of it forgotten: rounding level"));

  reports::Figure figure;
  figure.id = "ordinary-models-error";
  figure.title = "On ordinary models there is nothing to choose";
  figure.caption = fmt::format(
      "Does the form matter on everyday models? Worst relative error in {} steps of what each filter holds, P or the "
      "information matrix, on {}. Below the dashed line, 4 u a step, all is rounding. Only the codings (iii) to (v) "
      "rise above it, whose asymmetry is not damped.",
      steps, names);
  figure.x = {"model", false};
  figure.y = {"worst relative error of what is held", true};
  // Side by side, or they would hide one another.
  for (std::size_t i = 0; i < studied.size(); ++i) {
    std::vector<double> place;
    for (const double model : number)
      place.push_back(model + .6 * (static_cast<double>(i) / static_cast<double>(studied.size() - 1) - .5));
    figure.curves.push_back(measured(studied[i], place, worst[studied[i]]));
  }
  std::vector<double> edges;
  for (const double model : number) edges.insert(edges.end(), {model - .5, model + .5});
  figure.curves.push_back(theory_line("theory", "4 u a step", edges, [&](double) { return limit; }));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "ordinary-models",
      .number = 20,
      .title = "On ordinary models there is nothing to choose between the forms",
      .statement =
          "On tracking and signal models as textbooks and filter collections use them, every form that keeps its "
          "symmetry is at rounding level. A control: a laboratory that sees divergence here sees it everywhere.",
      .source =
          "a control; models after Rauch, Tung, Striebel (1965), Singer (1970) and filter collections; theory (4.4)",
      .setup =
          "The systems rts-satellite, ecg, radar, resonator and navigation of the catalogue, without data; worst error "
          "over the steps of what each filter holds. Codings (iii) to (v), whose asymmetry follows A, are shown and "
          "not judged. Left out: coding (ii), which loses everything on most systems; csrf, which holds no P; the "
          "information filter by normal equations, which takes radar's mixture of units for a singular P^-1.",
      .prediction =
          "Moderate condition numbers and closed loops that forget: errors at most 4 u a step, 1e-13 in 200 steps.",
      .meaning = "On a well-scaled model choose by cost and convenience, as long as P is kept symmetric.",
      .parameters = {{"steps", 200, "number of steps", 50, 10000}},
      .measure = measure,
      .mathematics =
          "W_{k+1} = F_k W_k F_k' + delta_k I,  W_0 = 0,  -W_k <= dP_k <= W_k\n"
          "P held:  delta_k = u (n + m + p) k(Re) ||P+|| / cos^2\n"
          "||dP_k|| <= 4 k u ||P_k||"};
}

}  // namespace kfstab::experiments::claims::ordinary_models
