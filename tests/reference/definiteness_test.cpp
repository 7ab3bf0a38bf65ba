#include <kfstab/reference/definiteness.hpp>

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include <kfstab/reference/error.hpp>

#include "support.hpp"
#include "tolerance.hpp"

namespace kfstab::reference::testing {
namespace {

using test::ulp;

constexpr double denormal = std::numeric_limits<double>::denorm_min();

Matrix<double> transposed_product(const Matrix<double>& L, const Matrix<double>& D) {
  const Matrix<double> LD = L.lazyProduct(D);
  return LD.lazyProduct(L.transpose());
}

TEST(Definiteness, DecidesByOneUnitInTheLastPlace) {
  const auto near_singular = [](double corner) { return matrix(2, 2, {1, 1, 1, corner}); };
  EXPECT_EQ(signature(near_singular(1)), (Signature{1, 1, 0}));
  EXPECT_EQ(signature(near_singular(1 + ulp)), (Signature{2, 0, 0}));
  EXPECT_EQ(signature(near_singular(1 - ulp / 2)), (Signature{1, 0, 1}));
  EXPECT_TRUE(is_positive_semidefinite(near_singular(1)));
  EXPECT_FALSE(is_positive_definite(near_singular(1)));
  EXPECT_TRUE(is_positive_definite(near_singular(1 + ulp)));
  EXPECT_FALSE(is_positive_semidefinite(near_singular(1 - ulp / 2)));
  EXPECT_EQ(smallest_eigenvalue(near_singular(1)), 0);
  // lambda = e/2 - e^2/8 + ..., e the distance from 1
  EXPECT_NEAR(smallest_eigenvalue(near_singular(1 + ulp)) / (ulp / 2), 1, 1e-6);
  EXPECT_NEAR(smallest_eigenvalue(near_singular(1 - ulp / 2)) / (-ulp / 4), 1, 1e-6);
}

TEST(Definiteness, SmallAndDegenerate) {
  EXPECT_EQ(signature(Matrix<double>(0, 0)), (Signature{0, 0, 0}));
  EXPECT_TRUE(is_positive_definite(Matrix<double>(0, 0)));
  EXPECT_EQ(smallest_eigenvalue(Matrix<double>(0, 0)), std::numeric_limits<double>::infinity());
  EXPECT_EQ(signature(matrix(1, 1, {-0.0})), (Signature{0, 1, 0}));
  EXPECT_TRUE(is_positive_definite(matrix(1, 1, {denormal})));
  EXPECT_FALSE(is_positive_semidefinite(matrix(1, 1, {-denormal})));
  EXPECT_EQ(smallest_eigenvalue(matrix(1, 1, {-3})), -3);
  EXPECT_EQ(signature(Matrix<double>::Zero(3, 3)), (Signature{0, 3, 0}));
  EXPECT_TRUE(is_positive_semidefinite(Matrix<double>::Zero(3, 3)));
  EXPECT_EQ(smallest_eigenvalue(Matrix<double>::Zero(3, 3)), 0);
}

TEST(Definiteness, ZeroPivots) {
  EXPECT_EQ(signature(matrix(2, 2, {0, 1, 1, 0})), (Signature{1, 0, 1}));
  EXPECT_EQ(signature(matrix(2, 2, {0, 0, 0, -1})), (Signature{0, 1, 1}));
  // trace 0, determinant 2 x 1 x 2 x 3 > 0
  EXPECT_EQ(signature(matrix(3, 3, {0, 1, 2, 1, 0, 3, 2, 3, 0})), (Signature{1, 0, 2}));
  EXPECT_EQ(signature(matrix(3, 3, {1, 1, 0, 1, 1, 1, 0, 1, 0})), (Signature{2, 0, 1}));
  EXPECT_FALSE(is_positive_semidefinite(matrix(3, 3, {1, 1, 0, 1, 1, 1, 0, 1, 0})));
  EXPECT_FALSE(is_positive_semidefinite(matrix(2, 2, {0, denormal, denormal, 1})));
  EXPECT_TRUE(is_positive_semidefinite(matrix(2, 2, {0, 0, 0, 1})));
}

/// Signs of the roots of det(X - x I) by Descartes' rule, which is exact where all roots are real: its coefficients by
/// Faddeev and Le Verrier, in integers that a double holds.
Signature signature_by_descartes(const Matrix<double>& X) {
  const Index n = X.rows();
  std::vector<double> coefficients{1};  // of x^n, x^{n-1}, ...
  Matrix<double> M = Matrix<double>::Identity(n, n);
  for (Index k = 1; k <= n; ++k) {
    const Matrix<double> XM = X.lazyProduct(M);
    coefficients.push_back(-XM.trace() / static_cast<double>(k));
    M = XM + coefficients.back() * Matrix<double>::Identity(n, n);
  }
  Signature found;
  for (Index k = n; k > 0 && coefficients[static_cast<std::size_t>(k)] == 0; --k) ++found.zero;
  double last = 1;
  for (const double c : coefficients)
    if (c != 0) {
      if (c * last < 0) ++found.positive;
      last = c;
    }
  found.negative = n - found.zero - found.positive;
  return found;
}

TEST(Definiteness, ZeroDiagonals) {
  std::mt19937_64 random(3);
  for (int trial = 0; trial < 500; ++trial) {
    const Index n = 2 + trial % 5;
    Matrix<double> X = Matrix<double>::Zero(n, n);
    for (Index j = 0; j < n; ++j)
      for (Index i = j + 1; i < n; ++i) X(i, j) = X(j, i) = static_cast<double>(static_cast<int>(random() % 5) - 2);
    if (trial % 2) X(n / 2, n / 2) = 1;  // zeros come up later, too
    EXPECT_EQ(signature(X), signature_by_descartes(X)) << X;
  }
}

TEST(Definiteness, TakesTheSymmetricPartExactly) {
  EXPECT_EQ(signature(matrix(2, 2, {1, 2, 0, 1})), (Signature{1, 1, 0}));
  // Off the diagonal 1 + ulp / 2, which no double is: the determinant is -ulp^2 / 4. Then 1 + ulp.
  EXPECT_EQ(signature(matrix(2, 2, {1, 1, 1 + ulp, 1 + ulp})), (Signature{1, 0, 1}));
  EXPECT_FALSE(is_positive_semidefinite(matrix(2, 2, {1, 1, 1 + ulp, 1 + ulp})));
  EXPECT_EQ(signature(matrix(2, 2, {1, 1 + 2 * ulp, 1, 1 + ulp})), (Signature{1, 0, 1}));
}

/// Sylvester: L D L' has D's signs. Units far apart, as in a state of metres and nanoseconds; and as far as they go.
TEST(Definiteness, SignatureSurvivesCongruence) {
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 200; ++trial) {
    const Index n = 1 + static_cast<Index>(random() % 6);
    Signature expected;
    Matrix<double> D = Matrix<double>::Zero(n, n), L = few_bits_root(random, n);
    for (Index i = 0; i < n; ++i) {
      const int sign = static_cast<int>(random() % 4) - 1;
      D(i, i) = sign > 0 ? 1 : sign;
      ++(sign > 0 ? expected.positive : sign < 0 ? expected.negative : expected.zero);
    }
    Matrix<double> X = transposed_product(L, D);
    if (trial % 2 == 1) {
      const int reach = trial % 4 == 1 ? 40 : 480;
      for (Index i = 0; i < n; ++i) {
        const int shift = static_cast<int>(random() % static_cast<unsigned>(2 * reach)) - reach;
        X.row(i) *= std::ldexp(1.0, shift);
        X.col(i) *= std::ldexp(1.0, shift);
      }
    }
    SCOPED_TRACE(trial);
    EXPECT_EQ(signature(X), expected);
    EXPECT_EQ(is_positive_semidefinite(X), expected.negative == 0);
    EXPECT_EQ(is_positive_definite(X), expected.positive == n);
    EXPECT_EQ(is_singular(X), expected.zero > 0);
    if (trial % 2 == 0) {
      const double smallest = smallest_eigenvalue(X);
      EXPECT_EQ(smallest > 0, expected.positive == n);
      EXPECT_EQ(smallest<0, expected.negative> 0);
    }
  }
}

/// The filters in front must only ever say what the integers say.
TEST(Definiteness, FastAnswersAreTheExactOnes) {
  std::mt19937_64 random(2);
  int indefinite = 0, definite = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const Index n = 2 + static_cast<Index>(random() % 4);
    // S S' rounded to double with k(S) about 2^20 ... 2^40: definite or not by the luck of rounding
    Matrix<double> S = few_bits_root(random, n);
    const int shift = 20 + static_cast<int>(random() % 20);
    S.row(n - 1).head(n - 1) *= 1.0 / 3;
    S(n - 1, n - 1) *= std::ldexp(1.0, -shift);
    const Matrix<double> X = product_of(S);
    const Signature exact_signature = signature(X);
    EXPECT_EQ(is_positive_semidefinite(X), exact_signature.negative == 0);
    EXPECT_EQ(is_positive_definite(X), exact_signature.positive == n);
    const double smallest = smallest_eigenvalue(X);
    EXPECT_EQ(smallest<0, exact_signature.negative> 0);
    EXPECT_EQ(smallest > 0, exact_signature.positive == n);
    exact_signature.negative > 0 ? ++indefinite : ++definite;
  }
  // Both kinds were met, or nothing was tested.
  EXPECT_GT(indefinite, 20);
  EXPECT_GT(definite, 20);
}

