#include <cmath>
#include <map>

#include <fmt/core.h>
#include <boost/random/uniform_real_distribution.hpp>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/ladder.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/reference/trajectory.hpp>

namespace kfstab::experiments::claims::post_array_angle {
namespace {

/// A number between 1/2 and 2 times `size`, of 20 bits, so that its square is a double.
Matrix<double> generic(Random& random, double size) {
  boost::random::uniform_real_distribution<double> factor(.5, 2);
  int exponent = 0;
  const double mantissa = std::frexp(size * factor(random), &exponent);
  return Matrix<double>{{std::ldexp(std::round(std::ldexp(mantissa, 20)), exponent - 20)}};
}

/// S+ of [r s; 0 a s] by a rotation of its two columns, which forms a s (r/h), h = (r^2 + s^2)^{1/2}: nothing is
/// subtracted.
Matrix<double> rotated(double a, double r, double s) {
  const double h = std::sqrt(r * r + s * s);
  return Matrix<double>{{r / h * (a * s)}};
}

constexpr const char* givens = "by a rotation";

/// 1: loses 1/cos. 2: 1/cos^2. 0: nothing.
int predicted_slope(const Metadata& metadata) {
  if (metadata.id == "joseph") return 0;
  return metadata.holds == Held::covariance ? 2 : 1;
}

std::vector<std::string> studied() {
  std::vector<std::string> ids;
  for (const Metadata& metadata : filters())
    if (metadata.holds == Held::covariance) ids.emplace_back(metadata.id);
  ids.emplace_back("srcf");
  return ids;
}

Findings measure(const Settings& set) {
  const int frames = static_cast<int>(set("frames"));
  Random random(static_cast<std::uint64_t>(set("seed")));
  std::map<std::string, Ladder> errors;
  std::size_t rung = 0;
  for (double decade = 0; decade <= set("decades"); decade += .5, ++rung)
    for (int f = 0; f < frames && going_on(); ++f) {
      const Matrix<double> a = generic(random, 1), s = generic(random, 1), r = generic(random, std::pow(10., -decade));
      const auto system = system_of("scalar", a, Matrix<double>::Zero(1, 1), Matrix<double>::Identity(1, 1), r, s, 1);
      for (const auto form : {Parametrisation::covariance, Parametrisation::root}) {
        const auto problem = problem_of(system, form);
        reference::Trajectory truth(problem, nullptr);
        truth.advance();
        const double difficulty = 1 / truth.truth().cosine;
        for (const std::string& id : studied()) {
          if (find_filter(id)->takes != form) continue;
          const auto filter = make_filter<double>(id);
          filter->start(problem);
          const auto step = filter->step(0, nullptr, nullptr);
          errors[id].add(rung, difficulty, step.report ? truth.measure(filter->metadata(), step).covariance : infinity);
          if (id != "srcf") continue;
          const Matrix<double> S = rotated(a(0, 0), r(0, 0), s(0, 0));
          auto by_rotation = step;
          by_rotation.held = &S;
          errors[givens].add(rung, difficulty, truth.measure(filter->metadata(), by_rotation).covariance);
        }
      }
    }

  Findings findings;
  for (const std::string& id : studied()) {
    const int slope = predicted_slope(*find_filter(id));
    if (slope > 0)
      findings.checks.push_back(check_slope(fmt::format("{}: slope of the error of P in 1/cos", id), slope,
                                            errors[id].power(2e-15, 1e-2), slope == 2 ? .15 : .1));
    else
      findings.checks.push_back(
          check_at_most(fmt::format("{}: growth of the error of P", id), 10, errors[id].growth(),
                        "a sum of squares loses nothing; medians of random draws scatter by a few"));
  }
  findings.checks.push_back(check_at_most("srcf by a rotation instead of a reflector: growth of the error of P", 10,
                                          errors[givens].growth(),
                                          "nothing is subtracted; medians of random draws scatter by a few"));

  reports::Figure figure;
  figure.id = "post-array-angle";
  figure.title = "A measurement that is much better than the prior";
  figure.caption = fmt::format(
      "What does one step lose, if it leaves little of the prior (R = r^2, r from 1 down to 1e-{:g})? One state, one "
      "output, no process noise; cos^2 = ||P+|| / ||A P A'||. A downdate of P loses 1/cos^2, the reflectors of the "
      "square-root filter 1/cos, rotations and Joseph's form nothing. Medians of {} random draws, thin lines the "
      "quartiles; dashed: u/cos and u/cos^2.",
      set("decades"), frames);
  figure.x = {"1 / cos", true};
  figure.y = {"relative error of P after one step", true};
  for (const char* id : {"ckf", "ckf-textbook", "joseph", "srcf"}) add_curves(figure, errors[id], id);
  auto rotation = measured_points("givens", "srcf by a rotation", "svd");
  rotation.x = errors[givens].difficulties();
  rotation.y = errors[givens].medians();
  figure.curves.push_back(std::move(rotation));
  for (const int power : {1, 2}) {
    auto line = theory_line(fmt::format("theory-{}", power), power == 1 ? "theory: u/cos" : "theory: u/cos^2");
    for (const double x : errors["srcf"].difficulties()) add_point(line, x, u * std::pow(x, power));
    figure.curves.push_back(std::move(line));
  }
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {.id = "post-array-angle",
          .number = 10,
          .title = "A step that leaves little of P loses digits by a subtraction",
          .statement =
              "One step loses 1/cos in the square-root filter by reflectors and 1/cos^2 where P is downdated, cos^2 "
              "= ||P+|| / ||A P A' + B Q B'||; Joseph's form and a square-root filter by rotations lose nothing.",
          .source = "derived here, after Verhaegen and Van Dooren (1986), theory (4.1), (4.2)",
          .setup =
              "n = p = 1, B = 0, C = 1, A and S0 random in (.5, 2), R^1/2 in (.5, 2) times 1 ... 1e-5, numbers of 20 "
              "bits; one step, error of P; medians of random draws.",
          .prediction =
              "Slope in 1/cos 2 (within .15) for ckf and its codings, 1 (within .1) for srcf, fitted where the "
              "median error is between 2e-15 and 1e-2; no growth for Joseph's form and for rotations.",
          .meaning =
              "A first accurate measurement after a vague prior is where a downdated P loses most. Joseph's form or "
              "a root costs little there.",
          .parameters = {{"decades", 5, "largest 1/cos, as a power of ten", 4, 7},
                         {"frames", 100, "random draws at each size of R", 10, 10000},
                         {"seed", 1, "seed of the random draws", 0, 1e15}},
          .measure = measure,
          .mathematics =
              "P held:  ||dP|| <= c u k(Re) ||P+|| / cos^2\n"
              "S held:  ||dS|| <= c u (1 + k(Re)^{1/2}) ||S+|| / cos\n"
              "cos^2 = ||P+|| / (||A P A' + B Q B'||)\n"
              "n = p = 1,  B = 0,  C = 1:  k(Re) = 1,  cos^2 = R / (P + R)"};
}

}  // namespace kfstab::experiments::claims::post_array_angle
