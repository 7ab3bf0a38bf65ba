#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <thread>

#include <gtest/gtest.h>

#include <kfstab/filters/registry.hpp>
#include <kfstab/reference/definiteness.hpp>
#include <kfstab/reference/error.hpp>
#include <kfstab/reference/rounded.hpp>
#include <kfstab/reference/trajectory.hpp>

#include "filters/with_kernels.hpp"
#include "support.hpp"

namespace kfstab::reference::testing {
namespace {

/// The same number, or both NaN; a zero has a sign.
template <class Native>
bool same(const Rounded& x, Native y) {
  const double value = static_cast<double>(x);
  if (std::isnan(y)) return std::isnan(value);
  return value == static_cast<double>(y) && std::signbit(value) == std::signbit(y);
}

/// Random numbers over a range of exponents where nothing of the test overflows or underflows.
template <class Native>
Native random_number(std::mt19937_64& random) {
  const auto mantissa = static_cast<Native>(static_cast<double>(random() >> 11) * 0x1p-53);
  return std::ldexp(random() % 2 ? -mantissa : mantissa, static_cast<int>(random() % 41) - 20);
}

template <class Native>
void arithmetic_is_that_of(int bits) {
  const RoundedBits at(bits);
  std::mt19937_64 random(1);
  for (int i = 0; i < 2000; ++i) {
    const Native a = random_number<Native>(random), b = random_number<Native>(random);
    const Rounded x(static_cast<double>(a)), y(static_cast<double>(b));
    ASSERT_TRUE(same<Native>(x + y, a + b)) << a << " + " << b;
    ASSERT_TRUE(same<Native>(x - y, a - b)) << a << " - " << b;
    ASSERT_TRUE(same<Native>(x * y, a * b)) << a << " * " << b;
    ASSERT_TRUE(same<Native>(x / y, a / b)) << a << " / " << b;
    ASSERT_TRUE(same<Native>(sqrt(abs(x)), std::sqrt(std::abs(a)))) << a;
    ASSERT_TRUE(same<Native>(-x, -a));
    Rounded z = x;
    z *= y;
    z -= x;
    ASSERT_TRUE(same<Native>(z, static_cast<Native>(a * b) - a));
    int exponent = 0, expected = 0;
    ASSERT_TRUE(same<Native>(frexp(x, &exponent), std::frexp(a, &expected)));
    ASSERT_EQ(exponent, expected);
    ASSERT_TRUE(same<Native>(ldexp(x, 5), std::ldexp(a, 5)));
    ASSERT_EQ(x < y, a < b);
    ASSERT_EQ(x <= y, a <= b);
    ASSERT_EQ(x == y, a == b);
  }
  EXPECT_TRUE(same<Native>(unit_roundoff<Rounded>(), std::numeric_limits<Native>::epsilon() / 2));
}

template <class To, class From>
auto to(const From& from) {
  return convert(from, [](double x) { return static_cast<To>(x); });
}

/// Numbers of few bits, the same in float and double. Time-invariant, so that every filter takes it.
AnyProblem<double> random_problem(Parametrisation form, std::uint64_t seed, Dimensions d) {
  std::mt19937_64 random(seed);
  Problem<RootModel<double>> root;
  root.models = {random_root_model(random, d)};
  root.initial = few_bits_root(random, d.n);
  root.x0 = few_bits(random, d.n, 1);
  if (form == Parametrisation::root) return root;
  if (form == Parametrisation::covariance) return as_covariance(root);
  Problem<InformationModel<double>> information;
  InformationModel<double>& model = information.models.emplace_back();
  const auto& from = root.models.front();
  model.A_inverse = Matrix<double>::Identity(d.n, d.n) + from.A / 4;
  model.A_inverse_B = from.B;
  model.C = from.C;
  model.D = from.D;
  model.Q_inverse_root = from.Q_root.transpose();
  model.R_inverse_root = from.R_root.transpose();
  model.w_mean = few_bits(random, d.m, 1);
  information.initial = root.initial.transpose();
  information.x0 = root.x0;
  return information;
}

template <class Native, int Cols>
::testing::AssertionResult equal(const Matrix<Rounded, Dynamic, Cols>& X, const Matrix<Native, Dynamic, Cols>& Y) {
  if (X.rows() != Y.rows() || X.cols() != Y.cols()) return ::testing::AssertionFailure() << "shapes differ";
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      if (!same(X(i, j), Y(i, j)))
        return ::testing::AssertionFailure()
               << "entry " << i << ", " << j << ": " << static_cast<double>(X(i, j)) << ", expected " << Y(i, j);
  return ::testing::AssertionSuccess();
}

constexpr Dimensions shapes[] = {{4, 2, 2}, {3, 1, 1}, {2, 3, 4}, {3, 2, 3}, {1, 1, 1}, {5, 5, 1}};

template <class Native>
void every_filter_is_that_of(int bits) {
  for (const Metadata& metadata : filters())
    for (const Dimensions& d : shapes)
      for (std::uint64_t seed = 1; seed <= 2; ++seed) {
        SCOPED_TRACE(std::string(metadata.id) + ": n=" + std::to_string(d.n) + " m=" + std::to_string(d.m) +
                     " p=" + std::to_string(d.p) + " seed=" + std::to_string(seed));
        const AnyProblem<double> problem = random_problem(metadata.takes, seed, d);
        const AnyProblem<Native> native_problem = to<Native>(problem);
        const auto native = make_filter<Native>(metadata.id);
        native->start(native_problem);
        RoundedFilter filter(metadata, bits);
        filter.start(problem);
        std::mt19937_64 random(seed);
        const auto data = random_data(random, d.p, 1, 12);
        const auto stream = data->open();
        for (int k = 0; k < 12; ++k) {
          const StepData& now = stream->next();
          const Vector<Native> y = to<Native>(now.y), input = to<Native>(now.u);
          const Step<Native> expected = native->step(k, &y, &input);
          const Step<Rounded> step = filter.step(k, &now.y, &now.u);
          ASSERT_EQ(step.report.status, expected.report.status) << "step " << k;
          if (!expected.report) break;
          EXPECT_TRUE(same(step.report.rcond, expected.report.rcond)) << "rcond, step " << k;
          ASSERT_EQ(bool(step.held), bool(expected.held));
          if (expected.held) {
            EXPECT_TRUE(equal(*step.held, *expected.held)) << "held, step " << k;
          }
          EXPECT_TRUE(equal(*step.gain, *expected.gain)) << "gain, step " << k;
          EXPECT_TRUE(equal(*step.state, *expected.state)) << "state, step " << k;
        }
      }
}

}  // namespace

TEST(Rounded, Has53BitsAsDouble) { arithmetic_is_that_of<double>(53); }
TEST(Rounded, Has24BitsAsFloat) { arithmetic_is_that_of<float>(24); }

TEST(Rounded, TiesGoToEven) {
  const RoundedBits at(8);
  const Rounded one(1), half_a_step(0x1p-8);
  EXPECT_EQ(one + half_a_step, one);
  EXPECT_EQ(one + Rounded(0x3p-8), Rounded(1 + 0x1p-6));
  EXPECT_EQ(one + Rounded(0x1.02p-8), Rounded(1 + 0x1p-7));
  EXPECT_EQ(Rounded(0.1), Rounded(0x1.9ap-4));  // 1.100110011... in binary
  EXPECT_EQ(Rounded(257), Rounded(256));
}

TEST(Rounded, KnowsNoNumbers) {
  const Rounded nan = std::numeric_limits<Rounded>::quiet_NaN(), infinity = Rounded(1) / Rounded(0);
  EXPECT_FALSE(nan == nan);
  EXPECT_FALSE(nan < Rounded(1) || nan >= Rounded(1));
  EXPECT_FALSE(is_finite(nan));
  EXPECT_FALSE(is_finite(infinity));
  EXPECT_TRUE(is_finite(Rounded(1e300) * Rounded(1e300)));  // 10^600 is a number here
  EXPECT_TRUE(std::isnan(static_cast<double>(sqrt(Rounded(-1)))));
}

TEST(Rounded, BitsAreAThreadsOwnAndEndWithTheirBlock) {
  ASSERT_EQ(Rounded::bits(), 53);
  const Rounded third = Rounded(1) / Rounded(3);
  {
    const RoundedBits at(100);
    EXPECT_EQ(unit_roundoff<Rounded>(), Rounded(0x1p-100));
    Rounded copy(1);
    copy = third;
    EXPECT_EQ(copy, third);
    EXPECT_EQ(copy.precision(), 53);
    EXPECT_EQ((copy + copy).precision(), 100);
    int elsewhere = 0;
    std::thread([&] { elsewhere = Rounded::bits(); }).join();
    EXPECT_EQ(elsewhere, 53);
    {
      const RoundedBits inner(10);
      copy += copy;  // what it holds is rounded to ten bits now
      EXPECT_EQ(copy.precision(), 10);
    }
    EXPECT_EQ(Rounded::bits(), 100);
  }
  EXPECT_EQ(Rounded::bits(), 53);
  EXPECT_THROW(RoundedBits(Rounded::least_bits - 1), ReferenceError);
  EXPECT_THROW(RoundedBits(Rounded::most_bits + 1), ReferenceError);
  EXPECT_EQ(Rounded::bits(), 53);
}

// By the plain text: kernels sum in an order of their own, and fuse.
TEST(RoundedFilter, IsThatOfDoubleAt53Bits) {
  const test::WithKernels with("plain");
  every_filter_is_that_of<double>(53);
}
TEST(RoundedFilter, IsThatOfFloatAt24Bits) { every_filter_is_that_of<float>(24); }

TEST(RoundedProblem, HasTheBitsThatWereAskedFor) {
  for (const auto form : {Parametrisation::covariance, Parametrisation::root, Parametrisation::information}) {
    AnyProblem<double> problem = random_problem(form, 3, {3, 2, 2});
    std::visit([](auto& p) { p.initial(0, 0) = p.x0(1) = p.models[0].C(1, 1) = 0.1; }, problem);
    const auto entries = [](const AnyProblem<double>& of) {
      return std::visit([](const auto& p) { return std::vector{p.initial(0, 0), p.x0(1), p.models[0].C(1, 1)}; }, of);
    };
    EXPECT_EQ(entries(rounded(problem, 8)), std::vector(3, 0x1.9ap-4));
    EXPECT_EQ(entries(rounded(problem, 24)), std::vector(3, static_cast<double>(0.1f)));
    EXPECT_EQ(entries(rounded(problem, 113)), std::vector(3, 0.1));
  }
  const auto data = std::make_shared<ListedData>(std::vector{StepData{Vector<double>::Constant(1, 0.1), {}}});
  EXPECT_EQ(rounded(data, 8)->open()->next().y(0), 0x1.9ap-4);
  EXPECT_EQ(rounded(data, 53), data);
  EXPECT_EQ(rounded(nullptr, 8), nullptr);
}

TEST(RoundedMeasure, Of53BitsIsThatOfDouble) {
  const test::WithKernels with("plain");
  std::mt19937_64 random(7);
  const Dimensions d{4, 2, 2};
  const auto data = random_data(random, d.p, 1, 3);
  for (const Metadata& metadata : filters()) {
    SCOPED_TRACE(metadata.id);
    const AnyProblem<double> problem = random_problem(metadata.takes, 7, d);
    Trajectory truth(problem, data);
    const auto plain = make_filter<double>(metadata.id);
    plain->start(problem);
    RoundedFilter filter(metadata, 53);
    filter.start(problem);
    const auto stream = data->open();
    for (int k = 0; k < 3; ++k) {
      truth.advance();
      const StepData& now = stream->next();
      const Errors expected = truth.measure(metadata, plain->step(k, &now.y, &now.u));
      const Errors errors = truth.measure(metadata, filter.step(k, &now.y, &now.u));
      EXPECT_EQ(errors.gain, expected.gain);
      EXPECT_EQ(errors.state, expected.state);
      if (metadata.holds == Held::gain) continue;
      EXPECT_EQ(errors.covariance, expected.covariance);
      EXPECT_EQ(errors.entrywise, expected.entrywise);
      EXPECT_EQ(errors.asymmetry, expected.asymmetry);
      EXPECT_EQ(errors.correct_digits, expected.correct_digits);
      EXPECT_EQ(errors.positive_semidefinite, expected.positive_semidefinite);
      // Promised to three digits, and found in two ways.
      EXPECT_NEAR(errors.smallest_eigenvalue, expected.smallest_eigenvalue,
                  1e-3 * std::abs(expected.smallest_eigenvalue));
    }
  }
}

// 30 u (n + m + p) k, LAPACK's threshold and (4.1): what one step from exact data may lose, whatever the form. k = 100
// is more than k(Re) and the other amplifications of theory (4) are for these systems.
TEST(RoundedMeasure, ErrorIsOfTheSizeOfTheRoundoff) {
  const Dimensions d{3, 2, 2};
  for (const Metadata& metadata : filters()) {
    const AnyProblem<double> problem = random_problem(metadata.takes, 5, d);
    for (const int bits : {20, 53, 80, 113, 200}) {
      SCOPED_TRACE(std::string(metadata.id) + " at " + std::to_string(bits));
      const AnyProblem<double> given = rounded(problem, bits);
      Trajectory truth(given, nullptr, {.digits = 80});
      RoundedFilter filter(metadata, bits);
      filter.start(given);
      truth.advance();
      const Errors errors = truth.measure(metadata, filter.step(0, nullptr, nullptr));
      const double limit = 30 * std::ldexp(7.0, -bits) * 100;
      EXPECT_LE(errors.gain, limit);
      EXPECT_GT(errors.gain, 0);
      if (metadata.holds == Held::gain) continue;
      EXPECT_LE(errors.covariance, limit);
      EXPECT_TRUE(errors.positive_semidefinite);
    }
  }
}

TEST(RoundedDefiniteness, IsExactBeyondDouble) {
  const RoundedBits at(113);
  const Rounded tiny = ldexp(Rounded(1), -100);
  const auto matrix = [](const Rounded& off) {
    Matrix<Rounded> X(2, 2);
    X << Rounded(1), off, off, Rounded(1);
    return X;
  };
  // Eigenvalues 1 +- off; as doubles, all three are singular.
  const Matrix<Rounded> definite = matrix(Rounded(1) - tiny), singular = matrix(1),
                        indefinite = matrix(Rounded(1) + tiny);
  EXPECT_TRUE(is_positive_definite(definite));
  EXPECT_TRUE(is_positive_semidefinite(singular));
  EXPECT_FALSE(is_positive_definite(singular));
  EXPECT_FALSE(is_positive_semidefinite(indefinite));
  EXPECT_NEAR(smallest_eigenvalue(definite), 0x1p-100, 1e-3 * 0x1p-100);
  EXPECT_EQ(smallest_eigenvalue(singular), 0);
  EXPECT_NEAR(smallest_eigenvalue(indefinite), -0x1p-100, 1e-3 * 0x1p-100);
}

}  // namespace kfstab::reference::testing
