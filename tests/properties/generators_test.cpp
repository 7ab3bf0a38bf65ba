#include <kfstab/properties/generators.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <set>
#include <tuple>

#include <rapidcheck/Random.h>
#include <rapidcheck/shrinkable/Operations.h>

#include <kfstab/properties/data.hpp>
#include <kfstab/properties/precise.hpp>
#include <kfstab/reference/definiteness.hpp>
#include <kfstab/reference/steady_state.hpp>

#include "systems.hpp"

namespace kfstab::properties::testing {
namespace {

double smallest_singular_value(const Matrix<double>& X) {
  const auto inverse = Precise(X).inverse();
  return inverse ? 1 / reference::two_norm(inverse->rounded()) : 0;
}

// The generator makes singular matrices in double, so they are singular to rounding.
bool singular(const Matrix<double>& X) {
  return X.rows() > 0 && !(smallest_singular_value(X) > 1e-14 * reference::two_norm(X));
}

/// System k of the whole ranges, where sizes are uniform.
System whole(const Options& options, std::uint64_t k) { return systems(options)(rc::Random(k), 100).value(); }

/// How often something is so, among systems of which something else is.
struct Share {
  std::string name;
  double expected;
  std::function<bool(const System&, const std::set<std::string>&)> is, among;
  int count = 0, all = 0;
};

/// Each share within 6 sigma of a binomial.
void expect_shares(const Options& options, int cases, std::vector<Share> shares) {
  for (int k = 0; k < cases; ++k) {
    const System system = whole(options, static_cast<std::uint64_t>(k));
    const auto names = classes(system);
    const std::set<std::string> of(names.begin(), names.end());
    EXPECT_EQ(of.size(), names.size());
    for (Share& share : shares) {
      if (share.among && !share.among(system, of)) continue;
      ++share.all;
      share.count += share.is(system, of);
    }
  }
  for (const Share& share : shares) {
    ASSERT_GT(share.all, 0) << share.name;
    const double q = share.expected, sigma = std::sqrt(share.all * q * (1 - q));
    EXPECT_NEAR(share.count, share.all * q, 6 * sigma) << share.name << ", of " << share.all;
  }
}

/// A class named by classes().
std::function<bool(const System&, const std::set<std::string>&)> of_class(const std::string& name) {
  return [name](const System&, const std::set<std::string>& of) { return of.contains(name); };
}

TEST(Generator, DrawsEveryClassAtItsShare) {
  using Classes = std::set<std::string>;
  const auto outputs = [](const System& s, const Classes&) { return s.C.rows() > 0; };
  const auto data_and_outputs = [](const System& s, const Classes&) { return s.data && s.C.rows() > 0; };
  const auto several = [](const System& s, const Classes&) { return s.A.rows() > 1; };
  const auto several_and_outputs = [](const System& s, const Classes&) { return s.A.rows() > 1 && s.C.rows() > 0; };
  const auto constant = [](const System& s, const Classes&) { return s.A.matrices.size() == 1; };
  const auto observed = [](const System& s, const Classes& of) {
    return s.A.rows() > 1 && s.C.rows() > 0 && !of.contains("partially observed");
  };
  // n is 1 to 6, m 0 to 4, p 0 to 6, all equally likely.
  std::vector<Share> shares = {
      {"n = 1", 1.0 / 6, of_class("n = 1"), {}},
      {"n = 2", 1.0 / 6, of_class("n = 2"), {}},
      {"n >= 3", 4.0 / 6, of_class("n >= 3"), {}},
      {"p < n", 21.0 / 42, of_class("p < n"), {}},
      {"p = n", 6.0 / 42, of_class("p = n"), {}},
      {"p > n", 15.0 / 42, of_class("p > n"), {}},
      {"p = 0", 1.0 / 7, of_class("p = 0"), {}},
      {"m = 0", 1.0 / 5, of_class("m = 0"), {}},
      {"m != n", 1 - 4.0 / 30, of_class("m != n"), {}},
      {"one step", 1.0 / 12, of_class("one step"), {}},
      // Each of six matrices in half of the quarter; D only where it is.
      {"time-varying, three steps and more", 0.25 * (1 - std::pow(0.5, 6)), of_class("time-varying"),
       [](const System& s, const Classes&) { return s.steps > 1 && s.inputs() > 0; }},
      {"data", 7.0 / 8, of_class("data"), {}},
      {"known input", 1.0 / 3, of_class("known input"), of_class("data")},
      {"x0 not 0", 3.0 / 4, of_class("x0 not 0"), {}},
      {"missing", 1.0 / 4, [](const System& s, const Classes&) { return measurements_missing(s); }, data_and_outputs},
      {"entries missing", 0, of_class("entries missing"),
       [](const System& s, const Classes&) { return s.data && s.C.rows() == 1; }},
      {"partially observed", 1.0 / 6, of_class("partially observed"), several_and_outputs},
      {"singular A", 1.0 / 6, of_class("singular A"), constant},
      {"non-symmetric A", 5.0 / 6, of_class("non-symmetric A"), observed},
      // Orthogonal ones, of a condition number of 1, are normal: of the worst of 1e2, 1e4, 1e8, 1e12 a half, a third,
      // a fifth, a seventh.
      {"non-normal A", 5.0 / 6 - 4.0 / 6 * (1.0 / 4 + 1.0 / 12 + 1.0 / 40 + 1.0 / 56), of_class("non-normal A"), observed},
      {"singular P0", 1.0 / 6, of_class("singular P0"), {}},
      {"singular Q", 1.0 / 6, of_class("singular Q"), [](const System& s, const Classes&) { return s.B.cols() > 0; }},
      {"correlated R", 2.0 / 3, of_class("correlated R"),
       [](const System& s, const Classes&) { return s.C.rows() > 1 && s.R.value.matrices.size() == 1; }},
  };
  expect_shares({}, 2000, std::move(shares));

  // What depends on a share of another kind is looked at without it.
  Options plain;
  plain.singular = plain.units = plain.time_varying = false;
  expect_shares(plain, 800,
                {{"unstable A", 1.0 / 4, of_class("unstable A"), {}},
                 {"k >= 1e4", 1.0 / 2, of_class("k >= 1e4"), several},
                 {"k >= 1e8", 1.0 / 4, of_class("k >= 1e8"), several},
                 {"k >= 1e12", 1.0 / 8, of_class("k >= 1e12"), several},
                 {"a root of R", 1.0 / 2,
                  [](const System& s, const Classes&) { return s.R.written == Covariance::Written::root; }, outputs},
                 {"units far from 1", 0, of_class("units far from 1"), {}}});
}

TEST(Generator, LeavesOutStepsAndEntries) {
  std::ptrdiff_t steps = 0, entries = 0, far = 0;
  for (std::uint64_t k = 0; k < 1000; ++k) {
    const auto names = classes(whole({}, k));
    steps += std::ranges::count(names, "steps without measurement");
    entries += std::ranges::count(names, "entries missing");
    far += std::ranges::count(names, "units far from 1");
  }
  // Of each kind there are 1/8 of 7/8 of 6/7, of single entries hardly fewer; units are near 1 by chance in less than half.
  EXPECT_GT(steps, 60);
  EXPECT_GT(entries, 40);
  EXPECT_GT(far, 1000 / 16);
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
  options.time_varying = options.singular = options.data = options.units = false;
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
    EXPECT_FALSE(system.data);
    EXPECT_EQ(system.inputs(), 0);
    EXPECT_LT(reference::spectral_radius(system.A.at(0)), 1.26);
    const auto names = classes(system);
    for (const char* name : {"units far from 1", "k >= 1e4"}) EXPECT_EQ(std::ranges::count(names, name), 0) << name;
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

/// The first of some systems that fails, and what it shrinks to.
struct Found {
  System drawn, system;
  std::size_t shrinks = 0;
  int tried = 0;  ///< in shrinking
};

std::optional<Found> smallest_failure(const std::function<bool(const System&)>& fails, std::uint64_t seed, int cases,
                                      const Options& options = {}) {
  for (int number = 0; number < cases; ++number) {
    Found found;
    found.drawn = drawn_system(systems(options), seed, number, cases);
    if (!fails(found.drawn)) continue;
    std::tie(found.system, found.shrinks) = smallest_of(found.drawn, options, [&](const System& system) {
      ++found.tried;
      return fails(system);
    });
    return found;
  }
  return std::nullopt;
}

TEST(Shrinking, OfAnySystemEndsAtTheSmallest) {
  for (const int number : {0, 20, 50, 99}) {
    const auto everything =
        smallest_failure([](const System&) { return true; }, static_cast<std::uint64_t>(number) + 10, 1);
    ASSERT_TRUE(everything);
    EXPECT_EQ(everything->system.dimensions(), (Dimensions{1, 0, 0}));
    EXPECT_EQ(everything->system.steps, 1);
    EXPECT_EQ(everything->system.A.at(0)(0, 0), 0);
    EXPECT_EQ(everything->system.P0.value.at(0)(0, 0), 0);
    EXPECT_EQ(everything->system.x0(0), 0);
    EXPECT_EQ(everything->system.inputs(), 0);
    EXPECT_FALSE(everything->system.data);
    // Each edit is bold and of use: steps, data, time, p, m, n, and what is left of n = 1.
    EXPECT_LE(everything->tried, 30);
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
  const auto found = smallest_failure(fails, 5, 200);
  ASSERT_TRUE(found);
  EXPECT_TRUE(fails(found->system));
  EXPECT_TRUE(fails(found->drawn));
  EXPECT_EQ(found->system.dimensions(), (Dimensions{2, 0, 2}));
  EXPECT_EQ(found->system.steps, 1);
  EXPECT_EQ(found->system.A.at(0), (Matrix<double>(2, 2) << 0, 1, 0, 0).finished());
  EXPECT_EQ(found->system.R.value.at(0), (Matrix<double>(2, 2) << 1, 0, 1, 1).finished());
  const auto again = smallest_failure(fails, 5, 200);
  expect_same(again->system, found->system);
  EXPECT_EQ(again->shrinks, found->shrinks);
}

// A filter that takes u for missing, where y is: the smallest system has one of each.
TEST(Shrinking, KeepsTheDataThatTheFailureNeeds) {
  const auto fails = [](const System& system) {
    if (!system.data || system.inputs() == 0) return false;
    const auto stream = system.data->open();
    for (std::int64_t k = 0; k < system.steps; ++k) {
      const StepData& step = stream->next();
      if (step.y.hasNaN() && step.u(0) != 0) return true;
    }
    return false;
  };
  const auto found = smallest_failure(fails, 8, 200);
  ASSERT_TRUE(found);
  const System& system = found->system;
  EXPECT_EQ(system.dimensions(), (Dimensions{1, 0, 1})) << write_system(system);
  EXPECT_EQ(system.inputs(), 1);
  EXPECT_EQ(system.D.at(0)(0, 0), 0);
  ASSERT_TRUE(system.data);
  EXPECT_TRUE(fails(read_toml(write_system(system))));
  const auto stream = system.data->open();
  for (std::int64_t k = 0; k < system.steps; ++k) {
    const StepData& step = stream->next();
    EXPECT_TRUE(std::isnan(step.y(0)) || step.y(0) == 0);
    EXPECT_TRUE(step.u(0) == 0 || step.u(0) == 1);
  }
}

TEST(Shrinking, MissingIsNotSimple) {
  // Fails with data, whatever they are: nothing is missing in the end, and y is 0.
  const auto fails = [](const System& system) { return system.data && system.C.rows() > 0; };
  Options options;
  options.p = {1, 3};
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const auto found = smallest_failure(fails, seed, 50, options);
    ASSERT_TRUE(found);
    EXPECT_EQ(found->system.data->open()->next().y, Vector<double>::Zero(1));
  }
}

TEST(Irrelevant, IsWhatShrankAway) {
  System drawn = read_toml(
      "name = 'drawn'\nsteps = 3\nA = [[0.5, 1], [0, 0.5]]\nB = [[1], [2]]\nC = [[1, 0], [1, 1]]\nD = [[1], [1]]\n"
      "Q = 2\nR = [[2, 1], [1, 2]]\nP0 = {diagonal = [1, 2]}\nx0 = [1, 2]\n"
      "measurements = [[1, 2], ['missing', 1], [2, 2]]\ninputs = [1, 2, 3]\n");
  System smallest = read_toml("name = 'drawn'\nsteps = 1\nA = 1\nB = [[]]\nC = 1\nQ = []\nR = 2\nP0 = 1\n");
  using Words = std::vector<std::string>;
  EXPECT_EQ(irrelevant(drawn, smallest), (Words{"one step is enough", "one state is enough", "one output is enough",
                                                "B and Q do not matter", "no data needed"}));
  EXPECT_EQ(irrelevant(drawn, drawn), Words());
  EXPECT_EQ(irrelevant(smallest, smallest), Words());
  smallest = drawn;
  smallest.steps = 2;
  smallest.R.value = Sequence(Matrix<double>(Matrix<double>::Identity(2, 2)));
  smallest.A = Sequence(Matrix<double>(Matrix<double>::Zero(2, 2)));
  smallest.x0.setZero();
  smallest.D = Sequence(Matrix<double>(2, 0));
  smallest.data = std::make_shared<Recorded>(Matrix<double>::Zero(2, 2), Matrix<double>(0, 2));
  EXPECT_EQ(
      irrelevant(drawn, smallest),
      (Words{"2 of 3 steps are enough", "A does not matter", "correlations in R do not matter", "no known input needed",
             "x0 does not matter", "nothing need be missing", "the values of y do not matter"}));
}

}  // namespace
}  // namespace kfstab::properties::testing
