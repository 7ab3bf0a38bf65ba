#include <cmath>
#include <map>
#include <string>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/ladder.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/joseph.hpp>
#include <kfstab/filters/square_root_covariance.hpp>
#include <kfstab/filters/square_root_information.hpp>
#include <kfstab/filters/unsymmetrised.hpp>
#include <kfstab/reference/high_precision.hpp>

namespace kfstab::experiments::claims::first_order {
namespace {

using Number = reference::HighPrecision;
using Numbers = Matrix<Number>;

// Plain loops: the products of Eigen take ten times as long to compile.

Numbers product(const Numbers& X, const Numbers& Y) {
  Numbers Z = Numbers::Zero(X.rows(), Y.cols());
  for (Index j = 0; j < Y.cols(); ++j)
    for (Index k = 0; k < X.cols(); ++k)
      for (Index i = 0; i < X.rows(); ++i) Z(i, j) += X(i, k) * Y(k, j);
  return Z;
}

Numbers product(const Numbers& X, const Numbers& Y, const Numbers& Z) { return product(product(X, Y), Z); }

Numbers transposed(const Numbers& X) {
  Numbers Y(X.cols(), X.rows());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(j, i) = X(i, j);
  return Y;
}

/// X E Y'.
Numbers congruence(const Numbers& X, const Numbers& E, const Numbers& Y) { return product(X, E, transposed(Y)); }

Numbers scaled(const Numbers& X, const Number& factor) {
  Numbers Y = X;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(i, j) *= factor;
  return Y;
}

double norm(const Numbers& X) {
  Number sum = 0;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) sum += X(i, j) * X(i, j);
  return reference::round_to_double(Number(sqrt(sum)));
}

/// Upper V, V'V = X.
Numbers root(Numbers X) {
  cholesky_upper(X);
  Numbers V;
  V.resize(X.rows(), X.cols());
  copy_upper(X, V);
  return V;
}

/// X^{-1}, X symmetric and positive definite.
Numbers inverse(const Numbers& X) {
  const Numbers V = root(X);
  Numbers Y = Numbers::Identity(X.rows(), X.cols());
  solve_triangular_right<Triangle::upper, false>(V, Y);
  return product(Y, transposed(Y));
}

/// What a step makes of P and x, of whichever form.
struct Outcome {
  Numbers P, K, x;
};

/// A random model, and what one exact step of it is made of.
struct Setting {
  CovarianceModel<Number> model;
  RootModel<Number> root_model;
  InformationModel<Number> information_model;
  Numbers P, x, y;
  Numbers K, F, G, Re_inverse;  ///< G = K C
};

Numbers exact(const Matrix<double>& X) { return reference::exact<Number>(X); }

Setting draw(Random& random, Dimensions d) {
  const auto system = random_system(random, d, 1.1, 1);
  Setting s;
  auto& m = s.model;
  m.A = exact(system.A.matrices.front());
  m.B = exact(system.B.matrices.front());
  m.C = exact(system.C.matrices.front());
  m.D.resize(d.n, 0);
  m.Q = Numbers::Identity(d.m, d.m);
  m.R = Numbers::Identity(d.p, d.p);
  auto& r = s.root_model;
  static_cast<StateSpace<Number>&>(r) = m;
  r.Q_root = m.Q;
  r.R_root = m.R;
  const Numbers S = exact(round_to(random_normal(random, d.n, d.n), 18));
  s.P = product(S, transposed(S));
  s.x = exact(random_normal(random, d.n, 1));
  s.y = exact(random_normal(random, d.p, 1));

  s.Re_inverse = inverse(m.R + congruence(m.C, s.P, m.C));
  s.K = product(product(m.A, s.P), transposed(m.C), s.Re_inverse);
  s.G = product(s.K, m.C);
  s.F = m.A - s.G;

  auto& i = s.information_model;
  i.A_inverse = product(inverse(product(transposed(m.A), m.A)), transposed(m.A));
  i.A_inverse_B = product(i.A_inverse, m.B);
  i.C = m.C;
  i.D = m.D;
  i.Q_inverse_root = m.Q;
  i.R_inverse_root = m.R;
  return s;
}

template <class Filter>
Outcome covariance_step(const Setting& s, const Numbers& P, const Numbers& x) {
  Filter filter(s.model.dimensions());
  filter.start(P, Vector<Number>(x.col(0)));
  const Vector<Number> y = s.y.col(0);
  filter.step(s.model, &y);
  if constexpr (requires { filter.predictor_gain(); })
    return {filter.covariance(), filter.predictor_gain(), filter.state()};
  else
    return {filter.covariance(), product(s.model.A, filter.filter_gain()), filter.state()};
}

Outcome root_step(const Setting& s, const Numbers& P, const Numbers& x) {
  SquareRootCovarianceFilter<Number> filter(s.model.dimensions());
  filter.start(transposed(root(P)), Vector<Number>(x.col(0)));
  const Vector<Number> y = s.y.col(0);
  filter.step(s.root_model, &y);
  return {product(filter.factor(), transposed(filter.factor())), filter.predictor_gain(), filter.state()};
}

/// P^{-1} of k|k in, of k+1|k+1 out.
Numbers information_step(const Setting& s, const Numbers& information) {
  SquareRootInformationFilter<Number> filter(s.model.dimensions());
  filter.start(root(information), Vector<Number>(s.x.col(0)));
  filter.step(s.information_model, s.information_model);
  return product(transposed(filter.information_factor()), filter.information_factor());
}

/// Distances of an exact step from the formulas, relative, by form and quantity, each a ladder over the size of the
/// error.
using Residuals = std::map<std::string, Ladder>;

/// Symmetric errors: (3.1) to (3.3).
template <class Step>
void symmetric(Residuals& residuals, const std::string& form, Step step, const Setting& s, const Numbers& E,
               const Numbers& e, std::size_t rung, double size) {
  const Outcome before = step(s, s.P, s.x), after = step(s, s.P + E, s.x + e);
  const Numbers dK = product(product(s.F, E), transposed(s.model.C), s.Re_inverse);
  const Numbers dx = product(s.F, e) + product(dK, s.y - product(s.model.C, s.x)), dP = congruence(s.F, E, s.F);
  residuals[form + ", P"].add(rung, size, norm(after.P - before.P - dP) / norm(dP));
  residuals[form + ", K"].add(rung, size, norm(after.K - before.K - dK) / norm(dK));
  residuals[form + ", x"].add(rung, size, norm(after.x - before.x - dx) / norm(dx));
}

/// Any error: (3.6), and the asymmetry by itself, (3.i) to (3.v).
template <Asymmetry coding>
void unsymmetric(Residuals& residuals, const std::string& form, const Setting& s, const Numbers& E, std::size_t rung,
                 double size) {
  using Filter = UnsymmetrisedFilter<coding, Number>;
  const Outcome before = covariance_step<Filter>(s, s.P, s.x), after = covariance_step<Filter>(s, s.P + E, s.x);
  const Numbers D = E - transposed(E), &A = s.model.A, &F = s.F, &G = s.G, C_transposed = transposed(s.model.C);
  Numbers dP = congruence(F, E, F), dD = congruence(A, D, A), dK = product(F, E, C_transposed);
  if constexpr (coding == Asymmetry::textbook) dD = congruence(F, D, F);
  if constexpr (coding == Asymmetry::mixed) {
    dP = congruence(F, transposed(E), F) + dD;
    dK = product(F, transposed(E), C_transposed);
    dD = dD + dD - congruence(F, D, F);
  }
  if constexpr (coding == Asymmetry::gain) {
    dP += congruence(G, D, F);
    dD -= congruence(G, D, G);
  }
  if constexpr (coding == Asymmetry::cp) {
    dP += congruence(F, D, G) + congruence(G, D, G);
    dK = product(product(A, transposed(E)) - product(G, E), C_transposed);
    dD += congruence(G, D, G);
  }
  if constexpr (coding == Asymmetry::downdate) {
    dP += congruence(G, D, F) + congruence(G, D, G);
    dD += congruence(G, D, G);
  }
  dK = product(dK, s.Re_inverse);
  const Numbers moved = after.P - before.P;
  residuals[form + ", any dP"].add(rung, size, norm(moved - dP) / norm(dP));
  residuals[form + ", any dP: K"].add(rung, size, norm(after.K - before.K - dK) / norm(dK));
  residuals[form + ", asymmetry"].add(rung, size, norm(moved - transposed(moved) - dD) / norm(dD));
}

/// (3.5), of k|k.
void information(Residuals& residuals, const Setting& s, const Numbers& E, std::size_t rung, double size) {
  const auto& m = s.model;
  const Numbers I = Numbers::Identity(s.P.rows(), s.P.cols()), held = inverse(s.P);
  const Numbers predicted = congruence(m.A, s.P, m.A) + congruence(m.B, m.Q, m.B);
  const Numbers Kf = product(predicted, transposed(m.C), inverse(m.R + congruence(m.C, predicted, m.C)));
  const Numbers next = information_step(s, held), Ft = product(next, I - product(Kf, m.C), product(m.A, s.P));
  const Numbers d = congruence(Ft, E, Ft);
  residuals["srif, T'T"].add(rung, size, norm(information_step(s, held + E) - next - d) / norm(d));
}

Findings measure(const Settings& set) {
  const int systems = static_cast<int>(set("systems"));
  const Dimensions d{static_cast<Index>(set("n")), 2, static_cast<Index>(set("p"))};
  Random random(static_cast<std::uint64_t>(set("seed")));
  Residuals residuals;
  for (int s = 0; s < systems && going_on(); ++s) {
    const Setting setting = draw(random, d);
    Numbers any = exact(random_normal(random, d.n, d.n));
    any = scaled(any, Number(1) / Number(norm(any)));
    const Numbers symmetrised = scaled(any + transposed(any), Number(.5));
    const Numbers e = exact(random_normal(random, d.n, 1));
    std::size_t rung = 0;
    for (int exponent = 4; exponent <= static_cast<int>(set("smallest")); exponent += 2, ++rung) {
      const double size = std::pow(10., -exponent);
      const Numbers E = scaled(any, Number(size)), symmetric_E = scaled(symmetrised, Number(size)),
                    e_x = scaled(e, Number(size));
      symmetric(residuals, "ckf", covariance_step<ConventionalFilter<Number>>, setting, symmetric_E, e_x, rung, size);
      symmetric(residuals, "joseph", covariance_step<JosephFilter<Number>>, setting, symmetric_E, e_x, rung, size);
      symmetric(residuals, "srcf", root_step, setting, symmetric_E, e_x, rung, size);
      information(residuals, setting, symmetric_E, rung, size);
      unsymmetric<Asymmetry::textbook>(residuals, "(i)", setting, E, rung, size);
      unsymmetric<Asymmetry::mixed>(residuals, "(ii)", setting, E, rung, size);
      unsymmetric<Asymmetry::gain>(residuals, "(iii)", setting, E, rung, size);
      unsymmetric<Asymmetry::cp>(residuals, "(iv)", setting, E, rung, size);
      unsymmetric<Asymmetry::downdate>(residuals, "(v)", setting, E, rung, size);
    }
  }

  Findings findings;
  for (const auto& [what, ladder] : residuals)
    findings.checks.push_back(check_slope(what + ": slope of the formula's relative residual in the size of the error",
                                          1, ladder.power(0, 1e300), .01));

  reports::Figure figure;
  figure.id = "first-order";
  figure.title = "The formulas of propagation are right to first order";
  figure.caption = fmt::format(
      "Are the formulas for what one step makes of an error of P right, in every form and coding? If they are, what "
      "they leave unexplained is proportional to the error: slope 1 (dashed), down to the smallest errors. The "
      "filters' own code in 50 digits; medians of {} random systems.",
      systems);
  figure.x = {"size of the error, ||dP||", true};
  figure.y = {"||what happens - formula|| / ||formula||", true};
  for (const auto& [what, id] : std::map<std::string, std::string>{{"ckf, P", "ckf"},
                                                                   {"(i), any dP", "ckf-textbook"},
                                                                   {"(ii), any dP", "ckf-mixed"},
                                                                   {"(iii), any dP", "ckf-gain"},
                                                                   {"(iv), any dP", "ckf-cp"},
                                                                   {"(v), any dP", "ckf-downdate"},
                                                                   {"srcf, K", "srcf"},
                                                                   {"joseph, x", "joseph"},
                                                                   {"srif, T'T", "srif"}}) {
    auto points = measured_points(id, what, id);
    points.x = residuals[what].difficulties();
    points.y = residuals[what].medians();
    figure.curves.push_back(std::move(points));
  }
  auto line = theory_line("theory", "theory: slope 1");
  for (const double size : residuals["ckf, P"].difficulties()) add_point(line, size, size);
  figure.curves.push_back(std::move(line));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "first-order",
      .number = 2,
      .title = "The formulas of propagation are right to first order",
      .statement =
          "What one step makes of a small error of P, symmetric or not, and of x, is what the formulas say, but for "
          "a residual whose relative size is proportional to the error: in the symmetric forms, in each coding, in "
          "the square-root filters.",
      .source = "derived here, after Verhaegen and Van Dooren (1986), theory (3.1)-(3.6), (3.i)-(3.v)",
      .setup =
          "One step of random systems, n = 4, m = p = 2, rho(A) = 1.1, P0 random, by the filters' own code in 50 "
          "digits; random errors of norm 1e-4 ... 1e-14 of P, of x, of P^-1 in srif; medians over the systems.",
      .prediction = "Slope 1 (within .01) of every relative residual: from 1e-6 to 1e-12 it drops by a factor of 1e6.",
      .meaning =
          "What is said of the growth and decay of errors here can be relied upon, form by form: it is algebra, "
          "checked on the code that runs.",
      .parameters = {{"smallest", 14, "smallest error, as a power of 1/10", 8, 60},
                     {"n", 4, "number of states", 2, 8},
                     {"p", 2, "number of outputs", 1, 4},
                     {"systems", 5, "number of random systems", 1, 100},
                     {"seed", 1, "seed of the random systems", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "dP+ = F dP F',  dK = F dP C' Re^{-1},  dx+ = F dx + dK (y - C x)\n"
          "dP+ = F E F'  in (i),  F E' F' + A D A'  in (ii),  F E F' + G D F'  in (iii)\n"
          "dP+ = F E F' + F D G' + G D G'  in (iv),  F E F' + G D F' + G D G'  in (v)\n"
          "D = E - E',  G = K C,  ||residual|| <= c ||E||^2"};
}

}  // namespace kfstab::experiments::claims::first_order
