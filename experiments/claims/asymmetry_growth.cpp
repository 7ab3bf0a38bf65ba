#include <algorithm>
#include <cmath>
#include <memory>
#include <set>

#include <fmt/core.h>

#include <kfstab/experiments/asymmetry.hpp>
#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/precise.hpp>
#include <kfstab/reference/bounds.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::experiments::claims::asymmetry_growth {
namespace {

using Covariances = Problem<CovarianceModel<double>>;

/// The two-state system with one output, P0 = diag(4, 1) with an antisymmetric seed.
struct Pair {
  Matrix<double> A, B{{1.}, {.5}}, C{{1., .25}}, R_root{{1.}};
  double seed = 1e-12;

  properties::System system() const { return system_of("pair", A, B, C, R_root, Matrix<double>::Identity(2, 2), 1); }
  AnyProblem<double> problem() const {
    auto problem = problem_of(system(), Parametrisation::covariance);
    std::get<Covariances>(problem).initial << 4, seed, -seed, 1;
    return problem;
  }
  reference::SteadyState steady() const {
    return reference::steady_state(problem_of(system(), Parametrisation::covariance));
  }
  double predicted(Asymmetry coding) const {
    const auto limit = steady();
    return reference::asymmetry_growth(coding, false, A, limit.predictor_gain * C, limit.closed_loop);
  }
};

void one_output(const Settings& set, Findings& findings) {
  reports::Figure figure;
  figure.id = "asymmetry-growth-one-output";
  figure.title = "One output: the asymmetry of codings (iii), (iv), (v) grows by r^2 a step";
  figure.caption =
      "How fast does an asymmetry of 1e-12 in P0 grow? A = r times a rotation, so |l1 l2| = r^2. The three codings lie on one another, on the "
      "dashed line of the theory; (i) forgets it; (ii) diverges faster.";
  figure.x = {"step k", false};
  figure.y = {"asymmetry, ||P - P'|| / 2", true};

  const double r_shown = set("r");
  for (const double r : std::set{1.02, 1.05, 1.1, r_shown, 1.5}) {
    Pair pair;
    pair.A = round_to(rotation(r, .7), 20);
    const double predicted = std::abs(pair.A(0, 0) * pair.A(1, 1) - pair.A(0, 1) * pair.A(1, 0));
    for (const Metadata* metadata : codings()) {
      const auto curve = norms(asymmetries(*metadata, pair.problem(), 3000, 1e3));
      const std::string name = fmt::format("{} at r = {:g}", coding_of(*metadata), r);
      if (follows_A(metadata->asymmetry))
        findings.checks.push_back(
            check_growth(name + ": growth per step", predicted, fit_growth(curve, 1e-13, 1e-4), .01));
      else if (metadata->asymmetry == Asymmetry::textbook)
        findings.checks.push_back(check_at_most(name + ": asymmetry after 300 steps, relative to P", 1e-15,
                                                curve.size() > 300 ? curve[300] / pair.steady().P.norm() : NaN,
                                                "forgotten down to the rounding of a step"));
      if (r == r_shown) {
        reports::Curve shown{std::string(metadata->id), fmt::format("{}  {}", coding_of(*metadata), metadata->id), {}, {},
                             reports::CurveRole::measured_line, color_of(metadata->id)};
        for (std::size_t k = 0; k < std::min<std::size_t>(curve.size(), 150); ++k) {
          shown.x.push_back(static_cast<double>(k + 1));
          shown.y.push_back(curve[k]);
        }
        figure.curves.push_back(std::move(shown));
      }
    }
    if (r == r_shown) {
      reports::Curve theory{"theory", fmt::format("theory: {:.4g}^k", predicted), {}, {}, reports::CurveRole::theory, -1};
      for (int k = 0; k <= 100; ++k) {
        theory.x.push_back(k);
        theory.y.push_back(pair.seed * std::sqrt(2.) * std::pow(predicted, k));
      }
      figure.curves.push_back(std::move(theory));
    }
  }
  findings.figures.push_back(std::move(figure));

  // At r <= 1 nothing grows but (ii).
  for (const double r : {1., .95}) {
    Pair pair;
    pair.A = round_to(rotation(r, .7), 20);
    for (const Metadata* metadata : codings()) {
      const auto curve = norms(asymmetries(*metadata, pair.problem(), 1000, 1e3));
      const std::string name = fmt::format("{} at r = {:g}", coding_of(*metadata), r);
      if (metadata->asymmetry == Asymmetry::mixed) {
        if (r < 1)
          findings.checks.push_back(check_growth(name + ": growth per step although A is stable",
                                                 pair.predicted(Asymmetry::mixed),
                                                 fit_growth(curve, 1e-13, 1e-4), .01));
      } else {
        findings.checks.push_back(check_at_most(name + ": largest asymmetry in 1000 steps over the seed's", 2,
                                                *std::ranges::max_element(curve) / (pair.seed * std::sqrt(2.)),
                                                "no growth; a transient may double it"));
      }
    }
  }

  // Real modes: what counts is the product of the two largest, not the largest.
  const Matrix<double> V{{1., .5}, {.25, 1.}};
  for (const auto& [l1, l2] : {std::pair{1.3, .5}, {2., .4}, {1.3, .9}}) {
    Pair pair;
    pair.A = V * Eigen::DiagonalMatrix<double, 2>(l1, l2) * properties::Precise(V).inverse()->rounded();
    for (const Metadata* metadata : codings()) {
      const auto curve = norms(asymmetries(*metadata, pair.problem(), 1000, 1e3));
      const std::string name = fmt::format("{} at modes {:g}, {:g}", coding_of(*metadata), l1, l2);
      if (metadata->asymmetry == Asymmetry::mixed)
        findings.checks.push_back(check_growth(name + ": growth per step", pair.predicted(Asymmetry::mixed),
                                               fit_growth(curve, 1e-13, 1e-4), .01));
      else if (l1 * l2 > 1 && follows_A(metadata->asymmetry))
        findings.checks.push_back(
            check_growth(name + ": growth per step", l1 * l2, fit_growth(curve, 1e-13, 1e-4), .01));
      else
        findings.checks.push_back(check_at_most(name + ": asymmetry after the last step over the seed's", 1,
                                                curve.back() / (pair.seed * std::sqrt(2.)), "no growth, |l1 l2| < 1"));
    }
  }
}

/// A stable A, two outputs: (iv) and (v) grow all the same.
void stable_with_two_outputs(Findings& findings) {
  const Matrix<double> plane = Matrix<double>::Identity(2, 2);
  const std::vector<std::pair<std::string, Matrix<double>>> noises = {
      {"B = [1 0; .5 .25]", Matrix<double>{{1., 0.}, {.5, .25}}},
      {"B = I", plane},
      {"B = [1; .5]", Matrix<double>{{1.}, {.5}}}};
  for (const auto& [name, B] : noises) {
    const Matrix<double> A = round_to(rotation(.9, .7), 20);
    auto system = system_of("pair", A, B, plane, plane, plane, 1);
    system.R = {properties::Covariance::Written::covariance, Matrix<double>(.01 * plane)};
    auto problem = problem_of(system, Parametrisation::covariance);
    const auto steady = reference::steady_state(problem);
    std::get<Covariances>(problem).initial << 4.25, .25 + 1e-12, .25 - 1e-12, 1.25;
    for (const Metadata* metadata : codings())
      if (metadata->asymmetry == Asymmetry::cp || metadata->asymmetry == Asymmetry::downdate) {
        const double predicted =
            reference::asymmetry_growth(metadata->asymmetry, false, A, steady.predictor_gain * plane, steady.closed_loop);
        const auto curve = norms(asymmetries(*metadata, problem, 400, 1e3));
        findings.checks.push_back(check_growth(fmt::format("{}, stable A = .9 rotation, C = I, {}: growth per step",
                                                          coding_of(*metadata), name),
                                               predicted, fit_growth(curve, 1e-13, 1e-4), .01));
      }
  }
}

/// Two outputs, five states: the measured asymmetry against the linear map, step by step.
void two_outputs(const Settings& set, Findings& findings) {
  const int systems = static_cast<int>(set("systems"));
  std::map<std::string, double> worst;
  reports::Figure figure;
  figure.id = "asymmetry-growth-two-outputs";
  figure.title = "Two outputs: each coding follows its own map";
  figure.caption =
      "Does the asymmetry follow D+ = map(D), step by step? Points: measured, from the steady state with a random asymmetry of "
      "1e-10 |P|; dashed: the map of theory (3.i)-(3.v) iterated, nothing fitted. The first of the random systems.";
  figure.x = {"step k", false};
  figure.y = {"asymmetry, ||P - P'|| / 2 relative to ||P||", true};

  for (int s = 0; s < systems && going_on(); ++s) {
    Random random(static_cast<std::uint64_t>(set("seed")) + static_cast<std::uint64_t>(s));
    const Index n = 5, p = 2;
    const auto system = random_system(random, {n, 2, p}, 1.15, 1);
    const Matrix<double>&A = system.A.matrices.front(), &C = system.C.matrices.front();
    auto problem = problem_of(system, Parametrisation::covariance);
    const auto steady = reference::steady_state(problem);
    const double size = steady.P.norm();
    Matrix<double> D0 = random_normal(random, n, n);
    D0 = (D0 - D0.transpose()).eval();
    D0 *= 1e-10 * size / D0.norm();
    auto& initial = std::get<Covariances>(problem).initial;
    initial = (steady.P + steady.P.transpose()) / 2 + D0 / 2;
    D0 = initial - initial.transpose();  // as it came out in double

    for (const Metadata* metadata : codings()) {
      const auto measured = asymmetries(*metadata, problem, 200, 1e-6 * size);
      double& distance = worst.try_emplace(std::string(metadata->id), 0).first->second;
      reports::Curve points{std::string(metadata->id), fmt::format("{}  {}", coding_of(*metadata), metadata->id), {}, {},
                            reports::CurveRole::measured_points, color_of(metadata->id)};
      reports::Curve line{"theory-" + std::string(metadata->id), "map of " + coding_of(*metadata), {}, {},
                          reports::CurveRole::theory, -1};
      Matrix<double> D = D0;
      for (std::size_t k = 0; k < measured.size(); ++k) {
        D = reference::asymmetry_map(metadata->asymmetry, false, A, steady.predictor_gain * C, steady.closed_loop, D);
        if (!(D.norm() > 1e-12 * size && D.norm() < 1e-6 * size)) break;
        distance = std::max(distance, (measured[k] - D).norm() / D.norm());
        points.x.push_back(static_cast<double>(k + 1));
        points.y.push_back(measured[k].norm() / 2 / size);
        line.x.push_back(static_cast<double>(k + 1));
        line.y.push_back(D.norm() / 2 / size);
      }
      if (s == 0) {
        figure.curves.push_back(std::move(points));
        figure.curves.push_back(std::move(line));
      }
    }
  }
  for (const Metadata* metadata : codings())
    findings.checks.push_back(check_at_most(
        fmt::format("{}, p = 2, {} systems: worst distance from the map, relative", coding_of(*metadata), systems), .01,
        worst[std::string(metadata->id)], "what is left is of second order in D, and rounding"));
  findings.figures.push_back(std::move(figure));
}

Findings measure(const Settings& set) {
  Findings findings;
  one_output(set, findings);
  stable_with_two_outputs(findings);
  two_outputs(set, findings);
  return findings;
}

}  // namespace

