#include <kfstab/filters/condensed.hpp>

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <kfstab/filters/counting.hpp>
#include <kfstab/filters/products.hpp>

#include "filters/guarded.hpp"
#include "filters/random_problem.hpp"
#include "tolerance.hpp"

namespace kfstab::test {
namespace {

using Wide = Matrix<long double>;  // where residuals are formed

template <class XType>
Wide widened(const XType& X) {
  Wide Y(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(i, j) = X(i, j);
  return Y;
}

template <class S>
Matrix<S> random(Dice& dice, Index rows, Index cols) {
  return cast<S>(Matrix<double>(dice.matrix(rows, cols, 16)));
}

template <class S>
bool same_bits(const Matrix<S>& X, const Matrix<S>& Y) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      if (X(i, j) != Y(i, j) || std::signbit(X(i, j)) != std::signbit(Y(i, j))) return false;
  return X.rows() == Y.rows() && X.cols() == Y.cols();
}

/// error / (u size scale); 0 where there is no error, infinite where the scale is 0 and the error is not.
template <class S>
double ratio(const Wide& difference, Index size, long double scale) {
  const long double error = difference.norm();
  if (error == 0) return 0;
  return static_cast<double>(error / (unit_roundoff<S>() * static_cast<long double>(size) * scale));
}

// ---- The reductions

enum class Side { controller, observer };

struct Form {
  Side side;
  Triangle triangle;

  std::string text() const {
    return std::string(triangle == Triangle::upper ? "upper " : "lower ") +
           (side == Side::controller ? "controller" : "observer");
  }
};

const Form forms[] = {{Side::controller, Triangle::upper},
                      {Side::controller, Triangle::lower},
                      {Side::observer, Triangle::lower},
                      {Side::observer, Triangle::upper}};

/// W is B (n x w) or C (w x n).
template <class S>
struct Pair {
  Matrix<S> A, W;
};

template <class S>
void reduce(const Form& form, Pair<S>& pair, Matrix<S>& X) {
  if (form.side == Side::controller)
    controller_hessenberg(form.triangle, pair.A, pair.W, X);
  else
    observer_hessenberg(form.triangle, pair.A, pair.W, X);
}

/// The patterns, as the manual of the forms draws them: [B A], [A B], [C; A] and [A; C] are trapezoidal.
bool zero_of_A(const Form& form, Index w, Index i, Index j) {
  return w > 0 && (form.triangle == Triangle::upper ? i > j + w : j > i + w);
}
bool zero_of_W(const Form& form, Index n, Index w, Index i, Index j) {
  if (form.side == Side::controller) return form.triangle == Triangle::upper ? i > j : n - 1 - i > w - 1 - j;
  return form.triangle == Triangle::lower ? j > i : n - 1 - j > w - 1 - i;
}

template <class S>
void expect_reduced(const Form& form, const Pair<S>& given) {
  const Index n = given.A.rows(), w = form.side == Side::controller ? given.W.cols() : given.W.rows();
  Pair<S> pair = given;
  Matrix<S> U = Matrix<S>::Identity(n, n);
  reduce(form, pair, U);

  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i < n; ++i)
      if (zero_of_A(form, w, i, j)) {
        EXPECT_TRUE(pair.A(i, j) == S(0) && !std::signbit(pair.A(i, j))) << "A(" << i << "," << j << ")";
      }
  for (Index j = 0; j < pair.W.cols(); ++j)
    for (Index i = 0; i < pair.W.rows(); ++i)
      if (zero_of_W(form, n, w, i, j)) {
        EXPECT_TRUE(pair.W(i, j) == S(0) && !std::signbit(pair.W(i, j))) << "B or C(" << i << "," << j << ")";
      }

