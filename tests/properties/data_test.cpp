#include <kfstab/properties/data.hpp>

#include <boost/random/mersenne_twister.hpp>
#include <boost/random/normal_distribution.hpp>

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

}  // namespace
}  // namespace kfstab::properties::testing
