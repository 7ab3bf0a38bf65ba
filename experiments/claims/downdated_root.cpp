#include <cmath>
#include <optional>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/traces.hpp>
#include <kfstab/filters/registry.hpp>

namespace kfstab::experiments::claims::downdated_root {
namespace {

/// S, lower, with S S' := S S' - v v'. Nothing if that is not positive definite. LINPACK's DCHDD, one column at a time.
std::optional<Matrix<double>> downdated(Matrix<double> S, Vector<double> v) {
  for (Index j = 0; j < S.cols(); ++j) {
    const double square = (S(j, j) - v(j)) * (S(j, j) + v(j));
    if (!(square > 0)) return {};
    const double root = std::sqrt(square), c = root / S(j, j), s = v(j) / S(j, j);
    S(j, j) = root;
    for (Index i = j + 1; i < S.rows(); ++i) {
      S(i, j) = (S(i, j) - s * v(i)) / c;
      v(i) = c * v(i) - s * S(i, j);
    }
  }
  return S;
}

/// The measurement update of filters that hold a root and do not use it as one: Re is formed and factored, and S+ is a
/// Cholesky downdate by the columns of Kf Re^{1/2}, as in square-root unscented filters.
std::optional<Matrix<double>> updated_by_downdating(const Matrix<double>& S0, const Matrix<double>& C,
                                                    const Matrix<double>& R) {
  const Matrix<double> CS = C * S0, Re = CS * CS.transpose() + R;
  const double a = std::sqrt(Re(0, 0)), b = Re(1, 0) / a, square = Re(1, 1) - b * b;
  if (!(square > 0)) return {};
  const Matrix<double> PC = S0 * CS.transpose();
  const Vector<double> first = PC.col(0) / a, second = (PC.col(1) - b * first) / std::sqrt(square);
  const auto S = downdated(S0, first);
  return S ? downdated(*S, second) : S;
}

/// One step at one d, from a random S0: the errors of P.
struct OneStep {
  double downdated, array;
};

OneStep one_step(double d, std::uint64_t seed) {
  Random random(seed);
  Matrix<double> S0 = random_normal(random, 3, 3).triangularView<Eigen::Lower>();
  S0.diagonal().array() = S0.diagonal().array().abs() + 1;
  S0 = round_to(S0, 8);
  const Matrix<double> C{{1., 1., 1.}, {1., 1., 1 + d}}, I = Matrix<double>::Identity(3, 3);
  const auto system =
      system_of("downdated", I, Matrix<double>::Zero(3, 1), C, d * Matrix<double>::Identity(2, 2), S0, 1);

  const auto problem = problem_of(system, Parametrisation::root);
  reference::Trajectory truth(problem, nullptr);
  truth.advance();
  const auto S = updated_by_downdating(S0, C, d * d * Matrix<double>::Identity(2, 2));
  const double error = S ? truth.measure(*find_filter("srcf"), {.report = {}, .held = &*S}).covariance : infinity;
  return {error, traces(system, {"srcf"}).at("srcf").worst(&reference::Errors::covariance)};
}

Findings measure(const Settings& set) {
  std::vector<double> inverse, downdating, array;
  double breaks_down = NaN;
  for (int j = 3; j <= 29 && going_on(); j += 2) {
    std::vector<double> one, other;
    for (int draw = 0; draw < static_cast<int>(set("draws")); ++draw) {
      const auto errors =
          one_step(std::exp2(-j), static_cast<std::uint64_t>(set("seed")) + static_cast<std::uint64_t>(draw));
      one.push_back(errors.downdated);
      other.push_back(errors.array);
    }
    inverse.push_back(std::exp2(j));
    downdating.push_back(median(one));
    array.push_back(median(other));
    if (std::isnan(breaks_down) && std::isinf(downdating.back())) breaks_down = j;
  }

  Findings findings;
  findings.checks.push_back(check_slope("downdated root: slope of the error of P in 1/d", 2,
                                        fit_power(inverse, downdating, 1e-14, 1e-2), .1));
  findings.checks.push_back(check_within(
      "downdated root: j of the largest d = 2^-j at which half of the updates do not exist", 25, breaks_down, 2));
  findings.checks.push_back(
      check_slope("srcf: slope of the error of P in 1/d", 1, fit_power(inverse, array, 1e-14, 1e-2), .1));

  reports::Figure figure;
  figure.id = "downdated-root-error";
  figure.title = "A root that is downdated loses what P loses";
  figure.caption = fmt::format(
      "Is every filter with a Cholesky factor a square-root filter? One measurement update with two measurements that "
      "differ by d and have noise d, medians of {:g} random S0. S+ from S S' - Kf Re Kf' by Cholesky downdating, with "
      "Re formed, loses (1/d)^2 and does not exist beyond the end of its curve; by an orthogonal array it loses 1/d.",
      set("draws"));
  figure.x = {"1/d", true};
  figure.y = {"relative error of P after one update, median", true};
  for (double& y : downdating)
    if (std::isinf(y)) y = NaN;
  figure.curves.push_back({"downdated", "downdated root", inverse, downdating, reports::CurveRole::measured_points,
                           color_of("ckf-textbook")});
  figure.curves.push_back(measured("srcf", inverse, array));
  figure.curves.push_back(theory_line("theory-2", "theory: u/d^2", inverse, [&](double x) { return u * x * x; }));
  figure.curves.push_back(theory_line("theory-1", "theory: u/d", inverse, [&](double x) { return u * x; }));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "downdated-root",
      .number = 27,
      .title = "A root obtained by downdating is no square-root filter",
      .statement =
          "A filter that holds S, but forms Re and downdates S S' - Kf Re Kf' as square-root unscented filters do, "
          "loses k(Re) as if it held P, and its update ceases to exist near d = u^1/2.",
      .source = "derived here, theory (4.1), (4.2); the form: van der Merwe and Wan (2001)",
      .setup =
          "C = [1 1 1; 1 1 1+d], R = d^2 I, A = I, random lower S0 of eight bits with a diagonal >= 1, d = 2^-3 ... "
          "2^-29; one step, medians.",
      .prediction =
          "k(Re) is of size 1/d^2: slope 2 in 1/d (within .1) for the downdated root, 1 (within .1) for srcf, fitted "
          "between 1e-14 and 1e-2; d^2 is lost beside 1, and the downdate with it, at j = 25 or so.",
      .meaning =
          "Ask of a `square-root` filter how it updates: by an orthogonal transformation of an array, or not at all.",
      .parameters = {{"draws", 30, "random S0 at each d", 5, 1000}, {"seed", 1, "seed of the first S0", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "S_{k|k} S_{k|k}' = S S' - Kf Re Kf',  Re = R + C S S' C'\n"
          "downdated:  ||dP|| <= c u k(Re) ||P+|| / cos^2\n"
          "srcf:  ||dS|| <= c u (1 + k(Re)^{1/2}) ||S+|| / cos\n"
          "k(Re) ~ 1/d^2"};
}

}  // namespace kfstab::experiments::claims::downdated_root
