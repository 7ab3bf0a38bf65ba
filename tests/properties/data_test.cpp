#include <kfstab/properties/data.hpp>

#include <boost/random/mersenne_twister.hpp>
#include <boost/random/normal_distribution.hpp>

#include <kfstab/properties/exact.hpp>
#include <kfstab/reference/exact_filter.hpp>

#include "systems.hpp"

namespace kfstab::properties::testing {
namespace {

const char* const simulated = R"(
name = "walk"
A = [[0.9, 0.1], [0, 0.5]]
B = [[1, 0], [0, 1]]
C = [[1, 0]]
D = [[0], [1]]
Q = [[2, 1], [1, 1]]
R = 0.25
P0 = [[4, 1], [1, 1]]
x0 = [3, -3]
steps = 3
measurements = { simulate = { seed = 7 } }
inputs = [1, 0, 2]
)";

TEST(Simulated, TheSameSeedGivesTheSameNumbers) {
  const System system = read_toml(simulated);
  const auto first = system.data->open(), second = system.data->open();
  for (int k = 0; k < 3; ++k) {
    const StepData& a = first->next();
    const StepData& b = second->next();
    EXPECT_EQ(a.y, b.y);
    EXPECT_EQ(a.u, b.u);
  }
  EXPECT_THROW(first->next(), std::out_of_range);  // there are no more inputs
  Overrides other;
  other.seed = 8;
  EXPECT_NE(read_toml(simulated, other).data->open()->next().y, system.data->open()->next().y);
  expect_same(read_toml(write_system(system)), system);
}

TEST(Simulated, TheVeryNumbers) {
  // In the order x_0, v_0, w_0, v_1: another generator, or another order of draws, would give other numbers.
  const System system = read_toml("name = 'one'\nA = 1\nB = 1\nC = 1\nQ = 1\nR = 1\nP0 = 1\nsteps = 2\nmeasurements = {simulate = {seed = 1}}\n");
  boost::random::mt19937_64 engine(1);
  boost::random::normal_distribution<double> normal;
  const double x0 = normal(engine), v0 = normal(engine), w0 = normal(engine), v1 = normal(engine);
  const auto stream = system.data->open();
  EXPECT_EQ(stream->next().y(0), x0 + v0);
  EXPECT_EQ(stream->next().y(0), x0 + w0 + v1);
}

TEST(Simulated, HasTheMomentsOfTheModel) {
  // y_k of a stationary walk: A = 1/2, Q = 3/4, P0 = 1 is its stationary variance; R = 1/4.
  const System system = read_toml("name = 'one'\nA = 0.5\nB = 1\nC = 1\nQ = 0.75\nR = 0.25\nP0 = 1\nsteps = 1\nmeasurements = {simulate = {seed = 3}}\n");
  const auto stream = system.data->open();
  const int steps = 200000;
  double sum = 0, squares = 0, lagged = 0, last = 0;
  for (int k = 0; k < steps; ++k) {
    const double y = stream->next().y(0);
    sum += y;
    squares += y * y;
    lagged += y * last;
    last = y;
  }
  EXPECT_NEAR(sum / steps, 0, 0.02);
  EXPECT_NEAR(squares / steps, 1.25, 0.03);
  EXPECT_NEAR(lagged / steps, 0.5, 0.03);

  // Over seeds: the start has mean x0 and covariance P0.
  double mean = 0, variance = 0;
  for (std::uint64_t seed = 0; seed < 4000; ++seed) {
    Overrides with_seed;
    with_seed.seed = seed;
    const double y = read_toml(simulated, with_seed).data->open()->next().y(0) - 3;
    mean += y / 4000;
    variance += y * y / 4000;
  }
  EXPECT_NEAR(mean, 0, 0.15);
  EXPECT_NEAR(variance, 4.25, 0.4);
}

TEST(Simulated, HoldsOneStepHoweverMany) {
  const System system = read_toml("name = 'one'\nA = 0.5\nB = 1\nC = 1\nQ = 0.75\nR = 0.25\nP0 = 1\nsteps = 10000000\nmeasurements = {simulate = {seed = 3}}\n");
  EXPECT_EQ(system.steps, 10000000);
  const auto stream = system.data->open();
  const double* where = stream->next().y.data();
  for (int k = 0; k < 1000; ++k) EXPECT_EQ(stream->next().y.data(), where);
}

TEST(Simulated, WithoutMeasurementsOrNoise) {
  System system = read_toml("name = 'one'\nA = 0.5\nB = [[]]\nC = []\nQ = []\nR = []\nP0 = 1\nsteps = 3\n");
  system.data = std::make_shared<Simulated>(system, 1);
  EXPECT_EQ(system.data->open()->next().y.size(), 0);
  system = read_toml("name = 'one'\nA = 0.5\nB = [[]]\nC = 1\nQ = []\nR = 0\nP0 = 0\nx0 = 8\nsteps = 3\n");
  const auto stream = Simulated(system, 1).open();
  EXPECT_EQ(stream->next().y(0), 8);
  EXPECT_EQ(stream->next().y(0), 4);
  system.R.value = Sequence(Matrix<double>(Matrix<double>::Constant(1, 1, -1)));
  EXPECT_THROW(Simulated(system, 1), std::invalid_argument);
}

TEST(Recorded, BringsColumnAfterColumn) {
  const Recorded data((Matrix<double>(1, 2) << 1, 2).finished(), Matrix<double>(0, 0));
  const auto stream = data.open();
  EXPECT_EQ(stream->next().y(0), 1);
  EXPECT_EQ(stream->next().y(0), 2);
  EXPECT_THROW(stream->next(), std::out_of_range);
  EXPECT_EQ(data.open()->next().u.size(), 0);
}

// --- missing measurements -----------------------------------------------------------------------------------------------

/// n = 2, m = 1, p = 3, three steps: the first has all, the second the entries 0 and 2, the third none.
System with_gaps(const std::string& R) {
  return read_toml(
      "name = 'gaps'\nA = [[1, 0.5], [0, 0.75]]\nB = [[0], [1]]\nC = [[1, 0], [1, 1], ['1/3', 0]]\nQ = 0.5\n" + R +
      "\nP0 = {diagonal = [2, 1]}\nx0 = [1, -1]\nsteps = 3\n"
      "measurements = [[1, 2, 3], [1, 'missing', '1/3'], ['missing', 'missing', 'missing']]\n");
}

TEST(MissingMeasurements, TellNothing) {
  const System system = with_gaps("R = [[1, 0.5, 0.25], [0.5, 1, 0.125], [0.25, 0.125, 1]]");
  EXPECT_TRUE(measurements_missing(system));
  const System complete = with_every_measurement(system);
  EXPECT_FALSE(measurements_missing(complete));
  EXPECT_EQ(complete.C.at(0), system.C.at(0));
  EXPECT_EQ(complete.R.value.at(0), system.R.value.at(0));

  // The same in exact numbers as the system whose second step has two outputs and whose third has none.
  const auto all = exact_problem(complete);
  const auto data = exact_data(complete);
  reference::ExactFilter filter(all, data);
  filter.advance();
  filter.advance();
  System two = system;
  two.A = two.A.at(0);
  two.C = Sequence((Matrix<double>(2, 2) << 1, 0, system.C.at(0)(2, 0), 0).finished());
  two.C.exact = {{0, 1, 0, "1/3"}};
  two.R.value = Sequence((Matrix<double>(2, 2) << 1, 0.25, 0.25, 1).finished());
  two.steps = 1;
  two.data = std::make_shared<Recorded>((Matrix<double>(2, 1) << 1, 1.0 / 3).finished(), Matrix<double>(0, 1),
                                        std::vector<ExactEntry>{{0, 1, 0, "1/3"}});
  auto second = exact_problem(two);
  second.initial = filter.step().P_predicted;
  second.x0 = filter.step().x_predicted;
  reference::ExactFilter alone(second, exact_data(two));
  alone.advance();
  EXPECT_EQ(filter.step().P_filtered, alone.step().P_filtered);
  EXPECT_EQ(filter.step().x_filtered, alone.step().x_filtered);
  EXPECT_EQ(filter.step().predictor_gain.col(0), alone.step().predictor_gain.col(0));
  EXPECT_EQ(filter.step().predictor_gain.col(1), (Matrix<reference::Rational>::Zero(2, 1)));
  filter.advance();
  EXPECT_EQ(filter.step().P_filtered, filter.step().P_predicted);
  EXPECT_EQ(filter.step().x_filtered, filter.step().x_predicted);
}

TEST(MissingMeasurements, ARootStaysOneWhereItCan) {
  // Entry 1 is missing in the second step: row 2 may not hang on it.
  const System kept = with_every_measurement(with_gaps("R_root = [[1, 0, 0], [2, 2, 0], [4, 0, 1]]"));
  EXPECT_EQ(kept.R.written, Covariance::Written::root);
  EXPECT_EQ(kept.R.value.at(0), (Matrix<double>(3, 3) << 1, 0, 0, 2, 2, 0, 4, 0, 1).finished());
  EXPECT_EQ(kept.R.value.at(1), (Matrix<double>(3, 3) << 1, 0, 0, 0, 2, 0, 4, 0, 1).finished());
  EXPECT_EQ(kept.R.value.at(2), (Matrix<double>(3, 3) << 1, 0, 0, 0, 2, 0, 0, 0, 1).finished());
  const System lost = with_every_measurement(with_gaps("R_root = [[1, 0, 0], [2, 1, 0], [4, 8, 1]]"));
  EXPECT_EQ(lost.R.written, Covariance::Written::covariance);
  EXPECT_EQ(lost.R.value.at(0), (Matrix<double>(3, 3) << 1, 2, 4, 2, 5, 16, 4, 16, 81).finished());
  EXPECT_EQ(lost.R.value.at(1), (Matrix<double>(3, 3) << 1, 0, 4, 0, 5, 0, 4, 0, 81).finished());
  EXPECT_EQ(lost.R.value.at(2), (Matrix<double>(3, 3) << 1, 0, 0, 0, 5, 0, 0, 0, 81).finished());
}

TEST(MissingMeasurements, AreAskedForWithinTheStepsOnly) {
  System system = with_gaps("R = {identity = 3}");
  system.steps = 1;
  EXPECT_FALSE(measurements_missing(system));
  system.data = nullptr;
  EXPECT_FALSE(measurements_missing(system));
}

TEST(MissingMeasurements, AreNotForAFilterThatRemembersItsModel) {
  Metadata filter;
  filter.id = "csrf";
  EXPECT_FALSE(refusal(filter, with_gaps("R = {identity = 3}")));
  filter.needs.time_invariant = true;
  EXPECT_EQ(refusal(filter, with_gaps("R = {identity = 3}"))->reason,
            "csrf needs a time-invariant system: measurements are missing, and C is another where they are");
}

}  // namespace
}  // namespace kfstab::properties::testing
