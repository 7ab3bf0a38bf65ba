#include <kfstab/filters/structured_lq.hpp>

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "filters/guarded.hpp"
#include "filters/random_problem.hpp"
#include "tolerance.hpp"

namespace kfstab::test::lq_factorisation {
namespace {

using Wide = Matrix<long double>;  // truth beside double and float: 11 bits more, and a range that no square leaves

template <class S>
Wide widened(const Matrix<S>& X) {
  Wide Y(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(i, j) = X(i, j);
  return Y;
}

Wide transposed(const Wide& X) {
  Wide Y(X.cols(), X.rows());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(j, i) = X(i, j);
  return Y;
}

/// [X Y; Z W].
Wide joined(const Wide& X, const Wide& Y, const Wide& Z, const Wide& W) {
  Wide all(X.rows() + Z.rows(), X.cols() + Y.cols());
  for (Index j = 0; j < all.cols(); ++j)
    for (Index i = 0; i < all.rows(); ++i) {
      const bool top = i < X.rows(), left = j < X.cols();
      const Index row = top ? i : i - X.rows(), col = left ? j : j - X.cols();
      all(i, j) = top ? (left ? X(row, col) : Y(row, col)) : (left ? Z(row, col) : W(row, col));
    }
  return all;
}

long double product(const Wide& X, Index i, const Wide& Y, Index j) {
  long double s = 0;
  for (Index k = 0; k < X.cols(); ++k) s += X(i, k) * Y(j, k);
  return s;
}

/// Whether post = pre U for an orthogonal U, which it is if and only if the inner products of their rows are the same.
/// An array perturbed by u times the norm of each row, as Householder's reflectors perturb it, changes each product by
/// u |row i| |row j|: kappa = 1, whatever the entries. Returns the largest error / (u size |row i| |row j|).
template <class S>
double rotation_ratio(const Wide& pre, const Wide& post) {
  const long double unit = unit_roundoff<S>(), size = static_cast<long double>(pre.rows() + pre.cols());
  double worst = 0;
  for (Index i = 0; i < pre.rows(); ++i)
    for (Index j = 0; j <= i; ++j) {
      const long double error = std::abs(product(pre, i, pre, j) - product(post, i, post, j));
      const long double scale = std::sqrt(product(pre, i, pre, i)) * std::sqrt(product(pre, j, pre, j));
      if (error == 0) continue;
      const double ratio = static_cast<double>(error / (unit * size * scale));
      if (!(ratio <= worst)) worst = ratio;
    }
  return worst;
}

/// Largest difference of two arrays, row by row, over u times size times the norm of the row.
template <class S>
double difference_ratio(const Wide& X, const Wide& Y) {
  const long double unit = unit_roundoff<S>(), size = static_cast<long double>(X.rows() + X.cols());
  double worst = 0;
  for (Index i = 0; i < X.rows(); ++i)
    for (Index j = 0; j < X.cols(); ++j) {
      const long double error = std::abs(X(i, j) - Y(i, j));
      if (error == 0) continue;
      const double ratio = static_cast<double>(error / (unit * size * std::sqrt(product(X, i, X, i))));
      if (!(ratio <= worst)) worst = ratio;
    }
  return worst;
}

template <class S>
struct Array {
  Guarded<S> L, A, B, C;
  Vector<S> tau;
};

struct Sizes {
  Index n, m, r;
};

// n against m both ways round (n > m is p > n in a filter), and nothing at all.
const std::vector<Sizes> all_sizes = {{3, 3, 2}, {2, 5, 3}, {5, 2, 3}, {5, 1, 1}, {1, 5, 2}, {1, 1, 1}, {3, 2, 0},
                                      {0, 3, 2}, {3, 0, 2}, {0, 0, 0}, {1, 0, 0}, {0, 1, 1}, {4, 4, 1}};

template <class S>
Matrix<S> random(Dice& dice, Index rows, Index cols) {
  return cast<S>(Matrix<double>(dice.matrix(rows, cols, 16)));
}

/// For the LQ; what C holds at first is not read: NaN.
template <class S>
Array<S> random_array(Shape shape, const Sizes& size, std::uint64_t seed) {
  Dice dice(seed);
  const bool trapezoidal = shape == Shape::trapezoidal;
  return {Guarded<S>(random<S>(dice, size.n, size.n), Allowed::lower),
          Guarded<S>(random<S>(dice, size.n, size.m), trapezoidal ? Allowed::lower : Allowed::all),
          Guarded<S>(random<S>(dice, size.r, size.m), Allowed::all),
          Guarded<S>(Matrix<S>::Constant(size.r, size.n, S(std::nan(""))), Allowed::all),
          Vector<S>::Constant(size.n, S(std::nan("")))};
}

template <class S>
Array<S> transposed(const Array<S>& X, Shape shape) {
  const auto flip = [](const Guarded<S>& Y) { return Matrix<S>(Y.values().transpose()); };
  return {Guarded<S>(flip(X.L), Allowed::upper),
          Guarded<S>(flip(X.A), shape == Shape::trapezoidal ? Allowed::upper : Allowed::all),
          Guarded<S>(flip(X.B), Allowed::all),
          Guarded<S>(Matrix<S>::Constant(X.C.cols(), X.C.rows(), S(std::nan(""))), Allowed::all), X.tau};
}

template <class S>
Wide before(const Array<S>& X) {
  return joined(widened(X.L.values()), widened(X.A.values()), Wide::Zero(X.B.rows(), X.L.cols()),
                widened(X.B.values()));
}

template <class S>
Wide after(const Array<S>& X) {
  return joined(widened(X.L.values()), Wide::Zero(X.A.rows(), X.A.cols()), widened(X.C.values()),
                widened(X.B.values()));
}

/// The pre-array times the reflectors that A and tau hold, one after the other, in long double.
template <class S>
Wide reflected(Wide pre, const Array<S>& post) {
  const Index n = post.L.rows(), m = post.A.cols();
  const Matrix<S> V = post.A.values();
  for (Index i = 0; i < n; ++i)
    for (Index row = 0; row < pre.rows(); ++row) {
      long double w = pre(row, i);
      for (Index j = 0; j < m; ++j) w += pre(row, n + j) * V(i, j);
      w *= post.tau(i);
      pre(row, i) -= w;
      for (Index j = 0; j < m; ++j) pre(row, n + j) -= w * V(i, j);
    }
  return pre;
}

template <class S>
void expect_orthogonal_reflectors(const Array<S>& post) {
  const Matrix<S> V = post.A.values();
  for (Index i = 0; i < post.L.rows(); ++i) {
    long double vv = 1;
    for (Index j = 0; j < post.A.cols(); ++j) vv += static_cast<long double>(V(i, j)) * V(i, j);
    const long double tau = post.tau(i);
    if (tau == 0) {
      EXPECT_EQ(vv, 1) << "H = I holds no vector: reflector " << i;
      continue;
    }
    EXPECT_GE(tau, 1);
    EXPECT_LE(tau, 2);
    // tau u'u = 2; u'u sums m + 1 squares.
    EXPECT_LE(std::abs(tau * vv - 2), threshold * unit_roundoff<S>() * static_cast<long double>(post.A.cols() + 1) * 2)
        << "reflector " << i;
  }
}

template <class S>
void factorises(Shape shape, const Array<S>& given) {
  const Wide pre = before(given);
  Array<S> X = given;
  ASSERT_NO_THROW(structured_lq(shape, X.L, X.A, X.B, X.C, X.tau));
  EXPECT_LE(rotation_ratio<S>(pre, after(X)), threshold);
  EXPECT_LE((difference_ratio<S>(reflected(pre, X), after(X))), threshold);
  expect_orthogonal_reflectors(X);

  Array<S> Y = transposed(given, shape);
  ASSERT_NO_THROW(structured_qr(shape, Y.L, Y.A, Y.B, Y.C, Y.tau));
  const Wide mirrored =
      joined(widened(Y.L.values()), widened(Y.C.values()), Wide::Zero(Y.A.rows(), Y.A.cols()), widened(Y.B.values()));
  EXPECT_LE(rotation_ratio<S>(pre, transposed(mirrored)), threshold);
  const Array<S> back{Guarded<S>(X.L.values(), Allowed::lower), Guarded<S>(Y.A.values().transpose(), Allowed::all),
                      Guarded<S>(Y.B.values().transpose(), Allowed::all),
                      Guarded<S>(Y.C.values().transpose(), Allowed::all), Y.tau};
  EXPECT_LE((difference_ratio<S>(reflected(pre, back), transposed(mirrored))), threshold);
  expect_orthogonal_reflectors(back);
}

std::string text(Shape shape, const Sizes& size) {
  return std::string(shape == Shape::full ? "full" : "trapezoidal") + " n=" + std::to_string(size.n) +
         " m=" + std::to_string(size.m) + " r=" + std::to_string(size.r);
}

template <class S>
void factorises_every_size() {
  for (const Shape shape : {Shape::full, Shape::trapezoidal})
    for (const Sizes& size : all_sizes)
      for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        SCOPED_TRACE(text(shape, size) + " seed=" + std::to_string(seed));
        factorises(shape, random_array<S>(shape, size, seed));
      }
}

template <class S>
void scale_rows(Guarded<S>& X, const std::vector<S>& factors, Index first = 0) {
  for (Index i = 0; i < X.rows(); ++i)
    for (Index j = 0; j < X.cols(); ++j)
      if (X.may_touch(i, j)) X(i, j) *= factors[static_cast<std::size_t>(first + i) % factors.size()];
}

/// Bit by bit, NaN or not.
template <class S>
void expect_scaled(const Matrix<S>& X, const Matrix<S>& Y, S factor) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) EXPECT_EQ(X(i, j) * factor, Y(i, j)) << "(" << i << "," << j << ")";
}

