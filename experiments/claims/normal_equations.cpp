#include <cmath>
#include <map>
#include <memory>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/traces.hpp>
#include <kfstab/properties/data.hpp>

namespace kfstab::experiments::claims::normal_equations {
namespace {

const std::vector<std::string> studied = {"information", "srif"};

Findings measure(const Settings& set) {
  std::vector<double> inverse;
  std::map<std::string, std::vector<double>> error;
  for (int j = 3; j <= 29 && going_on(); j += 2) {
    const double d = std::exp2(-j);
    const Matrix<double> C{{1., 1., 1.}, {1., 1., 1 + d}}, I = Matrix<double>::Identity(3, 3);
    std::map<std::string, std::vector<double>> draws;
    for (int draw = 0; draw < static_cast<int>(set("draws")); ++draw) {
      Random random(static_cast<std::uint64_t>(set("seed")) + static_cast<std::uint64_t>(draw));
      Matrix<double> S0 = random_normal(random, 3, 3).triangularView<Eigen::Lower>();
      S0.diagonal().array() = S0.diagonal().array().abs() + 1;
      S0 = round_to(S0, 8);
      auto system =
          system_of("normal-equations", I, Matrix<double>::Zero(3, 1), C, d * Matrix<double>::Identity(2, 2), S0, 1);
      system.x0 = random_normal(random, 3, 1);
      system.data = std::make_shared<properties::Recorded>(random_normal(random, 2, 1), Matrix<double>(0, 1));
      for (const auto& [id, trace] : traces(system, studied))
        draws[id].push_back(trace.worst(&reference::Errors::state));
    }
    inverse.push_back(1 / d);
    for (const auto& id : studied) error[id].push_back(median(draws[id]));
  }

  Findings findings;
  findings.checks.push_back(check_slope("information: slope of the error of the state in 1/d", 2,
                                        fit_power(inverse, error["information"], 1e-14, 1e-2), .1));
  findings.checks.push_back(check_slope("srif: slope of the error of the state in 1/d", 1,
                                        fit_power(inverse, error["srif"], 1e-14, 1e-2), .1));

  reports::Figure figure;
  figure.id = "normal-equations-error";
  figure.title = "Normal equations lose the square of what the information array loses";
  figure.caption = fmt::format(
      "Does it matter how information is added up? State after one update with two measurements that differ by d and "
      "have noise d, medians of {:g} random priors. P^-1 + C'R^-1 C formed and solved (information) loses (1/d)^2, the "
      "same least-squares problem by an orthogonal array (srif) 1/d. The first curve ends where the filter refuses.",
      set("draws"));
  figure.x = {"1/d", true};
  figure.y = {"relative error of the state, median", true};
  for (const auto& id : studied) {
    for (double& y : error[id])
      if (std::isinf(y)) y = NaN;
    figure.curves.push_back(measured(id, inverse, error[id]));
  }
  figure.curves.push_back(theory_line("theory-2", "theory: u/d^2", inverse, [&](double x) { return u * x * x; }));
  figure.curves.push_back(theory_line("theory-1", "theory: u/d", inverse, [&](double x) { return u * x; }));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {.id = "normal-equations",
          .number = 28,
          .title = "An information filter that forms P^-1 loses the square of what a root of it loses",
          .statement =
              "The information filter solves a least-squares problem by its normal equations, the square-root "
              "information filter by orthogonal triangularisation: the state from the first loses the square of what "
              "it loses in the second.",
          .source = "derived here, theory (2.4), (2.11); the rule is that of least squares (Golub 1965)",
          .setup =
              "C = [1 1 1; 1 1 1+d], R = d^2 I, random S0, x0 and y, d = 2^-3 ... 2^-29; the state after one "
              "measurement update, medians.",
          .prediction =
              "k(T) is of size 1/d, k(T'T) of size 1/d^2: slope 2 in 1/d (within .1) for the information filter, 1 "
              "(within .1) for srif, fitted between 1e-14 and 1e-2.",
          .meaning =
              "If you need information form, hold the root T: it costs no more and keeps twice as many digits of what "
              "is lost.",
          .parameters = {{"draws", 30, "random priors at each d", 5, 1000},
                         {"seed", 1, "seed of the first prior", 0, 1e15}},
          .measure = measure,
          .mathematics =
              "U [T, T x; R^{-1/2} C, R^{-1/2} y] = [T+, T+ x+; 0, e]\n"
              "Y+ = Y + C' R^{-1} C,  Y+ x+ = Y x + C' R^{-1} y\n"
              "Y+ = T+' T+,  k(Y+) = k(T+)^2 ~ 1/d^2\n"
              "T held:  ||dx|| <= c u k(T+) ||x||,  Y held:  ||dx|| <= c u k(T+)^2 ||x||"};
}

}  // namespace kfstab::experiments::claims::normal_equations
