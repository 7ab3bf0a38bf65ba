#include <kfstab/filters/singular_values.hpp>

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "filters/high_precision.hpp"
#include "filters/random_problem.hpp"
#include "tolerance.hpp"

namespace kfstab::test {
namespace {

constexpr int dozen = 12;  // sweeps that no matrix here may exceed

template <class S>
struct Decomposed {
  Matrix<S> F;
  Vector<S> sigma;
  bool converged;
};

template <class S>
Decomposed<S> decompose(const Matrix<double>& given, int most_sweeps = dozen) {
  Matrix<S> X = cast<S>(given);
  Decomposed<S> result{Matrix<S>(X.cols(), X.cols()), Vector<S>(X.cols()), false};
  Vector<int> pivots(X.cols());
  result.converged = singular_values(X, result.F, result.sigma, pivots, most_sweeps);
  return result;
}

/// Frobenius.
template <class S>
S size_of(const Matrix<S>& X) {
  using std::sqrt;
  S sum(0);
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) sum += X(i, j) * X(i, j);
  return sqrt(sum);
}

/// |X'X - F F'| / (u (r + c) |X|^2), in high precision.
template <class S>
double residual(const Matrix<double>& given, const Matrix<S>& F) {
  const Matrix<HighPrecision> X = cast<HighPrecision>(given);
  const Index r = X.rows(), c = X.cols();
  if (c == 0) return 0;
  Matrix<HighPrecision> difference(c, c);
  for (Index j = 0; j < c; ++j)
    for (Index i = 0; i < c; ++i) {
      HighPrecision s = 0;
      for (Index k = 0; k < r; ++k) s += X(k, i) * X(k, j);
      for (Index k = 0; k < c; ++k) s -= HighPrecision(F(i, k)) * HighPrecision(F(j, k));
      difference(i, j) = s;
    }
  const HighPrecision size = size_of(X), error = size_of(difference);
  if (error == 0) return 0;
  return static_cast<double>(
      HighPrecision(error / (HighPrecision(unit_roundoff<S>()) * static_cast<int>(r + c) * size * size)));
}

/// The largest |f_i' f_j| / ((2r + 12) u |f_i| |f_j|) of different columns, in high precision; and that sigma has their
/// norms, in decreasing order.
template <class S>
double angle(Index r, const Decomposed<S>& is) {
  const Index c = is.F.cols();
  HighPrecision worst = 0;
  Vector<HighPrecision> norms(c);
  for (Index j = 0; j < c; ++j) {
    HighPrecision s = 0;
    for (Index k = 0; k < c; ++k) s += HighPrecision(is.F(k, j)) * HighPrecision(is.F(k, j));
    norms(j) = sqrt(s);
    EXPECT_LE(abs(HighPrecision(norms(j) - HighPrecision(is.sigma(j)))),
              HighPrecision(norms(j) * HighPrecision(unit_roundoff<S>()) * static_cast<int>(2 * c + 4)));
    if (j > 0) {
      EXPECT_LE(is.sigma(j), is.sigma(j - 1));
    }
    for (Index i = 0; i < j; ++i) {
      if (norms(i) == 0 || norms(j) == 0) continue;
      HighPrecision inner = 0;
      for (Index k = 0; k < c; ++k) inner += HighPrecision(is.F(k, i)) * HighPrecision(is.F(k, j));
      worst = std::max(worst, HighPrecision(abs(inner) / (norms(i) * norms(j))));
    }
  }
  return static_cast<double>(HighPrecision(worst / (static_cast<int>(2 * r + 12) * HighPrecision(unit_roundoff<S>()))));
}

/// What holds of every decomposition. The angle: that of the sweeps' test, whose own
/// rounding is r u.
template <class S>
void expect_decomposed(const Matrix<double>& X, const std::string& text) {
  SCOPED_TRACE(text + ", " + std::to_string(X.rows()) + " x " + std::to_string(X.cols()));
  const Decomposed<S> is = decompose<S>(X);
  EXPECT_TRUE(is.converged);
  EXPECT_LE(residual(X, is.F), threshold);
  EXPECT_LE(angle(X.rows(), is), 1.5);
}

std::vector<std::pair<std::string, Matrix<double>>> matrices() {
  std::vector<std::pair<std::string, Matrix<double>>> all;
  Dice dice(71);
  for (const auto& [r, c] : {std::pair{0, 0}, {3, 0}, {1, 1}, {4, 1}, {2, 2}, {3, 2}, {5, 5}, {12, 5}, {20, 20}}) {
    all.emplace_back("random", dice.matrix(r, c, 16));
    all.emplace_back("zero", Matrix<double>::Zero(r, c));
    all.emplace_back("ones", Matrix<double>::Ones(r, c));
    Matrix<double> X = Matrix<double>::Zero(r, c);
    for (Index j = 0; j < c; ++j) X(j, c - 1 - j) = std::ldexp(1., static_cast<int>(3 * ((7 * j) % c)) - 20);
    all.emplace_back("permuted diagonal", X);
    if (c < 2) continue;
    X = dice.matrix(r, c, 16);
    X.col(c - 1) = X.col(0);
    all.emplace_back("one column twice", X);
    X.col(0).setZero();
    all.emplace_back("a column of zeros", X);
    Matrix<double> thin = dice.matrix(r, 1 + c / 3, 16);
    all.emplace_back("deficient rank", thin * dice.matrix(thin.cols(), c, 16));
    X = Matrix<double>::Zero(r, c);
    X.row(r - 1) = dice.matrix(1, c, 16);
    all.emplace_back("one row", X);
    X = Matrix<double>::Zero(r, c);
    for (Index j = 0; j < c; ++j)
      for (Index i = 0; i < r; ++i) X(i, j) = static_cast<float>(1. / static_cast<double>(i + j + 1));
    all.emplace_back("Hilbert's", X);
    X = dice.matrix(r, c, 16);
    for (Index j = 0; j < c; ++j) X.col(j) *= std::ldexp(1., static_cast<int>(-30 * j / c));
    all.emplace_back("graded columns", X);
    X.rowwise().reverseInPlace();
    all.emplace_back("columns graded the other way", X);
    X = dice.matrix(r, c, 16);
    for (Index i = 0; i < r; ++i) X.row(i) *= std::ldexp(1., static_cast<int>(30 * i / r));
    all.emplace_back("graded rows", X);
  }
  return all;
}

/// X = B D: each singular value is right to u k(B), the smallest too, 2^-60 of the largest.
template <class S>
void graded_columns() {
  for (std::uint64_t seed = 1; seed <= 10; ++seed)
    for (const Index c : {2, 4, 7}) {
      Dice dice(seed);
      const Matrix<double> B = dice.matrix(c + 3, c, 16);
      const auto of_B = decompose<HighPrecision>(B);
      const double kappa = static_cast<double>(HighPrecision(of_B.sigma(0) / of_B.sigma(c - 1)));
      Matrix<double> X = B;
      for (Index j = 0; j < c; ++j) X.col((j * 3) % c) *= std::ldexp(1., static_cast<int>(-60 * j / (c - 1)));
      const auto truth = decompose<HighPrecision>(X);
      const auto is = decompose<S>(X);
      ASSERT_TRUE(truth.converged && is.converged);
      for (Index j = 0; j < c; ++j) {
        const double error =
            static_cast<double>(HighPrecision(abs(HighPrecision(is.sigma(j)) - truth.sigma(j)) / truth.sigma(j)));
        EXPECT_LE(error / (static_cast<double>(unit_roundoff<S>()) * static_cast<double>(2 * c + 3) * kappa), threshold)
            << "sigma " << j << " of " << c << " is " << is.sigma(j) << ", k(B) = " << kappa;
      }
    }
}

}  // namespace