TEST(Definiteness, SmallestEigenvalueFarBelowRounding) {
  // Hadamard's columns are orthogonal with squared norm 4: eigenvalues 4, 4, 4 and 4 e, and every entry is exact.
  const Matrix<double> H = matrix(4, 4, {1, 1, 1, 1, 1, -1, 1, -1, 1, 1, -1, -1, 1, -1, -1, 1});
  for (double e : {0x1p-10, 0x1p-40, 0x1p-50, -0x1p-50, -0x1p-49}) {
    Matrix<double> D = Matrix<double>::Identity(4, 4);
    D(2, 2) = e;
    EXPECT_NEAR(smallest_eigenvalue(transposed_product(H, D)) / (4 * e), 1, 1e-6) << e;
  }
  EXPECT_NEAR(smallest_eigenvalue(matrix(2, 2, {1, 0, 0, 1e-300})) / 1e-300, 1, 1e-6);
  EXPECT_NEAR(smallest_eigenvalue(matrix(2, 2, {1e300, 0, 0, 1e-300})) / 1e-300, 1, 1e-6);
  EXPECT_NEAR(smallest_eigenvalue(matrix(3, 3, {1e300, 0, 0, 0, -1e-200, 0, 0, 0, 1e-300})) / -1e-200, 1, 1e-6);
}