  // n reflectors, each orthogonal to u: U is within n u of an orthogonal matrix, and what they make of A and W within
  // n u of its norm from their exact transforms.
  const Wide V = widened(U), A = widened(given.A), W = widened(given.W);
  const Wide orthogonal = V.lazyProduct(V.transpose()) - Wide::Identity(n, n);
  EXPECT_LE(ratio<S>(orthogonal, n + w, std::sqrt(static_cast<long double>(n))), threshold) << "U U' - I";
  const Wide similar = A.lazyProduct(V) - V.lazyProduct(widened(pair.A));
  EXPECT_LE(ratio<S>(similar, n + w, A.norm()), threshold) << "A U - U (U'AU)";
  const Wide other = form.side == Side::controller ? Wide(W - V.lazyProduct(widened(pair.W)))
                                                   : Wide(W.lazyProduct(V) - widened(pair.W));
  EXPECT_LE(ratio<S>(other, n + w, W.norm()), threshold) << "B - U (U'B), or C U - (C U)";

  // What is to follow the change of coordinates follows it, whatever its rows, and changes nothing else.
  Dice dice(7);
  for (const Index rows : {Index(0), Index(1), n + 2}) {
    const Matrix<S> X0 = random<S>(dice, rows, n);
    Matrix<S> X = X0;
    Pair<S> again = given;
    reduce(form, again, X);
    EXPECT_TRUE(same_bits(again.A, pair.A) && same_bits(again.W, pair.W));
    const Wide followed = widened(X0).lazyProduct(V) - widened(X);
    EXPECT_LE(ratio<S>(followed, n + w, widened(X0).norm()), threshold) << "X U";
  }
  Pair<S> alone = given;
  if (form.side == Side::controller)
    controller_hessenberg(form.triangle, alone.A, alone.W);
  else
    observer_hessenberg(form.triangle, alone.A, alone.W);
  EXPECT_TRUE(same_bits(alone.A, pair.A) && same_bits(alone.W, pair.W));
}

template <class S>
void reduces_every_size() {
  for (const Form& form : forms)
    for (const Index n : {0, 1, 2, 3, 6, 9})
      for (const Index w : {0, 1, 2, 3, 6, 8})
        for (std::uint64_t seed = 1; seed <= 3; ++seed) {
          SCOPED_TRACE(form.text() + " n=" + std::to_string(n) + " w=" + std::to_string(w) +
                       " seed=" + std::to_string(seed));
          Dice dice(seed);
          const bool controller = form.side == Side::controller;
          expect_reduced(form, Pair<S>{random<S>(dice, n, n), random<S>(dice, controller ? n : w, controller ? w : n)});
        }
}

}  // namespace

TEST(CondensedForm, IsSimilarOrthogonalAndZeroWherePromised) {
  reduces_every_size<double>();
  reduces_every_size<float>();
  reduces_every_size<long double>();
}

// Nothing decides on a rank: the zeros are there whatever can be controlled or observed.
TEST(CondensedForm, OfADeficientPairIsOneToo) {
  for (const Form& form : forms) {
    SCOPED_TRACE(form.text());
    Dice dice(11);
    const bool controller = form.side == Side::controller;
    Pair<double> pair{random<double>(dice, 6, 6), random<double>(dice, controller ? 6 : 3, controller ? 3 : 6)};
    Pair<double> zero = pair;
    zero.W.setZero();
    expect_reduced(form, zero);
    Pair<double> twice = pair;
    if (controller)
      twice.W.col(2) = twice.W.col(0);
    else
      twice.W.row(2) = twice.W.row(0);
    expect_reduced(form, twice);
    Pair<double> still = pair;
    still.A.setIdentity();
    expect_reduced(form, still);
    Pair<double> blocks = pair;  // two systems side by side, one of which nothing reaches or shows
    blocks.A.topRightCorner(3, 3).setZero();
    blocks.A.bottomLeftCorner(3, 3).setZero();
    if (controller)
      blocks.W.bottomRows(3).setZero();
    else
      blocks.W.rightCols(3).setZero();
    expect_reduced(form, blocks);
  }
}

