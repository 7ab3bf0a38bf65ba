#include <cmath>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/ladder.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/properties/precise.hpp>

namespace kfstab::experiments::claims::joseph_second_order {
namespace {

using properties::Precise;

/// A covariance, a model, and what one exact step makes of them.
struct ExactStep {
  Precise A, C, P, R, BQB, Re, K, next;
};
ExactStep exact_step(Random& random, Dimensions d) {
  const auto system = random_system(random, d, 1.1, 1);
  const Precise A(system.A.matrices.front()), B(system.B.matrices.front()), C(system.C.matrices.front());
  const Precise S(round_to(random_normal(random, d.n, d.n), 18)), R = Precise::identity(d.p);
  const Precise P = S * S.transposed(), BQB = B * B.transposed();
  const Precise Re = R + C * P * C.transposed(), K = A * P * C.transposed() * *Re.inverse();
  return {A, C, P, R, BQB, Re, K, (A - K * C) * P * A.transposed() + BQB};
}

/// Joseph's P+ from a gain that need not be the right one, in doubles.
Matrix<double> joseph_in_double(const ExactStep& exact, const Matrix<double>& K) {
  const Matrix<double> F = exact.A.rounded() - K.lazyProduct(exact.C.rounded());
  const Matrix<double> FP = F.lazyProduct(exact.P.rounded()), KR = K.lazyProduct(exact.R.rounded());
  return Matrix<double>(FP.lazyProduct(F.transpose())) + Matrix<double>(KR.lazyProduct(K.transpose())) +
         exact.BQB.rounded();
}

Findings measure(const Settings& set) {
  const int systems = static_cast<int>(set("systems")), decades = static_cast<int>(set("decades"));
  const Dimensions d{static_cast<Index>(set("n")), 2, static_cast<Index>(set("p"))};
  Random random(static_cast<std::uint64_t>(set("seed")));
  Ladder joseph, textbook, rounded;
  double joseph_residual = 0, textbook_residual = 0, floor_ratio = 0;
  for (int s = 0; s < systems && going_on(); ++s) {
    const ExactStep exact = exact_step(random, d);
    Matrix<double> direction = random_normal(random, d.n, d.p);
    direction *= exact.K.norm() / direction.norm();
    const double size = exact.next.norm();
    for (int e = 0; e <= decades; ++e) {
      const double relative = std::pow(10., -e);
      const Precise dK(relative * direction), K = exact.K + dK, F = exact.A - K * exact.C;
      const auto rung = static_cast<std::size_t>(e);

      const Precise of_joseph = F * exact.P * F.transposed() + K * exact.R * K.transposed() + exact.BQB - exact.next;
      const Precise second = dK * exact.Re * dK.transposed();
      joseph.add(rung, relative, of_joseph.norm() / size);
      keep_worst(joseph_residual, (of_joseph - second).norm() / second.norm());

      const Precise of_textbook = F * exact.P * exact.A.transposed() + exact.BQB - exact.next;
      const Precise first = dK * exact.C * exact.P * exact.A.transposed();
      textbook.add(rung, relative, of_textbook.norm() / size);
      keep_worst(textbook_residual, (of_textbook + first).norm() / first.norm());

      const double error = (Precise(joseph_in_double(exact, K.rounded())) - exact.next).norm();
      rounded.add(rung, relative, error / size);
      if (relative > std::sqrt(u)) continue;
      // What is added up, over what is left: kappa of conventions.md for a sum.
      const double terms =
          std::pow(F.norm(), 2) * exact.P.norm() + std::pow(K.norm(), 2) * exact.R.norm() + exact.BQB.norm();
      keep_worst(floor_ratio, (error - second.norm()) / (u * static_cast<double>(d.n + d.m + d.p) * terms));
    }
  }

  Findings findings;
  findings.checks = {
      check_slope("joseph: slope of the error of P in the error of K", 2, joseph.power(0, 1e300), .01),
      check_slope("ckf-textbook: slope of the error of P in the error of K", 1, textbook.power(0, 1e300), .01),
      check_at_most("joseph: distance of dP from dK Re dK', relative", u, joseph_residual,
                    "theory (4.5) is exact, and computed in 100 digits"),
      check_at_most("ckf-textbook: distance of dP from -dK C P A', relative", u, textbook_residual,
                    "theory (4.5) is exact, and computed in 100 digits"),
      check_at_most("joseph in double, from gains with half their digits: error of P over u (n+m+p) times its terms",
                    30, floor_ratio, "rounding level: the gain's error is below u^(1/2), its square below u"),
  };

  reports::Figure figure;
  figure.id = "joseph-second-order";
  figure.title = "Joseph's form squares the error of the gain";
  figure.caption = fmt::format(
      "How much of an error of the gain reaches P? The gain of one exact step is falsified by a relative error; "
      "medians of {} random systems, thin lines the quartiles. (A - K C) P A' + B Q B' takes the error in as it is, "
      "Joseph's form its square, down to rounding in double. Dashed: slopes 1 and 2.",
      systems);
  figure.x = {"relative error of K", true};
  figure.y = {"relative error of P", true};
  add_curves(figure, textbook, "ckf-textbook");
  add_curves(figure, rounded, "joseph");
  for (auto& curve : figure.curves)
    if (curve.id == "joseph") curve.label = "joseph, in double";
  auto exact = measured_points("joseph-exact", "joseph, in 100 digits", "joseph");
  exact.color = color_of("joseph") + 1;
  exact.x = joseph.difficulties();
  exact.y = joseph.medians();
  figure.curves.push_back(std::move(exact));
  for (const auto& [ladder, power] : {std::pair{&textbook, 1}, {&joseph, 2}}) {
    auto line = theory_line(fmt::format("theory-{}", power), fmt::format("theory: slope {}", power));
    const auto x = ladder->difficulties();
    const double height = ladder->medians().front();
    for (const double error : x) add_point(line, error, height * std::pow(error / x.front(), power));
    figure.curves.push_back(std::move(line));
  }
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "joseph-second-order",
      .number = 9,
      .title = "Joseph's form squares the error of the gain",
      .statement =
          "An error dK of the gain enters Joseph's P to second order, as dK Re dK', and (A - K C) P A' + B Q B' to "
          "first order, as -dK C P A'.",
      .source = "derived here, after Bucy and Joseph (1968), theory (4.5)",
      .setup =
          "One step of random systems, n = 5, p = 3, m = 2, in 100 digits, with a random error of the gain of 1 ... "
          "1e-12 relative to it; Joseph's formula in double beside it.",
      .prediction =
          "Slopes 2 and 1 within .01, the two identities to the last digit; Joseph's P in double at rounding level "
          "once the gain's error is below the square root of u.",
      .meaning =
          "Where the gain is known to half its digits, Joseph's form still gives P to all of them: but the gain, and "
          "the state that it makes, keep their error.",
      .parameters = {{"decades", 12, "least error of the gain, as a power of 1/10", 9, 16},
                     {"n", 5, "number of states", 1, 12},
                     {"p", 3, "number of outputs", 1, 6},
                     {"systems", 20, "number of random systems", 3, 1000},
                     {"seed", 1, "seed of the random systems", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "(I - (Kf+dK) C) P (I - (Kf+dK) C)' + (Kf+dK) R (Kf+dK)' = P_{k|k} + dK Re dK'\n"
          "(A - (K+dK) C) P A' + B Q B' = P+ - dK C P A'"};
}

}  // namespace kfstab::experiments::claims::joseph_second_order
