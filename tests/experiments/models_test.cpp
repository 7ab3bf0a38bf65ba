#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/models.hpp>

#include <cmath>
#include <set>
#include <stdexcept>

#include <gtest/gtest.h>

#include <kfstab/reference/steady_state.hpp>

#include <kfstab/experiments/selection.hpp>

using namespace kfstab;
using namespace kfstab::experiments;

namespace {

Matrix<double> plain_product(const Matrix<double>& X, const Matrix<double>& Y) { return X.lazyProduct(Y); }

bool equal(const Matrix<double>& X, const Matrix<double>& Y) {
  return X.rows() == Y.rows() && X.cols() == Y.cols() && (X.array() == Y.array()).all();
}

}  // namespace

TEST(Rotation, TurnsByTheAngleAndStretchesByTheModulus) {
  const auto X = rotation(2, std::acos(-1.) / 6);
  EXPECT_NEAR(X(0, 0), std::sqrt(3.), 8 * u);
  EXPECT_NEAR(X(0, 1), -1, 8 * u);
  EXPECT_NEAR(X(1, 0), 1, 8 * u);
  EXPECT_EQ(X(1, 1), X(0, 0));
  EXPECT_TRUE(equal(rotation(3, 0), (Matrix<double>(2, 2) << 3, 0, 0, 3).finished()));
}

TEST(RoundTo, IsTheNearestMultiple) {
  Matrix<double> X(2, 3);
  X << .3, -.3, 1.0 / 3, 5, -0.0625, 1e-9;
  const auto Y = round_to(X, 4);
  EXPECT_TRUE(equal(Y, (Matrix<double>(2, 3) << .3125, -.3125, .3125, 5, -.0625, 0).finished()));
  EXPECT_TRUE(equal(round_to(Y, 4), Y));
  EXPECT_TRUE(equal(round_to(X, 0), (Matrix<double>(2, 3) << 0, 0, 0, 5, 0, 0).finished()));
  EXPECT_TRUE(equal(round_to(8 * X, -2), (Matrix<double>(2, 3) << 4, -4, 4, 40, 0, 0).finished()));
}

TEST(RoundTo, MakesProductsExact) {
  // 18 bits and a few before the point: sums of products of two entries fit 53 bits.
  Random random(5);
  const auto X = round_to(random_normal(random, 6, 6), 18), Y = round_to(random_normal(random, 6, 6), 18);
  EXPECT_TRUE(equal(plain_product(X, Y), plain_product(X.rowwise().reverse(), Y.colwise().reverse())))
      << "the order of summation counts";
}

TEST(RandomNormal, SameSeedSameNumbers) {
  Random one(3), two(3), other(4);
  const auto X = random_normal(one, 4, 5);
  EXPECT_TRUE(equal(X, random_normal(two, 4, 5)));
  EXPECT_FALSE(equal(X, random_normal(other, 4, 5)));
  EXPECT_FALSE(equal(X, random_normal(one, 4, 5))) << "the generator stands still";
  EXPECT_EQ(random_normal(one, 0, 3).cols(), 3);
}

TEST(RandomNormal, HasMeanZeroAndVarianceOne) {
  Random random(1);
  const auto X = random_normal(random, 200, 200);
  // Five standard deviations of mean and variance of N samples: 5 / sqrt(N), 5 sqrt(2 / N).
  EXPECT_NEAR(X.mean(), 0, 5. / 200);
  EXPECT_NEAR(X.array().square().mean(), 1, 5. * std::sqrt(2.) / 200);
}

TEST(RandomOrthogonal, IsOrthogonal) {
  Random random(2);
  for (const Index n : {1, 2, 3, 8}) {
    const auto Q = random_orthogonal(random, n);
    ASSERT_EQ(Q.rows(), n);
    ASSERT_EQ(Q.cols(), n);
    const Matrix<double> gram = plain_product(Q.transpose(), Q);
    const auto size = static_cast<double>(n);
    EXPECT_LE((gram - Matrix<double>::Identity(n, n)).norm(), 30 * u * size * std::sqrt(size)) << n;
  }
}

TEST(RandomOrthogonal, IsUniformNotWhatAFactorisationPrefers) {
  // Householder's Q has first entries of one sign; of 200 fair coins fewer than 60 heads are 1e-8 likely.
  Random random(6);
  int positive = 0, ones = 0;
  for (int i = 0; i < 200; ++i) {
    if (random_orthogonal(random, 3)(0, 0) > 0) ++positive;
    if (random_orthogonal(random, 1)(0, 0) > 0) ++ones;
  }
  EXPECT_GT(positive, 60);
  EXPECT_LT(positive, 140);
  EXPECT_GT(ones, 60);
  EXPECT_LT(ones, 140);
}

TEST(SystemOf, GivesEveryParametrisationTheSameExactProblem) {
  const auto A = round_to(rotation(.9, .7), 20);
  const Matrix<double> B{{1.}, {.5}}, C{{1., .25}}, R_root{{.5}}, S0{{2., 0.}, {.5, 1.}};
  const auto system = system_of("pair", A, B, C, R_root, S0, 17);
  EXPECT_EQ(system.name, "pair");
  EXPECT_EQ(system.steps, 17);
  EXPECT_FALSE(system.data);
  EXPECT_TRUE(system.time_invariant());

  const auto covariances = problem_of(system, Parametrisation::covariance);
  const auto& P = std::get<Problem<CovarianceModel<double>>>(covariances);
  EXPECT_TRUE(equal(P.initial, (Matrix<double>(2, 2) << 4, 1, 1, 1.25).finished()));
  EXPECT_TRUE(equal(P.models[0].A, A));
  EXPECT_EQ(P.models[0].Q(0, 0), 1);
  EXPECT_EQ(P.models[0].R(0, 0), .25);
  EXPECT_EQ(P.x0.norm(), 0);

  const auto roots = problem_of(system, Parametrisation::root);
  const auto& S = std::get<Problem<RootModel<double>>>(roots);
  EXPECT_TRUE(equal(S.initial, S0));
  EXPECT_EQ(S.models[0].R_root(0, 0), .5);
  EXPECT_EQ(parametrisation(problem_of(system, Parametrisation::information)), Parametrisation::information);
}

TEST(RandomSystem, HasItsSizesAndItsRadius) {
  Random random(1);
  const auto system = random_system(random, {5, 2, 3}, 1.15, 7);
  EXPECT_EQ(system.dimensions(), (kfstab::Dimensions{5, 2, 3}));
  EXPECT_EQ(system.steps, 7);
  // 18 bits after the point move the entries of A by 2^-19, its eigenvalues by no more than some n times that here.
  EXPECT_NEAR(kfstab::reference::spectral_radius(system.A.matrices.front()), 1.15, 1e-4);
  EXPECT_EQ(round_to(system.C.matrices.front(), 18), system.C.matrices.front());
}

TEST(ProblemOf, AClaimsOwnSystemThatDoesNotFitIsAFault) {
  const Matrix<double> I = Matrix<double>::Identity(1, 1), zero = Matrix<double>::Zero(1, 1);
  EXPECT_THROW(problem_of(system_of("singular", zero, I, I, I, I, 1), Parametrisation::information), std::logic_error);
}

TEST(ColorOf, EachFilterHasItsOwn) {
  std::set<int> slots;
  for (const Metadata* metadata : select_filters("")) slots.insert(color_of(metadata->id));
  EXPECT_EQ(slots.size(), select_filters("").size());
  EXPECT_GE(*slots.begin(), 0);
  EXPECT_EQ(color_of("no-such-filter"), -1);
}
