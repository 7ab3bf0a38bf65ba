#include <cmath>
#include <map>
#include <memory>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/ladder.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/data.hpp>
#include <kfstab/reference/trajectory.hpp>

namespace kfstab::experiments::claims::state_estimate {
namespace {

/// The forms for which theory 4 bounds the gain: those that hold P, and the two arrays.
std::vector<std::string> studied() {
  std::vector<std::string> ids;
  for (const Metadata& metadata : filters())
    if (metadata.holds == Held::covariance) ids.emplace_back(metadata.id);
  ids.insert(ids.end(), {"srcf", "srif"});
  return ids;
}

int power_of(const std::string& id) { return find_filter(id)->holds == Held::covariance ? 2 : 1; }

/// The measurements of dyer-mcreynolds, of a state drawn at random, with a random prior: so that each draw rounds
/// another Re, which the draws of y alone would not.
struct Measured {
  properties::System system;
  Matrix<double> y;
};
Measured draw(Random& random, double d) {
  const Matrix<double> I = Matrix<double>::Identity(3, 3), C{{1., 1., 1.}, {1., 1., 1. + d}};
  Matrix<double> S0(3, 3);
  copy_lower(round_to(random_normal(random, 3, 3), 8), S0);
  S0.diagonal() = S0.diagonal().cwiseAbs() + Vector<double>::Ones(3);
  auto system =
      system_of("dyer-mcreynolds", I, Matrix<double>::Zero(3, 1), C, d * Matrix<double>::Identity(2, 2), S0, 1);
  system.x0 = random_normal(random, 3, 1) / 2;
  const Matrix<double> y = C * random_normal(random, 3, 1) + d * random_normal(random, 2, 1);
  system.data = std::make_shared<properties::Recorded>(y, Matrix<double>(0, 1));
  return {std::move(system), y};
}

Findings measure(const Settings& set) {
  const int frames = static_cast<int>(set("frames"));
  Random random(static_cast<std::uint64_t>(set("seed")));
  std::map<std::string, Ladder> errors;
  std::size_t rung = 0;
  for (int j = 4; j <= static_cast<int>(set("finest")); j += 2, ++rung)
    for (int f = 0; f < frames && going_on(); ++f) {
      const auto [system, measured] = draw(random, std::exp2(-j));
      const Vector<double> y = measured.col(0);
      for (const auto form : {Parametrisation::covariance, Parametrisation::root, Parametrisation::information}) {
        const auto problem = problem_of(system, form);
        reference::Trajectory truth(problem, system.data);
        truth.advance();
        for (const std::string& id : studied()) {
          if (find_filter(id)->takes != form) continue;
          const auto filter = make_filter<double>(id);
          filter->start(problem);
          const auto step = filter->step(0, &y, nullptr);
          errors[id].add(rung, std::exp2(j), step.report ? truth.measure(filter->metadata(), step).state : infinity);
        }
      }
    }

  Findings findings;
  for (const std::string& id : studied())
    findings.checks.push_back(check_slope(fmt::format("{}: slope of the error of x in 1/d", id), power_of(id),
                                          errors[id].power(2e-15, 1e-2), .15));

  reports::Figure figure;
  figure.id = "state-estimate";
  figure.title = "The estimate loses what the gain loses";
  figure.caption = fmt::format(
      "Does the estimate itself suffer, or P alone? Relative error of x after one update with two measurements that "
      "differ by d and have noise d. What holds P loses (1/d)^2, what holds a root 1/d (dashed), as their gains do. "
      "Medians of {} random states and measurements, thin lines the quartiles; a curve ends where its filter breaks "
      "down.",
      frames);
  figure.x = {"1/d", true};
  figure.y = {"relative error of x", true};
  for (const char* id : {"ckf", "ckf-textbook", "joseph", "srcf", "srif"}) add_curves(figure, errors[id], id);
  for (const int power : {1, 2}) {
    auto line = theory_line(fmt::format("theory-{}", power), power == 1 ? "theory: u/d" : "theory: u/d^2");
    for (const double x : errors["srcf"].difficulties())
      if (const double y = u * std::pow(x, power); y <= 1) add_point(line, x, y);
    figure.curves.push_back(std::move(line));
  }
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "state-estimate",
      .number = 12,
      .title = "What is lost in the gain is lost in the estimate",
      .statement =
          "On two nearly equal, accurate measurements the relative error of x grows as the square of 1/d where P is "
          "held, Joseph's form included, and as 1/d in srcf and srif.",
      .source = "derived here, after Verhaegen and Van Dooren (1986), theory (3.3), (4.1)-(4.3), (6.1)",
      .setup =
          "The measurements of dyer-mcreynolds, C = [1 1 1; 1 1 1+d], R = d^2 I, d = 2^-4 ... 2^-50, A = I, B = 0; "
          "one step; P0 = S0 S0', S0 random, x0 and the true state random, y = C x + d v; medians of 30 draws.",
      .prediction =
          "Slope in 1/d 2 for what holds P and 1 for srcf and srif, within .15, fitted where the median error is "
          "between 2e-15 and 1e-2.",
      .meaning =
          "It is not the covariance alone, which nobody may look at: with nearly dependent, accurate measurements "
          "the estimate of a filter that holds P has half the digits.",
      .parameters = {{"finest", 50, "least d, as a power of 1/2", 26, 52},
                     {"frames", 30, "random draws at each d", 5, 1000},
                     {"seed", 1, "seed of the random draws", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "dx+ = F dx + dK (y - C x)\n"
          "P held:  ||dK|| <= c u k(Re) ||K||\n"
          "S held:  ||dK|| <= c u/s_p ((s_1/s_p) ||S+|| + s_1 ||G|| + ||S+||/cos)\n"
          "k(Re) = (s_1/s_p)^2 ~ 1/d^2"};
}

}  // namespace kfstab::experiments::claims::state_estimate
