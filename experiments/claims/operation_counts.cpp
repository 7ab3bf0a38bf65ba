#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/carlson.hpp>
#include <kfstab/filters/chandrasekhar.hpp>
#include <kfstab/filters/counting.hpp>
#include <kfstab/filters/hessenberg_square_root_covariance.hpp>
#include <kfstab/filters/hessenberg_square_root_information.hpp>
#include <kfstab/filters/information.hpp>
#include <kfstab/filters/joseph.hpp>
#include <kfstab/filters/potter.hpp>
#include <kfstab/filters/square_root_information.hpp>
#include <kfstab/filters/ud.hpp>
#include <kfstab/filters/unsymmetrised.hpp>

namespace kfstab::experiments::claims::operation_counts {
namespace {

using Number = Counting<double>;

Matrix<Number> counted(const Matrix<double>& X) {
  Matrix<Number> Y(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(i, j) = Number(X(i, j));
  return Y;
}

// Nearly diagonal data: what must be inverted is as good as diagonal, so that the estimate of its condition number
// takes the same number of solves whatever the size. 1e-6 elsewhere, positive, so that no reflector is trivial.

Matrix<double> diagonal(Index n) {
  Matrix<double> X = Matrix<double>::Zero(n, n);
  for (Index i = 0; i < n; ++i) X(i, i) = 2 - static_cast<double>(i) / static_cast<double>(n);
  return X;
}

Matrix<double> small(Random& random, Index rows, Index cols) {
  return 1e-6 * random_normal(random, rows, cols).cwiseAbs();
}

/// Zero below the band: X(i, j) for i > j + width. A model in condensed coordinates already stays diagonal in them.
Matrix<double> banded(Matrix<double> X, Index width) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = j + width + 1; i < X.rows(); ++i) X(i, j) = 0;
  return X;
}

/// Multiplications in one step of a filter, the second: the first of some is a start. -1 if it failed.
template <template <class, int, int, int> class Filter>
std::int64_t multiplications(Dimensions d) {
  using F = Filter<Number, Dynamic, Dynamic, Dynamic>;
  using Model = typename F::Model;
  Random random(1);
  const auto [n, m, p] = d;
  Model model;
  model.C = counted(small(random, p, n));
  model.D = Matrix<Number>(n, 0);
  if constexpr (Model::parametrisation == Parametrisation::information) {
    model.A_inverse = counted(diagonal(n) + banded(small(random, n, n), m));
    model.A_inverse_B = counted(banded(small(random, n, m), 0));
    model.Q_inverse_root = counted(diagonal(m));
    model.R_inverse_root = counted(diagonal(p));
  } else {
    model.A = counted(diagonal(n) + small(random, n, n));
    model.B = counted(small(random, n, m));
    if constexpr (Model::parametrisation == Parametrisation::root) {
      model.Q_root = counted(diagonal(m));
      model.R_root = counted(diagonal(p));
    } else {
      model.Q = counted(diagonal(m));
      model.R = counted(diagonal(p));
    }
  }
  F filter(d);
  // P0 = 0 for Chandrasekhar's, whose increments then have rank m.
  const bool from_zero = std::is_same_v<F, ChandrasekharFilter<Number>>;
  filter.start(counted(from_zero ? Matrix<double>(Matrix<double>::Zero(n, n)) : diagonal(n)),
               Vector<Number>(counted(Matrix<double>::Zero(n, 1))));
  const auto step = [&] {
    if constexpr (Model::parametrisation == Parametrisation::information)
      return static_cast<bool>(filter.step(model, model));
    else
      return static_cast<bool>(filter.step(model));
  };
  if (!step()) return -1;
  kfstab::operations() = {};
  return step() ? kfstab::operations().multiplications : -1;
}

/// Coefficients of n^3, n^2 m, n^2 p, n m p in theory (5).
struct Form {
  const char* id;
  std::int64_t (*count)(Dimensions);
  std::array<double, 4> coefficients;
};

constexpr std::array<const char*, 4> terms = {"n^3", "n^2 m", "n^2 p", "n m p"};

const std::vector<Form> forms = {
    {"ckf", multiplications<ConventionalFilter>, {1.5, .5, 1.5, 0}},
    {"ckf-textbook", multiplications<TextbookFilter>, {2, 1, 3, 0}},
    {"ckf-mixed", multiplications<MixedFilter>, {2, 1, 5, 0}},
    {"ckf-gain", multiplications<GainFilter>, {2, 1, 3, 0}},
    {"ckf-cp", multiplications<CrossProductFilter>, {2, 1, 4, 0}},
    {"ckf-downdate", multiplications<DowndateFilter>, {2, 1, 3, 0}},
    {"joseph", multiplications<JosephFilter>, {3, .5, 2.5, 0}},
    {"srcf", multiplications<SquareRootCovarianceFilter>, {7. / 6, 1, 2.5, 0}},
    {"srif", multiplications<SquareRootInformationFilter>, {7. / 6, 2.5, 2, 0}},
    {"csrf", multiplications<ChandrasekharFilter>, {0, 1, 0, 3}},
    {"srcf-hessenberg", multiplications<HessenbergSquareRootCovarianceFilter>, {1. / 6, 1, 2.5, 0}},
    {"srif-hessenberg", multiplications<HessenbergSquareRootInformationFilter>, {1. / 6, 1.5, 3, 0}},
    {"ud", multiplications<UdFilter>, {1.5, 1, 1.5, 0}},
    {"potter", multiplications<PotterFilter>, {5. / 3, 1, 3, 0}},
    {"carlson", multiplications<CarlsonFilter>, {7. / 6, 1, 2, 0}},
    {"information", multiplications<InformationFilter>, {5. / 3, 1.5, 1.5, 0}},
};

/// Least squares over a grid of (n, m, p) for the polynomial of total degree 3; the coefficients of `terms`.
std::array<double, 4> fitted(const Form& form) {
  std::vector<std::array<int, 3>> powers = {{3, 0, 0}, {2, 1, 0}, {2, 0, 1}, {1, 1, 1}};
  for (int n = 0; n <= 3; ++n)
    for (int m = 0; n + m <= 3; ++m)
      for (int p = 0; n + m + p <= 3; ++p)
        if (std::array<int, 3> power = {n, m, p}; std::ranges::find(powers, power) == powers.end())
          powers.push_back(power);
  std::vector<Dimensions> grid;
  for (const Index n : {12, 16, 20, 24})
    for (Index m = 1; m <= 4; ++m)
      for (Index p = 1; p <= 4; ++p) grid.push_back({n, m, p});

  const auto rows = static_cast<Index>(grid.size()), columns = static_cast<Index>(powers.size());
  Matrix<double> X(rows, columns);
  Vector<double> y(rows);
  for (Index i = 0; i < rows; ++i) {
    const Dimensions d = grid[static_cast<std::size_t>(i)];
    y(i) = static_cast<double>(form.count(d));
    for (Index j = 0; j < columns; ++j) {
      const auto& power = powers[static_cast<std::size_t>(j)];
      X(i, j) = std::pow(d.n, power[0]) * std::pow(d.m, power[1]) * std::pow(d.p, power[2]);
    }
  }
  qr(X, y);
  Vector<double> coefficients = y.head(columns);
  solve_triangular<Triangle::upper, false>(X.topRows(columns), coefficients);
  return {coefficients(0), coefficients(1), coefficients(2), coefficients(3)};
}

Findings measure(const Settings& set) {
  Findings findings;
  reports::Figure figure;
  const auto m = static_cast<Index>(set("m")), p = static_cast<Index>(set("p"));
  figure.id = "operation-counts-ratio";
  figure.title = "What a step costs, counted, over what the formula says";
  figure.caption = fmt::format(
      "Do the formulas say what a step costs? Multiplications counted in one step at m = {}, p = {}, divided by the "
      "leading terms of theory (5), n^3 and n^2. The terms left out, n and a constant, are what remains; each curve "
      "goes to 1 (dashed).",
      m, p);
  figure.x = {"number of states n", true};
  figure.y = {"multiplications counted / leading terms", false};
  reports::Figure cost = figure;
  cost.id = "operation-counts-cost";
  cost.title = "What a step costs";
  cost.caption = fmt::format(
      "Which form is cheapest? Multiplications counted in one step at m = {}, p = {}. Roots cost about as much as P "
      "itself; the condensed forms and Chandrasekhar's, for time-invariant systems, far less. Dashed: the leading "
      "terms of srcf and of csrf.",
      m, p);
  cost.y = {"multiplications in a step", true};
  std::vector<double> n;
  for (const double size : {6, 8, 12, 16, 24, 32, 48, 64}) n.push_back(size);
  const auto leading = [&](const Form& form, double size) {
    const auto& c = form.coefficients;
    const double dm = static_cast<double>(m), dp = static_cast<double>(p);
    return c[0] * std::pow(size, 3) + (c[1] * dm + c[2] * dp) * size * size + c[3] * size * dm * dp;
  };
  for (const Form& form : forms) {
    going_on();
    const auto coefficients = fitted(form);
    for (std::size_t i = 0; i < terms.size(); ++i)
      if (i < 3 || form.coefficients[i] > 0)
        findings.checks.push_back(check_within(fmt::format("{}: multiplications per {}", form.id, terms[i]),
                                               form.coefficients[i], coefficients[i], 1e-9));
    std::vector<double> counts, ratios;
    for (const double size : n) {
      counts.push_back(static_cast<double>(form.count({static_cast<Index>(size), m, p})));
      ratios.push_back(counts.back() / leading(form, size));
    }
    figure.curves.push_back(measured(form.id, n, ratios, reports::CurveRole::measured_line));
    cost.curves.push_back(measured(form.id, n, counts, reports::CurveRole::measured_line));
    if (std::string(form.id) == "srcf" || std::string(form.id) == "csrf")
      cost.curves.push_back(theory_line(
          fmt::format("theory-{}", form.id), fmt::format("theory: {}", form.id), n,
          [&](double size) { return leading(form, size); }, 1e9));
  }
  figure.curves.push_back(theory_line("theory", "theory: 1", n, [](double) { return 1.; }));
  findings.figures.push_back(std::move(figure));
  findings.figures.push_back(std::move(cost));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "operation-counts",
      .number = 19,
      .title = "A step costs what the formulas say, counted",
      .statement =
          "The leading terms of the operation counts, n^3, n^2 m and n^2 p, are those of theory (5): a square-root "
          "filter costs about as much as the conventional one, condensed and Chandrasekhar forms far less.",
      .source =
          "theory (5.1)-(5.7), after the documentation of SLICOT's FB01 routines and Verhaegen and Van Dooren (1986)",
      .setup =
          "Each filter with a number that counts what is done to it; the multiplications of a step for n = 12 ... 24, "
          "m, p = 1 ... 4, fitted by all polynomials of degree 3. One operation is one multiply-add; csrf starts from "
          "P0 = 0, so that alpha = m.",
      .prediction =
          "The coefficients of the filters' metadata. The counts are polynomials of degree 3 if the estimate of a "
          "condition number takes the same number of solves everywhere, which nearly diagonal data see to: right to "
          "1e-9.",
      .meaning = "Cost is no reason to hold P rather than a root, and a reason for the condensed forms.",
      .parameters = {{"m", 2, "number of noises in the figures", 1, 6},
                     {"p", 2, "number of outputs in the figures", 1, 6}},
      .measure = measure,
      .mathematics =
          "ckf:  3/2 n^3 + n^2 (3p + m)/2\n"
          "srcf:  7/6 n^3 + n^2 (5p/2 + m) + n (p^2 + m^2/2)\n"
          "srcf condensed:  1/6 n^3 + n^2 (5p/2 + m) + n p^2\n"
          "csrf:  alpha n^2 + 3 alpha n p + alpha p^2"};
}

}  // namespace kfstab::experiments::claims::operation_counts
