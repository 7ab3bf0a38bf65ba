#include <kfstab/properties/generators.hpp>

#include <cmath>
#include <map>
#include <set>

#include <rapidcheck/Random.h>
#include <rapidcheck/shrinkable/Operations.h>

#include <kfstab/properties/precise.hpp>
#include <kfstab/reference/definiteness.hpp>
#include <kfstab/reference/steady_state.hpp>

#include "systems.hpp"

namespace kfstab::properties::testing {
namespace {

bool diagonal(const Covariance& Q) {
  return std::ranges::all_of(Q.value.matrices, [](const Matrix<double>& X) { return X.isDiagonal(0); });
}

double smallest_singular_value(const Matrix<double>& X) {
  const auto inverse = Precise(X).inverse();
  return inverse ? 1 / reference::two_norm(inverse->rounded()) : 0;
}

// The generator makes singular matrices in double, so they are singular to rounding.
bool singular(const Matrix<double>& X) {
  return X.rows() > 0 && !(smallest_singular_value(X) > 1e-14 * reference::two_norm(X));
}

TEST(Generator, DrawsEveryClassOfSystem) {
  std::map<std::string, int> seen;
  const int cases = 1000;
  for (int i = 0; i < cases; ++i) {
    const System system = drawn_system(systems(), 1, i, cases);
    const auto [n, m, p] = system.dimensions();
    const auto count = [&seen](const std::string& name, bool is) { seen[name] += is; };
    count("p < n", p < n);
    count("p = n", p == n);
    count("p > n", p > n);
    count("p = 0", p == 0);
    count("m = 0", m == 0);
    count("n = 1", n == 1);
    count("n = 6", n == 6);
    count("one step", system.steps == 1);
    count("12 steps", system.steps == 12);
    count("correlated Q", !diagonal(system.Q));
    count("correlated R", !diagonal(system.R));
    count("diagonal R", diagonal(system.R) && p > 1);
    count("singular Q", singular(system.Q.value.at(0)));
    count("singular P0", singular(system.P0.value.at(0)));
    count("singular A", singular(system.A.at(0)));
    count("unstable A", reference::spectral_radius(system.A.at(0)) > 1.01);
    count("stable A", reference::spectral_radius(system.A.at(0)) < 0.99);
    count("periodic", system.A.kind == Sequence::Kind::periodic);
    count("listed", system.C.kind == Sequence::Kind::list);
    count("time-invariant", system.time_invariant());
    count("Q as a root", system.Q.written == Covariance::Written::root);
    count("R as a covariance", system.R.written == Covariance::Written::covariance);
    const double largest = reference::two_norm(system.A.at(0)), smallest = smallest_singular_value(system.A.at(0));
    count("k(A) > 1e3", n > 1 && largest > 1e3 * smallest);
    count("k(A) < 10", n > 1 && largest < 10 * smallest);
  }
  for (const auto& [name, count] : seen) EXPECT_GE(count, cases / 100) << name;
  EXPECT_EQ(seen.size(), 24U);
}

TEST(Generator, WhatItDrawsIsValid) {
  for (int i = 0; i < 400; ++i) {
    const System system = drawn_system(systems(), 2, i, 400);
    SCOPED_TRACE(i);
    expect_same(read_toml(write_system(system)), system);  // the reader refuses whatever is not
    for (const Matrix<double>& R : system.R.value.matrices) EXPECT_FALSE(singular(R));
  }
}

TEST(Generator, KeepsToItsOptions) {
  Options options;
  options.n = {2, 3};
  options.m = {1, 1};
  options.p = {0, 2};
  options.most_steps = 4;
  options.time_varying = options.singular = false;
  options.worst_condition = 1;
  std::set<Index> n, p;
  for (int i = 0; i < 300; ++i) {
    const System system = drawn_system(systems(options), 3, i, 300);
    n.insert(system.A.rows());
    p.insert(system.C.rows());
    EXPECT_EQ(system.B.cols(), 1);
    EXPECT_LE(system.steps, 4);
    EXPECT_TRUE(system.time_invariant());
    EXPECT_FALSE(singular(system.P0.value.at(0)));
    EXPECT_LT(reference::two_norm(system.A.at(0)), 1.26);
  }
  EXPECT_EQ(n, (std::set<Index>{2, 3}));
  EXPECT_EQ(p, (std::set<Index>{0, 1, 2}));
}

TEST(Generator, IsDeterministicAndDeafToTheEnvironment) {
  expect_same(drawn_system(systems(), 4, 77, 100), drawn_system(systems(), 4, 77, 100));
  const System before = drawn_system(systems(), 4, 50, 100);
  setenv("RC_PARAMS", "seed=1 max_size=1", 1);
  expect_same(drawn_system(systems(), 4, 50, 100), before);
  unsetenv("RC_PARAMS");
}

TEST(Shrinking, OfAnySystemEndsAtTheSmallest) {
  for (const int number : {0, 20, 50, 99}) {
    const auto everything = smallest_failure(systems(), [](const System&) { return true; }, static_cast<std::uint64_t>(number) + 10, 1);
    ASSERT_TRUE(everything);
    EXPECT_EQ(everything->system.dimensions(), (Dimensions{1, 0, 0}));
    EXPECT_EQ(everything->system.steps, 1);
    EXPECT_EQ(everything->system.A.at(0)(0, 0), 0);
    EXPECT_EQ(everything->system.P0.value.at(0)(0, 0), 0);
  }
}

TEST(Shrinking, EveryShrinkIsValidAndDifferent) {
  for (int number = 0; number < 40; ++number) {
    const auto drawn = systems()(rc::Random(static_cast<std::uint64_t>(number)), 40);
    const std::string whole = write_system(drawn.value());
    auto shrinks = drawn.shrinks();
    int count = 0;
    while (const auto shrink = shrinks.next()) {
      const std::string text = write_system(shrink->value());
      EXPECT_NE(text, whole);
      EXPECT_NO_THROW(read_toml(text)) << text;
      ++count;
    }
    EXPECT_GT(count, 0);
  }
}

TEST(Shrinking, KeepsWhatTheFailureNeeds) {
  // Fails if an entry of A off the diagonal is above 1/2 and two outputs are correlated.
  const auto fails = [](const System& system) {
    const Matrix<double>& A = system.A.at(0);
    const auto converted = problem(system, Parametrisation::covariance);
    const auto& R = std::get<Problem<CovarianceModel<double>>>(std::get<AnyProblem<double>>(converted)).models[0].R;
    return A.rows() > 1 && A(0, 1) > 0.5 && R.rows() > 1 && R(0, 1) != 0;
  };
  const auto found = smallest_failure(systems(), fails, 5, 200);
  ASSERT_TRUE(found);
  EXPECT_TRUE(fails(found->system));
  EXPECT_TRUE(fails(found->drawn));
  EXPECT_EQ(found->system.dimensions(), (Dimensions{2, 0, 2}));
  EXPECT_EQ(found->system.steps, 1);
  EXPECT_EQ(found->system.A.at(0), (Matrix<double>(2, 2) << 0, 1, 0, 0).finished());
  EXPECT_EQ(found->system.R.value.at(0), (Matrix<double>(2, 2) << 1, 0, 1, 1).finished());
  const auto again = smallest_failure(systems(), fails, 5, 200);
  expect_same(again->system, found->system);
  EXPECT_EQ(again->number, found->number);
  EXPECT_EQ(again->shrinks, found->shrinks);
}

TEST(Shrinking, FindsNothingWhereNothingFails) {
  EXPECT_FALSE(smallest_failure(systems(), [](const System&) { return false; }, 6, 100));
}

}  // namespace
}  // namespace kfstab::properties::testing
