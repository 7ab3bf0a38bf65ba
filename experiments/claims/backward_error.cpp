#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/products.hpp>
#include <kfstab/filters/singular_values.hpp>
#include <kfstab/filters/structured_lq.hpp>
#include <kfstab/reference/high_precision.hpp>

#include <boost/random/uniform_int_distribution.hpp>
#include <boost/random/uniform_real_distribution.hpp>

namespace kfstab::experiments::claims::backward_error {
namespace {

using Real = reference::HighPrecision;

// Products by plain loops: Eigen's cost more to compile than all the rest.
Matrix<Real> product(const Matrix<Real>& X, const Matrix<Real>& Y) {
  Matrix<Real> Z(X.rows(), Y.cols());
  for (Index j = 0; j < Y.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) {
      Real sum = 0;
      for (Index l = 0; l < X.cols(); ++l) sum += X(i, l) * Y(l, j);
      Z(i, j) = sum;
    }
  return Z;
}

Matrix<Real> product(const Matrix<double>& X, const Matrix<double>& Y) {
  return product(reference::exact<Real>(X), reference::exact<Real>(Y));
}

Matrix<Real> transposed(const Matrix<Real>& X) {
  Matrix<Real> Y(X.cols(), X.rows());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(j, i) = X(i, j);
  return Y;
}

Real squared_norm(const Matrix<Real>& X) {
  Real sum = 0;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) sum += X(i, j) * X(i, j);
  return sum;
}

void place(Matrix<Real>& X, Index row, Index col, const Matrix<Real>& block) {
  for (Index j = 0; j < block.cols(); ++j)
    for (Index i = 0; i < block.rows(); ++i) X(row + i, col + j) = block(i, j);
}

/// A pre-array of r rows and its computed triangle, L with X U = [L 0] for some orthogonal U if nothing were rounded.
struct Factorisation {
  Matrix<Real> X;  ///< r x c, its products formed exactly
  Matrix<Real> L;  ///< r x r, lower
};

/// The smallest ||X U - [L 0]||_F over all orthogonal U, relative to ||X||_F: sqrt(|X|^2 + |L|^2 - 2 sum sigma(X'L)),
/// an orthogonal Procrustes problem. The difference leaves 50 - 32 digits.
double backward_error(const Factorisation& f) {
  Matrix<Real> M = product(transposed(f.X), f.L), F(M.cols(), M.cols());
  Vector<Real> sigma(M.cols());
  Vector<int> pivots(M.cols());
  singular_values(M, F, sigma, pivots);
  Real nuclear = 0;
  for (Index i = 0; i < sigma.size(); ++i) nuclear += sigma(i);
  const Real size = squared_norm(f.X), square = size + squared_norm(f.L) - 2 * nuclear;
  return std::sqrt(std::max(0., reference::round_to_double(Real(square / size))));
}

/// Each row of X divided by its norm, that of L with it. Rows of zeros stay.
Factorisation rows_alike(Factorisation f) {
  for (Index i = 0; i < f.X.rows(); ++i) {
    Real sum = 0;
    for (Index j = 0; j < f.X.cols(); ++j) sum += f.X(i, j) * f.X(i, j);
    if (sum == 0) continue;
    const Real size = sqrt(sum);
    for (Index j = 0; j < f.X.cols(); ++j) f.X(i, j) /= size;
    for (Index j = 0; j < f.L.cols(); ++j) f.L(i, j) /= size;
  }
  return f;
}

/// What one step takes, in double, of random sizes.
struct Numbers {
  Matrix<double> A, B, C, S, R_root, Q_root;
};

Numbers draw(Random& random, bool ill_conditioned) {
  const auto size = [&](int most) {
    return static_cast<Index>(boost::random::uniform_int_distribution<int>(1, most)(random));
  };
  const auto power = [&](double least) {
    return std::pow(10., boost::random::uniform_real_distribution<double>(least, 0)(random));
  };
  const Index n = size(5), m = size(3), p = size(3);
  Numbers x;
  x.A = random_normal(random, n, n);
  x.B = random_normal(random, n, m);
  x.C = random_normal(random, p, n);
  x.S = random_normal(random, n, n).triangularView<Eigen::Lower>();
  x.S.diagonal().array() += 2;
  x.R_root = Matrix<double>::Identity(p, p);
  x.Q_root = Matrix<double>::Identity(m, m);
  if (ill_conditioned) {
    for (Index j = 0; j < n; ++j) {
      x.S.col(j) *= power(-8);
      x.A.col(j) *= power(-8);
    }
    x.A = (x.A * random_orthogonal(random, n)).eval();
    x.B *= power(-9);
    x.R_root *= power(-9);
    x.Q_root *= power(-9);
  }
  return x;
}

/// [R^{1/2} C S 0; 0 A S B] as srcf takes it, with B for B Q^{1/2}.
Factorisation covariance_array(const Numbers& x) {
  const Index n = x.A.rows(), m = x.B.cols(), p = x.C.rows();
  Matrix<double> Re_root = x.R_root, CS(p, n), AS_BQ(n, n + m), G(n, p);
  Vector<double> tau(std::max(n, p));
  multiply_lower(x.C, x.S, CS);
  auto AS = AS_BQ.leftCols(n);
  multiply_lower(x.A, x.S, AS);
  AS_BQ.rightCols(m) = x.B;
  structured_lq(Shape::full, Re_root, CS, AS, G, tau);
  lq(AS_BQ, tau);

  Factorisation f{Matrix<Real>(p + n, p + n + m), Matrix<Real>(p + n, p + n)};
  f.X.fill(Real(0));
  f.L.fill(Real(0));
  place(f.X, 0, 0, reference::exact<Real>(x.R_root));
  place(f.X, 0, p, product(x.C, x.S));
  place(f.X, p, p, product(x.A, x.S));
  place(f.X, p, p + n, reference::exact<Real>(x.B));
  place(f.L, 0, 0, reference::exact<Real>(Re_root));
  place(f.L, p, 0, reference::exact<Real>(G));
  place(f.L, p, p, reference::exact<Real>(Matrix<double>(AS_BQ.leftCols(n).triangularView<Eigen::Lower>())));
  return f;
}

/// [Q^{-1/2} 0; T A^{-1}B T A^{-1}; 0 R^{-1/2}C] as srif takes it, transposed: A, B, S' and the roots stand for A^{-1},
/// A^{-1}B, T, Q^{-1/2} and R^{-1/2}, which are any numbers to a backward error.
Factorisation information_array(const Numbers& x) {
  const Index n = x.A.rows(), m = x.B.cols(), p = x.C.rows();
  const Matrix<double> T = x.S.transpose();
  Matrix<double> Qe_root = x.Q_root, TAB(n, m), stack(n + p, n), over(m, n), RC(p, n);
  Vector<double> tau(m), no_right_hand_side = Vector<double>::Zero(n + p);
  auto TA = stack.topRows(n);
  multiply_upper(T, x.A, TA);
  multiply_upper(T, x.B, TAB);
  multiply_upper(x.R_root, x.C, RC);
  structured_qr(Shape::full, Qe_root, TAB, TA, over, tau);
  stack.bottomRows(p) = RC;
  qr(stack, no_right_hand_side);

  Matrix<Real> X(m + n + p, m + n), R(m + n, m + n);
  X.fill(Real(0));
  R.fill(Real(0));
  place(X, 0, 0, reference::exact<Real>(x.Q_root));
  place(X, m, 0, product(T, x.B));
  place(X, m, m, product(T, x.A));
  place(X, m + n, m, product(x.R_root, x.C));
  place(R, 0, 0, reference::exact<Real>(Matrix<double>(Qe_root.triangularView<Eigen::Upper>())));
  place(R, 0, m, reference::exact<Real>(over));
  place(R, m, m, reference::exact<Real>(Matrix<double>(stack.topRows(n).triangularView<Eigen::Upper>())));
  return {transposed(X), transposed(R)};
}

/// k_2 of a wide matrix of full rank.
double condition(const Matrix<Real>& X) {
  Matrix<double> tall(X.cols(), X.rows()), F(X.rows(), X.rows());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) tall(j, i) = reference::round_to_double(X(i, j));
  Vector<double> sigma(X.rows());
  Vector<int> pivots(X.rows());
  singular_values(tall, F, sigma, pivots);
  return sigma(0) / sigma(sigma.size() - 1);
}

