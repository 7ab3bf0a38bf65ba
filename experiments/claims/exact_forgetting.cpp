#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include <fmt/core.h>
#include <boost/random/uniform_real_distribution.hpp>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/perturbation.hpp>
#include <kfstab/reference/bounds.hpp>

namespace kfstab::experiments::claims::exact_forgetting {
namespace {

constexpr double criterion = .01;
constexpr double floor = 1e-10;  // relative to P, beneath which the rounding of the two runs counts

/// A, B and C new at every step, rho(A_k) between .6 and 1.2; P0 = 2.25 I.
properties::System varying_system(Random& random, Dimensions dimensions, std::int64_t steps) {
  using Kind = properties::Sequence::Kind;
  std::vector<Matrix<double>> A, B, C;
  boost::random::uniform_real_distribution<double> radius(.6, 1.2);
  properties::System system;
  for (std::int64_t k = 0; k < steps; ++k) {
    system = random_system(random, dimensions, radius(random), steps);
    A.push_back(system.A.matrices.front());
    B.push_back(system.B.matrices.front() / 2);
    C.push_back(system.C.matrices.front());
  }
  system.A = {Kind::list, std::move(A)};
  system.B = {Kind::list, std::move(B)};
  system.C = {Kind::list, std::move(C)};
  system.P0 = {properties::Covariance::Written::covariance,
               Matrix<double>(2.25 * Matrix<double>::Identity(dimensions.n, dimensions.n))};
  return system;
}

Findings measure(const Settings& set) {
  const int systems = static_cast<int>(set("systems"));
  const auto n = static_cast<Index>(set("n")), p = static_cast<Index>(set("p"));
  const auto steps = static_cast<std::int64_t>(set("steps"));
  Random random(static_cast<std::uint64_t>(set("seed")));
  auto filters = forgetful_filters();
  std::erase_if(filters, [](const Metadata* filter) { return filter->needs.time_invariant; });
  const std::vector<double> small{1e-3, 1e-6};
  const double large = 1;

  reports::Figure figure;
  figure.id = "exact-forgetting";
  figure.title = "A system that changes at every step: errors go by the product of the closed loops";
  figure.caption =
      "Where there is no steady state, does the product of the closed loops still say what becomes of an error of "
      "P0? Points: ||dP_k|| of filters that hold P, S or T, for a random, positive definite dP of 1e-3; dashed: "
      "||Phi dP Phi'||, Phi = F_k ... F_0 (or, for srif, which shows P_{k|k}, that of (I - Kf C) A), nothing fitted. "
      "A random system whose A, B, C are new at every step.";
  figure.x = {"step k", false};
  figure.y = {"||dP_k|| / ||dP||", true};

  std::map<std::string_view, std::map<double, double>> worst;  // by filter and size of dP
  for (int s = 0; s < systems && going_on(); ++s) {
    const auto system = varying_system(random, {n, 2, p}, steps);
    // An indefinite dP may be lost by chance in Phi dP Phi', and then second order is all there is: theory bounds it for
    // dP >= 0.
    const Matrix<double> X = random_normal(random, n, n);
    const Matrix<double> definite = X * X.transpose(), any = X + X.transpose();
    const double P0_norm = system.P0.value.matrices.front().norm();
    const std::map forms{std::pair{Parametrisation::covariance, transitions(system)},
                         {Parametrisation::information, transitions(system, Parametrisation::information)}};
    for (const double size : {small.front(), small.back(), large}) {
      auto disturbed = system;
      const Matrix<double>& direction = size == large ? any : definite;
      disturbed.P0.value.matrices.front() += size / direction.norm() * direction;
      const Matrix<double> dP = disturbed.P0.value.matrices.front() - system.P0.value.matrices.front();
      const std::map disturbed_forms{std::pair{Parametrisation::covariance, transitions(disturbed)},
                                     {Parametrisation::information, transitions(disturbed, Parametrisation::information)}};
      for (const Metadata* filter : filters) {
        const auto form = filter->takes == Parametrisation::root ? Parametrisation::covariance : filter->takes;
        const auto &Phi = forms.at(form), &disturbed_Phi = disturbed_forms.at(form);
        const auto& other_Phi = size == large ? disturbed_Phi : Phi;
        const auto measured = deviations(*filter, system, dP, {}, {});
        const std::string id(filter->id);
        auto points = measured_points(id, id, id);
        auto line = theory_line("theory-" + id, id == "srif" ? "theory, P_{k|k}" : "theory, P_{k+1|k}");
        double& distance = worst[filter->id].try_emplace(size, 0).first->second;
        reference::FirstOrderBound bound(*filter, {n, 2, p}), disturbed_bound = bound;
        for (std::size_t k = 0; k < measured.size(); ++k) {
          const Matrix<double> predicted = carried(Phi.of(filter->instant)[k], dP, other_Phi.of(filter->instant)[k]);
          // What the two runs have rounded, as far as theory excuses it: a single A_k that is nearly singular may
          // multiply it by 1e6 in an information filter.
          const auto &P = Phi.P(filter->instant, k), &disturbed_P = disturbed_Phi.P(filter->instant, k);
          const double excused = bound.advance(Phi.truths[k]) * P.norm() +
                                 disturbed_bound.advance(disturbed_Phi.truths[k]) * disturbed_P.norm();
          const double rounding = std::min(excused, (measured[k].P - (disturbed_P - P)).norm());
          if (!(predicted.norm() > std::max(floor * P0_norm, 5 / criterion * rounding))) break;
          keep_worst(distance, (measured[k].P - predicted).norm() / predicted.norm());
          add_point(points, static_cast<double>(k), measured[k].P.norm() / dP.norm());
          add_point(line, static_cast<double>(k), predicted.norm() / dP.norm());
        }
        if (points.x.size() < 2) distance = NaN;  // all is rounding
        if (s > 0 || size != small.front() || !(id == "ckf" || id == "srcf" || id == "srif")) continue;
        figure.curves.push_back(std::move(points));
        if (id != "ckf") figure.curves.push_back(std::move(line));
      }
    }
  }

  Findings findings;
  for (const Metadata* filter : filters) {
    auto& distances = worst[filter->id];
    for (const double size : small)
      findings.checks.push_back(
          check_at_most(fmt::format("{}, {} systems, |dP| = {:g}: worst distance of dP_k from Phi dP Phi', relative",
                                    filter->id, systems, size),
                        criterion, distances[size], "theory (3.4): within ||W|| ||dP||, as dP > 0, and W <= P0^-1"));
    findings.checks.push_back(
        check_at_most(fmt::format("{}, {} systems, |dP| = {:g}: worst distance of dP_k from Phi dP Phi2', relative",
                                  filter->id, systems, large),
                      criterion, distances[large],
                      "exact, theory (3), Phi2 being that of the disturbed run; what is left is rounding"));
  }
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "exact-forgetting",
      .number = 22,
      .title = "Time-varying systems forget by the product of their closed loops",
      .statement =
          "For a system that changes at every step an error dP of P0 has become Phi dP Phi' after k steps, Phi = F_k "
          "... F_0, to first order; with Phi of the disturbed run on the other side the formula is exact.",
      .source = "derived here, after Verhaegen and Van Dooren (1986), theory (3.4)",
      .setup =
          "Random A_k, B_k, C_k, new at each of 40 steps, n = 4, m = p = 2, rho(A_k) in (.6, 1.2), R = I, P0 = 2.25 "
          "I; a random positive definite dP of 1e-3 and of 1e-6, and a symmetric one of 1; two runs of one filter, "
          "compared while the predicted difference exceeds 1e-10 |P0| and the two runs have rounded no more than a fifth of "
          "the criterion of it: measured by the difference of their references, and no more than (4.4) excuses.",
      .prediction = "Within 1 %: Phi dP Phi' for the small dP, Phi dP Phi2' for the large one.",
      .meaning =
          "To know how long an error lasts in a filter of a changing system, multiply its closed loops: no "
          "eigenvalue of a single one tells.",
      .parameters = {{"n", 4, "number of states", 2, 8},
                     {"p", 2, "number of outputs", 1, 4},
                     {"steps", 40, "number of steps", 30, 200},
                     {"systems", 20, "number of random systems", 1, 1000},
                     {"seed", 1, "seed of the random systems", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "dP_k = Phi dP_0 Phi',  Phi = F_{k-1} ... F_1 F_0\n"
          "P1+ - P2+ = F1 (P1 - P2) F2'\n"
          "dP_k = Phi dP_0 Phi_2',  Phi_2  of the disturbed run"};
}

}  // namespace kfstab::experiments::claims::exact_forgetting
