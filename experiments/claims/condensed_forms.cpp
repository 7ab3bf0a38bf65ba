#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/traces.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::experiments::claims::condensed_forms {
namespace {

using reference::Errors;

/// A dense form, its condensed twin, and the error by which what they hold is judged.
struct Pair {
  const char *dense, *condensed, *what;
  double Errors::*error;
};
const std::vector<Pair> pairs = {{"srcf", "srcf-hessenberg", "P", &Errors::covariance},
                                 {"srif", "srif-hessenberg", "T'T", &Errors::information}};

Findings measure(const Settings& set) {
  const auto n = static_cast<Index>(set("n"));
  const auto steps = static_cast<std::int64_t>(set("steps"));
  const auto late = static_cast<std::size_t>(steps / 2);
  const int systems = static_cast<int>(set("systems"));

  std::vector<double> number;
  std::map<std::string, std::vector<double>> worst;
  for (int s = 0; s < systems && going_on(); ++s) {
    Random random(static_cast<std::uint64_t>(set("seed")) + static_cast<std::uint64_t>(s));
    Matrix<double> A = random_normal(random, n, n);
    A = round_to(A * (set("rho") / reference::spectral_radius(A)), 18);
    const Matrix<double> B = round_to(.3 * random_normal(random, n, 2), 18),
                         C = round_to(random_normal(random, 2, n), 18);
    const auto system =
        system_of("random", A, B, C, Matrix<double>::Identity(2, 2), Matrix<double>::Identity(n, n), steps);
    const auto traced = traces(system, {"srcf", "srcf-hessenberg", "srif", "srif-hessenberg"});
    number.push_back(s + 1);
    for (const Pair& pair : pairs)
      for (const char* id : {pair.dense, pair.condensed}) worst[id].push_back(traced.at(id).worst(pair.error, late));
  }

  Findings findings;
  for (const Pair& pair : pairs) {
    double most = 0;
    std::vector<double> ratios;
    for (std::size_t s = 0; s < number.size(); ++s) {
      ratios.push_back(worst[pair.condensed][s] / worst[pair.dense][s]);
      most = std::max({most, ratios.back(), 1 / ratios.back()});
    }
    findings.checks.push_back(check_at_most(
        fmt::format("{} and {}: largest factor between their errors of {}", pair.condensed, pair.dense, pair.what), 10,
        most, "the orthogonal change of coordinates adds errors of the size of those that are there"));
    reports::Figure figure;
    figure.id = fmt::format("condensed-forms-{}", pair.dense);
    figure.title = fmt::format("{} is as accurate as {}", pair.condensed, pair.dense);
    figure.caption = fmt::format(
        "Does the condensed form pay for its speed with digits? Worst relative error of {} over the later half of {} "
        "steps, of {} random time-invariant systems with {} states: the dense form, and the Hessenberg form of the "
        "same filter. Between the dashed lines the errors differ from the dense form's median by a factor of ten at "
        "most.",
        pair.what, steps, systems, n);
    figure.x = {"number of the random system", false};
    figure.y = {fmt::format("worst relative error of {}", pair.what), true};
    figure.curves.push_back(measured(pair.dense, number, worst[pair.dense]));
    figure.curves.push_back(measured(pair.condensed, number, worst[pair.condensed]));
    const double middle = median(worst[pair.dense]);
    figure.curves.push_back(theory_line("theory-above", "dense x 10", number, [&](double) { return 10 * middle; }));
    figure.curves.push_back(theory_line("theory-below", "dense / 10", number, [&](double) { return middle / 10; }));
    findings.figures.push_back(std::move(figure));
  }
  return findings;
}

}  // namespace

Claim claim() {
  return {.id = "condensed-forms",
          .number = 18,
          .title = "Hessenberg forms are as accurate as the dense ones",
          .statement =
              "For time-invariant systems the square-root filters in condensed coordinates, observer-Hessenberg and "
              "controller-Hessenberg, cost a fraction of the dense ones and lose no more digits.",
          .source = "Van Dooren and Verhaegen (1988); derived here, theory (2.8), (2.9), (4.2)",
          .setup =
              "Random systems with n = 6, m = p = 2, rho(A) = .98, B of size .3, Q = R = I, P0 = I; the worst error "
              "over steps 31 to 60, since at a single step the ratio of two rounding errors says little.",
          .prediction =
              "Worst errors of P (srcf) and of T'T (srif) within a factor of ten of the dense form's, either way: U is "
              "orthogonal, so its application commits errors of the size of one more product.",
          .meaning = "For a system that does not change take the condensed form: it is the same filter, faster.",
          .parameters = {{"systems", 20, "random systems", 5, 1000, 5},
                         {"n", 6, "number of states", 3, 20},
                         {"steps", 60, "number of steps; the later half is judged", 20, 1000},
                         {"rho", .98, "spectral radius of A before it is rounded", .3, 1.1},
                         {"seed", 1, "seed of the first random system", 0, 1e15}},
          .measure = measure,
          .mathematics =
              "A_U = U A U',  C_U = C U':  C_U(i, j) = 0  for j > i,  A_U(i, j) = 0  for j > i + p\n"
              "[R^{1/2}, 0, C_U S; 0, B_U Q^{1/2}, A_U S] V = [Re^{1/2}, 0, 0; G, S+, 0],  P = U' S S' U\n"
              "V [Q^{-1/2}, 0; 0, R^{-1/2} C U'; T A_U^{-1} B_U, T A_U^{-1}] = [Qe^{-1/2}, *; 0, T+; 0, 0]\n"
              "S held:  ||dS|| <= c u (1 + k(Re)^{1/2}) ||S+|| / cos"};
}

}  // namespace kfstab::experiments::claims::condensed_forms
