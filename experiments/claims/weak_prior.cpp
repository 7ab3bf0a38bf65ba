#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/ladder.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/traces.hpp>
#include <kfstab/filters/registry.hpp>

namespace kfstab::experiments::claims::weak_prior {
namespace {

using reference::Errors;

/// P0 = 4^j I, exact as S0 too, in a frame drawn at random: rotated coordinates are as good as any, and round otherwise.
properties::System system_in(const Matrix<double>& frame, double prior, std::int64_t steps) {
  const Matrix<double> A{{1., .5, .125}, {0., 1., .5}, {0., 0., .9}}, B{{0.}, {0.}, {.25}}, C{{1., 0., 0.}};
  const Matrix<double> rotated = frame.lazyProduct(A).eval().lazyProduct(frame.transpose());
  return system_of("weak-prior", round_to(rotated, 20), round_to(frame.lazyProduct(B), 20),
                   round_to(C.lazyProduct(frame.transpose()), 20), Matrix<double>{{1.}},
                   std::sqrt(prior) * Matrix<double>::Identity(3, 3), steps);
}

Findings measure(const Settings& set) {
  const auto steps = static_cast<std::int64_t>(set("steps"));
  const int frames = static_cast<int>(set("frames"));
  const auto conventional = filter_ids([](const Metadata& m) { return m.holds == Held::covariance; });
  auto studied = conventional;
  studied.insert(studied.end(), {"srcf", "srif"});

  Random random(static_cast<std::uint64_t>(set("seed")));
  std::vector<Matrix<double>> drawn{Matrix<double>::Identity(3, 3)};  // the model as it is written
  for (int f = 1; f < frames; ++f) drawn.push_back(random_orthogonal(random, 3));

  std::vector<double> priors;
  std::map<std::string, Ladder> errors;
  Ladder information;
  std::map<std::string, double> kept, kept_as_written;  // runs with priors from 2^56 on in which P stays definite
  double runs = 0;
  for (int exponent = 0; exponent <= 80 && going_on(); exponent += 4) {
    const std::size_t rung = priors.size();
    priors.push_back(std::exp2(exponent));
    for (const auto& frame : drawn) {
      if (exponent >= 56) ++runs;
      for (const auto& [id, trace] : traces(system_in(frame, priors.back(), steps), studied)) {
        errors[id].add(rung, priors.back(), trace.worst(&Errors::covariance));
        if (exponent >= 56 && !trace.lost_definiteness()) {
          ++kept[id];
          if (&frame == &drawn.front()) ++kept_as_written[id];
        }
        if (id == "srif") information.add(rung, priors.back(), trace.worst(&Errors::information));
      }
    }
  }
  // First order: where it is above the floor and small.
  const auto slope = [&](const std::string& id, double from, double to) {
    std::vector<double> x, y;
    const auto medians = errors[id].medians();
    for (std::size_t i = 0; i < medians.size(); ++i)
      if (priors[i] >= from && priors[i] <= to) {
        x.push_back(priors[i]);
        y.push_back(medians[i]);
      }
    return fit_power(x, y, 3e-15, 1e-2);
  };

  Findings findings;
  for (const std::string& id : conventional) {
    // (ii) commits the same error, and doubles it a step: theory (3.ii) with |l1 l2| = 1.
    if (find_filter(id)->asymmetry != Asymmetry::mixed)
      findings.checks.push_back(check_slope(fmt::format("{}: slope of the error of P in the prior, 2^16..2^48", id), 1,
                                            slope(id, 0x1p16, 0x1p48), .1));
    findings.checks.push_back(check_at_most(
        fmt::format("{}: priors from 2^56 on at which it stays definite, as the model is written", id), 0,
        kept_as_written[id], "u prior is then beyond R, which P is to be compared with"));
    findings.checks.push_back(check_at_most(
        fmt::format("{}: part of the runs with priors from 2^56 on that stay definite", id), .5, kept[id] / runs,
        "an error larger than P, of either sign: it is definite by chance"));
  }
  for (const char* id : {"srcf", "srif"})
    findings.checks.push_back(check_slope(fmt::format("{}: slope of the error of P in the prior, 2^24..2^80", id), .5,
                                          slope(id, 0x1p24, 0x1p80), .08));
  findings.checks.push_back(check_at_most("srif: error of T'T, worst of all priors", 2e-15,
                                          std::ranges::max(information.medians()),
                                          "rounding level: no condition number of P enters (4.3)"));

  reports::Figure figure;
  figure.id = "weak-prior-error";
  figure.title = "A weak prior costs digits where P is held, half as many where a root is held";
  figure.caption = fmt::format(
      "How much does it cost to start from knowing nothing? Worst relative error in {} steps from P0 = prior times I, "
      "when one measurement has variance 1; medians of {} frames, thin lines the quartiles. Filters that hold P lose "
      "the size of the prior (dashed, u prior), square-root filters its root (u prior^1/2), and what an information filter "
      "holds, T'T, loses nothing. Curves end where half of the runs break down.",
      steps, frames);
  figure.x = {"prior: variance of each state at the start", true};
  figure.y = {"worst relative error of P", true};
  for (const std::string& id : studied) add_curves(figure, errors[id], id);
  figure.curves.push_back({"srif-information", "srif: T'T itself", priors, information.medians(),
                           reports::CurveRole::measured_line, -1});
  figure.curves.push_back(theory_line("theory-1", "theory: u prior", priors, [&](double x) { return u * x; }));
  figure.curves.push_back(
      theory_line("theory-half", "theory: u prior^1/2", priors, [&](double x) { return u * std::sqrt(x); }));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "weak-prior",
      .number = 14,
      .title = "A weak prior costs digits where P is held, half as many where a root is held, none in T",
      .statement =
          "Started from a large P0, filters that hold P lose as many digits as the prior has beyond the measurements, "
          "Joseph's form included, and before it reaches 1/u it is chance whether they stay definite; a square-root filter "
          "loses half as many, "
          "and an information filter none in what it holds.",
      .source = "derived here, after Verhaegen and Van Dooren (1986), theory (4.1)-(4.3)",
      .setup =
          "A = [1 .5 .125; 0 1 .5; 0 0 .9], B = [0; 0; .25], C = [1 0 0], Q = R = 1, P0 = prior I with prior = 2^0 ... "
          "2^80, as it is written and in random orthogonal frames; worst of the first steps, against the reference, median "
          "of the frames. The slope of coding (ii) is not judged: whatever it "
          "commits grows by 2 |l1 l2| = 2 a step, (3.ii).",
      .prediction =
          "k(Re^1/2) does not count with one output, but 1/cos^2 of (4.1) is the prior over R: slope 1 in the prior "
          "(within .1) for what holds P, 1/2 (within .08) for srcf, and for P made from srif's T, fitted where the "
          "error is between 3e-15 and 1e-2; T'T at 2e-15. From 2^56 on P in the directions that were measured, of the size of "
          "R, is less than its error, of either sign: at most half of the runs stay definite, and of the model as it is written "
          "none.",
      .meaning = "Do not start a filter that holds P from 1e12 I to say `unknown`: hold a root, or the information.",
      .parameters = {{"steps", 10, "number of steps", 3, 100},
                     {"frames", 25, "number of frames", 1, 1000, 15},
                     {"seed", 1, "seed of the frames", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "P held:  ||dP|| <= c u k(Re) ||P+|| / cos^2,  cos^2 = ||P+|| / (||A P A' + B Q B'||)\n"
          "S held:  ||dS|| <= c u (1 + k(Re)^{1/2}) ||S+|| / cos\n"
          "P0 = a I,  p = 1:  k(Re) = 1,  1/cos^2 ~ a/R\n"
          "T held:  ||dT|| <= c u (k(A) + k(R^{1/2}) + (t_1/t_m) (k(Q^{1/2}) + k(A))) ||T+|| / cos3"};
}

}  // namespace kfstab::experiments::claims::weak_prior
