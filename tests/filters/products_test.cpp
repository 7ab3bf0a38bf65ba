#include <kfstab/filters/products.hpp>

#include <gtest/gtest.h>

#include "filters/guarded.hpp"
#include "filters/random_problem.hpp"

// Few-bit numbers: every product here is exact, so every comparison is of bits.
namespace kfstab::test {
namespace {

Matrix<double> plain(const Matrix<double>& X, const Matrix<double>& Y) {
  Matrix<double> Z = Matrix<double>::Zero(X.rows(), Y.cols());
  for (Index j = 0; j < Y.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      for (Index k = 0; k < X.cols(); ++k) Z(i, j) += X(i, k) * Y(k, j);
  return Z;
}

}  // namespace

TEST(Products, WithTrianglesReadThoseAlone) {
  Dice dice(1);
  for (Index n = 0; n <= 4; ++n)
    for (Index r = 0; r <= 3; ++r) {
      const Guarded<double> L(dice.matrix(n, n, 16), Allowed::lower), U(dice.matrix(n, n, 16), Allowed::upper);
      const Matrix<double> X = dice.matrix(r, n, 16), Y = dice.matrix(n, r, 16);
      Matrix<double> XL(r, n), UY(n, r);
      ASSERT_NO_THROW(multiply_lower(X, L, XL));
      ASSERT_NO_THROW(multiply_upper(U, Y, UY));
      EXPECT_EQ(XL, plain(X, L.values())) << n << " " << r;
      EXPECT_EQ(UY, plain(U.values(), Y)) << n << " " << r;
    }
}

TEST(Products, IntoOneTriangleLeaveTheOther) {
  Dice dice(2);
  for (Index n = 0; n <= 4; ++n)
    for (Index r = 0; r <= 3; ++r) {
      Guarded<double> M(dice.matrix(n, n, 16), Allowed::upper);
      const Matrix<double> before = M.values(), X = dice.matrix(n, r, 16), Y = dice.matrix(n, r, 16);
      const Matrix<double> XY = plain(X, Y.transpose());
      ASSERT_NO_THROW(add_product_upper(M, X, Y));
      for (Index j = 0; j < n; ++j)
        for (Index i = 0; i <= j; ++i) EXPECT_EQ(M(i, j), before(i, j) + XY(i, j));
      ASSERT_NO_THROW(subtract_product_upper(M, X, Y));
      EXPECT_EQ(M.values(), before);
    }
}

TEST(Products, MirrorsAndCopiesOfTriangles) {
  Dice dice(3);
  const Matrix<double> X = dice.matrix(3, 3, 16);
  Matrix<double> M = X;
  mirror_upper(M);
  EXPECT_EQ(M, M.transpose());
  Matrix<double> upper(3, 3), lower(3, 3);
  ASSERT_NO_THROW(copy_upper(Guarded<double>(X, Allowed::upper), upper));
  ASSERT_NO_THROW(copy_lower(Guarded<double>(X, Allowed::lower), lower));
  for (Index j = 0; j < 3; ++j)
    for (Index i = 0; i < 3; ++i) {
      EXPECT_EQ(upper(i, j), i <= j ? X(i, j) : 0);
      EXPECT_EQ(lower(i, j), i >= j ? X(i, j) : 0);
      EXPECT_EQ(M(i, j), i <= j ? X(i, j) : X(j, i));
    }
}

}  // namespace kfstab::test
