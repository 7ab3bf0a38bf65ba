#include <algorithm>
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
#include <kfstab/filters/registry.hpp>
#include <kfstab/reference/trajectory.hpp>

namespace kfstab::experiments::claims::noise_free_modes {
namespace {

/// Position, velocity and a constant acceleration that no noise drives; B is what drives the velocity.
properties::System system_with(double drive, std::int64_t steps) {
  const double h = .125;
  const Matrix<double> A{{1., h, h * h / 2}, {0., 1., h}, {0., 0., 1.}};
  return system_of("noise-free-bias", A, Matrix<double>{{0.}, {drive}, {0.}}, Matrix<double>{{1., 0., 0.}},
                   Matrix<double>::Identity(1, 1), Matrix<double>::Identity(3, 3), steps);
}

const std::vector<std::string> level = {"ckf-textbook", "ckf", "joseph", "srcf"};

/// Errors at the steps that were looked at.
struct Course {
  std::vector<double> step;
  std::map<std::string, std::vector<double>> covariance;
  std::vector<double> chandrasekhar;  ///< error of csrf's gain
  std::vector<double> asymmetry;      ///< ||P - P'|| of ckf-gain

  /// The slope of a curve in the number of steps, from step 300 on.
  Line slope(const std::vector<double>& y) const {
    std::vector<double> x, late;
    for (std::size_t i = 0; i < y.size(); ++i)
      if (step[i] >= 300) {
        x.push_back(step[i]);
        late.push_back(y[i]);
      }
    return fit_power(x, late, 0, infinity);
  }
};

Course course(const properties::System& system) {
  Course course;
  std::int64_t looked = 0;
  for (const auto form : {Parametrisation::covariance, Parametrisation::root}) {
    const auto problem = problem_of(system, form);
    reference::Trajectory truth(problem, nullptr, {.digits = 18});
    std::map<std::string, std::unique_ptr<AnyFilter<double>>> running;
    auto ids = level;
    ids.insert(ids.end(), {"ckf-gain", "csrf"});
    for (const std::string& id : ids)
      if (find_filter(id)->takes == form) (running[id] = make_filter<double>(id))->start(problem);
    const bool first = form == Parametrisation::covariance;
    looked = 0;
    for (std::int64_t k = 0; k < system.steps && going_on(); ++k) {
      truth.advance();
      // Every step at first, then one in fifty of what has passed.
      const bool look = k + 1 >= looked + std::max<std::int64_t>(1, looked / 50) || k + 1 == system.steps;
      if (look) looked = k + 1;
      if (look && first) course.step.push_back(static_cast<double>(k + 1));
      for (auto& [id, filter] : running) {
        const auto step = filter->step(k, nullptr, nullptr);
        if (!look) continue;
        const auto errors = truth.measure(filter->metadata(), step);
        if (id == "csrf")
          course.chandrasekhar.push_back(step.report ? errors.gain : NaN);
        else if (id == "ckf-gain")
          course.asymmetry.push_back((*step.held - step.held->transpose()).norm());
        else
          course.covariance[id].push_back(step.report ? errors.covariance : NaN);
      }
    }
  }
  return course;
}

double largest(const std::vector<double>& y) {
  double most = 0;
  for (const double value : y) most = std::max(most, std::isnan(value) ? infinity : value);
  return most;
}

/// The curve from step 10 on: before, some errors are 0.
reports::Curve late(const std::string& id, const Course& course, const std::vector<double>& y) {
  std::vector<double> x, late;
  for (std::size_t i = 0; i < y.size(); ++i)
    if (course.step[i] >= 10) {
      x.push_back(course.step[i]);
      late.push_back(y[i]);
    }
  return measured(id, std::move(x), std::move(late), reports::CurveRole::measured_line);
}

reports::Curve power_through(const std::string& id, const std::string& label, const Course& course,
                             const std::vector<double>& y, double power) {
  // At the height of the measured curve in the middle: only the slope is predicted.
  const std::size_t middle = course.step.size() / 2;
  std::vector<double> steps;
  for (const double k : course.step)
    if (k >= 10) steps.push_back(k);
  return theory_line(id, label, steps, [&](double k) { return y[middle] * std::pow(k / course.step[middle], power); });
}

Findings measure(const Settings& set) {
  const auto steps = static_cast<std::int64_t>(set("steps"));
  Findings findings;
  reports::Figure figure;
  figure.id = "noise-free-modes-error";
  figure.title = "A bias without noise: most filters stay at rounding level for ever, two do not";
  figure.caption = fmt::format(
      "Does a filter wear out when a state is driven by no noise, so that it is forgotten ever more slowly? Position, "
      "velocity and a constant bias for {} steps. Errors of P, relative, and of the Chandrasekhar filter's gain, which "
      "grows as k; ||P - P'|| of coding (iii) grows as k^2. Dashed: those slopes.",
      steps);
  figure.x = {"step k", true};
  figure.y = {"relative error of P (csrf: of K; ckf-gain: ||P - P'||)", true};

  for (const double drive : {.0625, 0.}) {
    const Course seen = course(system_with(drive, steps));
    const std::string noise = drive > 0 ? "noise drives the velocity" : "no noise at all";
    if (drive > 0) {
      for (const auto& id : level)
        findings.checks.push_back(check_at_most(fmt::format("{}: worst error of P, {}", id, noise), 1e-14,
                                                largest(seen.covariance.at(id)),
                                                "rounding level, however many the steps"));
      findings.checks.push_back(check_slope("ckf-gain: slope of ||P - P'|| in the number of steps, " + noise, 2.1,
                                            seen.slope(seen.asymmetry), .3));
      findings.checks.push_back(check_slope("csrf: slope of the error of K in the number of steps, " + noise, 1,
                                            seen.slope(seen.chandrasekhar), .3));
      for (const auto& id : level) figure.curves.push_back(late(id, seen, seen.covariance.at(id)));
      figure.curves.push_back(late("csrf", seen, seen.chandrasekhar));
      figure.curves.push_back(late("ckf-gain", seen, seen.asymmetry));
      figure.curves.push_back(power_through("theory-2", "theory: slope 2", seen, seen.asymmetry, 2));
      figure.curves.push_back(power_through("theory-1", "theory: slope 1", seen, seen.chandrasekhar, 1));
    } else {
      for (const auto& id : level)
        findings.checks.push_back(check_at_most(fmt::format("{}: worst error of P, {}", id, noise),
                                                static_cast<double>(steps) * u, largest(seen.covariance.at(id)),
                                                "steps u, nothing being forgotten at all"));
      findings.checks.push_back(check_at_most("ckf-gain: slope of ||P - P'|| in the number of steps, " + noise, 2.4,
                                              seen.slope(seen.asymmetry).slope,
                                              "k^2 at most, which directions are sown is rounding's"));
      findings.checks.push_back(check_at_least("csrf: error of K after the last step over that of srcf's P, " + noise,
                                               1e6, seen.chandrasekhar.back() / largest(seen.covariance.at("srcf")),
                                               "an error of the gain is never forgotten, while K itself goes to 0"));
    }
  }
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "noise-free-modes",
      .number = 16,
      .title = "A state without noise wears out coding (iii) and the Chandrasekhar filter, and no other",
      .statement =
          "When a state is driven by no noise its error is forgotten ever more slowly, and yet coding (i), the "
          "symmetric form, Joseph's form and the square-root filter stay at rounding level for thousands of steps. The "
          "asymmetry of coding (iii) grows as k^2, the error of the Chandrasekhar filter's gain as k.",
      .source = "derived here, after Verhaegen and Van Dooren (1986), theory (3.iii), (2.5)",
      .setup = "A = [1 h h^2/2; 0 1 h; 0 0 1], h = 1/8, B = [0; .0625; 0] (and B = 0), C = [1 0 0], Q = R = 1, P0 = I.",
      .prediction =
          "Errors of P at most 1e-14, or steps u without any noise. D+ = A D A' is a Jordan block of size 3: ||D|| as "
          "k^2 (slope 1.8 to 2.4 from step 300 on). csrf's gain as k (within .3).",
      .meaning =
          "Modelling a bias as a state without noise is safe, with a symmetric form or a root; a Chandrasekhar filter "
          "has to be started anew from time to time.",
      .parameters = {{"steps", 4000, "number of steps", 1000, 100000}},
      .measure = measure,
      .mathematics =
          "D+ = A D A' - G D G'  in (iii),  G D G' = 0  for p = 1\n"
          "A = [1, h, h^2/2; 0, 1, h; 0, 0, 1]:  D_k = A^k D_0 (A^k)',  ||D_k|| ~ k^2\n"
          "G_{k+1} Re_{k+1}^{T/2} = G_k Re_k^{T/2} + A L_k Sig L_k' C':  ||dK_k|| ~ k u"};
}

}  // namespace kfstab::experiments::claims::noise_free_modes