template <class S>
bool has_nan(const Matrix<S>& X) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      if (std::isnan(X(i, j))) return true;
  return false;
}

}  // namespace

TEST(MakeReflector, MapsToAMultipleOfTheFirstUnitVector) {
  for (Index size = 0; size <= 5; ++size)
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      Dice dice(seed);
      const double alpha = dice.roll(-2, 2);
      Matrix<double> v = dice.matrix(size, 1, 16);
      const Matrix<double> x = v;
      const auto H = make_reflector(alpha, size, [&](Index i) -> double& { return v(i, 0); });
      long double norm = static_cast<long double>(alpha) * alpha, w = alpha;
      for (Index i = 0; i < size; ++i) {
        norm += static_cast<long double>(x(i, 0)) * x(i, 0);
        w += static_cast<long double>(x(i, 0)) * v(i, 0);
      }
      norm = std::sqrt(norm);
      w *= H.tau;
      const long double tolerance = threshold * unit_roundoff<double>() * static_cast<long double>(size + 1) * norm;
      EXPECT_LE(std::abs(alpha - w - H.beta), tolerance);
      for (Index i = 0; i < size; ++i) EXPECT_LE(std::abs(x(i, 0) - w * v(i, 0)), tolerance);
      EXPECT_LE(std::abs(std::abs(static_cast<long double>(H.beta)) - norm), tolerance);
      // Never the sign of alpha, which would cancel.
      if (H.tau != 0) {
        EXPECT_LE(H.beta * alpha, 0);
      }
    }
}