template <class S>
class SingularValues : public ::testing::Test {};

using Scalars = ::testing::Types<float, double, long double, HighPrecision>;
TYPED_TEST_SUITE(SingularValues, Scalars);

TYPED_TEST(SingularValues, AreAColumnwiseOrthogonalRoot) {
  for (const auto& [text, X] : matrices()) expect_decomposed<TypeParam>(X, text);
}

TYPED_TEST(SingularValues, OfADiagonalAreExact) {
  for (const Index c : {1, 3, 8}) {
    Matrix<double> X = Matrix<double>::Zero(c + 2, c);
    for (Index j = 0; j < c; ++j) X((j + 2) % c, j) = (j % 2 ? -1 : 1) * std::ldexp(1., static_cast<int>((5 * j) % c));
    const auto is = decompose<TypeParam>(X, 0);
    ASSERT_TRUE(is.converged);
    for (Index j = 0; j < c; ++j) EXPECT_EQ(is.sigma(j), TypeParam(std::ldexp(1., static_cast<int>(c - 1 - j))));
  }
}

TEST(SingularValuesOfGradedColumns, AreRelativelyAccurate) {
  graded_columns<float>();
  graded_columns<double>();
  graded_columns<long double>();
}

// Numbers whose squares are out of range: scaled by a power of two the result is the same to the last bit, and a part
// of a matrix that is 2^-700 of the rest is not lost.
TEST(SingularValuesOfDouble, NeitherOverflowNorUnderflow) {
  const Matrix<double> X = Dice(72).matrix(6, 4, 16);
  const auto is = decompose<double>(X);
  for (const int e : {-900, -600, 600, 1000}) {
    const auto scaled = decompose<double>(X * std::ldexp(1., e));
    ASSERT_TRUE(scaled.converged);
    EXPECT_EQ(scaled.sigma, is.sigma * std::ldexp(1., e));
    EXPECT_EQ(scaled.F, is.F * std::ldexp(1., e));
  }
  Matrix<double> parts = Matrix<double>::Zero(6, 4);
  parts.topLeftCorner(3, 2) = X.topLeftCorner(3, 2) * 0x1p+300;
  parts.bottomRightCorner(3, 2) = X.topLeftCorner(3, 2) * 0x1p-400;
  const auto part = decompose<double>(X.topLeftCorner(3, 2)), both = decompose<double>(parts);
  ASSERT_TRUE(both.converged);
  for (Index j = 0; j < 2; ++j) {
    // u (r + c) k(B) of the part, whose condition number is sigma_0 / sigma_1.
    const double limit = threshold * 0x1p-53 * 5 * part.sigma(0) / part.sigma(1);
    EXPECT_NEAR(both.sigma(j) / (part.sigma(j) * 0x1p+300), 1, limit);
    EXPECT_NEAR(both.sigma(2 + j) / (part.sigma(j) * 0x1p-400), 1, limit);
  }
}