Findings measure(const Settings& set) {
  struct Form {
    const char *id, *lines;
    Factorisation (*factorise)(const Numbers&);
  };
  constexpr std::array<Form, 2> forms = {{{"srcf", "rows", covariance_array}, {"srif", "columns", information_array}}};
  const double limit = 10;

  Findings findings;
  reports::Figure figure;
  figure.id = "backward-error-constant";
  figure.title = "The computed array is the exact transform of one that is off by a few u";
  figure.caption = fmt::format(
      "Are the array filters backward stable, whatever the condition number? For {:g} random and ill-conditioned "
      "steps, the distance of the computed triangle from the nearest exact transform of the pre-array, in 50 digits, "
      "in units of (n+m+p) u: of the whole array, and with each row (srif: column) scaled to norm 1, so that small "
      "rows count as much as large ones. Dashed: the limit.",
      set("systems"));
  figure.x = {"condition number of the pre-array", true};
  figure.y = {"backward error in units of (n+m+p) u", true};
  double largest_condition = 1;
  for (std::size_t which = 0; which < forms.size(); ++which) {
    const Form& form = forms[which];
    std::vector<double> k, whole, scaled;
    for (int s = 0; s < static_cast<int>(set("systems")) && going_on(); ++s) {
      Random random(static_cast<std::uint64_t>(set("seed")) + static_cast<std::uint64_t>(s));
      const Numbers x = draw(random, s % 2 == 1);
      const auto f = form.factorise(x);
      const double unit = static_cast<double>(x.A.rows() + x.B.cols() + x.C.rows()) * u;
      const auto alike = rows_alike(f);
      k.push_back(condition(f.X));
      whole.push_back(backward_error(f) / unit);
      scaled.push_back(backward_error(alike) * std::sqrt(static_cast<double>(alike.X.rows())) / unit);
      largest_condition = std::max(largest_condition, k.back());
    }
    findings.checks.push_back(
        check_at_most(fmt::format("{}: largest backward error in units of (n+m+p) u ||X||", form.id), limit,
                      *std::ranges::max_element(whole), "a modest constant, whatever the condition number"));
    findings.checks.push_back(check_at_most(fmt::format("{}: the same with {} scaled to norm 1", form.id, form.lines),
                                            limit, *std::ranges::max_element(scaled),
                                            "a modest constant, line by line"));
    figure.curves.push_back({fmt::format("{}-whole", form.id), form.id, k, whole, reports::CurveRole::measured_points,
                             static_cast<int>(2 * which)});
    figure.curves.push_back({fmt::format("{}-scaled", form.id), fmt::format("{}, {} alike", form.id, form.lines), k,
                             scaled, reports::CurveRole::measured_points, static_cast<int>(2 * which + 1)});
  }
  figure.curves.push_back(theory_line(
      "theory", "limit: c = 10", {1, largest_condition}, [&](double) { return limit; }, limit));
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "backward-error",
      .number = 21,
      .title = "The computed array is the exact transform of a pre-array off by a small multiple of u",
      .statement =
          "The structured factorisations of the square-root filters are backward stable, products included, and row by "
          "row (of the information array column by column): what is computed is exactly orthogonally equivalent to a "
          "pre-array a few u away.",
      .source =
          "derived here, after Verhaegen and Van Dooren (1986), theory (2.6), (2.7); Higham, Accuracy and Stability "
          "(2002), ch. 19",
      .setup =
          "Random sizes n <= 5, m, p <= 3; every second system with singular values over eight decades and noise down "
          "to 1e-9. X, with exact products, and the computed [L 0] in 50 digits; min over orthogonal U of ||X U - [L "
          "0]|| from the singular values of X'L.",
      .prediction =
          "At most c (n+m+p) u ||X|| with c <= 10, for any condition number, also with each row of X scaled to norm 1.",
      .meaning =
          "Every loss of a square-root filter is one that the problem has in itself, posed in terms of the roots.",
      .parameters = {{"systems", 120, "random systems", 10, 2000}, {"seed", 1, "seed of the first system", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "[L, A; 0, B] Q = [L+, 0; C, D],  L, L+ lower triangular\n"
          "Q' [R, 0; A, B] = [R+, C; 0, D],  R, R+ upper triangular\n"
          "min ||X U - Y|| <= c (n + m + p) u ||X||  over U U' = I,  X the left side, Y the computed right side"};
}

}  // namespace kfstab::experiments::claims::backward_error