TEST(MakeReflector, IsTheIdentityWhereNothingIsToBeDone) {
  double zeros[] = {0, 0, 0};
  const auto H = make_reflector(-2., 3, [&](Index i) -> double& { return zeros[i]; });
  EXPECT_EQ(H.beta, -2.);
  EXPECT_EQ(H.tau, 0.);
  const auto empty = make_reflector(3., 0, [&](Index i) -> double& { return zeros[i]; });
  EXPECT_EQ(empty.beta, 3.);
  EXPECT_EQ(empty.tau, 0.);
}

TEST(MakeReflector, LetsNothingThatIsNotFinitePass) {
  const double nan = std::nan(""), inf = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, inf, -inf})
    for (Index where = -1; where < 3; ++where)
      for (const double rest : {0., 1., 1e-300, 1e300}) {
        double x[] = {rest, rest, rest};
        double alpha = rest;
        (where < 0 ? alpha : x[where]) = bad;
        const auto H = make_reflector(alpha, 3, [&](Index i) -> double& { return x[i]; });
        EXPECT_FALSE(std::isfinite(H.beta)) << bad << " at " << where << " among " << rest;
      }
}

TEST(StructuredLq, IsBackwardStableInDouble) { factorises_every_size<double>(); }
TEST(StructuredLq, IsBackwardStableInFloat) { factorises_every_size<float>(); }