// A pair that has the form already keeps its bits, and U is the identity: nothing had to be done.
TEST(CondensedForm, OfACondensedPairIsThatPair) {
  for (const Form& form : forms) {
    SCOPED_TRACE(form.text());
    Dice dice(12);
    const bool controller = form.side == Side::controller;
    Pair<double> pair{random<double>(dice, 6, 6), random<double>(dice, controller ? 6 : 2, controller ? 2 : 6)};
    for (Index j = 0; j < 6; ++j)
      for (Index i = 0; i < 6; ++i) {
        if (zero_of_A(form, 2, i, j)) pair.A(i, j) = 0;
        if (i < pair.W.rows() && j < pair.W.cols() && zero_of_W(form, 6, 2, i, j)) pair.W(i, j) = 0;
      }
    Pair<double> result = pair;
    Matrix<double> U = Matrix<double>::Identity(6, 6);
    reduce(form, result, U);
    EXPECT_EQ(result.A, pair.A);
    EXPECT_EQ(result.W, pair.W);
    EXPECT_EQ(U, (Matrix<double>::Identity(6, 6)));
  }
}

TEST(CondensedForm, WithNothingToStartFromLeavesEveryBit) {
  for (const Form& form : forms) {
    Dice dice(13);
    const bool controller = form.side == Side::controller;
    const Pair<double> pair{random<double>(dice, 4, 4), Matrix<double>(controller ? 4 : 0, controller ? 0 : 4)};
    const Matrix<double> X = random<double>(dice, 2, 4);
    Pair<double> result = pair;
    Matrix<double> Y = X;
    reduce(form, result, Y);
    EXPECT_TRUE(same_bits(result.A, pair.A)) << form.text();
    EXPECT_TRUE(same_bits(Y, X)) << form.text();
  }
}

// ---- Products and factorisations inside the pattern

namespace {

template <class S>
Guarded<S> blank(Index rows, Index cols, Allowed allowed, Index band = 0) {
  return Guarded<S>(Matrix<S>::Constant(rows, cols, S(std::nan(""))), allowed, band);
}

template <class S>
Matrix<S> flipped(const Matrix<S>& X) {
  return X.transpose();
}

template <class S>
void multiplies(Index n, Index r, Index band, std::uint64_t seed) {
  SCOPED_TRACE("n=" + std::to_string(n) + " r=" + std::to_string(r) + " band=" + std::to_string(band));
  Dice dice(seed);
  const Guarded<S> L(random<S>(dice, n, n), Allowed::lower), X(random<S>(dice, r, n), Allowed::lower, band);
  auto XL = blank<S>(r, n, Allowed::lower, band);
  ASSERT_NO_THROW(multiply_hessenberg_lower(band, X, L, XL));
  const Wide x = widened(X.values()), l = widened(L.values());
  const Wide product = x.lazyProduct(l), sizes = x.cwiseAbs().lazyProduct(l.cwiseAbs());

  const Guarded<S> U(flipped(L.values()), Allowed::upper), Y(flipped(X.values()), Allowed::upper, band);
  auto UY = blank<S>(n, r, Allowed::upper, band);
  ASSERT_NO_THROW(multiply_upper_hessenberg(band, U, Y, UY));
  const Wide right = widened(XL.values()), left = widened(flipped(UY.values()));

  // An entry is a sum of n products: n u of the sum of their sizes. What was not touched is 0 here, as in product.
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i < r; ++i) {
      const long double limit = unit_roundoff<S>() * static_cast<long double>(n) * sizes(i, j);
      EXPECT_LE(std::abs(right(i, j) - product(i, j)), limit);
      EXPECT_LE(std::abs(left(i, j) - product(i, j)), limit);
    }
  if (band < n) return;
  Matrix<S> plain(r, n), mirrored(n, r);
  multiply_lower(X.values(), L.values(), plain);
  multiply_upper(U.values(), Y.values(), mirrored);
  EXPECT_TRUE(same_bits(plain, XL.values()));
  EXPECT_TRUE(same_bits(mirrored, UY.values()));
}