Claim claim() {
  return {.id = "asymmetry-growth",
          .number = 3,
          .title = "How an asymmetry grows depends on how the formula is coded",
          .statement = "Five codings of the same Riccati step treat an asymmetry D = P - P' differently. Coding (i) damps it "
                       "like any error; (iii), (iv) and (v) multiply it by the product of the two largest eigenvalue moduli "
                       "of A a step when there is one output, whatever the filter's own stability; (ii) can diverge even "
                       "for a stable A, and with several outputs so can (iv) and (v).",
          .source = "derived here, after Verhaegen and Van Dooren (1986), theory (3.i)-(3.v)",
          .setup = "One output: A = r rotation(.7), B = [1; .5], C = [1 .25], R = 1, P0 = diag(4, 1) with a seed of 1e-12; "
                   "real modes (1.3, .5), (2, .4), (1.3, .9). Two outputs: random systems with five states and rho(A) = "
                   "1.15 from their steady state; A = .9 rotation(.7) with C = I, R = .01 I. Re is used as computed, by LU.",
          .prediction = "Growth r^2 = |l1 l2| a step for (iii), (iv), (v), none for |l1 l2| <= 1; for (ii), and wherever "
                        "p >= 2, the spectral radius of the coding's map on antisymmetric matrices, and the map itself "
                        "step by step.",
          .meaning = "The stability of the filter says nothing about its asymmetry. Symmetrise, or compute one triangle.",
          .parameters = {{"r", 1.2, "modulus of the eigenvalues of A in the figure", 1.02, 2},
                         {"systems", 20, "number of random systems", 1, 1000, 3},
                         {"seed", 1, "seed of the first random system", 0, 1e15}},
          .measure = measure,
          .mathematics = "D+ = F D F'  in (i)\n"
                         "D+ = 2 A D A' - F D F'  in (ii)\n"
                         "D+ = A D A' - G D G'  in (iii)\n"
                         "D+ = A D A' + G D G'  in (iv), (v)\n"
                         "F = A - K C,  G = K C,  p = 1:  |D+| = |l1 l2| |D|  in (iii), (iv), (v)"};
}

}  // namespace kfstab::experiments::claims::asymmetry_growth