// Many of the smallest, where the test for orthogonality leaves the least room to rounding.
TEST(SingularValuesOfFloat, OfSmallMatricesConverge) {
  Dice dice(73);
  for (int i = 0; i < 20000; ++i) {
    const Index c = 1 + i % 3;
    const Matrix<double> X = cast<float>(Matrix<double>(dice.matrix(c, c, 1 << 20))).cast<double>();
    const auto is = decompose<float>(X);
    ASSERT_TRUE(is.converged) << X;
  }
}

// However far the rotations have come, F F' is X'X: what a filter that holds F loses is the order of its columns.
TYPED_TEST(SingularValues, ThatDoNotConvergeLeaveARootAllTheSame) {
  const Matrix<double> X = Dice(74).matrix(9, 6, 16);
  for (const int sweeps : {0, 1, 2}) {
    const auto is = decompose<TypeParam>(X, sweeps);
    EXPECT_FALSE(is.converged) << sweeps;
    EXPECT_LE(residual(X, is.F), threshold) << sweeps;
  }
  EXPECT_TRUE(decompose<TypeParam>(X).converged);
}

TEST(SingularValuesOfDouble, OfNaNAndInfinityAreRefused) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()})
    for (const Index c : {1, 3})
      for (Index i = 0; i < 4; ++i)
        for (Index j = 0; j < c; ++j) {
          Matrix<double> X = Dice(75).matrix(4, c, 16);
          X(i, j) = bad;
          const auto is = decompose<double>(X);
          EXPECT_FALSE(is.converged);
          EXPECT_FALSE(all_finite(is.F) || all_finite(is.sigma));
        }
}

}  // namespace kfstab::test