/// Whether post = pre V for an orthogonal V: if and only if the inner products of their rows are the same. Reflectors
/// perturb each row by u times its norm, and so each product by u |row i| |row j|. The largest error over that and the
/// size.
template <class S>
double rotation_ratio(const Wide& pre, const Wide& post) {
  const Wide before = pre.lazyProduct(pre.transpose()), after = post.lazyProduct(post.transpose());
  double worst = 0;
  for (Index i = 0; i < pre.rows(); ++i)
    for (Index j = 0; j <= i; ++j) {
      const long double error = std::abs(before(i, j) - after(i, j));
      if (error == 0) continue;
      const long double scale = std::sqrt(before(i, i)) * std::sqrt(before(j, j));
      const double r =
          static_cast<double>(error / (unit_roundoff<S>() * static_cast<long double>(pre.rows() + pre.cols()) * scale));
      if (!(r <= worst)) worst = r;
    }
  return worst;
}

Wide lower_of(Wide X) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < std::min(j, X.rows()); ++i) X(i, j) = 0;
  return X;
}

template <class S>
void factorises(Index r, Index c, Index width, std::uint64_t seed) {
  SCOPED_TRACE("r=" + std::to_string(r) + " c=" + std::to_string(c) + " width=" + std::to_string(width));
  Dice dice(seed);
  const Guarded<S> given(random<S>(dice, r, c), Allowed::lower, width);
  Guarded<S> X = given;
  Vector<S> tau = Vector<S>::Constant(r, S(std::nan("")));
  ASSERT_NO_THROW(hessenberg_lq(width, X, tau));
  EXPECT_LE(rotation_ratio<S>(widened(given.values()), lower_of(widened(X.values()))), threshold);

  // The mirror, with a right-hand side: one column more that takes the same turns.
  Guarded<S> Y(flipped(given.values()), Allowed::upper, width);
  const Vector<S> y0 = random<S>(dice, c, 1);
  Vector<S> y = y0;
  ASSERT_NO_THROW(hessenberg_qr(width, Y, y));
  Wide pre(r + 1, c), post(r + 1, c);
  pre.topRows(r) = widened(given.values());
  post.topRows(r) = lower_of(widened(flipped(Y.values())));
  for (Index i = 0; i < c; ++i) {
    pre(r, i) = y0(i);
    post(r, i) = y(i);
  }
  EXPECT_LE(rotation_ratio<S>(pre, post), threshold);

  if (width + 1 < c) return;
  Matrix<S> plain = given.values(), mirrored = flipped(plain);
  Vector<S> plain_tau(r), plain_y = y0;
  lq(plain, plain_tau);
  qr(mirrored, plain_y);
  EXPECT_TRUE(same_bits(plain, X.values()));
  EXPECT_TRUE(same_bits(Matrix<S>(plain_tau), Matrix<S>(tau)));
  EXPECT_TRUE(same_bits(mirrored, Y.values()));
  EXPECT_TRUE(same_bits(Matrix<S>(plain_y), Matrix<S>(y)));
}

template <class S>
void works_inside_every_pattern() {
  for (std::uint64_t seed = 1; seed <= 3; ++seed)
    for (const Index n : {0, 1, 2, 5})
      for (const Index extra : {0, 1, 3})
        for (const Index band : {0, 1, 2, 3, 5, 9}) {
          multiplies<S>(n, n + extra, band, seed);
          multiplies<S>(n + extra, n, band, seed);
          factorises<S>(n, n + extra, band, seed);
        }
}

}  // namespace

TEST(CondensedArray, PartsStayInsideThePattern) {
  works_inside_every_pattern<double>();
  works_inside_every_pattern<float>();
  works_inside_every_pattern<long double>();
}

// ---- Both arrays as a whole

