#include <algorithm>
#include <cmath>
#include <map>
#include <memory>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/reference/trajectory.hpp>

namespace kfstab::experiments::claims::dyer_mcreynolds {
namespace {

/// Two measurements that differ by d, with noise d: every number is exact for d a power of two.
properties::System system_at(double d, std::int64_t steps) {
  Matrix<double> C(2, 3);
  C << 1, 1, 1, 1, 1, 1 + d;
  const auto I = Matrix<double>::Identity(3, 3);
  return system_of("dyer-mcreynolds", I, Matrix<double>::Zero(3, 1), C, d * Matrix<double>::Identity(2, 2), I, steps);
}

/// P+ of the first step in closed form.
Matrix<double> first_covariance(double d) {
  Matrix<double> P(3, 3);
  const double a = 5 + 2 * d * (1 + d), b = -2 - d;
  P << a, -3, b, -3, a, b, b, b, 4 + d * d;
  return P / (8 + 2 * d * (1 + d));
}

/// K = Kf of the first step in closed form.
Matrix<double> first_gain(double d) {
  Matrix<double> K(3, 2);
  K << 2 * d + 1, d - 1, 2 * d + 1, d - 1, d - 2, d * d + d + 2;
  return K / (2 * d * (d * d + d + 4));
}

/// What holds P, and the two roots. Of what other factors lose here the claim scalar-roots speaks.
bool is_studied(const Metadata& metadata) {
  return metadata.holds == Held::covariance || metadata.id == "srcf" || metadata.id == "srif";
}

struct Fate {
  double error = 0;        ///< worst relative error of P
  double information = 0;  ///< worst relative error of T'T, for one that holds T
  bool failed = false;     ///< error > .1, breakdown, or not positive definite
};

/// All that are studied through all steps at one d; `closed_form` takes the larger of the reference's distances from it.
std::map<std::string, Fate> fates(double d, std::int64_t steps, double& closed_form) {
  std::map<std::string, Fate> result;
  const auto system = system_at(d, steps);
  for (const auto form : {Parametrisation::covariance, Parametrisation::root, Parametrisation::information}) {
    const auto problem = problem_of(system, form);
    reference::Trajectory truth(problem, nullptr);
    std::vector<std::unique_ptr<AnyFilter<double>>> running;
    for (const Metadata& metadata : filters())
      if (metadata.takes == form && is_studied(metadata)) {
        running.push_back(make_filter<double>(metadata.id));
        running.back()->start(problem);
      }
    for (std::int64_t k = 0; k < steps; ++k) {
      truth.advance();
      if (k == 0) {
        const Matrix<double> P = first_covariance(d), K = first_gain(d);
        closed_form = std::max({closed_form, (truth.truth().P_next - P).norm() / P.norm(),
                                (truth.truth().filter_gain - K).norm() / K.norm()});
      }
      for (auto& filter : running) {
        Fate& fate = result[std::string(filter->metadata().id)];
        const auto step = filter->step(k, nullptr, nullptr);
        if (!step.report) {
          fate.failed = true;
          continue;
        }
        const auto errors = truth.measure(filter->metadata(), step);
        if (!(errors.covariance <= fate.error)) fate.error = errors.covariance;
        if (!(errors.information <= fate.information)) fate.information = errors.information;
        if (!(errors.covariance <= .1) || !errors.positive_semidefinite) fate.failed = true;
      }
    }
  }
  return result;
}

Findings measure(const Settings& set) {
  const auto steps = static_cast<std::int64_t>(set("steps"));
  std::vector<int> exponents;
  for (int j = 4; j <= 52; j += 2) exponents.push_back(j);

  double closed_form = 0;
  std::map<int, std::map<std::string, Fate>> table;
  for (const int j : exponents) {
    going_on();
    table[j] = fates(std::exp2(-j), steps, closed_form);
  }

  Findings findings;
  findings.checks.push_back(check_at_most(
      "reference: distance of P+ and Kf of the first step from the closed form, relative", 32 * 0x1p-53, closed_form,
      "both are rounded to double, the closed form after a dozen operations"));

  const auto first_failure = [&](const std::string& id) {
    for (const auto& [j, row] : table)
      if (row.at(id).failed) return static_cast<double>(j);
    return NaN;
  };
  for (const Metadata& metadata : filters()) {
    if (!is_studied(metadata)) continue;
    const std::string id(metadata.id);
    if (metadata.holds == Held::covariance) {
      bool always = true;
      for (const auto& [j, row] : table)
        if (j >= 26) always = always && row.at(id).failed;
      findings.checks.push_back({fmt::format("{}: fails at every d <= 2^-26 (1: yes)", id), 1, always ? 1. : 0.,
                                 "error above .1, breakdown or an exactly indefinite P, once d^2 < 4u", always});
      findings.checks.push_back(check_at_least(fmt::format("{}: j of the largest d = 2^-j at which it fails", id), 17,
                                               first_failure(id), "none at d >= 2^-16"));
    } else {
      std::vector<double> x, y;
      for (const auto& [j, row] : table)
        if (!row.at(id).failed) {
          x.push_back(std::exp2(j));
          y.push_back(row.at(id).error);
        }
      findings.checks.push_back(check_slope(fmt::format("{}: slope of the error of P in 1/d", id), 1,
                                            fit_power(x, y, 1e-14, 1e-2), .15));
      const double j = first_failure(id);
      findings.checks.push_back({fmt::format("{}: j of the largest d = 2^-j at which it fails", id), 48, j,
                                 "from 46 to 50: error of size u/d", j >= 46 && j <= 50});
      if (metadata.holds == Held::information_factor) {
        double worst = 0;
        for (const auto& [exponent, row] : table)
          if (!row.at(id).failed) worst = std::max(worst, row.at(id).information);
        findings.checks.push_back(check_at_most(fmt::format("{}: worst error of what it holds, T'T", id), 1e-14, worst,
                                                "rounding level at every d: only turning T into P costs digits"));
      }
    }
  }

  reports::Figure figure;
  figure.id = "dyer-mcreynolds-error";
  figure.title = "Two nearly equal, accurate measurements";
  figure.caption = fmt::format(
      "Worst relative error of P in {} steps when two measurements differ by d and have noise d. What holds P loses (1/d)^2 and fails near d = "
      "u^1/2, halfway; what holds a root loses 1/d. A curve ends where its filter breaks down.", steps);
  figure.x = {"1/d", true};
  figure.y = {"worst relative error of P", true};
  for (const Metadata& metadata : filters()) {
    if (!is_studied(metadata)) continue;
    const std::string id(metadata.id);
    reports::Curve curve{id, id, {}, {}, reports::CurveRole::measured_line, color_of(id)};
    for (const auto& [j, row] : table) {
      curve.x.push_back(std::exp2(j));
      const double error = row.at(id).error;
      curve.y.push_back(error > 0 ? error : NaN);
    }
    figure.curves.push_back(std::move(curve));
  }
  for (const int power : {1, 2}) {
    reports::Curve line{fmt::format("theory-{}", power), power == 1 ? "theory: u/d" : "theory: u/d^2", {}, {},
                        reports::CurveRole::theory, -1};
    for (const int j : exponents) {
      const double y = 0x1p-53 * std::exp2(power * j);
      if (y > 1) break;
      line.x.push_back(std::exp2(j));
      line.y.push_back(y);
    }
    figure.curves.push_back(std::move(line));
  }
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {.id = "dyer-mcreynolds",
          .number = 11,
          .title = "Two nearly equal, accurate measurements break every filter that holds P",
          .statement = "With C = [1 1 1; 1 1 1+d] and R = d^2 I every filter that holds P, Joseph's too, has failed at d = "
                       "2^-26, near the square root of u; filters that hold a root go on to d near u itself.",
          .source = "Dyer and McReynolds, J. Optim. Theory Appl. 3 (1969); closed forms derived here, theory (6.1)",
          .setup = "P0 = I, A = I, B = 0, d = 2^-4 ... 2^-52, all numbers exact. A filter fails when its error of P exceeds "
                   ".1, it breaks down, or its P is exactly not positive semidefinite.",
          .prediction = "Error u/d^2 for what holds P, u/d for srcf and for P from srif (slope 1 within .15), which fail between "
                        "d = 2^-46 and 2^-50; T'T of srif stays at rounding level.",
          .meaning = "Half of the digits are gone before the first of a square-root filter's: the classic reason to hold a "
                     "root.",
          .parameters = {{"steps", 20, "number of steps", 1, 1000}},
          .measure = measure,
          .mathematics = "C = [1, 1, 1; 1, 1, 1+d],  R = d^2 I\n"
                         "P_k = (I + k C'C / d^2)^{-1}\n"
                         "k(Re) -> 4.5 / d^2"};
}

}  // namespace kfstab::experiments::claims::dyer_mcreynolds
