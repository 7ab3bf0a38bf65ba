// The certificate of the trajectory against the exact filter: every digit that it claims has to be right.

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <kfstab/reference/closed_forms.hpp>
#include <kfstab/reference/detail/elimination.hpp>
#include <kfstab/reference/exact_filter.hpp>
#include <kfstab/reference/trajectory.hpp>

#include "support.hpp"

namespace kfstab::reference::testing {
namespace {

/// Both side by side: whatever is certified is right, of every quantity of every step.
void expect_right(Trajectory& trajectory, ExactFilter& exact, int steps, bool with_data, const std::string& which) {
  const auto judge = [&](Quantity quantity, auto error) {
    const int digits = trajectory.certified_digits(quantity);
    EXPECT_LE(error(trajectory.expansion(quantity, digits / 15 + 2)), to_digits(digits))
        << which << ", step " << trajectory.k() << ": " << digits << " digits of quantity "
        << static_cast<int>(quantity) << " are certified, with " << trajectory.working_digits() << " at work";
  };
  for (int k = 0; k < steps; ++k) {
    trajectory.advance();
    exact.advance();
    for (const Quantity quantity : rational_quantities) {
      const Matrix<Rational> truth = exact_quantity(exact.step(), quantity);
      if (truth.size() == 0) continue;
      judge(quantity, [&](const auto& sum) { return relative_distance(sum, truth); });
    }
    if (!with_data) continue;
    const Wide truth = log_likelihood(exact.step());
    judge(Quantity::log_likelihood, [&](const auto& sum) {
      Wide error = -truth;
      for (const auto& term : sum) error += term(0, 0);
      return Wide(abs(Wide(error / truth)));
    });
  }
}

// ---- a thousand random systems ----

/// Sizes and condition all over the place: rows of S0 and R^{1/2} scaled by powers of two, A singular now and then.
Problem<RootModel<double>> random_system(std::mt19937_64& random, int range) {
  const auto below = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  const Dimensions d{1 + below(4), below(3), 1 + below(2)};
  const auto scale_rows = [&](Matrix<double>& S) {
    for (Index i = 0; i < S.rows(); ++i) S.row(i) *= std::ldexp(1.0, below(2 * range + 1) - range);
  };
  Problem<RootModel<double>> problem;
  const int models = 1 + below(2);
  for (int k = 0; k < models; ++k) {
    RootModel<double> model = random_root_model(random, d);
    if (below(4) == 0 && d.n > 1) model.A.row(0) = model.A.row(1) / 2;
    if (below(3) == 0) model.R_root *= std::ldexp(1.0, -below(3 * range));
    if (d.p == 2 && below(3) == 0) {
      model.C.row(1) = model.C.row(0);
      model.C(1, d.n - 1) += std::ldexp(1.0, -below(2 * range));
    }
    scale_rows(model.Q_root);
    problem.models.push_back(model);
  }
  problem.initial = few_bits_root(random, d.n);
  scale_rows(problem.initial);
  problem.x0 = few_bits(random, d.n, 1);
  return problem;
}

class RandomSystems : public ::testing::TestWithParam<int> {};

TEST_P(RandomSystems, HaveAllTheDigitsThatAreClaimed) {
  constexpr int systems = 250, steps = 10;
  std::mt19937_64 random(9000 + static_cast<unsigned>(GetParam()));
  for (int number = 0; number < systems; ++number) {
    const Problem<RootModel<double>> root = random_system(random, 16);
    const auto data = random_data(random, root.dimensions().p, 1, steps);
    AnyProblem<double> problem = root;
    if (number % 3 == 0) problem = as_covariance(root);
    ExactProblem numbers = exact_problem(problem);
    const auto exact_numbers = exact_data(problem, data);
    // and now and then numbers that no binary fraction is
    const bool thirds = number % 3 == 1;
    if (thirds)
      for (auto& model : numbers.models)
        for (Index i = 0; i < model.A.size(); ++i) model.A(i) /= 3;
    Trajectory trajectory = thirds ? Trajectory(numbers, exact_numbers) : Trajectory(problem, data);
    ExactFilter exact(numbers, exact_numbers);
    expect_right(trajectory, exact, steps, true,
                 "shard " + std::to_string(GetParam()) + ", system " + std::to_string(number));
    EXPECT_GE(trajectory.certified_digits(), 30);
  }
}

INSTANTIATE_TEST_SUITE_P(Shards, RandomSystems, ::testing::Range(0, 4));

// ---- numbers that no double arithmetic survives ----

Rational power_of_ten(int exponent) {
  Rational x = 1;
  for (int i = 0; i < std::abs(exponent); ++i) x *= 10;
  return exponent < 0 ? Rational(1 / x) : x;
}

std::shared_ptr<const ExactData> exact_random_data(unsigned seed, Index p, int steps) {
  std::mt19937_64 random(seed);
  std::vector<StepDataOf<Rational>> list;
  for (int k = 0; k < steps; ++k) {
    Vector<Rational> y(p);
    for (Index i = 0; i < p; ++i) y(i) = Rational(static_cast<int>(random() % 201) - 100) / 10;
    list.push_back({y, Vector<Rational>(0)});
  }
  return std::make_shared<ExactListedData>(std::move(list));
}

/// Three states, the first two unstable and turning, one measurement, all in decimals.
ExactProblem three_states() {
  CovarianceModel<Rational> model;
  const auto decimals = [](Index rows, Index cols, std::initializer_list<int> hundredths) {
    Matrix<Rational> X(rows, cols);
    auto entry = hundredths.begin();
    for (Index i = 0; i < rows; ++i)
      for (Index j = 0; j < cols; ++j) X(i, j) = Rational(*entry++) / 100;
    return X;
  };
  model.A = decimals(3, 3, {102, 25, 0, -25, 102, 13, 0, 7, 90});
  model.B = decimals(3, 1, {25, 0, 50});
  model.C = decimals(1, 3, {100, 0, 100});
  model.D = Matrix<Rational>(3, 0);
  model.Q = model.R = decimals(1, 1, {100});
  return {
      {{model}, decimals(3, 3, {100, 0, 0, 0, 100, 0, 0, 0, 100}), Vector<Rational>(decimals(3, 1, {10, 20, -30}))}};
}

void expect_thirty_digits(const ExactProblem& problem, const std::string& which) {
  constexpr int steps = 10;
  const auto data = exact_random_data(71, problem.dimensions().p, steps);
  Trajectory trajectory(problem, data);
  ExactFilter exact(problem, data);
  expect_right(trajectory, exact, steps, true, which);
  EXPECT_GE(trajectory.certified_digits(), 30) << which;
}

TEST(Certificate, OfNearlyEqualMeasurements) {
  expect_thirty_digits(DyerMcReynolds(power_of_ten(-30)).problem(), "d = 1e-30");
}

TEST(Certificate, OfAWeakPrior) {
  ExactProblem problem = three_states();
  for (Index i = 0; i < 3; ++i) problem.initial(i, i) = power_of_ten(60);
  expect_thirty_digits(problem, "P0 = 1e60 I");
}

TEST(Certificate, OfANearlySingularA) {
  // U diag(1, 1e-20, 1e-40) V with unit triangular U and V
  ExactProblem problem = three_states();
  Matrix<Rational> U = detail::unit<Rational>(3), V = U, diagonal = U;
  U(1, 0) = Rational(1) / 3;
  U(2, 0) = U(2, 1) = Rational(1) / 2;
  V(0, 1) = Rational(2) / 3;
  V(0, 2) = V(1, 2) = -1;
  diagonal(1, 1) = power_of_ten(-20);
  diagonal(2, 2) = power_of_ten(-40);
  problem.models[0].A = detail::times(detail::times(U, diagonal), V);
  expect_thirty_digits(problem, "k(A) = 1e40");
}

// ---- a precision that is too small ----

/// One digit is asked for, so the lowest rung serves until it has lost nearly all; of what it still claims, nothing may
/// be wrong. These lose from 8 to 112 digits.
TEST(Certificate, NeverClaimsADigitThatIsWrong) {
  int claimed_little = 0;
  for (int exponent = 4; exponent <= 56; ++exponent) {
    const ExactProblem problem = DyerMcReynolds(Rational(3 * power_of_ten(-exponent) / 7)).problem();
    const auto data = exact_random_data(72, 2, 4);
    Trajectory trajectory(problem, data, {.digits = 1, .first_digits = 1});
    ExactFilter exact(problem, data);
    expect_right(trajectory, exact, 4, true, "d = 3e-" + std::to_string(exponent) + " / 7");
    claimed_little += trajectory.certified_digits() < 10;
  }
  EXPECT_GT(claimed_little, 0);  // or precision was not too small
  std::mt19937_64 random(73);
  for (int number = 0; number < 150; ++number) {
    const AnyProblem<double> problem = random_system(random, 64);
    const auto data = random_data(random, std::get<1>(problem).dimensions().p, 1, 4);
    Trajectory trajectory(problem, data, {.digits = 1, .first_digits = 1});
    ExactFilter exact(exact_problem(problem), exact_data(problem, data));
    expect_right(trajectory, exact, 4, true, "system " + std::to_string(number));
  }
}

// ---- a long run ----

/// N steps of the Riccati recursion as one: P -> H + A P (I + G P)^{-1} A'. Two in a row are one again, so 2^j steps
/// cost j of these, as in the doubling of steady_state.
struct Leap {
  Matrix<Wide> A, G, H;
};

Matrix<Wide> solved(const Matrix<Wide>& X, Matrix<Wide> Y) {
  Wide determinant;
  EXPECT_TRUE(detail::solve(
      X, Y, determinant, [](const Wide& x) { return x != 0; }, false));
  return Y;
}

Leap operator*(const Leap& second, const Leap& first) {
  using detail::sum_of, detail::times, detail::transpose_of, detail::unit;
  // (I + G2 H1)^{-1}, and its transpose (I + H1 G2)^{-1}
  const Matrix<Wide> W = solved(sum_of(unit<Wide>(3), times(second.G, first.H)), unit<Wide>(3)), Wt = transpose_of(W);
  const Matrix<Wide> A2Wt = times(second.A, Wt), A1tW = times(transpose_of(first.A), W);
  return {times(A2Wt, first.A), sum_of(first.G, times(times(A1tW, second.G), first.A)),
          sum_of(second.H, times(times(A2Wt, first.H), transpose_of(second.A)))};
}

/// Double integrator with a bias that no noise moves: three eigenvalues 1. Errors in the bias are forgotten as 1/k^2
/// only, and an error of an eigenvalue would be multiplied by 1e5.
TEST(Certificate, OfAHundredThousandStepsWithNoiseFreeModesOnTheUnitCircle) {
  constexpr int steps = 100000;
  CovarianceModel<double> model;
  model.A = matrix(3, 3, {1, 0.125, 0.0078125, 0, 1, 0.125, 0, 0, 1});
  model.B = matrix(3, 1, {0, 0.0625, 0});
  model.C = matrix(1, 3, {1, 0, 0});
  model.D = Matrix<double>(3, 0);
  model.Q = model.R = matrix(1, 1, {1});
  const AnyProblem<double> problem =
      Problem<CovarianceModel<double>>{{model}, Matrix<double>::Identity(3, 3), Vector<double>::Zero(3)};
  Trajectory trajectory(problem, nullptr);
  for (int k = 0; k < steps; ++k) trajectory.advance();
  EXPECT_GE(trajectory.certified_digits(), 30);

  const Matrix<Wide> B = exact<Wide>(model.B), C = exact<Wide>(model.C);
  Leap power{exact<Wide>(model.A), detail::times(detail::transpose_of(C), C),
             detail::times(B, detail::transpose_of(B))};
  const Matrix<Wide> I = detail::unit<Wide>(3);
  Leap leap{I, detail::zero<Wide>(3, 3), detail::zero<Wide>(3, 3)};
  for (int left = steps; left > 0; left /= 2) {
    if (left % 2 == 1) leap = power * leap;
    power = power * power;
  }
  // P0 = I; with (I + G)^{-1} from the right, for P = H + A (I + G)^{-1} A'
  const Matrix<Wide> P =
      detail::sum_of(leap.H, detail::times(leap.A, solved(detail::sum_of(I, leap.G), detail::transpose_of(leap.A))));
  const int digits = trajectory.certified_digits(Quantity::P_next);
  Wide distance = 0, size = 0;
  const auto sum = trajectory.expansion(Quantity::P_next, digits / 15 + 2);
  for (Index i = 0; i < 9; ++i) {
    Wide d = -P(i / 3, i % 3);
    size += d * d;
    for (const auto& term : sum) d += term(i / 3, i % 3);
    distance += d * d;
  }
  EXPECT_LE(Wide(sqrt(Wide(distance / size))), to_digits(digits));
}

// ---- rubbish ----

std::string refusal(const ExactProblem& problem, int steps) {
  try {
    Trajectory trajectory(problem, nullptr);
    for (int k = 0; k < steps; ++k) {
      trajectory.advance();
      (void)trajectory.truth();
    }
  } catch (const ReferenceError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Certificate, RubbishIsRefusedByName) {
  ExactProblem problem = three_states();
  EXPECT_EQ(refusal(problem, 5), "accepted");
  // Re indefinite by next to nothing, and by exactly nothing: R = -C P C' + 1e-40
  const auto with_R = [&](const Rational& R) {
    ExactProblem changed = problem;
    changed.models[0].R(0, 0) = R;
    return refusal(changed, 1);
  };
  EXPECT_EQ(with_R(Rational(-2 + power_of_ten(-40))), "accepted");
  EXPECT_NE(with_R(Rational(-2 - power_of_ten(-40))).find("step 0: Re is not positive definite"), std::string::npos);
  EXPECT_NE(with_R(-2).find("step 0: Re is"), std::string::npos) << with_R(-2);
  EXPECT_NE(with_R(-3).find("step 0: Re is not positive definite"), std::string::npos);

  ExactProblem large = problem;
  for (Index i = 0; i < 9; ++i) large.models[0].A(i) *= power_of_ten(200);
  EXPECT_NE(refusal(large, 3).find("overflow"), std::string::npos) << refusal(large, 3);

  // R singular where its inverse is asked for
  ExactProblem certain = DyerMcReynolds(1).problem();
  certain.models[0].R(0, 0) = 0;
  EXPECT_THROW(noise_free_covariance(certain, 1), ReferenceError);
  Problem<InformationModel<double>> information = exact_information().information;
  information.models[0].R_inverse_root(1, 1) = 0;
  EXPECT_THROW(exact_problem(information), ReferenceError);
  EXPECT_THROW(Trajectory(*std::make_unique<AnyProblem<double>>(information), nullptr), ReferenceError);
}

}  // namespace
}  // namespace kfstab::reference::testing