TEST(Definiteness, SmallestEigenvalueOfAProduct) {
  EXPECT_EQ(smallest_eigenvalue_of_product(Matrix<double>(0, 0)), std::numeric_limits<double>::infinity());
  EXPECT_NEAR(smallest_eigenvalue_of_product(matrix(1, 1, {-3})), 9, 4 * 8 * ulp);
  EXPECT_EQ(smallest_eigenvalue_of_product(matrix(2, 2, {1, 9, 1, 0})), 0);
  for (double b : {1.0, 1e-5, 1e-12, 1e-30, 1e-100}) {
    // S S' = [1 a; a a^2 + b^2]: lambda = det / (the other), the other = (t + (t^2 - 4 det)^{1/2}) / 2
    const double a = 1.0 / 3;
    const Wide t = Wide(1) + Wide(a) * a + Wide(b) * b, det = Wide(b) * b;
    const Wide expected = 2 * det / (t + sqrt(Wide(t * t - 4 * det)));
    const Matrix<double> S = matrix(2, 2, {1, std::numeric_limits<double>::quiet_NaN(), a, b});
    EXPECT_NEAR(smallest_eigenvalue_of_product(S) / round_to_double(expected), 1, 1e-12) << b;
  }
}

TEST(Definiteness, SaysNoToWhatIsNotANumber) {
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  for (double bad : {nan, infinity}) {
    const Matrix<double> X = matrix(2, 2, {1, 0, 0, bad});
    EXPECT_FALSE(is_positive_semidefinite(X));
    EXPECT_FALSE(is_positive_definite(X));
    EXPECT_TRUE(std::isnan(smallest_eigenvalue(X)));
    EXPECT_THROW(signature(X), ReferenceError);
    EXPECT_THROW(is_singular(X), ReferenceError);
  }
  EXPECT_THROW(is_positive_semidefinite(Matrix<double>::Ones(2, 3)), ReferenceError);
}

TEST(Definiteness, SingularExactly) {
  EXPECT_TRUE(is_singular(matrix(2, 2, {3, 7, 6, 14})));
  EXPECT_TRUE(is_singular(matrix(2, 2, {0, 1, 0, 2})));
  EXPECT_FALSE(is_singular(matrix(2, 2, {0, 1, 1, 0})));
  // 0.1 x 0.9 and 0.3 x 0.3 differ, as doubles
  EXPECT_FALSE(is_singular(matrix(2, 2, {0.1, 0.3, 0.3, 0.9})));
  EXPECT_FALSE(is_singular(matrix(2, 2, {1, 1, 1, 1 + ulp})));
  EXPECT_FALSE(is_singular(matrix(2, 2, {1e-300, 0, 0, 1e300})));
  EXPECT_FALSE(is_singular(Matrix<double>(0, 0)));
  // The third row is the sum of the others.
  EXPECT_TRUE(is_singular(matrix(3, 3, {0.5, 0.25, 3, 1, -2, 0.125, 1.5, -1.75, 3.125})));
}

TEST(TwoNorm, KnownNorms) {
  EXPECT_EQ(two_norm(Matrix<double>(0, 3)), 0);
  EXPECT_EQ(two_norm(matrix(1, 1, {-2})), 2);
  EXPECT_NEAR(two_norm(matrix(2, 3, {3, 0, 0, 0, 0, 4})), 4, 4 * ulp);
  EXPECT_NEAR(two_norm(Matrix<double>::Ones(3, 4)), std::sqrt(12.0), 8 * ulp * 4);
  EXPECT_NEAR(two_norm(1e300 * Matrix<double>::Ones(2, 2)) / 2e300, 1, 8 * ulp);
  EXPECT_NEAR(two_norm(1e-300 * Matrix<double>::Ones(2, 2)) / 2e-300, 1, 8 * ulp);
}

}  // namespace
}  // namespace kfstab::reference::testing
