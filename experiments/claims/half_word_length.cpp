#include <cmath>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/traces.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/filters/square_root_covariance.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::experiments::claims::half_word_length {
namespace {

using reference::Errors;

/// The worst error of P of a square-root filter in single precision: an S of floats is an S of doubles too.
double worst_in_single_precision(const properties::System& system) {
  const auto any = problem_of(system, Parametrisation::root);
  const auto& problem = std::get<Problem<RootModel<double>>>(any);
  const auto& model = problem.models.front();
  RootModel<float> single;
  single.A = model.A.cast<float>();
  single.B = model.B.cast<float>();
  single.C = model.C.cast<float>();
  single.D = model.D.cast<float>();
  single.Q_root = model.Q_root.cast<float>();
  single.R_root = model.R_root.cast<float>();
  SquareRootCovarianceFilter<float> filter(model.dimensions());
  filter.start(problem.initial.cast<float>(), problem.x0.cast<float>());

  const Metadata& metadata = *find_filter("srcf");
  reference::Trajectory truth(any, nullptr);
  Trace trace;
  for (std::int64_t k = 0; k < system.steps; ++k) {
    truth.advance();
    if (!filter.step(single)) return infinity;
    const Matrix<double> S = filter.factor().cast<double>();
    trace.errors.push_back(truth.measure(metadata, {.report = {}, .held = &S}));
  }
  return trace.worst(&Errors::covariance);
}

/// At one size of the prior.
struct Rung {
  double alpha;
  double conventional, single, root;  ///< medians of the worst errors of P: ckf, srcf in float, srcf
  double lost;                        ///< part of the systems on which ckf's P was not definite
};

Rung rung(double alpha, const Settings& set) {
  const Index n = 3;
  std::vector<double> conventional, single, root;
  int lost = 0, systems = 0;
  for (; systems < static_cast<int>(set("systems")) && going_on(); ++systems) {
    // The same systems at every alpha. Ten bits: exact in float, and so are S0 S0' and B Q B' in double.
    Random random(static_cast<std::uint64_t>(set("seed")) + static_cast<std::uint64_t>(systems));
    Matrix<double> A = random_normal(random, n, n);
    A = round_to(A * (set("rho") / reference::spectral_radius(A)), 9);
    const Matrix<double> B = round_to(.5 * random_normal(random, n, 1), 9),
                         C = round_to(random_normal(random, 1, n), 9);
    Matrix<double> S0 = random_normal(random, n, n).triangularView<Eigen::Lower>();
    S0 = round_to(S0 + 1.5 * Matrix<double>::Identity(n, n), 9);
    const auto system = system_of("ten-bits", A, B, C, Matrix<double>::Identity(1, 1), std::sqrt(alpha) * S0,
                                  static_cast<std::int64_t>(set("steps")));
    const auto traced = traces(system, {"ckf", "srcf"});
    conventional.push_back(traced.at("ckf").worst(&Errors::covariance));
    root.push_back(traced.at("srcf").worst(&Errors::covariance));
    single.push_back(worst_in_single_precision(system));
    lost += traced.at("ckf").lost_definiteness();
  }
  return {alpha, median(conventional), median(single), median(root), static_cast<double>(lost) / systems};
}

Findings measure(const Settings& set) {
  std::vector<Rung> ladder;
  for (int exponent = 0; exponent <= 60 && going_on(); exponent += exponent < 40 ? 4 : 2)
    ladder.push_back(rung(std::exp2(exponent), set));
  const auto column = [&](double Rung::*of) {
    std::vector<double> values;
    for (const Rung& r : ladder) values.push_back(r.*of);
    return values;
  };
  const auto alphas = column(&Rung::alpha);
  /// log2 of the first alpha at which a value reaches a limit.
  const auto passes = [&](double Rung::*of, double limit) {
    for (const Rung& r : ladder)
      if (r.*of >= limit) return std::log2(r.alpha);
    return NaN;
  };

  const double u_single = unit_roundoff<float>();
  Findings findings;
  findings.checks.push_back(check_slope("ckf in double: slope of the error of P in alpha", 1,
                                        fit_power(alphas, column(&Rung::conventional), 1e-14, .1), .1));
  findings.checks.push_back(check_slope("srcf in float: slope of the error of P in alpha", .5,
                                        fit_power(alphas, column(&Rung::single), 1e-14 * u_single / u, .1),
                                        .08));
  findings.checks.push_back(check_within("ckf in double: log2 of the alpha at which its error passes .5", 49,
                                         passes(&Rung::conventional, .5), 5));
  findings.checks.push_back(
      check_within("srcf in float: log2 of the alpha at which its error passes .5", 49, passes(&Rung::single, .5), 5));
  findings.checks.push_back(check_within("ckf in double: log2 of the alpha at which half of its runs are indefinite",
                                         49, passes(&Rung::lost, .5), 5));
  for (const Rung& r : ladder)
    if (r.alpha == 0x1p20)
      findings.checks.push_back(check_within("log10 of srcf's error in float over ckf's in double, at alpha = 2^20",
                                             std::log10(u_single * 0x1p10 / (u * 0x1p20)),
                                             std::log10(r.single / r.conventional), 1));

  reports::Figure figure;
  figure.id = "half-word-length-error";
  figure.title = "A root in single precision breaks down where P in double does, and is less accurate before";
  figure.caption = fmt::format(
      "Does a square root halve the word length that a filter needs? Worst relative error of P in {:g} steps, medians "
      "of {:g} random systems, from P0 = alpha S0 S0'. Held as P in double, the error is u alpha; held as S in single "
      "precision, 2^-24 alpha^1/2: the two meet where nothing is left of either (about 2^50), and left of that P in "
      "double is better by up to nine digits.",
      set("steps"), set("systems"));
  figure.x = {"alpha, size of the prior", true};
  figure.y = {"worst relative error of P, median", true};
  auto curve = measured("ckf", alphas, column(&Rung::conventional));
  curve.label = "ckf, double";
  figure.curves.push_back(curve);
  curve = measured("srcf", alphas, column(&Rung::root));
  curve.label = "srcf, double";
  figure.curves.push_back(curve);
  figure.curves.push_back({"srcf-single", "srcf, single", alphas, column(&Rung::single),
                           reports::CurveRole::measured_points, color_of("joseph")});
  figure.curves.push_back(theory_line("theory-double", "theory: u alpha", alphas, [&](double a) { return u * a; }));
  figure.curves.push_back(theory_line("theory-single", "theory: 2^-24 alpha^1/2", alphas,
                                      [&](double a) { return u_single * std::sqrt(a); }));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "half-word-length",
      .number = 15,
      .title = "A root in single precision lasts as long as P in double, and is not as accurate",
      .statement =
          "`A square-root filter needs half the word length` is true of breakdown alone: S in single precision and P "
          "in double come to their end at the same size of the prior. Before that, P in double is more accurate.",
      .source = "derived here, after Verhaegen and Van Dooren (1986), theory (4.1), (4.2)",
      .setup =
          "n = 3, m = p = 1, random data of ten bits, rho(A) = 1.02, R = 1, P0 = alpha S0 S0', alpha = 2^0 ... 2^60; "
          "medians over the systems of the worst of the first steps; the same systems at every alpha.",
      .prediction =
          "Error u alpha of ckf in double (slope 1 within .1), 2^-24 alpha^1/2 of srcf in float (slope 1/2 within "
          ".08): both pass .5 between 2^44 and 2^54. At 2^20 ckf in double is better by 2^19, within a factor of ten.",
      .meaning = "A square-root filter in single precision is a remedy against breakdown, not a substitute for double.",
      .parameters = {{"systems", 20, "random systems at each alpha", 5, 1000, 15},
                     {"steps", 30, "number of steps", 5, 1000},
                     {"rho", 1.02, "spectral radius of A before it is rounded", .5, 1.2},
                     {"seed", 1, "seed of the first random system", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "P held:  ||dP|| <= c u k(Re) ||P+|| / cos^2,  u = 2^-53\n"
          "S held:  ||dS|| <= c u (1 + k(Re)^{1/2}) ||S+|| / cos,  u = 2^-24\n"
          "P0 = alpha S0 S0',  p = 1:  k(Re) = 1,  1/cos^2 ~ alpha\n"
          "2^-53 alpha = .5  at alpha = 2^52,  2^-24 alpha^{1/2} = .5  at alpha = 2^46"};
}

}  // namespace kfstab::experiments::claims::half_word_length
