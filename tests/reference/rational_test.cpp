#include <kfstab/reference/rational.hpp>

#include <cmath>
#include <limits>
#include <random>

#include <kfstab/reference/error.hpp>

namespace kfstab::reference {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double tiny = std::numeric_limits<double>::denorm_min();

Rational power_of_two(int exponent) {
  const Rational power = pow(boost::multiprecision::mpz_int(2), static_cast<unsigned>(std::abs(exponent)));
  return exponent < 0 ? Rational(1 / power) : power;
}

TEST(Rational, RoundsToTheNearestDouble) {
  EXPECT_EQ(round_to_double(Rational(0)), 0);
  EXPECT_EQ(round_to_double(Rational(1) / 3), 1.0 / 3);  // one rounding of double's own division
  EXPECT_EQ(round_to_double(Rational(-7) / 20), -0.35);
  EXPECT_EQ(round_to_double(Rational(1) / 10), 0.1);
  // 1 + u is halfway between 1 and its successor: ties go to the even one, and the least beyond a tie goes up.
  const Rational u = power_of_two(-53);
  EXPECT_EQ(round_to_double(1 + u), 1);
  EXPECT_EQ(round_to_double(1 + 3 * u), 1 + std::ldexp(1, -51));
  EXPECT_EQ(round_to_double(1 + u + power_of_two(-5000)), 1 + std::ldexp(1, -52));
  EXPECT_EQ(round_to_double(-(1 + u + power_of_two(-5000))), -1 - std::ldexp(1, -52));
  EXPECT_EQ(round_to_double(1 + u - power_of_two(-5000)), 1);
}

TEST(Rational, RoundsOnceBelowAndBeyondTheRange) {
  EXPECT_EQ(round_to_double(power_of_two(-1075)), 0);  // a tie between 0 and the smallest
  EXPECT_EQ(round_to_double(power_of_two(-1075) + power_of_two(-3000)), tiny);
  EXPECT_EQ(round_to_double(3 * power_of_two(-1075)), 2 * tiny);
  // Rounded to 53 bits first, this would be a tie that goes to the even 2: it is below it.
  EXPECT_EQ(round_to_double(3 * power_of_two(-1075) - power_of_two(-1140)), tiny);
  EXPECT_EQ(round_to_double(power_of_two(1024)), infinity);
  EXPECT_EQ(round_to_double(-power_of_two(1024)), -infinity);
  EXPECT_EQ(round_to_double(power_of_two(1024) - power_of_two(970)), infinity);  // halfway to 2^1024
  EXPECT_EQ(round_to_double(power_of_two(1024) - power_of_two(970) - 1), std::numeric_limits<double>::max());
}

TEST(Rational, NoOtherDoubleIsNearer) {
  std::mt19937_64 random(5);
  for (int i = 0; i < 1000; ++i) {
    const Rational x = Rational(random()) / Rational(random()) * power_of_two(static_cast<int>(random() % 400) - 200);
    const double rounded = round_to_double(x);
    const Rational error = abs(Rational(rounded) - x);
    for (const double other : {std::nextafter(rounded, -infinity), std::nextafter(rounded, infinity)})
      EXPECT_LE(error, Rational(abs(Rational(other) - x)));
  }
}

TEST(Rational, DoublesAreRational) {
  const Matrix<Rational> X = rational(Matrix<double>::Constant(1, 2, 0.1));
  EXPECT_EQ(X(0, 1), Rational("3602879701896397/36028797018963968"));
  EXPECT_EQ(rational(Matrix<double>(0, 3)).cols(), 3);
  EXPECT_THROW(rational(Matrix<double>::Constant(1, 1, infinity)), ReferenceError);
}

TEST(Rational, DefinitenessIsExact) {
  const auto matrix = [](const Rational& a, const Rational& b, const Rational& c) {
    Matrix<Rational> X(2, 2);
    X(0, 0) = a;
    X(0, 1) = X(1, 0) = b;
    X(1, 1) = c;
    return X;
  };
  const Rational third = Rational(1) / 3, least = power_of_two(-2000);
  EXPECT_TRUE(no_negative_eigenvalue(Matrix<Rational>(0, 0)));
  EXPECT_TRUE(no_negative_eigenvalue(matrix(third * third, third, 1)));
  EXPECT_TRUE(no_negative_eigenvalue(matrix(third * third, third, 1 + least)));
  EXPECT_FALSE(no_negative_eigenvalue(matrix(third * third, third, 1 - least)));
  EXPECT_TRUE(no_negative_eigenvalue(matrix(0, 0, third)));
  EXPECT_FALSE(no_negative_eigenvalue(matrix(0, least, third)));
  EXPECT_FALSE(no_negative_eigenvalue(matrix(third, 0, -least)));
}

TEST(Rational, ProductOfARootReadsTheLowerTriangle) {
  Matrix<Rational> L(2, 2);
  L(0, 0) = Rational(1) / 3;
  L(1, 0) = -2;
  L(1, 1) = Rational(1) / 7;
  L(0, 1) = 99;
  const Matrix<Rational> X = product_of_root(L);
  EXPECT_EQ(X(0, 0), Rational(1) / 9);
  EXPECT_EQ(X(0, 1), Rational(-2) / 3);
  EXPECT_EQ(X(1, 0), Rational(-2) / 3);
  EXPECT_EQ(X(1, 1), Rational(197) / 49);
  L(0, 1) = 0;
  EXPECT_TRUE(product(L, L.transpose()) == X);
}

}  // namespace
}  // namespace kfstab::reference