namespace {

/// Columns or rows of a guarded matrix from `row`, `column` on.
template <class S>
struct Part {
  using Scalar = S;
  Guarded<S>& X;
  Index row, column, height, width;

  Index rows() const { return height; }
  Index cols() const { return width; }
  S& operator()(Index i, Index j) { return X(row + i, column + j); }
  const S& operator()(Index i, Index j) const { return const_cast<const Guarded<S>&>(X)(row + i, column + j); }
};

/// The covariance array of order n, m, p from random numbers: theory (2.8).
template <class S>
struct CovarianceArray {
  Index n, m, p;
  Guarded<S> A, C, L, R, CS, BQ_AS;
  Matrix<S> G;
  Vector<S> tau;

  CovarianceArray(Dimensions d, Dice& dice)
      : n(d.n), m(d.m), p(d.p), A(random<S>(dice, n, n), Allowed::lower, p), C(random<S>(dice, p, n), Allowed::lower),
        L(random<S>(dice, n, n), Allowed::lower), R(random<S>(dice, p, p), Allowed::lower),
        CS(blank<S>(p, n, Allowed::lower)), BQ_AS(blank<S>(n, m + n, Allowed::lower, m + p)), G(n, p),
        tau(std::max(n, p)) {
    const Matrix<S> BQ = random<S>(dice, n, m);
    for (Index j = 0; j < m; ++j)
      for (Index i = 0; i < n; ++i) BQ_AS(i, j) = BQ(i, j);
  }
  void multiply() {
    multiply_hessenberg_lower(p, A, L, Part<S>{BQ_AS, 0, m, n, n});
    multiply_hessenberg_lower(0, C, L, CS);
  }
  void triangularise() {
    structured_lq(Shape::trapezoidal, R, CS, Part<S>{BQ_AS, 0, m, n, n}, G, tau);
    hessenberg_lq(m + p, BQ_AS, tau);
  }
};

/// The information array: theory (2.9), its right-hand side included.
template <class S>
struct InformationArray {
  Index n, m, p;
  Guarded<S> F, H, T, Q, TH, CR_TF;
  Matrix<S> over;
  Vector<S> tau, y;

  InformationArray(Dimensions d, Dice& dice)
      : n(d.n), m(d.m), p(d.p), F(random<S>(dice, n, n), Allowed::upper, m), H(random<S>(dice, n, m), Allowed::upper),
        T(random<S>(dice, n, n), Allowed::upper), Q(random<S>(dice, m, m), Allowed::upper),
        TH(blank<S>(n, m, Allowed::upper)), CR_TF(blank<S>(p + n, n, Allowed::upper, p + m)), over(m, n), tau(m),
        y(random<S>(dice, p + n, 1)) {
    const Matrix<S> CR = random<S>(dice, p, n);
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < p; ++i) CR_TF(i, j) = CR(i, j);
  }
  void multiply() {
    multiply_upper_hessenberg(m, T, F, Part<S>{CR_TF, p, 0, n, n});
    multiply_upper_hessenberg(0, T, H, TH);
  }
  void triangularise() {
    structured_qr(Shape::trapezoidal, Q, TH, Part<S>{CR_TF, p, 0, n, n}, over, tau);
    hessenberg_qr(p + m, CR_TF, y);
  }
};

const Dimensions array_sizes[] = {{6, 3, 2}, {6, 2, 3}, {5, 1, 1}, {2, 4, 5}, {1, 1, 1}, {3, 0, 2}, {3, 2, 0},
                                  {1, 3, 3}, {0, 2, 2}, {0, 0, 0}, {4, 4, 4}, {3, 5, 3}, {3, 3, 5}};

