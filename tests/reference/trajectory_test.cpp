#include <cmath>
#include <limits>
#include <thread>

#include <gtest/gtest.h>

#include <kfstab/reference/closed_forms.hpp>
#include <kfstab/reference/detail/elimination.hpp>
#include <kfstab/reference/rational.hpp>
#include <kfstab/reference/trajectory.hpp>

#include "support.hpp"

namespace kfstab::reference::testing {
namespace {

// Terms of an expansion that hold more than any number of digits certified here at 50 digits: 4 x 15.95.
constexpr int terms = 4;

AnyProblem<double> dyer_mcreynolds(int j) {
  const double d = std::ldexp(1.0, -j);
  CovarianceModel<double> model;
  model.A = Matrix<double>::Identity(3, 3);
  model.B = Matrix<double>(3, 0);
  model.Q = Matrix<double>(0, 0);
  model.C = matrix(2, 3, {1, 1, 1, 1, 1, 1 + d});
  model.R = d * d * Matrix<double>::Identity(2, 2);
  return Problem<CovarianceModel<double>>{{model}, Matrix<double>::Identity(3, 3), Vector<double>::Zero(3)};
}

TEST(Trajectory, ClosedFormsOfDyerAndMcReynoldsToAllCertifiedDigits) {
  bool climbed = false;
  for (int j = 2; j <= 50; ++j) {
    SCOPED_TRACE(j);
    const AnyProblem<double> problem = dyer_mcreynolds(j);
    Trajectory trajectory(problem, nullptr);
    trajectory.advance();
    const int digits = trajectory.certified_digits();
    EXPECT_GE(digits, 30);
    // Certified at the lower precision; the higher run, which is read, is right to at least that.
    const Wide tolerance = to_digits(std::min(digits, 60));
    const DyerMcReynolds form{Rational(std::ldexp(1.0, -j))};
    const Matrix<Rational> P = form.P(), K = form.gain();
    EXPECT_LE(relative_distance(trajectory.expansion(Quantity::P_next, terms), P), tolerance);
    EXPECT_LE(relative_distance(trajectory.expansion(Quantity::P_filtered, terms), P), tolerance);
    EXPECT_LE(relative_distance(trajectory.expansion(Quantity::filter_gain, terms), K), tolerance);
    EXPECT_LE(relative_distance(trajectory.expansion(Quantity::predictor_gain, terms), K), tolerance);
    for (Index r = 0; r < 3; ++r) {
      for (Index c = 0; c < 3; ++c)
        EXPECT_EQ(trajectory.truth().P_next(r, c), nearest(P(r, c)));
      for (Index c = 0; c < 2; ++c)
        EXPECT_EQ(trajectory.truth().filter_gain(r, c), nearest(K(r, c)));
    }
    climbed = climbed || trajectory.working_digits() > 100;
  }
  // k(Re) reaches 4.5 / d^2 = 6e30, which 50 digits cannot lose and keep 30.
  EXPECT_TRUE(climbed);
}

TEST(Trajectory, ConditionOfTheInnovationFarBeyondDouble) {
  // Re = d^2 I + C C' has trace t and determinant e, so k = (t + r) / (t - r), r^2 = t^2 - 4 e.
  for (int j : {2, 10, 26, 40, 50}) {
    const AnyProblem<double> problem = dyer_mcreynolds(j);
    Trajectory trajectory(problem, nullptr);
    trajectory.advance();
    const Wide d = ldexp(Wide(1), -j), a = d * d + 3, b = 3 + d, c = d * d + 2 + (1 + d) * (1 + d);
    const Wide t = a + c, e = a * c - b * b, root = sqrt(Wide(t * t - 4 * e));
    const double expected = round_to_double(Wide((t + root) / (t - root)));
    // two norms of 2 x 2 matrices in double, each by a few roundings
    EXPECT_NEAR(trajectory.truth().innovation_condition / expected, 1, 32 * 0x1p-53) << j;
  }
}

struct Case {
  Dimensions d;
  std::size_t models;
};

class Random : public ::testing::TestWithParam<Case> {};

TEST_P(Random, AgreesWithRationalRecursion) {
  const auto [d, models] = GetParam();
  constexpr int steps = 4;
  std::mt19937_64 random(20260 + static_cast<unsigned>(d.n * 100 + d.m * 10 + d.p) + models);
  Problem<RootModel<double>> root;
  for (std::size_t k = 0; k < models; ++k) root.models.push_back(random_root_model(random, d));
  root.initial = few_bits_root(random, d.n);
  root.x0 = few_bits(random, d.n, 1);
  const auto covariance = as_covariance(root);
  const auto data = random_data(random, d.p, 1, steps);

  // Rubbish in the triangles that must not be read
  Problem<RootModel<double>> dirty = root;
  const auto spoil = [](Matrix<double>& S) {
    for (Index j = 0; j < S.cols(); ++j)
      for (Index i = 0; i < j; ++i) S(i, j) = std::numeric_limits<double>::quiet_NaN();
  };
  spoil(dirty.initial);
  for (auto& model : dirty.models) {
    spoil(model.Q_root);
    spoil(model.R_root);
  }

  const AnyProblem<double> from_covariance = covariance, from_root = dirty;
  Trajectory a(from_covariance, data), b(from_root, data);
  ExactFilter exact(exact_problem(from_covariance), exact_data(from_covariance, data));
  for (int k = 0; k < steps; ++k) {
    SCOPED_TRACE(k);
    exact.advance();
    for (Trajectory* trajectory : {&a, &b}) {
      trajectory->advance();
      EXPECT_EQ(trajectory->k(), k);
      EXPECT_GE(trajectory->certified_digits(), 30);
      const Wide tolerance = to_digits(std::min(trajectory->certified_digits(), 60));
      for (const Quantity quantity : rational_quantities)
        EXPECT_LE(relative_distance(trajectory->expansion(quantity, terms), exact_quantity(exact.step(), quantity)),
                  tolerance)
            << static_cast<int>(quantity);
      // Rounded once: the nearest double, however often the recursion rounded.
      for (Index i = 0; i < d.n; ++i) {
        EXPECT_EQ(trajectory->truth().x_filtered(i), nearest(exact.step().x_filtered(i)));
        EXPECT_EQ(trajectory->truth().x_next(i), nearest(exact.step().x_next(i)));
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Sizes, Random,
                         ::testing::Values(Case{{1, 1, 1}, 1}, Case{{2, 1, 1}, 1}, Case{{3, 2, 2}, 1},
                                           Case{{4, 2, 1}, 1}, Case{{2, 3, 3}, 1}, Case{{3, 2, 2}, 2},
                                           Case{{2, 1, 2}, 4}, Case{{3, 0, 1}, 1}, Case{{3, 2, 0}, 1},
                                           Case{{2, 0, 0}, 1}, Case{{0, 0, 0}, 1}, Case{{0, 1, 1}, 1}));

TEST(Trajectory, InformationProblemIsTheSameSystemAsItsCovarianceProblem) {
  const ExactInformation both = exact_information();
  std::mt19937_64 random(7);
  std::vector<StepData> information_data, covariance_data;
  for (int k = 0; k < 5; ++k) {
    const Vector<double> y = few_bits(random, 2, 1), input = few_bits(random, 1, 1);
    information_data.push_back({y, input});
    covariance_data.push_back({y, Vector<double>(matrix(2, 1, {input(0), 1}))});
  }
  const AnyProblem<double> information = both.information;
  Trajectory trajectory(information, std::make_shared<ListedData>(information_data));
  const AnyProblem<double> covariance = both.covariance;
  ExactFilter exact(exact_problem(covariance), exact_data(covariance, std::make_shared<ListedData>(covariance_data)));
  for (int k = 0; k < 5; ++k) {
    trajectory.advance();
    exact.advance();
    const ExactStep& step = exact.step();
    const Wide tolerance = to_digits(std::min(trajectory.certified_digits(), 60));
    EXPECT_LE(relative_distance(trajectory.expansion(Quantity::P_filtered, terms), step.P_filtered), tolerance);
    EXPECT_LE(relative_distance(trajectory.expansion(Quantity::P_next, terms), step.P_next), tolerance);
    EXPECT_LE(relative_distance(trajectory.expansion(Quantity::predictor_gain, terms), step.predictor_gain), tolerance);
    Matrix<Rational> Y = detail::unit<Rational>(2);
    Rational determinant;
    ASSERT_TRUE(detail::solve(step.P_filtered, Y, determinant, [](const Rational& x) { return x > 0; }, true));
    for (Index i = 0; i < 2; ++i) {
      EXPECT_EQ(trajectory.truth().x_filtered(i), nearest(step.x_filtered(i))) << k;
      EXPECT_EQ(trajectory.truth().x_next(i), nearest(step.x_next(i))) << k;
      for (Index j = 0; j < 2; ++j) EXPECT_EQ(trajectory.truth().information(i, j), nearest(Y(i, j)));
    }
    EXPECT_GT(trajectory.truth().information_loss.amplification(), 2);
  }
}

TEST(Trajectory, ClosedLoopsCarryWhatTheySay) {
  std::mt19937_64 random(3);
  Problem<RootModel<double>> root;
  for (int k = 0; k < 3; ++k) root.models.push_back(random_root_model(random, {3, 2, 2}));
  root.initial = few_bits_root(random, 3);
  root.x0 = Vector<double>::Zero(3);
  const AnyProblem<double> problem = root;
  Trajectory trajectory(problem, nullptr);
  for (int k = 0; k < 3; ++k) {
    trajectory.advance();
    const Truth& t = trajectory.truth();
    const auto& model = root.model(k);
    const Matrix<double> I = Matrix<double>::Identity(3, 3);
    const Matrix<double> F = model.A - t.predictor_gain.lazyProduct(model.C);
    const Matrix<double> J = I - t.filter_gain.lazyProduct(model.C);
    const Matrix<double> Ff = k == 0 ? J : Matrix<double>(J.lazyProduct(root.model(k - 1).A));
    // double's own rounding of a few products of numbers of this size
    const double tolerance = 16 * 0x1p-53 * (1 + model.A.norm()) * (1 + t.filter_gain.norm() * model.C.norm()) * 4;
    EXPECT_LE((t.closed_loop - F).norm(), tolerance);
    EXPECT_LE((t.filtered_closed_loop - Ff).norm(), tolerance);
    EXPECT_GT(t.cosine, 0);
    EXPECT_LE(t.cosine, 1);
    EXPECT_EQ(t.x_next.size(), 0);
    EXPECT_EQ(t.information.size(), 0);
  }
}

// ---- the certificate ----

TEST(Trajectory, ClimbsFromAPrecisionThatIsTooSmall) {
  // k(Re) = 4.5 / d^2 = 2^98: 57 digits less 29 are too few.
  const AnyProblem<double> problem = dyer_mcreynolds(48);
  Trajectory small(problem, nullptr, {30, 20}), usual(problem, nullptr, {30}), tall(problem, nullptr, {30, 384});
  EXPECT_EQ(small.working_digits(), 76);
  for (int k = 0; k < 3; ++k) {
    small.advance();
    usual.advance();
    tall.advance();
    EXPECT_EQ(small.truth().P_next, tall.truth().P_next);
    EXPECT_EQ(usual.truth().P_next, tall.truth().P_next);
    EXPECT_EQ(usual.truth().predictor_gain, tall.truth().predictor_gain);
  }
  EXPECT_EQ(small.working_digits(), 115);
  EXPECT_GE(small.certified_digits(), 30);
  EXPECT_LE(small.certified_digits(), 76);
  EXPECT_EQ(tall.working_digits(), 770);
}

TEST(Trajectory, ASmallPrecisionCertifiesNoMoreThanItHas) {
  // Few digits asked for: 57 and 76 do, and k(Re) = 4.5 / d^2 takes its share of the 57.
  const AnyProblem<double> problem = dyer_mcreynolds(50);
  Trajectory trajectory(problem, nullptr, {1, 20});
  trajectory.advance();
  EXPECT_EQ(trajectory.working_digits(), 76);
  EXPECT_LE(trajectory.certified_digits(), 57 - 28);
  EXPECT_GE(trajectory.certified_digits(), 1);
  const Wide error = relative_distance(trajectory.expansion(Quantity::filter_gain, terms),
                                       DyerMcReynolds(Rational(std::ldexp(1.0, -50))).gain());
  EXPECT_LE(error, to_digits(trajectory.certified_digits()));
  EXPECT_GE(error, to_digits(76));  // read from the run of 76 digits, of which k(Re) has its share too
}

/// An error in a mode that no noise excites is never forgotten: 1.125^2 a step.
TEST(Trajectory, ReplaysALongUnstableRunWithoutTheCallerNoticing) {
  CovarianceModel<double> model;
  model.A = matrix(2, 2, {1.125, 0.5, 0, 0.5});
  model.B = matrix(2, 1, {4, -5});  // the other mode: A B = B / 2
  model.Q = matrix(1, 1, {1});
  model.C = matrix(1, 2, {1, 0.3125});
  model.R = matrix(1, 1, {1});
  model.D = Matrix<double>(2, 0);
  const AnyProblem<double> problem =
      Problem<CovarianceModel<double>>{{model}, matrix(2, 2, {16, -20, -20, 25}), Vector<double>::Ones(2)};
  std::mt19937_64 random(11);
  const auto data = random_data(random, 1, 0, 400);
  Trajectory climbing(problem, data, {30, 20}), tall(problem, data, {30, 384});
  const int opened = data->opened();
  for (int k = 0; k < 400; ++k) {
    climbing.advance();
    tall.advance();
    EXPECT_EQ(climbing.k(), k);
    ASSERT_EQ(climbing.truth().P_next, tall.truth().P_next) << k;
    ASSERT_EQ(climbing.truth().x_next, tall.truth().x_next) << k;
  }
  EXPECT_GT(data->opened(), opened);
  EXPECT_GE(climbing.certified_digits(), 30);
}

TEST(Trajectory, TwoRunsCannotAgreeByLosingTheSameAddend) {
  // P0 = 2^700 [1 1; 1 1] + diag(0, 1): 57, 115 and 192 digits all lose the 1, and would agree on P_{k|k}
  // = [1 1; 1 1] to all their digits. It is [1 1; 1 2] but for 2^-700.
  RootModel<double> model;
  model.A = Matrix<double>::Identity(2, 2);
  model.B = Matrix<double>(2, 0);
  model.Q_root = Matrix<double>(0, 0);
  model.C = matrix(1, 2, {1, 0});
  model.R_root = matrix(1, 1, {1});
  const AnyProblem<double> problem =
      Problem<RootModel<double>>{{model}, matrix(2, 2, {0x1p350, 0, 0x1p350, 1}), Vector<double>::Zero(2)};
  Trajectory trajectory(problem, nullptr);
  trajectory.advance();
  EXPECT_EQ(trajectory.truth().P_filtered, matrix(2, 2, {1, 1, 1, 2}));
  EXPECT_GE(trajectory.working_digits(), 400);

  // The same P0 seen by its difference alone, where 57 digits say Re = 1: it is 2.
  model.C = matrix(1, 2, {1, -1});
  const AnyProblem<double> difference =
      Problem<RootModel<double>>{{model}, matrix(2, 2, {0x1p350, 0, 0x1p350, 1}), Vector<double>::Zero(2)};
  Trajectory other(difference, nullptr);
  other.advance();
  EXPECT_EQ(other.truth().innovation(0, 0), 2);

  // The scalar case: P - P^2 / (P + 1) is 0 in any precision below 2^700.
  model.A = model.C = matrix(1, 1, {1});
  model.B = Matrix<double>(1, 0);
  const AnyProblem<double> scalar =
      Problem<RootModel<double>>{{model}, matrix(1, 1, {0x1p350}), Vector<double>::Zero(1)};
  Trajectory one(scalar, nullptr);
  one.advance();
  EXPECT_EQ(one.truth().P_filtered(0, 0), 1);
}

TEST(Trajectory, ExactZerosAreFound) {
  // A perfect measurement of the whole state leaves nothing: P_{k|k} = 0, F = 0, P+ = B Q B'.
  CovarianceModel<double> model;
  model.A = matrix(2, 2, {0.3, 1, 0, 0.7});
  model.B = matrix(2, 1, {1, 0.5});
  model.Q = matrix(1, 1, {1});
  model.C = matrix(2, 2, {0.1, 0.7, 1, 0.3});
  model.R = Matrix<double>::Zero(2, 2);
  const AnyProblem<double> perfect =
      Problem<CovarianceModel<double>>{{model}, matrix(2, 2, {3, 0.1, 0.1, 0.7}), Vector<double>::Zero(2)};
  Trajectory trajectory(perfect, nullptr);
  trajectory.advance();
  EXPECT_EQ(trajectory.truth().P_filtered, Matrix<double>::Zero(2, 2));
  EXPECT_EQ(trajectory.truth().closed_loop, Matrix<double>::Zero(2, 2));
  EXPECT_EQ(trajectory.truth().P_next, matrix(2, 2, {1, 0.5, 0.5, 0.25}));

  // P C' = 0 although neither is: no gain, and F = A.
  model.C = matrix(1, 2, {0.3, 0.3});
  model.R = matrix(1, 1, {0.1});
  const AnyProblem<double> blind =
      Problem<CovarianceModel<double>>{{model}, matrix(2, 2, {0.1, -0.1, -0.1, 0.1}), Vector<double>::Zero(2)};
  Trajectory none(blind, nullptr);
  none.advance();
  EXPECT_EQ(none.truth().predictor_gain, Matrix<double>::Zero(2, 1));
  EXPECT_EQ(none.truth().filter_gain, Matrix<double>::Zero(2, 1));
  EXPECT_EQ(none.truth().closed_loop, model.A);
  EXPECT_GE(none.certified_digits(), 30);

  // An estimate that the data bring to 0: x = 1, Kf = 1/2, innovation -2
  CovarianceModel<double> scalar;
  scalar.A = scalar.B = scalar.C = scalar.Q = scalar.R = matrix(1, 1, {1});
  scalar.D = Matrix<double>(1, 0);
  const AnyProblem<double> to_zero =
      Problem<CovarianceModel<double>>{{scalar}, matrix(1, 1, {1}), Vector<double>::Ones(1)};
  const auto data =
      std::make_shared<ListedData>(std::vector<StepData>{{Vector<double>::Constant(1, -1.0), Vector<double>(0)}});
  Trajectory zero(to_zero, data);
  zero.advance();
  EXPECT_EQ(zero.truth().x_filtered(0), 0);
}

TEST(Trajectory, MoreDigitsOnRequest) {
  const AnyProblem<double> problem = dyer_mcreynolds(8);
  Trajectory trajectory(problem, nullptr, {500});
  trajectory.advance();
  EXPECT_GE(trajectory.certified_digits(), 500);
  EXPECT_EQ(trajectory.working_digits(), 1540);
  EXPECT_THROW(Trajectory(problem, nullptr, {751}), ReferenceError);
  EXPECT_THROW(Trajectory(problem, nullptr, {0}), ReferenceError);
}

// ---- beyond double ----

TEST(Trajectory, DecimalsAreTheDigitsThatAreCertified) {
  const AnyProblem<double> problem = dyer_mcreynolds(40);
  Trajectory trajectory(problem, nullptr, {40});
  trajectory.advance();
  const auto P = trajectory.decimals(Quantity::P_next, 40), K = trajectory.decimals(Quantity::filter_gain, 12);
  const DyerMcReynolds form{Rational(std::ldexp(1.0, -40))};
  const Matrix<Rational> P_true = form.P(), K_true = form.gain();
  const auto expect_right = [](const std::string& text, const Rational& truth, std::size_t digits) {
    const auto exponent = text.find('e');
    const std::string mantissa = text.substr(0, exponent);
    std::size_t count = 0;
    for (const char c : mantissa) count += c >= '0' && c <= '9';
    for (std::size_t i = 0; mantissa[i] == '0' || mantissa[i] == '-' || mantissa[i] == '.'; ++i)
      count -= mantissa[i] == '0';
    EXPECT_EQ(count, digits) << text;
    const Wide unit = pow(Wide(10), -static_cast<int>(digits) + 1) * abs(wide(truth));
    EXPECT_LE(abs(Wide(Wide(text) - wide(truth))), unit) << text;
  };
  for (std::size_t i = 0; i < 3; ++i) {
    const auto row = static_cast<Index>(i);
    for (std::size_t j = 0; j < 3; ++j) expect_right(P[i][j], P_true(row, static_cast<Index>(j)), 40);
    for (std::size_t j = 0; j < 2; ++j) expect_right(K[i][j], K_true(row, static_cast<Index>(j)), 12);
  }
  EXPECT_GE(trajectory.certified_digits(Quantity::P_next), 40);
  EXPECT_TRUE(trajectory.decimals(Quantity::x_next, 40).empty());
}

TEST(Trajectory, AnEntryHasTheDigitsOfItsOwn) {
  // Two states that know nothing of each other, but for a frame that mixes them a little.
  CovarianceModel<double> model;
  model.A = Matrix<double>::Identity(2, 2);
  model.B = Matrix<double>(2, 0);
  model.Q = Matrix<double>(0, 0);
  model.C = matrix(1, 2, {1, 0});
  model.R = matrix(1, 1, {1});
  // After the step p_22 is 2^100 - 2^200/(2^100 + 1), what is left of numbers of 2^100.
  const AnyProblem<double> problem = Problem<CovarianceModel<double>>{
      {model}, matrix(2, 2, {0x1p100, 0x1p100, 0x1p100, 0x1p100}), Vector<double>::Zero(2)};
  Trajectory trajectory(problem, nullptr);
  trajectory.advance();
  const auto P = trajectory.decimals(Quantity::P_next, 60);
  const Wide truth = Wide(1) / (1 + ldexp(Wide(1), -100));
  EXPECT_LE(abs(Wide(Wide(P[1][1]) - truth)), pow(Wide(10), -static_cast<int>(P[1][1].size()) + 2)) << P[1][1];
  EXPECT_EQ(P[0][1], P[1][0]);
}

TEST(Trajectory, EachEntryIsCertifiedOnRequest) {
  // One of two states is measured. P_{k|k} = diag(1 / (1 + 2^-200), 2^200): by its norm the small entry is rounding.
  CovarianceModel<double> model;
  model.A = Matrix<double>::Identity(2, 2);
  model.B = Matrix<double>(2, 0);
  model.Q = Matrix<double>(0, 0);
  model.C = matrix(1, 2, {1, 0});
  model.R = matrix(1, 1, {1});
  const AnyProblem<double> problem = Problem<CovarianceModel<double>>{
      {model}, Matrix<double>(0x1p200 * Matrix<double>::Identity(2, 2)), Vector<double>::Zero(2)};
  Trajectory by_norm(problem, nullptr, {30}), by_entry(problem, nullptr, {.digits = 30, .each_entry = true});
  by_norm.advance();
  by_entry.advance();
  EXPECT_EQ(by_norm.decimals(Quantity::P_filtered, 30)[0][0].substr(0, 2), "0e");
  EXPECT_GT(by_entry.working_digits(), by_norm.working_digits());
  const std::string small = by_entry.decimals(Quantity::P_filtered, 30)[0][0];
  EXPECT_EQ(small, "1.0000000000000000000000000000" + std::string(1, '0'));  // 1 - 2^-200 to 30 digits
  EXPECT_EQ(by_entry.decimals(Quantity::P_filtered, 30)[0][1], "0");
  EXPECT_GE(by_entry.certified_digits(Quantity::P_filtered), 30);
}

TEST(Trajectory, OfExactNumbers) {
  // Scalar: P = 1/3, R = 1/7: P_{k|k} = PR/(P+R) = 1/10, Kf = 7/10. No double is any of them.
  ExactProblem problem;
  CovarianceModel<Rational> model;
  model.A = model.B = model.C = Matrix<Rational>(1, 1);
  model.Q = model.R = Matrix<Rational>(1, 1);
  model.A(0, 0) = model.C(0, 0) = model.B(0, 0) = 1;
  model.Q(0, 0) = 0;
  model.R(0, 0) = Rational(1) / 7;
  model.D = Matrix<Rational>(1, 0);
  problem.models = {model};
  problem.initial = Matrix<Rational>(1, 1);
  problem.initial(0, 0) = Rational(1) / 3;
  problem.x0 = Vector<Rational>(1);
  problem.x0(0) = 0;
  Trajectory trajectory(problem, nullptr, {40});
  trajectory.advance();
  EXPECT_EQ(trajectory.decimals(Quantity::P_filtered, 40)[0][0], "0.1" + std::string(39, '0'));
  EXPECT_EQ(trajectory.decimals(Quantity::filter_gain, 40)[0][0], "0.7" + std::string(39, '0'));
  EXPECT_EQ(trajectory.truth().P_filtered(0, 0), 0.1);

  // Beyond the range of double there is a trajectory, but no Truth.
  problem.initial(0, 0) = pow(boost::multiprecision::mpz_int(10), 400);
  model.R(0, 0) = problem.initial(0, 0);
  problem.models = {model};
  Trajectory large(problem, nullptr, {40});
  large.advance();
  EXPECT_EQ(large.decimals(Quantity::P_filtered, 5)[0][0], "5.0000e399");
  EXPECT_THROW(large.truth(), ReferenceError);
}

TEST(Trajectory, LogLikelihoodOfAKnownNormal) {
  CovarianceModel<double> model;
  model.A = model.B = model.C = model.Q = matrix(1, 1, {1});
  model.R = matrix(1, 1, {3});
  model.D = Matrix<double>(1, 0);
  const AnyProblem<double> problem = Problem<CovarianceModel<double>>{{model}, matrix(1, 1, {1}), Vector<double>::Ones(1)};
  const auto data =
      std::make_shared<ListedData>(std::vector<StepData>{{Vector<double>::Constant(1, 2.0), Vector<double>(0)}});
  Trajectory trajectory(problem, data);
  trajectory.advance();
  // N(1, 4) at 2
  EXPECT_DOUBLE_EQ(trajectory.truth().log_likelihood, -.5 * (std::log(8 * std::acos(-1.0)) + .25));
  EXPECT_GE(trajectory.certified_digits(Quantity::log_likelihood), 30);
}

// ---- threads ----

TEST(Trajectory, ThreadsGiveTheBitsThatOneGives) {
  const AnyProblem<double> ill = dyer_mcreynolds(44);  // climbs
  std::mt19937_64 random(5);
  Problem<RootModel<double>> root;
  root.models = {random_root_model(random, {4, 2, 2})};
  root.initial = few_bits_root(random, 4);
  root.x0 = few_bits(random, 4, 1);
  const AnyProblem<double> ordinary = root;
  const auto data = random_data(random, 2, 1, 60);
  const auto run = [](const AnyProblem<double>& problem, const std::shared_ptr<const Data>& with, int steps) {
    std::vector<Truth> truths;
    Trajectory trajectory(problem, with);
    for (int k = 0; k < steps; ++k) {
      trajectory.advance();
      truths.push_back(trajectory.truth());
    }
    return truths;
  };
  const auto serial_ill = run(ill, nullptr, 60), serial_ordinary = run(ordinary, data, 60);
  std::vector<Truth> parallel_ill, parallel_ordinary;
  std::thread one([&] { parallel_ill = run(ill, nullptr, 60); });
  std::thread two([&] { parallel_ordinary = run(ordinary, data, 60); });
  one.join();
  two.join();
  for (std::size_t k = 0; k < 60; ++k) {
    EXPECT_EQ(parallel_ill[k].P_next, serial_ill[k].P_next);
    EXPECT_EQ(parallel_ill[k].filter_gain, serial_ill[k].filter_gain);
    EXPECT_EQ(parallel_ordinary[k].P_next, serial_ordinary[k].P_next);
    EXPECT_EQ(parallel_ordinary[k].x_next, serial_ordinary[k].x_next);
    EXPECT_EQ(parallel_ordinary[k].innovation_condition, serial_ordinary[k].innovation_condition);
  }
}

// ---- what it refuses ----

Problem<CovarianceModel<double>> plain() {
  CovarianceModel<double> model;
  model.A = matrix(2, 2, {0.5, 0.25, 0, 0.75});
  model.B = matrix(2, 1, {1, 0.5});
  model.C = matrix(1, 2, {1, 0});
  model.D = Matrix<double>(2, 0);
  model.Q = model.R = matrix(1, 1, {1});
  return {{model}, Matrix<double>::Identity(2, 2), Vector<double>::Zero(2)};
}

template <class Change>
std::string refusal(Change change, int steps = 1, std::shared_ptr<const Data> data = nullptr) {
  Problem<CovarianceModel<double>> changed = plain();
  change(changed);
  const AnyProblem<double> problem = changed;
  try {
    Trajectory trajectory(problem, data);
    for (int k = 0; k < steps; ++k) trajectory.advance();
  } catch (const ReferenceError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Trajectory, NamesWhatItRefuses) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(refusal([](auto&) {}), "accepted");
  EXPECT_EQ(refusal([](auto& p) { p.initial(0, 1) = 0.5; }), "P0 is not symmetric: entries (1,0) and (0,1) differ");
  EXPECT_EQ(refusal([](auto& p) { p.models[0].Q = Matrix<double>::Identity(2, 2); }), "Q is 2 x 2, expected 1 x 1");
  EXPECT_EQ(refusal([&](auto& p) { p.models[0].A(1, 0) = nan; }), "A(1,0) is not finite");
  EXPECT_EQ(refusal([&](auto& p) { p.models.push_back(p.models[0]), p.models[1].C(0, 1) = -1 / 0.0; }),
            "C of model 1(0,1) is not finite");
  EXPECT_EQ(refusal([](auto& p) { p.models.clear(); }), "the problem has no model");
  EXPECT_EQ(refusal([](auto& p) { p.x0 = Vector<double>::Zero(3); }), "x0 is 3 x 1, expected 2 x 1");
  EXPECT_EQ(refusal([](auto& p) { p.models[0].R(0, 0) = -2; }),
            "step 0: Re is not positive definite: pivot 0 of its Cholesky factorisation is -1");
  EXPECT_EQ(refusal([](auto& p) { p.models[0].R(0, 0) = 0, p.initial.setZero(); }),
            "step 0: Re is not positive definite: pivot 0 of its Cholesky factorisation is 0");
  EXPECT_EQ(refusal([](auto& p) { p.models[0].A *= 0x1p300; }, 4),
            "step 1: P_{k+1|k} does not fit a double (overflow)");
  const auto data = std::make_shared<ListedData>(std::vector<StepData>{{Vector<double>::Zero(1), Vector<double>(0)},
                                                                       {Vector<double>::Zero(2), Vector<double>(0)}});
  EXPECT_EQ(refusal([](auto&) {}, 2, data), "y of step 1 is 2 x 1, expected 1 x 1");
}

TEST(Trajectory, NamesWhatItRefusesOfAnInformationProblem) {
  const auto refused = [](auto change) -> std::string {
    auto information = exact_information().information;
    change(information);
    const AnyProblem<double> problem = information;
    try {
      Trajectory(problem, nullptr).advance();
    } catch (const ReferenceError& error) {
      return error.what();
    }
    return "accepted";
  };
  EXPECT_EQ(refused([](auto&) {}), "accepted");
  // 7 / 3 has no end in binary: elimination in any precision leaves a pivot of rounding, not 0
  EXPECT_EQ(refused([](auto& p) { p.models[0].A_inverse = matrix(2, 2, {3, 7, 6, 14}); }), "A^{-1} is singular");
  EXPECT_EQ(refused([](auto& p) { p.models[0].Q_inverse_root(1, 1) = 0; }), "Q^{-1/2} is singular: entry (1,1) is 0");
  EXPECT_EQ(refused([](auto& p) { p.initial(0, 0) = 0; }), "T0 is singular: entry (0,0) is 0");
  EXPECT_EQ(refused([](auto& p) { p.models[0].w_mean = Vector<double>::Zero(1); }),
            "the mean of w is 1 x 1, expected 2 x 1");
}

TEST(Trajectory, SaysSoWhenNoPrecisionHelps) {
  // Re is exactly singular, but rounding hides it: C P C' = 0.1 (1 - 1), R = 0.
  const std::string words = refusal([](auto& p) {
    p.models[0].R.setZero();
    p.models[0].C = matrix(1, 2, {0.3, 0.3});
    p.initial = matrix(2, 2, {0.1, -0.1, -0.1, 0.1});
  });
  EXPECT_NE(words.find("step 0: Re is singular or indefinite as far as 770 digits can tell"), std::string::npos)
      << words;
}

}  // namespace
}  // namespace kfstab::reference::testing