// Rows of 1e-300 beside rows of 1e300, and both in one row: squares of either leave the range, the results do not.
TEST(StructuredLq, NeitherOverflowsNorUnderflowsWhereItNeedNot) {
  const double big = 0x1p+996, tiny = 0x1p-996;
  for (const Shape shape : {Shape::full, Shape::trapezoidal})
    for (const Sizes& size : all_sizes)
      for (const auto& factors : std::vector<std::vector<double>>{{big}, {tiny}, {big, tiny}, {tiny, 1, big}}) {
        SCOPED_TRACE(text(shape, size) + " first factor " + std::to_string(std::ilogb(factors[0])));
        Array<double> X = random_array<double>(shape, size, 11);
        scale_rows(X.L, factors);
        scale_rows(X.A, factors);
        scale_rows(X.B, factors, size.n);
        factorises(shape, X);
      }
  for (const Sizes& size : all_sizes) {
    SCOPED_TRACE(text(Shape::full, size) + " one column of 1e-300 among 1e300");
    Array<double> X = random_array<double>(Shape::full, size, 12);
    scale_rows(X.L, {big});
    scale_rows(X.A, {big});
    scale_rows(X.B, {big});
    for (Index i = 0; i < size.n && size.m > 0; ++i) X.A(i, 0) *= tiny * tiny;
    factorises(Shape::full, X);
  }
}

// A power of two rounds nothing: the whole array times 2^s gives the same reflectors and 2^s times the same result.
TEST(StructuredLq, ScalesWithPowersOfTwoBitByBit) {
  for (const Shape shape : {Shape::full, Shape::trapezoidal})
    for (const Sizes& size : all_sizes)
      for (const int exponent : {-900, -300, -1, 1, 7, 300, 990}) {
        SCOPED_TRACE(text(shape, size) + " times 2^" + std::to_string(exponent));
        Array<double> X = random_array<double>(shape, size, 13), Y = X;
        const double factor = std::ldexp(1., exponent);
        scale_rows(Y.L, {factor});
        scale_rows(Y.A, {factor});
        scale_rows(Y.B, {factor});
        structured_lq(shape, X.L, X.A, X.B, X.C, X.tau);
        structured_lq(shape, Y.L, Y.A, Y.B, Y.C, Y.tau);
        expect_scaled(X.L.values(), Y.L.values(), factor);
        expect_scaled(X.B.values(), Y.B.values(), factor);
        expect_scaled(X.C.values(), Y.C.values(), factor);
        expect_scaled(X.A.values(), Y.A.values(), 1.);
        for (Index i = 0; i < size.n; ++i) EXPECT_EQ(X.tau(i), Y.tau(i));
      }
}

// One NaN anywhere must show in the result; one that got lost would leave a wrong number that looks like any other.
TEST(StructuredLq, LetsNoNaNGetLost) {
  for (const Sizes& size : {Sizes{2, 3, 2}, Sizes{1, 2, 0}, Sizes{3, 2, 1}, Sizes{1, 1, 1}})
    for (const bool sparse : {false, true})
      for (int block = 0; block < 3; ++block)
        for (Index i = 0; i < (block == 2 ? size.r : size.n); ++i)
          for (Index j = 0; j < (block == 0 ? i + 1 : size.m); ++j) {
            Array<double> X = random_array<double>(Shape::full, size, 14);
            if (sparse) {
              scale_rows(X.A, {0.});
              scale_rows(X.B, {0.});
            }
            (block == 0 ? X.L : block == 1 ? X.A : X.B)(i, j) = std::nan("");
            Array<double> Y = transposed(X, Shape::full);
            structured_lq(Shape::full, X.L, X.A, X.B, X.C, X.tau);
            EXPECT_TRUE(has_nan(X.L.values()) || has_nan(X.B.values()) || has_nan(X.C.values()))
                << "block " << block << " (" << i << "," << j << ")" << (sparse ? " among zeros" : "");
            structured_qr(Shape::full, Y.L, Y.A, Y.B, Y.C, Y.tau);
            EXPECT_TRUE(has_nan(Y.L.values()) || has_nan(Y.B.values()) || has_nan(Y.C.values()))
                << "QR, block " << block << " (" << j << "," << i << ")" << (sparse ? " among zeros" : "");
          }
}

