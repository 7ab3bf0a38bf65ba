#include <algorithm>
#include <cmath>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/perturbation.hpp>
#include <kfstab/reference/definiteness.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::experiments::claims::non_normal_transient {
namespace {

constexpr std::size_t steps = 100;
/// In the figure, each at every fourth step, so that none hides another.
const std::vector<std::string> shown = {"ckf", "joseph", "srcf", "svd"};

/// A right singular vector of the largest singular value, of unit length, by the power method on X'X.
Vector<double> right_singular_vector(const Matrix<double>& X) {
  Vector<double> v = Vector<double>::Ones(X.cols());
  for (int i = 0; i < 1000; ++i) v = (X.transpose() * (X * v)).normalized();
  return v;
}

Findings measure(const Settings& set) {
  const Matrix<double> A{{.9, set("shear")}, {0., .85}}, C{{0x1p-10, 0.}}, B{{.5, 0.}, {0., .5}}, R_root{{8.}};
  auto system = system_of("sheared", A, B, C, R_root, Matrix<double>::Identity(2, 2), steps);
  const auto limit = reference::steady_state(problem_of(system, Parametrisation::covariance));
  system.P0 = {properties::Covariance::Written::covariance, Matrix<double>((limit.P + limit.P.transpose()) / 2)};

  // ||F^k||^2, and where it is largest.
  std::vector<double> amplification;
  Matrix<double> power = Matrix<double>::Identity(2, 2), at_peak = power;
  std::size_t peak = 0;
  for (std::size_t k = 1; k <= steps; ++k) {
    power = limit.closed_loop * power;
    amplification.push_back(std::pow(reference::two_norm(power), 2));
    if (amplification.back() > amplification[peak]) {
      peak = k - 1;
      at_peak = power;
    }
  }
  const Vector<double> v = right_singular_vector(at_peak);
  const Matrix<double> direction = v * v.transpose();
  const double gamma = reference::two_norm(limit.closed_loop), rho = limit.spectral_radius;
  // What the powers of the norm would promise, in decades over what happens.
  const auto decades = [&](double growth) {
    return 2 * static_cast<double>(peak + 1) * std::log10(gamma) - std::log10(growth);
  };

  Findings findings;
  reports::Figure figure;
  figure.id = "non-normal-transient";
  figure.title = "An error grows before it is forgotten";
  figure.caption = fmt::format(
      "How far does an error of P grow before a stable filter forgets it, and who tells? The closed loop F has "
      "spectral radius {:.3f}, but is far from normal. Points: the difference of two runs of a filter, one from the "
      "steady P, one from P + 1e-6 v v'; dashed: ||F^k||^2, which is right, and ||F||^2k, which is off by {:.0f} "
      "decades at the peak.",
      rho, decades(amplification[peak]));
  figure.x = {"step k", false};
  figure.y = {"growth of the error, ||dP_k|| / ||dP_0||", true};

  double largest_measured = 0;
  for (const Metadata* filter : forgetful_filters()) {
    if (filter->instant != Instant::predicted) continue;  // (I - Kf C) A is not F, and its powers have another peak
    const std::string id(filter->id);
    double worst = 0, decay = NaN, largest = 0;
    bool in_time = true;
    for (const double size : {1e-1, 1e-3, 1e-6, 1e-9}) {
      const auto run = deviations(*filter, system, size * (direction + direction.transpose()) / 2, {}, {});
      std::vector<double> growth;
      for (const Deviation& deviation : run) growth.push_back(deviation.P.norm() / size);
      const auto top = static_cast<std::size_t>(std::ranges::max_element(growth) - growth.begin());
      in_time = in_time && top == peak;
      keep_worst(worst, std::abs(growth[top] / amplification[peak] - 1));
      largest = std::max(largest, growth[top]);
      if (size == 1e-1 && growth.size() >= 60) decay = std::pow(growth[59] / growth[39], 1. / 20);
      const auto drawn = std::ranges::find(shown, id);
      if (size != 1e-6 || drawn == shown.end()) continue;
      auto points = measured_points(id, id, id);
      for (auto k = static_cast<std::size_t>(drawn - shown.begin()); k < growth.size(); k += shown.size())
        if (growth[k] > 1e-3) add_point(points, static_cast<double>(k + 1), growth[k]);
      figure.curves.push_back(std::move(points));
    }
    findings.checks.push_back(
        check_at_most(fmt::format("{}: peak of the growth over max ||F^k||^2 = {:.4g}, worst distance from 1 for "
                                  "errors of 1e-1 ... 1e-9",
                                  id, amplification[peak]),
                      .01, worst, "theory (3.4), the error lies along the singular vector"));
    findings.checks.push_back({fmt::format("{}: the peak is at step {} (1: yes)", id, peak + 1), 1, in_time ? 1. : 0.,
                               "where ||F^k|| is largest", in_time});
    findings.checks.push_back(
        check_close(fmt::format("{}: factor a step from step 40 to 60", id), rho * rho, decay, .01));
    largest_measured = std::max(largest_measured, largest);
  }

  findings.checks.push_back(check_within("decades by which ||F||^2k exceeds the largest peak",
                                         decades(amplification[peak]), decades(largest_measured), .01));

  auto truth = theory_line("theory-powers", "theory: ||F^k||^2"), promise = theory_line("theory-norm", "||F||^2k");
  for (std::size_t k = 0; k < steps; ++k) {
    const double step = static_cast<double>(k + 1);
    add_point(truth, step, amplification[k]);
    if (const double y = std::pow(gamma, 2 * step); y < 1e9 * amplification[peak]) add_point(promise, step, y);
  }
  figure.curves.push_back(std::move(truth));
  figure.curves.push_back(std::move(promise));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {.id = "non-normal-transient",
          .number = 6,
          .title = "A filter far from normal amplifies an error before it forgets it",
          .statement =
              "An error of P grows by max ||F^k||^2 before it decays by rho(F)^2 a step. The spectral radius does "
              "not tell of the growth, and powers of ||F|| exaggerate it by many decades.",
          .source = "derived here, after Verhaegen and Van Dooren (1986), theory (3.4)",
          .setup =
              "A = [.9 20; 0 .85], C = [2^-10 0], B = .5 I, R = 64, from the steady state; dP = e v v', v the right "
              "singular vector of F^k where ||F^k|| is largest, e = 1e-1 ... 1e-9; two runs of one filter.",
          .prediction =
              "Peak of ||dP_k|| / ||dP_0|| equal to max ||F^k||^2 = 3985 within 1 %, at step 8, then a factor of "
              "rho(F)^2 a step within 1 % (steps 40 to 60).",
          .meaning =
              "A stable closed loop is no promise for the next ten steps. Look at the powers of F, not at its norm "
              "nor at its eigenvalues alone.",
          .parameters = {{"shear", 20, "off-diagonal entry of A", 1, 100}},
          .measure = measure,
          .mathematics =
              "dP_k = F^k dP_0 (F^k)'\n"
              "dP_0 = e v v':  max ||dP_k|| = ||dP_0|| max ||F^k||^2\n"
              "||dP_{k+1}|| -> rho(F)^2 ||dP_k||,  ||F^k||^2 <= ||F||^{2k}"};
}

}  // namespace kfstab::experiments::claims::non_normal_transient
