#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/core.h>

#include <kfstab/experiments/asymmetry.hpp>
#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/reference/bounds.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::experiments::claims::one_triangle {
namespace {

using Covariances = Problem<CovarianceModel<double>>;

/// One step of a coding of filters/unsymmetrised.hpp that takes one triangle of Re, as any Cholesky factorisation does,
/// instead of an LU of all of it. The rest is as coded there, and nothing keeps P symmetric. Empty where Re is not
/// definite.
Matrix<double> step(Asymmetry coding, const CovarianceModel<double>& model, const Matrix<double>& P) {
  const auto& [A, B, C, D] = static_cast<const StateSpace<double>&>(model);
  const Matrix<double> U = P.lazyProduct(C.transpose()), V = C.lazyProduct(P);
  Matrix<double> Re = model.R;
  if (coding == Asymmetry::cp)
    Re += V.lazyProduct(C.transpose());
  else if (coding == Asymmetry::mixed)
    Re += C.lazyProduct(V.transpose());
  else
    Re += C.lazyProduct(U);
  mirror_upper(Re);

  Matrix<double> root = Re;
  if (cholesky_upper(root) != 0) return {};
  const bool from_V = coding == Asymmetry::cp || coding == Asymmetry::mixed;
  Matrix<double> Kf = from_V ? Matrix<double>(V.transpose()) : U;
  solve_triangular_right<Triangle::upper, false>(root, Kf);
  solve_triangular_right<Triangle::upper, true>(root, Kf);
  const Matrix<double> K = A.lazyProduct(Kf);

  Matrix<double> left, next;
  if (coding == Asymmetry::textbook) {
    left = A - K.lazyProduct(C);
    next = left.lazyProduct(P).eval().lazyProduct(A.transpose());
  } else if (coding == Asymmetry::downdate) {
    left = A.lazyProduct(P - Kf.lazyProduct(U.transpose()).eval());
    next = left.lazyProduct(A.transpose());
  } else {
    left = A.lazyProduct(P);
    next = left.lazyProduct(A.transpose());
    if (coding == Asymmetry::gain)
      next -= K.lazyProduct(Re).eval().lazyProduct(K.transpose());
    else
      next -= K.lazyProduct(
          (coding == Asymmetry::mixed ? Matrix<double>(U.transpose()) : V).lazyProduct(A.transpose()).eval());
  }
  const Matrix<double> BQ = B.lazyProduct(model.Q);
  next += BQ.lazyProduct(B.transpose());
  return next;
}

/// P - P' after each step, until it exceeds `limit`.
std::vector<Matrix<double>> one_triangle_asymmetries(Asymmetry coding, const Covariances& problem, int steps,
                                                     double limit) {
  std::vector<Matrix<double>> curve;
  Matrix<double> P = problem.initial;
  for (int k = 0; k < steps; ++k) {
    P = step(coding, problem.model(k), P);
    if (P.size() == 0) break;
    curve.push_back(P - P.transpose());
    if (!(curve.back().norm() <= limit)) break;
  }
  return curve;
}

/// Random systems from their steady state: the measured asymmetry against the map, step by step, as in
/// asymmetry-growth.
void random_systems(const Settings& set, Findings& findings) {
  const int systems = static_cast<int>(set("systems"));
  const auto n = static_cast<Index>(set("n")), p = static_cast<Index>(set("p"));
  std::map<std::string_view, double> worst;
  reports::Figure figure;
  figure.id = "one-triangle-maps";
  figure.title = "One triangle of Re: the codings follow other maps";
  figure.caption =
      "Does the asymmetry of P follow the maps of theory (3.8), if Re is factored by Cholesky, which reads one "
      "triangle? Points: measured, from the steady state with a random asymmetry of 1e-10 |P|; dashed: the maps "
      "iterated, nothing fitted. The first of the random systems, two outputs; (iii), (iv), (v) are one map now.";
  figure.x = {"step k", false};
  figure.y = {"asymmetry, ||P - P'|| / 2 relative to ||P||", true};
  for (int s = 0; s < systems && going_on(); ++s) {
    Random random(static_cast<std::uint64_t>(set("seed")) + static_cast<std::uint64_t>(s));
    const auto system = random_system(random, {n, 2, p}, 1.15, 1);
    auto problem = problem_of(system, Parametrisation::covariance);
    const auto steady = reference::steady_state(problem);
    const Matrix<double> KC = steady.predictor_gain * system.C.matrices.front();
    const double size = steady.P.norm();
    Matrix<double> D0 = random_normal(random, n, n);
    D0 = (D0 - D0.transpose()).eval();
    auto& covariances = std::get<Covariances>(problem);
    covariances.initial = (steady.P + steady.P.transpose()) / 2 + D0 * (.5e-10 * size / D0.norm());
    D0 = covariances.initial - covariances.initial.transpose();  // as it came out in double

    for (const Metadata* metadata : codings()) {
      const auto measured = one_triangle_asymmetries(metadata->asymmetry, covariances, 200, 1e-6 * size);
      const std::string id(metadata->id);
      auto points = measured_points(id, fmt::format("{}  {}", coding_of(*metadata), id), id);
      auto line = theory_line("theory-" + id, follows_A(metadata->asymmetry) ? "map of (iii), (iv), (v)"
                                                                             : "map of " + coding_of(*metadata));
      double& distance = worst.try_emplace(metadata->id, 0).first->second;
      Matrix<double> D = D0;
      for (std::size_t k = 0; k < measured.size(); ++k) {
        D = reference::asymmetry_map(metadata->asymmetry, true, system.A.matrices.front(), KC, steady.closed_loop, D);
        if (!(D.norm() > 1e-12 * size && D.norm() < 1e-6 * size)) break;
        keep_worst(distance, (measured[k] - D).norm() / D.norm());
        add_point(points, static_cast<double>(k + 1), measured[k].norm() / 2 / size);
        add_point(line, static_cast<double>(k + 1), D.norm() / 2 / size);
      }
      if (s > 0) continue;
      figure.curves.push_back(std::move(points));
      const bool drawn =
          metadata->asymmetry == Asymmetry::cp || metadata->asymmetry == Asymmetry::downdate;  // as (iii)
      if (!drawn) figure.curves.push_back(std::move(line));
    }
  }
  for (const Metadata* metadata : codings())
    findings.checks.push_back(check_at_most(
        fmt::format("{}, {} systems: worst distance from the map of (3.8), relative", coding_of(*metadata), systems),
        .01, worst[metadata->id], "what is left is of second order in D, and rounding"));
  findings.figures.push_back(std::move(figure));
}

/// A = r rotation(.7), C = I, R = .01 I: coding (i) grows with one triangle, and is damped with all of Re.
void textbook(const Settings& set, Findings& findings) {
  const double r = set("r");
  const Matrix<double> A = round_to(rotation(r, .7), 20), I = Matrix<double>::Identity(2, 2), B{{1., 0.}, {.5, .25}};
  auto system = system_of("pair", A, B, I, I, I, 1);
  system.R = {properties::Covariance::Written::covariance, Matrix<double>(.01 * I)};
  auto problem = problem_of(system, Parametrisation::covariance);
  const auto steady = reference::steady_state(problem);
  const auto growth = [&](bool one_triangle) {
    return reference::asymmetry_growth(Asymmetry::textbook, one_triangle, A, steady.predictor_gain, steady.closed_loop);
  };
  auto& covariances = std::get<Covariances>(problem);
  covariances.initial << 4.25, .25 + 1e-12, .25 - 1e-12, 1.25;
  const auto cholesky = norms(one_triangle_asymmetries(Asymmetry::textbook, covariances, 1000, 1e-2));
  const auto lu = norms(asymmetries(*codings().front(), problem, 1000, 1e-2));
  const double start = std::sqrt(2.) * 1e-12;

  if (growth(true) > 1)
    findings.checks.push_back(check_growth(fmt::format("(i) at r = {:g}, one triangle of Re: growth a step", r),
                                           growth(true), fit_growth(cholesky, 1e-13, 1e-4), .01));
  else
    findings.checks.push_back(
        check_at_most(fmt::format("(i) at r = {:g}, one triangle of Re: last asymmetry over the first", r), 1,
                      cholesky.back() / start, "the map's spectral radius is below 1"));
  findings.checks.push_back(
      check_at_most(fmt::format("(i) at r = {:g}, all of Re by LU: last asymmetry over the first", r), 1,
                    lu.back() / start, "D+ = F D F', theory (3.i)"));

  reports::Figure figure;
  figure.id = "one-triangle-textbook";
  figure.title = "Even (A - K C) P A' + B Q B' can lose its symmetry";
  figure.caption = fmt::format(
      "Is the coding (i), which damps an asymmetry, safe? Not if Re is factored by Cholesky: then an asymmetry of "
      "1e-12 grows by {:.4f} a step (dashed, nothing fitted but its height after ten steps), while with an LU of all "
      "of Re it vanishes. A = {:g} times a rotation, C = I, R = .01 I.",
      growth(true), r);
  figure.x = {"step k", false};
  figure.y = {"asymmetry, ||P - P'|| / 2", true};
  auto of_cholesky = measured_points("cholesky", "one triangle of Re", "ckf-gain");
  auto of_lu = measured_points("lu", "all of Re, LU", "ckf-textbook");
  of_cholesky.role = of_lu.role = reports::CurveRole::measured_line;
  for (const double value : cholesky) add_point(of_cholesky, static_cast<double>(of_cholesky.x.size() + 1), value);
  for (std::size_t k = 0; k < std::min(lu.size(), cholesky.size()); ++k)
    add_point(of_lu, static_cast<double>(k + 1), lu[k]);
  auto line = theory_line("theory", fmt::format("theory: {:.4f}^k", growth(true)));
  for (std::size_t k = 9; k < cholesky.size(); ++k)
    add_point(line, static_cast<double>(k + 1), cholesky[9] * std::pow(growth(true), static_cast<double>(k - 9)));
  figure.curves = {std::move(of_cholesky), std::move(of_lu), std::move(line)};
  findings.figures.push_back(std::move(figure));
}

Findings measure(const Settings& set) {
  Findings findings;
  random_systems(set, findings);
  textbook(set, findings);
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "one-triangle",
      .number = 23,
      .title = "With one triangle of Re even coding (i) can lose the symmetry of P",
      .statement =
          "Where Re is symmetrised, or one of its triangles is factored by Cholesky, the maps of an asymmetry "
          "change: (iii), (iv), (v) go by A D A' even with several outputs, and (i) by F D F' - K C D (K C)', which "
          "can grow though both A - K C is stable and an LU of all of Re would damp it.",
      .source = "derived here, after Verhaegen and Van Dooren (1986), theory (3.8)",
      .setup =
          "The codings of filters/unsymmetrised.hpp with Re by Cholesky. Random systems, n = 5, p = m = 2, rho(A) = "
          "1.15, R = I, from their steady state with an asymmetry of 1e-10 |P|; A = 1.1 rotation(.7), C = I, R = .01 "
          "I, B = [1 0; .5 .25], with 1e-12.",
      .prediction =
          "Step by step within 1 % of the maps of (3.8), while 1e-12 |P| < |D| < 1e-6 |P|; growth of (i) on the "
          "second system 1.0291 a step within 1 %, none with LU.",
      .meaning =
          "A library's Cholesky solver does not make a filter symmetric: symmetrise P itself, or compute one "
          "triangle of P.",
      .parameters = {{"r", 1.1, "modulus of the eigenvalues of A in the second system", .5, 1.5},
                     {"n", 5, "number of states", 2, 8},
                     {"p", 2, "number of outputs", 1, 4},
                     {"systems", 20, "number of random systems", 1, 1000},
                     {"seed", 1, "seed of the first random system", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "D+ = F D F' - G D G'  in (i)\n"
          "D+ = 2 A D A' - F D F' + G D G'  in (ii)\n"
          "D+ = A D A'  in (iii), (iv), (v)\n"
          "D = P - P',  F = A - K C,  G = K C"};
}

}  // namespace kfstab::experiments::claims::one_triangle
