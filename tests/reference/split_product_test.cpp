#include <thread>

#include <gtest/gtest.h>

#include <kfstab/reference/detail/dense.hpp>

#include "reference/mpfr_numbers.hpp"

namespace kfstab::reference::detail {
namespace {

using testing::exact_number;
using testing::ExactNumber;
using testing::Kind;
using testing::Numbers;

/// Every width of vectors that this processor has.
std::vector<Vectors> all_vectors() {
  std::vector<Vectors> all{Vectors::of_2};
  if (widest_vectors() != Vectors::of_2) all.push_back(Vectors::of_4);
  if (widest_vectors() == Vectors::of_8) all.push_back(Vectors::of_8);
  return all;
}

/// |z - exact| <= 2^-p (|z| + 1/4 |z_before| + 3/2 (|X| |Y|)_ij), and 0 where all terms are.
template <class T>
void expect_within_bound(const Matrix<T>& Z, const Matrix<T>& before, Into into, const Matrix<T>& X, const Matrix<T>& Y,
                         const std::string& what) {
  for (Index j = 0; j < Z.cols(); ++j)
    for (Index i = 0; i < Z.rows(); ++i) {
      ExactNumber sum = 0, terms = 0;
      for (Index l = 0; l < X.cols(); ++l) {
        const ExactNumber term = exact_number(X(i, l)) * exact_number(Y(l, j));
        sum += term;
        terms += abs(term);
      }
      if (into == Into::subtract) sum = -sum;
      const ExactNumber start = into == Into::set ? ExactNumber(0) : exact_number(before(i, j));
      const ExactNumber got = exact_number(Z(i, j));
      const ExactNumber bound =
          (abs(got) + abs(start) / 4 + terms * 3 / 2) * testing::power_of_two(-testing::precision_of(Z(i, j)));
      ASSERT_TRUE(abs(got - start - sum) <= bound) << what << ", entry " << i << ", " << j << ": error "
                                                   << testing::ratio(got - start - sum, bound) << " of the bound";
    }
}

template <class T>
class SplitProduct : public ::testing::Test {};
using SplitPrecisions = ::testing::Types<Real<20>, Real<50>, Real<100>, Real<200>>;
TYPED_TEST_SUITE(SplitProduct, SplitPrecisions);

TYPED_TEST(SplitProduct, IsRightToItsBound) {
  using T = TypeParam;
  Numbers numbers(1);
  const Shape shapes[] = {{1, 1, 1}, {2, 3, 4}, {8, 8, 8}, {9, 1, 3}, {4, 17, 9}, {17, 5, 8}, {12, 12, 12}};
  for (const Shape shape : shapes)
    for (const Kind kind : testing::kinds)
      for (const Kind other : {kind, Kind::doubles}) {
        const Into into = static_cast<Into>(numbers.up_to(3));
        const Matrix<T> X = numbers.matrix<T>(shape.rows, shape.inner, kind);
        const Matrix<T> Y = kind == Kind::rows && other == kind
                                ? transposed(numbers.matrix<T>(shape.cols, shape.inner, kind))
                                : numbers.matrix<T>(shape.inner, shape.cols, other);
        const Matrix<T> before = numbers.matrix<T>(shape.rows, shape.cols, kind);
        for (const Vectors vectors : all_vectors()) {
          Matrix<T> Z = before;
          const bool split =
              multiply_by_splitting(results(Z), into, entries(X), entries(Y), shape, Structure::general, vectors);
          const bool easy = kind != Kind::wild && kind != Kind::hopeless && !(kind == Kind::units && other != kind);
          if (easy) {
            EXPECT_TRUE(split) << "kind " << static_cast<int>(kind);
          }
          if (!split) {
            EXPECT_EQ(Z, before);
            continue;
          }
          expect_within_bound(Z, before, into, X, Y,
                              "kinds " + std::to_string(static_cast<int>(kind)) + ", " +
                                  std::to_string(static_cast<int>(other)) + ", vectors " +
                                  std::to_string(static_cast<int>(vectors)));
        }
        Matrix<T> Z = before;
        multiply(results(Z), into, entries(X), entries(Y), shape, Structure::general);
        expect_within_bound(Z, before, into, X, Y, "either way");
      }
}

// Digits of one sign, all as large as can be: ones, and a zero where a digit begins, for every width that digits may
// have.
TYPED_TEST(SplitProduct, HoldsTheLargestSums) {
  using T = TypeParam;
  for (const Index inner : {1, 7, 15, 31, 63, 127})
    for (int width = 19; width <= 26; ++width) {
      T digit = ldexp(T(1), width - 1) - 1, x = 0;
      const auto precision = static_cast<int>(testing::precision_of(x));
      for (int at = 1; at * width <= precision; ++at) x += ldexp(digit, -at * width);
      Matrix<T> X(1, inner), Z(1, 1);
      for (Index l = 0; l < inner; ++l) X(0, l) = x;
      for (const Vectors vectors : all_vectors()) {
        ASSERT_TRUE(multiply_by_splitting(results(Z), Into::set, entries(X), entries(X).transposed(), {1, inner, 1},
                                          Structure::general, vectors));
        expect_within_bound(Z, Z, Into::set, X, transposed(X), "digits of " + std::to_string(width) + " bits");
      }
    }
}

// The widths differ in the order of sums that are exact.
TYPED_TEST(SplitProduct, GivesTheSameBitsWithAllVectors) {
  using T = TypeParam;
  Numbers numbers(2);
  const Matrix<T> X = numbers.matrix<T>(13, 21, Kind::full), Y = numbers.matrix<T>(21, 11, Kind::full);
  std::vector<Matrix<T>> all;
  for (const Vectors vectors : all_vectors()) {
    all.emplace_back(13, 11);
    EXPECT_TRUE(multiply_by_splitting(results(all.back()), Into::set, entries(X), entries(Y), {13, 21, 11},
                                      Structure::general, vectors));
  }
  for (const Matrix<T>& Z : all) EXPECT_EQ(Z, all.front());
}

TYPED_TEST(SplitProduct, MirrorsWhatIsSymmetric) {
  using T = TypeParam;
  Numbers numbers(3);
  for (const Index n : {1, 3, 8, 19}) {
    const Matrix<T> X = numbers.matrix<T>(n, 10, Kind::full);
    Matrix<T> before(n, n);
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i) before(i, j) = i + j;
    for (const Into into : {Into::set, Into::add, Into::subtract}) {
      Matrix<T> Z = before, by_dots = before;
      ASSERT_TRUE(multiply_by_splitting(results(Z), into, entries(X), entries(X).transposed(), {n, 10, n},
                                        Structure::symmetric, widest_vectors()));
      multiply_by_dots(results(by_dots), into, entries(X), entries(X).transposed(), {n, 10, n}, Structure::symmetric);
      for (const Matrix<T>& result : {Z, by_dots}) {
        EXPECT_EQ(result, Matrix<T>(transposed(result)));
        expect_within_bound(result, before, into, X, transposed(X), "symmetric");
      }
    }
  }
}

// Nothing is left of X Y where each term meets its opposite.
TYPED_TEST(SplitProduct, CancelsExactly) {
  using T = TypeParam;
  Numbers numbers(4);
  constexpr Index half = 9;
  const Matrix<T> a = numbers.matrix<T>(11, half, Kind::full), b = numbers.matrix<T>(half, 8, Kind::full);
  Matrix<T> X(11, 2 * half), Y(2 * half, 8), Z(11, 8);
  for (Index l = 0; l < half; ++l) {
    X.col(l) = a.col(l);
    X.col(half + l) = a.col(l);
    Y.row(l) = b.row(l);
    Y.row(half + l) = -b.row(l);
  }
  ASSERT_TRUE(multiply_by_splitting(results(Z), Into::set, entries(X), entries(Y), {11, 2 * half, 8},
                                    Structure::general, widest_vectors()));
  EXPECT_EQ(Z, zeros<T>(11, 8));
}

TYPED_TEST(SplitProduct, RefusesWhatIsNotFinite) {
  using T = TypeParam;
  Numbers numbers(5);
  Matrix<T> X = numbers.matrix<T>(9, 9, Kind::full), Z = X;
  const Matrix<T> Y = X, before = Z;
  X(3, 4) = std::numeric_limits<T>::infinity();
  EXPECT_FALSE(multiply_by_splitting(results(Z), Into::set, entries(X), entries(Y), {9, 9, 9}, Structure::general,
                                     widest_vectors()));
  EXPECT_EQ(Z, before);
  multiply(results(Z), Into::set, entries(X), entries(Y), {9, 9, 9}, Structure::general);
  for (Index j = 0; j < 9; ++j)
    for (Index i = 0; i < 9; ++i) EXPECT_EQ(isinf(Z(i, j)), i == 3) << i << j;
}

TYPED_TEST(SplitProduct, ThreadsShareNothing) {
  using T = TypeParam;
  Numbers numbers(6);
  const Matrix<T> X = numbers.matrix<T>(20, 20, Kind::full), Y = numbers.matrix<T>(20, 20, Kind::wild);
  const Matrix<T> expected = product(X, Y);
  std::vector<int> wrong(4);
  {
    std::vector<std::jthread> threads;
    for (int& mine : wrong)
      threads.emplace_back([&] {
        for (int k = 0; k < 20; ++k) mine += product(X, Y) == expected ? 0 : 1;
      });
  }
  EXPECT_EQ(wrong, std::vector<int>(4));
}

// The longest numbers of the reference, once.
TEST(SplitProductOfLongNumbers, IsRightToItsBound) {
  using T = Real<1600>;
  Numbers numbers(7);
  const Matrix<T> X = numbers.matrix<T>(5, 8, Kind::ones), Y = numbers.matrix<T>(8, 8, Kind::full);
  Matrix<T> Z = zeros<T>(5, 8);
  ASSERT_TRUE(multiply_by_splitting(results(Z), Into::set, entries(X), entries(Y), {5, 8, 8}, Structure::general,
                                    widest_vectors()));
  expect_within_bound(Z, Z, Into::set, X, Y, "1600 digits");
}

}  // namespace
}  // namespace kfstab::reference::detail
