#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/ladder.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/traces.hpp>

namespace kfstab::experiments::claims::scalar_roots {
namespace {

using reference::Errors;

/// A lower root of a prior of the size of I, of ten bits: no draw rounds as another does.
Matrix<double> root_of_prior(Random& random) {
  const Matrix<double> L = random_normal(random, 3, 3).triangularView<Eigen::StrictlyLower>();
  return round_to(Matrix<double>::Identity(3, 3) + .5 * L, 9);
}

properties::System both_at_once(double d, const Matrix<double>& S0, std::int64_t steps) {
  const Matrix<double> C{{1., 1., 1.}, {1., 1., 1 + d}}, I = Matrix<double>::Identity(3, 3);
  return system_of("dyer-mcreynolds", I, Matrix<double>::Zero(3, 1), C, d * Matrix<double>::Identity(2, 2), S0, steps);
}

/// The same measurements one a step: nothing moves between them, as A = I and B = 0.
properties::System one_a_step(double d, const Matrix<double>& S0, std::int64_t steps) {
  auto system = both_at_once(d, S0, 2 * steps);
  system.C.matrices = {Matrix<double>{{1., 1., 1.}}, Matrix<double>{{1., 1., 1 + d}}};
  system.R.value = Matrix<double>{{d}};
  return system;
}

const std::vector<std::string> scalar = {"ud", "potter", "carlson"};

Findings measure(const Settings& set) {
  const auto steps = static_cast<std::int64_t>(set("steps"));
  Random random(static_cast<std::uint64_t>(set("seed")));
  std::vector<Matrix<double>> priors;
  for (int i = 0; i < static_cast<int>(set("draws")); ++i) priors.push_back(root_of_prior(random));
  std::map<std::string, Ladder> errors;
  std::size_t rung = 0;
  for (int j = 4; j <= 52 && going_on(); j += 2, ++rung)
    for (const auto& S0 : priors) {
      const double d = std::exp2(-j);
      auto ids = scalar;
      ids.push_back("srcf");
      for (const auto& [id, trace] : traces(both_at_once(d, S0, steps), ids))
        errors[id].add(rung, 1 / d, trace.worst(&Errors::covariance));
      // After every second measurement, where both have been taken.
      const auto sequential = traces(one_a_step(d, S0, steps), {"srcf"}).at("srcf");
      double most = sequential.end == Status::ok ? 0 : infinity;
      for (std::size_t k = 1; k < sequential.errors.size(); k += 2)
        most = std::max(most, sequential.errors[k].covariance);
      errors["srcf one at a time"].add(rung, 1 / d, most);
    }

  Findings findings;
  auto studied = scalar;
  studied.push_back("srcf one at a time");
  const auto inverse = errors["srcf"].difficulties(), array = errors["srcf"].medians();
  for (const std::string& id : studied) {
    findings.checks.push_back(
        check_slope(fmt::format("{}: slope of the error of P in 1/d", id), 1, errors[id].power(1e-14, 1e-2), .1));
    const auto medians = errors[id].medians();
    double most = 0;
    for (std::size_t i = 0; i < inverse.size(); ++i)
      if (inverse[i] >= 0x1p8 && inverse[i] <= 0x1p44)
        most = std::max({most, medians[i] / array[i], array[i] / medians[i]});
    findings.checks.push_back(
        check_at_most(fmt::format("{}: largest factor between its error and srcf's, d = 2^-8..2^-44", id), 50, most,
                      "both are a modest constant times u/d"));
  }

  reports::Figure figure;
  figure.id = "scalar-roots-error";
  figure.title = "UD, Potter's and Carlson's updates are as accurate as the array";
  figure.caption = fmt::format(
      "Is one root better than another? Worst relative error of P in {} steps when two measurements differ by d and "
      "have noise d: all roots lose u/d (dashed), whether they take both measurements at once by an orthogonal array "
      "or one after the other by scalar formulas. Medians of {} random priors, thin lines the quartiles.",
      steps, priors.size());
  figure.x = {"1/d", true};
  figure.y = {"worst relative error of P", true};
  for (const char* id : {"ud", "potter", "carlson", "srcf"}) add_curves(figure, errors[id], id);
  figure.curves.push_back({"srcf-sequential", "srcf, one at a time", inverse, errors["srcf one at a time"].medians(),
                           reports::CurveRole::measured_points, color_of("joseph")});
  figure.curves.push_back(theory_line("theory", "theory: u/d", inverse, [](double x) { return u * x; }));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "scalar-roots",
      .number = 30,
      .title = "Roots updated by scalar formulas are as accurate as the orthogonal array",
      .statement =
          "Bierman's U and D, Potter's and Carlson's roots, and the square-root filter that takes one measurement at a "
          "time lose on nearly dependent measurements what the square-root array loses, within a modest factor.",
      .source = "Bierman and Thornton, Automatica 13 (1977); theory (6.1), (2.10)",
      .setup =
          "C = [1 1 1; 1 1 1+d], R = d^2 I, A = I, B = 0, d = 2^-4 ... 2^-52, P0 = S0 S0' with S0 = I and half a random normal "
          "number in each place below; worst error of P over the steps, median of the draws.",
      .prediction =
          "Slope 1 in 1/d (within .1) where the error is between 1e-14 and 1e-2, and within a factor of 50 of srcf for "
          "d = 2^-8 ... 2^-44.",
      .meaning = "Which root you hold is a matter of cost and taste: all of them keep the same digits.",
      .parameters = {{"steps", 20, "number of steps", 1, 1000},
                     {"draws", 9, "number of random priors", 1, 1000, 5},
                     {"seed", 1, "seed of the priors", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "Phi = R^{-1/2} C:  k_j = P phi_j / (1 + phi_j' P phi_j),  P := P - k_j phi_j' P\n"
          "P = S S':  S := S - k_j f' / (1 + a^{-1/2}),  f = S' phi_j,  a = 1 + f'f\n"
          "P = U D U',  U unit upper triangular\n"
          "||dP|| <= c u k(Re)^{1/2} ||P||,  k(Re)^{1/2} ~ 1/d"};
}

}  // namespace kfstab::experiments::claims::scalar_roots
