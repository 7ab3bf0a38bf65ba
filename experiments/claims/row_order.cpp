#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/structured_lq.hpp>
#include <kfstab/properties/precise.hpp>

namespace kfstab::experiments::claims::row_order {
namespace {

using properties::Precise;

/// T+ of the dense array (2.4) from T = I, R = I, whatever triangle Q^{-1/2} fills.
Matrix<double> information_factor(const Matrix<double>& A_inverse, const Matrix<double>& A_inverse_B,
                                  const Matrix<double>& C, const Matrix<double>& Q_inverse_root) {
  const Index n = A_inverse.rows(), m = A_inverse_B.cols(), p = C.rows();
  Matrix<double> X = Matrix<double>::Zero(m + n + p, m + n);
  X.topLeftCorner(m, m) = Q_inverse_root;
  X.middleRows(m, n) << A_inverse_B, A_inverse;
  X.bottomRightCorner(p, n) = C;
  Vector<double> no_right_hand_side = Vector<double>::Zero(m + n + p);
  qr(X, no_right_hand_side);
  return X.block(m, m, n, n).triangularView<Eigen::Upper>();
}

/// The relative error of T'T against P_{k|k}^{-1} of the very numbers that the array took.
double error(const Matrix<double>& T, const Matrix<double>& A_inverse, const Matrix<double>& A_inverse_B,
             const Matrix<double>& C, const Matrix<double>& Q_inverse_root) {
  const Precise Ai(A_inverse), G(A_inverse_B), c(C), q(Q_inverse_root), t(T);
  const Precise AiG = Ai.transposed() * G;
  const Precise inner = *(q.transposed() * q + G.transposed() * G).inverse();
  const Precise Y = Ai.transposed() * Ai - AiG * inner * AiG.transposed() + c.transposed() * c;
  return (t.transposed() * t - Y).norm() / Y.norm();
}

Findings measure(const Settings& set) {
  const Index n = 4, p = 2;
  std::vector<double> condition, lower, upper;
  for (double k = 1; k <= 8 && going_on(); k += .5) {
    // Q^{1/2} = [1 0; 1 e]: its inverse is exact.
    const double e = std::exp2(-std::round(k * std::log2(10.)));
    const Matrix<double> inverse_root{{1., 0.}, {-1 / e, 1 / e}};
    const Precise Q_inverse = Precise(inverse_root).transposed() * Precise(inverse_root);
    const Matrix<double> upper_root = Q_inverse.lower_root()->transposed().rounded();
    std::vector<double> one, other;
    for (int draw = 0; draw < static_cast<int>(set("draws")); ++draw) {
      Random random(static_cast<std::uint64_t>(set("seed")) + static_cast<std::uint64_t>(draw));
      const Matrix<double> A = round_to(random_normal(random, n, n), 18), B = round_to(random_normal(random, n, 2), 18),
                           C = round_to(random_normal(random, p, n), 18);
      const auto inverse = Precise(A).inverse();
      if (!inverse) continue;
      const Matrix<double> A_inverse = inverse->rounded(), A_inverse_B = (*inverse * Precise(B)).rounded();
      one.push_back(
          error(information_factor(A_inverse, A_inverse_B, C, inverse_root), A_inverse, A_inverse_B, C, inverse_root));
      other.push_back(
          error(information_factor(A_inverse, A_inverse_B, C, upper_root), A_inverse, A_inverse_B, C, upper_root));
    }
    condition.push_back(Precise(inverse_root).condition());
    lower.push_back(median(one));
    upper.push_back(median(other));
  }

  Findings findings;
  // From k = 2 on, where the loss is above the floor.
  findings.checks.push_back(check_within(
      "lower Q^-1/2: slope of the error of T'T in k(Q^1/2)", 1,
      fit_power({condition.begin() + 2, condition.end()}, {lower.begin() + 2, lower.end()}, 0, infinity).slope, .15));
  findings.checks.push_back(check_at_most("upper Q^-1/2: growth of the error of T'T from the smallest k(Q^1/2)", 10,
                                          *std::ranges::max_element(upper) / upper.front(),
                                          "no loss; medians of random frames scatter by a few"));

  reports::Figure figure;
  figure.id = "row-order-error";
  figure.title = "The lower Q^-1/2 costs its condition number, the upper one of the same Q nothing";
  figure.caption = fmt::format(
      "Does it matter which root of Q^-1 stands in the information array? One step from T = I with Q^1/2 = [1 0; 1 e], "
      "medians of {:g} random systems. Its inverse, a lower root of Q^-1, has a large row below a small one, and "
      "reflectors that meet them in that order lose the small one's digits; the upper root of the same Q^-1 has the "
      "large row on top.",
      set("draws"));
  figure.x = {"condition number of Q^1/2 (1-norm)", true};
  figure.y = {"relative error of T'T after one step, median", true};
  figure.curves.push_back({"lower", "lower Q^-1/2", condition, lower, reports::CurveRole::measured_points, 0});
  figure.curves.push_back({"upper", "upper Q^-1/2", condition, upper, reports::CurveRole::measured_points, 1});
  figure.curves.push_back(theory_line("theory", "theory: u k(Q^1/2)", condition, [](double k) { return u * k; }));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {.id = "row-order",
          .number = 26,
          .title = "The inverse of the lower Q^1/2 is the wrong root of Q^-1",
          .statement =
              "In the information array a lower Q^-1/2, made by inverting the lower Q^1/2, loses k(Q^1/2); the upper "
              "Q^-1/2 of the same Q loses nothing.",
          .source =
              "derived here, after Verhaegen and Van Dooren (1986), theory (1.3), (4.3); row-wise stability: Powell "
              "and Reid (1969)",
          .setup =
              "n = 4, m = p = 2, A, B, C random, T = I, R = I, Q^1/2 = [1 0; 1 e] with e a power of two near 10^-k, k "
              "= 1 ... 8; one step of the dense array, each root against the truth of its own numbers.",
          .prediction =
              "Slope 1 (within .15) in k(Q^1/2) from k = 2 on for the lower root; no growth for the upper one: "
              "reflectors are backward stable row by row only if large rows come first.",
          .meaning =
              "Compute Q^-1/2 as an upper root, or order the rows by size. An array that is right on paper may lose "
              "half of its digits by the order of its rows.",
          .parameters = {{"draws", 20, "random systems at each k", 5, 1000},
                         {"seed", 1, "seed of the first system", 0, 1e15}},
          .measure = measure,
          .mathematics =
              "Q^{-1} = (Q^{-1/2})' Q^{-1/2},  Q^{1/2} = [1, 0; 1, e],  k(Q^{1/2}) ~ 2/e\n"
              "lower:  Q^{-1/2} = [1, 0; -1/e, 1/e],  ||dT|| <= c u k(Q^{1/2}) ||T+|| / cos3\n"
              "upper:  Q^{-1/2} = (1 + e^2)^{-1/2} [(1 + e^2)/e, -1/e; 0, 1]"};
}

}  // namespace kfstab::experiments::claims::row_order
