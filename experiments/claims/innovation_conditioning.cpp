#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/reference/trajectory.hpp>

namespace kfstab::experiments::claims::innovation_conditioning {
namespace {

const std::vector<std::string> studied = {"ckf", "ckf-textbook", "joseph", "srcf"};

/// The errors of one step of each filter, on one system.
struct OneStep {
  double condition;  ///< of Re^{1/2}
  std::map<std::string, double> gain, covariance;
};

/// gain_scale: what the columns of both gains are multiplied with before they are compared, or empty.
OneStep one_step(const properties::System& system, const Vector<double>& gain_scale = {}) {
  OneStep result{};
  for (const auto form : {Parametrisation::covariance, Parametrisation::root}) {
    const auto problem = problem_of(system, form);
    reference::Trajectory truth(problem, nullptr);
    truth.advance();
    result.condition = std::sqrt(truth.truth().innovation_condition);
    for (const std::string& id : studied) {
      if (find_filter(id)->takes != form) continue;
      const auto filter = make_filter<double>(id);
      filter->start(problem);
      const auto step = filter->step(0, nullptr, nullptr);
      if (!step.report) {
        result.gain[id] = result.covariance[id] = infinity;
        continue;
      }
      const auto errors = truth.measure(filter->metadata(), step);
      result.covariance[id] = errors.covariance;
      result.gain[id] = errors.gain;
      if (gain_scale.size() > 0) {
        const auto& exact = filter->metadata().gain == GainKind::predictor ? truth.truth().predictor_gain
                                                                           : truth.truth().filter_gain;
        // In double: this control looks at errors far above what rounding the true gain to double can do.
        result.gain[id] = ((*step.gain - exact) * gain_scale.asDiagonal()).norm() / (exact * gain_scale.asDiagonal()).norm();
      }
    }
  }
  return result;
}

/// Medians over the frames of one rung of the ladder.
struct Rung {
  double condition;
  std::map<std::string, double> gain, covariance;
};

template <class Draw>
Rung medians(int frames, Draw draw) {
  std::vector<double> conditions;
  std::map<std::string, std::vector<double>> gains, covariances;
  for (int f = 0; f < frames && going_on(); ++f) {
    const OneStep one = draw();
    conditions.push_back(one.condition);
    for (const auto& id : studied) {
      gains[id].push_back(one.gain.at(id));
      covariances[id].push_back(one.covariance.at(id));
    }
  }
  Rung rung{median(conditions), {}, {}};
  for (const auto& id : studied) {
    rung.gain[id] = median(gains[id]);
    rung.covariance[id] = median(covariances[id]);
  }
  return rung;
}

reports::Curve curve_of(const std::vector<Rung>& rungs, const std::string& id, std::map<std::string, double> Rung::*of,
                        reports::CurveRole role = reports::CurveRole::measured_points) {
  reports::Curve curve{id, id, {}, {}, role, color_of(id)};
  for (const Rung& rung : rungs) {
    curve.x.push_back(rung.condition);
    curve.y.push_back((rung.*of).at(id));
  }
  return curve;
}

/// u k^power, up to where nothing is left.
reports::Curve theory(const std::vector<Rung>& rungs, int power) {
  reports::Curve line{fmt::format("theory-{}", power), power == 2 ? "theory: u k^2" : "theory: u k", {}, {},
                      reports::CurveRole::theory, -1};
  for (const Rung& rung : rungs) {
    const double y = u * std::pow(rung.condition, power);
    if (y > 10) break;
    line.x.push_back(rung.condition);
    line.y.push_back(y);
  }
  return line;
}

Findings measure(const Settings& set) {
  const Index n = 5, p = 3, m = 2;
  const int frames = static_cast<int>(set("frames"));
  Random random(static_cast<std::uint64_t>(set("seed")));

  std::vector<Rung> ladder, control;
  for (double c = 0; c <= set("decades"); c += .25) {
    const double k = std::pow(10., c);
    ladder.push_back(medians(frames, [&] {
      Matrix<double> spectrum = Matrix<double>::Zero(p, n);
      for (Index i = 0; i < p; ++i) spectrum(i, i) = std::pow(k, -.5 * static_cast<double>(i));
      const Matrix<double> C = random_orthogonal(random, p) * spectrum * random_orthogonal(random, n).transpose();
      const double root = std::exp2(std::round(std::log2(.5 / k)));
      return one_step(system_of("ladder", round_to(random_normal(random, n, n), 18),
                                round_to(random_normal(random, n, m), 18), C, root * Matrix<double>::Identity(p, p),
                                Matrix<double>::Identity(n, n), 1));
    }));
    // The same condition number by units alone: the last measurement, its noise with it, in units 1/k as large.
    control.push_back(medians(frames, [&] {
      Vector<double> units = Vector<double>::Ones(p);
      units(p - 1) = std::exp2(-std::round(std::log2(k)));
      const Matrix<double> C = units.asDiagonal() * round_to(random_normal(random, p, n), 18);
      return one_step(system_of("units", round_to(random_normal(random, n, n), 18),
                                round_to(random_normal(random, n, m), 18), C, Matrix<double>(units.asDiagonal()),
                                Matrix<double>::Identity(n, n), 1),
                      units);
    }));
  }

  Findings findings;
  const double low = 2e-15, high = 1e-2;
  std::vector<double> conditions;
  for (const Rung& rung : ladder) conditions.push_back(rung.condition);
  for (const auto& id : studied) {
    const bool root = id == "srcf";
    for (const auto& [what, of] : {std::pair{"K", &Rung::gain}, {"P", &Rung::covariance}}) {
      if (id == "joseph" && std::string(what) == "P") continue;
      const auto line = fit_power(conditions, curve_of(ladder, id, of).y, low, high);
      findings.checks.push_back(check_slope(fmt::format("{}: slope of the error of {} in k(Re^1/2)", id, what),
                                            root ? 1 : 2, line, root ? .1 : .15));
    }
    const auto grown = curve_of(control, id, &Rung::gain).y;
    const auto grown_P = curve_of(control, id, &Rung::covariance).y;
    double worst = 0;
    for (std::size_t i = 0; i < grown.size(); ++i)
      worst = std::max({worst, grown[i] / grown.front(), grown_P[i] / grown_P.front()});
    findings.checks.push_back(check_at_most(fmt::format("{}: growth of the errors when units alone make Re ill conditioned", id),
                                            10, worst, "units are no loss; medians of random frames scatter by a few"));
  }
  // Joseph's P against the conventional one, where both are above their floors.
  std::vector<double> ratios;
  for (const Rung& rung : ladder)
    if (rung.covariance.at("ckf") > 1e-10 && rung.covariance.at("ckf") < high)
      ratios.push_back(rung.covariance.at("ckf") / rung.covariance.at("joseph"));
  findings.checks.push_back(check_at_least("joseph: how many times smaller its error of P than ckf's, median", 10,
                                           median(ratios), "an error of K enters Joseph's P to second order"));

  reports::Figure figure;
  figure.id = "innovation-conditioning-gain";
  figure.title = "Holding P loses k(Re^1/2) squared, holding S loses it once";
  figure.caption = fmt::format(
      "How many digits of the gain does one step lose when the innovations are nearly dependent? Medians of {} random frames at each "
      "condition number; dashed and dotted, u k^2 and u k.", frames);
  figure.x = {"condition number k of Re^1/2", true};
  figure.y = {"relative error of K after one step", true};
  for (const auto& id : studied) figure.curves.push_back(curve_of(ladder, id, &Rung::gain));
  figure.curves.push_back(theory(ladder, 2));
  figure.curves.push_back(theory(ladder, 1));
  findings.figures.push_back(figure);

  figure.id = "innovation-conditioning-covariance";
  figure.title = "The same for P: Joseph's form repairs P, not the gain";
  figure.caption = fmt::format("How many digits of P does the same step lose? Medians of {} random frames.", frames);
  figure.y = {"relative error of P after one step", true};
  figure.curves.clear();
  for (const auto& id : studied) figure.curves.push_back(curve_of(ladder, id, &Rung::covariance));
  figure.curves.push_back(theory(ladder, 2));
  figure.curves.push_back(theory(ladder, 1));
  findings.figures.push_back(figure);

  figure.id = "innovation-conditioning-units";
  figure.title = "The control: units alone cost nothing";
  figure.caption = fmt::format(
      "Is it the condition number of Re itself? No: when one measurement is merely expressed in other units, Re is as ill conditioned and no "
      "filter loses a digit. Medians of {} random frames; error of K with its columns in the original units.", frames);
  figure.y = {"relative error of K after one step", true};
  figure.curves.clear();
  for (const auto& id : studied) figure.curves.push_back(curve_of(control, id, &Rung::gain));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {.id = "innovation-conditioning",
          .number = 8,
          .title = "Forms that hold P lose the square of the innovations' condition number",
          .statement = "One step of a filter that holds P loses k(Re) = k(Re^1/2)^2 in gain and covariance, Joseph's form no "
                       "less in its gain; the square-root filter loses k(Re^1/2).",
          .source = "derived here, after Verhaegen and Van Dooren (1986), theory (4.1), (4.2)",
          .setup = "n = 5, p = 3, m = 2, P0 = I, C = U diag(1, k^-1/2, 1/k) V' in random frames, R^1/2 = I/(2k) rounded to a "
                   "power of two; one step; medians over the frames. Control: the same condition number by rescaling "
                   "one measurement.",
          .prediction = "Slope 2 (within .15) in k(Re^1/2) for ckf, ckf-textbook and Joseph's gain, 1 (within .1) for srcf, "
                        "fitted where the median error is between 2e-15 and 1e-2; no growth in the control.",
          .meaning = "With accurate, nearly dependent measurements hold a root: it keeps twice as many digits of what is lost. "
                     "Joseph's form saves the covariance, not the gain.",
          .parameters = {{"decades", 7, "largest condition number of Re^1/2, as a power of ten", 4, 7},
                         {"frames", 60, "random frames at each condition number", 5, 1000, 40},
                         {"seed", 1, "seed of the random frames", 0, 1e15}},
          .measure = measure,
          .mathematics = "||dP|| <= c u k(Re) ||P+|| / cos^2\n"
                         "||dK|| <= c u k(Re) ||K||\n"
                         "||dS|| <= c u (1 + k(Re)^{1/2}) ||S+|| / cos"};
}

}  // namespace kfstab::experiments::claims::innovation_conditioning