TEST(Lq, IsBackwardStable) {
  for (const auto& [r, c] : {std::pair<Index, Index>{0, 0}, {0, 3}, {1, 1}, {1, 4}, {3, 3}, {3, 7}, {5, 5}})
    for (const double factor : {1., 0x1p+996, 0x1p-996})
      for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        Dice dice(seed);
        Matrix<double> X = dice.matrix(r, c, 16) * factor;
        const Wide pre = widened(X);
        Vector<double> tau(r);
        lq(X, tau);
        Wide post = Wide::Zero(r, c);
        for (Index j = 0; j < r; ++j)
          for (Index i = j; i < r; ++i) post(i, j) = X(i, j);
        EXPECT_LE(rotation_ratio<double>(pre, post), threshold) << r << " x " << c << " seed=" << seed;
      }
}

TEST(Qr, IsBackwardStableAndTakesTheRightHandSideAlong) {
  for (const auto& [r, c] : {std::pair<Index, Index>{0, 0}, {3, 0}, {1, 1}, {4, 1}, {3, 3}, {7, 3}, {5, 5}})
    for (const double factor : {1., 0x1p+996, 0x1p-996})
      for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        Dice dice(seed);
        Matrix<double> X = dice.matrix(r, c, 16) * factor;
        Vector<double> y = dice.vector(r, 16) * factor;
        const Matrix<double> y_before = y;
        const Wide pre = joined(transposed(widened(X)), Wide(c, 0), transposed(widened(y_before)), Wide(1, 0));
        qr(X, y);
        Wide post = Wide::Zero(c + 1, r);
        for (Index j = 0; j < c; ++j)
          for (Index i = 0; i <= j; ++i) post(j, i) = X(i, j);
        for (Index i = 0; i < r; ++i) post(c, i) = y(i);
        EXPECT_LE(rotation_ratio<double>(pre, post), threshold) << r << " x " << c << " seed=" << seed;
      }
}

// A column (0; b) is what structured_qr itself does to B: the same operations in the same order.
TEST(ApplyReflector, DoesWhatStructuredQrDoesToItsOwnColumns) {
  for (const Shape shape : {Shape::full, Shape::trapezoidal})
    for (const Sizes& size : all_sizes) {
      Array<double> X = transposed(random_array<double>(shape, size, 15), shape);
      const Matrix<double> B = X.B.values();
      structured_qr(shape, X.L, X.A, X.B, X.C, X.tau);
      for (Index column = 0; column < B.cols(); ++column) {
        Vector<double> bottom = B.col(column);
        for (Index j = 0; j < size.n; ++j) {
          const Index length = shape == Shape::trapezoidal ? std::min(j + 1, size.m) : size.m;
          double top = 0;
          apply_reflector(X.tau(j), X.A, j, length, top, bottom);
          EXPECT_EQ(top, X.C(j, column));
        }
        for (Index i = 0; i < size.m; ++i) EXPECT_EQ(bottom(i), X.B(i, column));
      }
    }
}

// And a column of R's kind, with a top of its own: its norm and its product with the first column are kept.
TEST(ApplyReflector, IsOrthogonal) {
  Dice dice(16);
  for (Index length = 0; length <= 4; ++length) {
    Matrix<double> V = dice.matrix(length, 1, 16);
    const Matrix<double> x = V;
    const double alpha = 1.5;
    const auto H = make_reflector(alpha, length, [&](Index i) -> double& { return V(i, 0); });
    Vector<double> bottom = dice.vector(length, 16);
    double top = -.75;
    Wide pre(2, length + 1), post(2, length + 1);
    pre(0, 0) = alpha, pre(1, 0) = top;
    for (Index i = 0; i < length; ++i) pre(0, i + 1) = x(i, 0), pre(1, i + 1) = bottom(i);
    apply_reflector(H.tau, V, 0, length, top, bottom);
    post.row(0).setZero();
    post(0, 0) = H.beta, post(1, 0) = top;
    for (Index i = 0; i < length; ++i) post(1, i + 1) = bottom(i);
    EXPECT_LE(rotation_ratio<double>(pre, post), threshold) << "length " << length;
  }
}

}  // namespace kfstab::test::lq_factorisation