template <class S>
void keeps_both_patterns() {
  for (const auto& d : array_sizes)
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
      SCOPED_TRACE("n=" + std::to_string(d.n) + " m=" + std::to_string(d.m) + " p=" + std::to_string(d.p) +
                   " seed=" + std::to_string(seed));
      const auto [n, m, p] = d;
      Dice dice(seed);
      CovarianceArray<S> c(d, dice);
      ASSERT_NO_THROW(c.multiply());
      Wide pre = Wide::Zero(p + n, p + m + n), post = pre;
      pre.topLeftCorner(p, p) = widened(c.R.values());
      pre.topRightCorner(p, n) = widened(c.CS.values());
      pre.bottomRightCorner(n, m + n) = widened(c.BQ_AS.values());
      ASSERT_NO_THROW(c.triangularise());
      post.topLeftCorner(p, p) = widened(c.R.values());
      post.bottomLeftCorner(n, p) = widened(c.G);
      post.bottomRightCorner(n, m + n) = lower_of(widened(c.BQ_AS.values()));
      EXPECT_LE(rotation_ratio<S>(pre, post), threshold) << "covariance";

      InformationArray<S> t(d, dice);
      ASSERT_NO_THROW(t.multiply());
      pre = post = Wide::Zero(m + n, m + p + n);  // transposed
      pre.topLeftCorner(m, m) = widened(t.Q.values()).transpose();
      pre.topRightCorner(m, n) = widened(t.TH.values()).transpose();
      pre.bottomRightCorner(n, p + n) = widened(t.CR_TF.values()).transpose();
      ASSERT_NO_THROW(t.triangularise());
      post.topLeftCorner(m, m) = widened(t.Q.values()).transpose();
      post.bottomLeftCorner(n, m) = widened(t.over).transpose();
      post.bottomRightCorner(n, p + n) = lower_of(widened(t.CR_TF.values()).transpose());
      EXPECT_LE(rotation_ratio<S>(pre, post), threshold) << "information";
    }
}

std::int64_t operations_of(auto&& function) {
  operations() = {};
  function();
  return operations().multiplications;
}

/// Six times the leading coefficient of f(1), f(2) ..., a cubic.
std::int64_t third_difference(auto&& f) { return f(4) - 3 * f(3) + 3 * f(2) - f(1); }

}  // namespace

TEST(CondensedArray, StaysInsideItsPatternAsAWhole) {
  keeps_both_patterns<double>();
  keeps_both_patterns<float>();
  keeps_both_patterns<long double>();
}

// 1/6 n^3 + n^2 (3p/2 + m) + n p^2 and 1/6 n^3 + n^2 (3m/2 + p) + n m^2: every coefficient of degree 3, for the count
// is a cubic of t along (n, m, p) t while p, m <= n. The manual's have 2 n p^2 + 2/3 p^3 in the last place.
TEST(CondensedArray, CostsWhatItSays) {
  using Number = Counting<double>;
  for (const auto& d :
       {Dimensions{6, 1, 2}, {6, 2, 1}, {5, 3, 3}, {4, 0, 2}, {4, 2, 0}, {3, 3, 2}, {3, 2, 3}, {2, 0, 0}}) {
    SCOPED_TRACE("n=" + std::to_string(d.n) + " m=" + std::to_string(d.m) + " p=" + std::to_string(d.p));
    const auto [n, m, p] = d;
    const auto scaled = [&d](int t) { return Dimensions{d.n * t, d.m * t, d.p * t}; };
    const auto covariance = [&](int t) {
      Dice dice(3);
      CovarianceArray<Number> array(scaled(t), dice);
      return operations_of([&] {
        array.multiply();
        array.triangularise();
      });
    };
    const auto information = [&](int t) {
      Dice dice(3);
      InformationArray<Number> array(scaled(t), dice);
      return operations_of([&] {
        array.multiply();
        array.triangularise();
      });
    };
    EXPECT_EQ(third_difference(covariance), n * n * n + n * n * (9 * p + 6 * m) + 6 * n * p * p);
    EXPECT_EQ(third_difference(information), n * n * n + n * n * (9 * m + 6 * p) + 6 * n * m * m);
  }
}

}  // namespace kfstab::test
