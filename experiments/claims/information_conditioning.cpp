#include <cmath>
#include <map>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/ladder.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/precise.hpp>
#include <kfstab/reference/trajectory.hpp>

namespace kfstab::experiments::claims::information_conditioning {
namespace {

using properties::Precise;

const std::vector<std::string> covariance_forms = {"ckf", "ckf-textbook", "joseph", "srcf"};
constexpr const char* as_given = "srif against A as given";

/// A = U diag(1, 1, 1, 1/k) V', B the last two columns of U: the direction that A loses is driven by noise, so that P+
/// is well conditioned. No measurement in step 0, so that a filter that starts with a measurement update holds T = I
/// when the step comes.
properties::System nearly_singular(Random& random, double k) {
  const Index n = 4;
  const Matrix<double> U = random_orthogonal(random, n), V = random_orthogonal(random, n),
                       I = Matrix<double>::Identity(n, n);
  const Vector<double> singular_values{{1., 1., 1., 1 / k}};
  const Matrix<double> A = U * singular_values.asDiagonal() * V.transpose();
  const Matrix<double> C = round_to(random_normal(random, 2, n), 18);
  auto system = system_of("nearly-singular", A, round_to(U.rightCols(2), 18), C, Matrix<double>::Identity(2, 2), I, 2);
  system.C = {properties::Sequence::Kind::list, {Matrix<double>::Zero(2, n), C}};
  return system;
}

/// P_{1|1}^{-1} = (A A' + B B')^{-1} + C'C, of the A that was written.
Precise information_as_given(const properties::System& system) {
  const Precise A(system.A.matrices.front()), B(system.B.matrices.front()), C(system.C.matrices.back());
  return *(A * A.transposed() + B * B.transposed()).inverse() + C.transposed() * C;
}

Findings measure(const Settings& set) {
  const int frames = static_cast<int>(set("frames"));
  Random random(static_cast<std::uint64_t>(set("seed")));
  std::map<std::string, Ladder> errors;
  for (std::size_t rung = 0; 2 * rung <= static_cast<std::size_t>(set("decades")); ++rung) {
    const double k = std::pow(100., static_cast<double>(rung));
    for (int f = 0; f < frames && going_on(); ++f) {
      const auto system = nearly_singular(random, k);
      for (const auto form : {Parametrisation::covariance, Parametrisation::root, Parametrisation::information}) {
        const auto problem = problem_of(system, form);
        reference::Trajectory truth(problem, nullptr);
        truth.advance();
        truth.advance();
        const bool information = form == Parametrisation::information;
        for (const std::string& id : information ? std::vector<std::string>{"srif"} : covariance_forms) {
          if (find_filter(id)->takes != form) continue;
          const auto filter = make_filter<double>(id);
          filter->start(problem);
          filter->step(0, nullptr, nullptr);
          const auto step = filter->step(1, nullptr, nullptr);
          const auto measured = truth.measure(filter->metadata(), step);
          errors[id].add(rung, k, !step.report ? infinity : information ? measured.information : measured.covariance);
          if (!information) continue;
          const Precise T(*step.held), exact = information_as_given(system);
          errors[as_given].add(rung, k, step.report ? (T.transposed() * T - exact).norm() / exact.norm() : infinity);
        }
      }
    }
  }

  Findings findings;
  for (const auto& [id, against] :
       {std::pair{"srif", "the problem that A^-1, rounded, states"}, {as_given, "A as given"}})
    findings.checks.push_back(check_slope(fmt::format("srif against {}: slope of the error of T'T in k(A)", against), 1,
                                          errors[id].power(2e-15, 1e-2), .1));
  for (const std::string& id : covariance_forms)
    findings.checks.push_back(
        check_at_most(fmt::format("{}: growth of the error of P", id), 10, errors[id].growth(),
                      "k(A) does not occur in (4.1), (4.2); medians of random frames scatter by a few"));

  reports::Figure figure;
  figure.id = "information-conditioning";
  figure.title = "An ill-conditioned A costs the information filter, and nobody else";
  figure.caption = fmt::format(
      "What does a nearly singular A cost in one step, if P stays well conditioned? The information filter works "
      "with A^-1: its T'T loses k(A) (dashed: u k), even against the very problem that the rounded A^-1 states. "
      "Forms that hold P or S lose nothing. Medians of {} random frames, thin lines the quartiles.",
      frames);
  figure.x = {"condition number of A", true};
  figure.y = {"relative error of P, or of T'T", true};
  add_curves(figure, errors["srif"], "srif");
  for (const std::string& id : covariance_forms) add_curves(figure, errors[id], id);
  auto given = measured_points("srif-given", "srif, A as given", "srif-hessenberg");
  given.x = errors[as_given].difficulties();
  given.y = errors[as_given].medians();
  figure.curves.push_back(std::move(given));
  auto line = theory_line("theory", "theory: u k");
  for (const double k : errors["srif"].difficulties()) add_point(line, k, u * k);
  figure.curves.push_back(std::move(line));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "information-conditioning",
      .number = 13,
      .title = "The information filter loses the condition number of A",
      .statement =
          "One step of the square-root information filter loses k(A) in what it holds, T'T, also against the problem "
          "that the rounded inverse of A states; forms that hold P or S lose nothing.",
      .source = "derived here, after Verhaegen and Van Dooren (1986), theory (4.3)",
      .setup =
          "n = 4, m = p = 2, A = U diag(1, 1, 1, 1/k) V' in random frames, B the last two columns of U, C random, Q "
          "= R = I, T = I; k = 1 ... 1e14; one step; A^-1 from A in high precision, rounded once; medians of 20 "
          "frames.",
      .prediction =
          "Slope 1 (within .1) of the error of T'T in k(A); the error of P in ckf, ckf-textbook, joseph and srcf "
          "does not grow.",
      .meaning =
          "Hold the covariance's root, not the information's, if A is nearly singular: strong damping over a long "
          "sampling interval is enough.",
      .parameters = {{"decades", 14, "largest condition number of A, as a power of ten", 8, 14},
                     {"frames", 20, "random frames at each condition number", 5, 1000},
                     {"seed", 1, "seed of the random frames", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "T held:  ||dT|| <= c u (k(A) + k(R^{1/2}) + (t_1/t_m) (k(Q^{1/2}) + k(A))) ||T+|| / cos3\n"
          "cos3 = ||T+|| / (||[T A^{-1}; R^{-1/2} C]||)\n"
          "Q^{-1} + (T A^{-1}B)'(T A^{-1}B) = (Qe^{-1/2})' Qe^{-1/2},  t_1 >= ... >= t_m  of Qe^{-1/2}"};
}

}  // namespace kfstab::experiments::claims::information_conditioning
