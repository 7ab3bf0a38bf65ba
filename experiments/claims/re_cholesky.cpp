#include <algorithm>
#include <cmath>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/square_root_covariance.hpp>
#include <kfstab/reference/trajectory.hpp>

namespace kfstab::experiments::claims::re_cholesky {
namespace {

/// The lower Cholesky factor of P, its pivots kept above 2 u p_jj: what is done so that a filter does not break down.
Matrix<double> clamped_cholesky(const Matrix<double>& P) {
  const Index n = P.rows();
  Matrix<double> L = Matrix<double>::Zero(n, n);
  for (Index j = 0; j < n; ++j) {
    double pivot = P(j, j);
    for (Index l = 0; l < j; ++l) pivot -= L(j, l) * L(j, l);
    L(j, j) = std::sqrt(std::max(pivot, 2 * u * P(j, j)));
    for (Index i = j + 1; i < n; ++i) {
      double sum = P(i, j);
      for (Index l = 0; l < j; ++l) sum -= L(i, l) * L(j, l);
      L(i, j) = sum / L(j, j);
    }
  }
  return L;
}

/// log10 det S S'.
double log_determinant(const Matrix<double>& S) {
  double sum = 0;
  for (Index i = 0; i < S.rows(); ++i) sum += 2 * std::log10(std::abs(S(i, i)));
  return sum;
}

Findings measure(const Settings& set) {
  const Index n = 3;
  const auto steps = static_cast<std::int64_t>(set("steps"));
  Random random(static_cast<std::uint64_t>(set("seed")));
  // S0 is the LQ factor of Q diag(1, 1e-8, 1e-18): standard deviations that far apart, in no frame of the coordinates.
  Matrix<double> S0 = random_orthogonal(random, n) * Eigen::DiagonalMatrix<double, 3>(1, 1e-8, 1e-18);
  Vector<double> tau(n);
  lq(S0, tau);
  S0 = S0.triangularView<Eigen::Lower>();
  const Matrix<double> A{{1., .5, .125}, {0., 1., .5}, {0., 0., 1.}};
  const auto problem = problem_of(system_of("graded", A, Matrix<double>::Zero(n, 1), Matrix<double>{{1., 0., 0.}},
                                            Matrix<double>::Identity(1, 1), S0, steps),
                                  Parametrisation::root);
  const auto& model = std::get<Problem<RootModel<double>>>(problem).models.front();

  reference::Trajectory truth(problem, nullptr);
  SquareRootCovarianceFilter<double> root({n, 1, 1}), squared({n, 1, 1});
  const Vector<double> x0 = Vector<double>::Zero(n);
  root.start(S0, x0);
  squared.start(S0, x0);
  // det P+ = det(A)^2 det(P) det(R) / det(Re), det A = R = 1 and no process noise: exact but for the rounding of Re.
  double exact = log_determinant(S0), worst_root = 0, off = NaN;
  std::vector<double> k{0}, exactly{exact}, of_root{exact}, of_squared{exact};
  for (std::int64_t step = 0; step < steps; ++step) {
    truth.advance();
    exact -= std::log10(truth.truth().innovation(0, 0));
    if (!root.step(model) || !squared.step(model)) break;
    squared.start(clamped_cholesky(squared.factor() * squared.factor().transpose()), x0);
    k.push_back(static_cast<double>(step + 1));
    exactly.push_back(exact);
    of_root.push_back(log_determinant(root.factor()));
    of_squared.push_back(log_determinant(squared.factor()));
    worst_root = std::max(worst_root, std::abs(of_root.back() - exact));
    off = of_squared.back() - exact;
  }

  Findings findings;
  findings.checks.push_back(check_at_most("srcf: worst error of log10 det P", 1e-13, worst_root,
                                          "the sum of some sixty logarithms near 50, each right to u"));
  findings.checks.push_back(check_at_least("re-Cholesky: decades by which det P is wrong at the end", 10, off,
                                           "variances below 2u of another in the same row are replaced by 2u of it"));

  reports::Figure figure;
  figure.id = "re-cholesky-determinant";
  figure.title = "A root that is squared and factored anew in every step is no root";
  figure.caption = fmt::format(
      "Does it suffice to hold a Cholesky factor? log10 det P of a state with standard deviations 1, 1e-8 and 1e-18, "
      "{} steps. The square-root filter lies on the truth (dashed). The same filter, but with P = S S' formed after "
      "each step and factored again, pivots clamped so that it does not break down, has a P that is larger by tens of "
      "decades: what is below u in P cannot be had back from it.",
      steps);
  figure.x = {"step k", false};
  figure.y = {"log10 det P", false};
  figure.curves.push_back({"re-cholesky", "squared, factored again", k, of_squared, reports::CurveRole::measured_line,
                           color_of("ckf-textbook")});
  figure.curves.push_back(measured("srcf", k, of_root));
  figure.curves.push_back({"theory", "truth", k, exactly, reports::CurveRole::theory, -1});
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {.id = "re-cholesky",
          .number = 32,
          .title = "A root that is squared and factored anew in every step is no root",
          .statement =
              "A filter that holds a Cholesky factor, but forms P = S S' and factors it in every step, has lost by its "
              "squaring what a root is held for: of strongly graded variances it invents the small ones.",
          .source = "derived here, theory (2.3)",
          .setup =
              "S0 = LQ factor of Q diag(1, 1e-8, 1e-18), Q random orthogonal, A = [1 .5 .125; 0 1 .5; 0 0 1], B = 0, C "
              "= [1 0 0], R = 1, 20 steps; pivots clamped at 2 u p_jj. The truth: det P+ = det P / Re.",
          .prediction = "log10 det P right to 1e-13 in srcf, wrong by more than ten decades in the other.",
          .meaning =
              "Look into a library's `square-root` filter for the line that forms S S': whatever follows it is a "
              "conventional filter.",
          .parameters = {{"steps", 20, "number of steps", 1, 200}, {"seed", 1, "seed of Q", 0, 1e15}},
          .measure = measure,
          .mathematics =
              "[R^{1/2}, C S, 0; 0, A S, B Q^{1/2}] U = [Re^{1/2}, 0, 0; G, S+, 0]\n"
              "P = S S' + E,  ||E|| <= c u ||S||^2  if P is formed\n"
              "B = 0,  R = 1,  det A = 1:  det P+ = det P / Re"};
}

}  // namespace kfstab::experiments::claims::re_cholesky
