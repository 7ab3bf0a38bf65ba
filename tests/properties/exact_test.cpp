#include <kfstab/properties/exact.hpp>

#include <cmath>

#include <kfstab/properties/data.hpp>
#include <kfstab/properties/expression.hpp>

#include "systems.hpp"

namespace kfstab::properties::testing {
namespace {

using reference::ExactProblem;
using reference::Rational;

Rational fraction(const char* text) { return Rational(text); }

TEST(Exact, ReadsDecimalsAndFractions) {
  const std::vector<std::pair<const char*, const char*>> cases = {{"0", "0"},
                                                                  {"-0", "0"},
                                                                  {"7", "7"},
                                                                  {"007", "7"},
                                                                  {"0.1", "1/10"},
                                                                  {"-2.5E+3", "-2500"},
                                                                  {".5", "1/2"},
                                                                  {"5.", "5"},
                                                                  {"+1e0", "1"},
                                                                  {"010e-1", "1"},
                                                                  {"1/3", "1/3"},
                                                                  {" 2 / 6 ", "1/3"},
                                                                  {"-7/2e3", "-7/2000"},
                                                                  {"0.1/.3", "1/3"},
                                                                  {"1/-4", "-1/4"},
                                                                  {"1e-5", "1/100000"},
                                                                  {"0e0005", "0"}};
  for (const auto& [text, value] : cases) {
    SCOPED_TRACE(text);
    ASSERT_TRUE(read_exact(text));
    EXPECT_EQ(*read_exact(text), fraction(value));
  }
  EXPECT_EQ(*read_exact("1e-10000") * *read_exact("1e10000"), 1);
}

TEST(Exact, WhatIsNoNumberIsNone) {
  for (const char* text : {"",     " ",   "q",   "1/q", "1/3/2", "1+1", "2^-1", "--1", "1e",    "e5", ".",
                           "1..2", "1 2", "(1)", "1,2", "0x10",  "inf", "nan",  "1/0", "0/0.0", "1/"})
    EXPECT_FALSE(read_exact(text)) << text;
  EXPECT_FALSE(read_exact(std::string(5000, '1')));
  // An exponent that would fill the memory.
  EXPECT_THROW(read_exact("1e10001"), ExpressionError);
  EXPECT_THROW(read_exact("1e-999999999999999999999"), ExpressionError);
}

/// Every kind of entry, in every place that has entries.
const std::string everywhere = R"(
name = "everywhere"
steps = 2
A = { period = [[["1/3", "q/3"], [0, "third"]], { identity = 2, scale = "1e-30" }] }
B = [["0.1"], [0.1]]
C = [["-7/3", "0.5"]]
D = [["1/7"], [1]]
Q_root = "0.3"
R = { list = ["0.1", 2] }
P0 = { diagonal = ["1e-30", 1] }
x0 = ["1/3", "d"]
measurements = ["2/3", 0.25]
inputs = [[0.1], ["0.1"]]
[parameters]
q = "0.1"
third = "1/3"
d = 0.1
)";

TEST(Exact, EntriesAreExactAndFiltersGetTheNearestDoubles) {
  const System system = read_toml(everywhere);
  EXPECT_EQ(system.A.at(0)(0, 0), 1.0 / 3);
  EXPECT_EQ(system.A.at(1)(1, 1), 1e-30);
  EXPECT_EQ(system.Q.value.at(0)(0, 0), 0.3);
  EXPECT_EQ(system.C.exact.size(), 1U) << "0.5 is a double";

  const ExactProblem problem = exact_problem(system);
  ASSERT_EQ(problem.models.size(), 2U);
  const auto &first = problem.models[0], &second = problem.models[1];
  EXPECT_EQ(first.A(0, 0), fraction("1/3"));
  EXPECT_EQ(first.A(0, 1), Rational(0.1 / 3)) << "an expression is computed in double";
  EXPECT_EQ(first.A(1, 1), fraction("1/3")) << "a parameter's name alone stands for what was written";
  EXPECT_EQ(second.A(0, 0), *read_exact("1e-30"));
  EXPECT_EQ(second.A(1, 1), *read_exact("1e-30"));
  EXPECT_EQ(second.A(1, 0), 0);
  for (const auto& model : problem.models) {
    EXPECT_EQ(model.B(0, 0), fraction("1/10"));
    EXPECT_EQ(model.B(1, 0), Rational(0.1)) << "a plain number is the double";
    EXPECT_EQ(model.C(0, 0), fraction("-7/3"));
    EXPECT_EQ(model.C(0, 1), fraction("1/2"));
    EXPECT_EQ(model.D(0, 0), fraction("1/7"));
    EXPECT_EQ(model.Q(0, 0), fraction("9/100")) << "the square of the root, not of its double";
  }
  EXPECT_EQ(first.R(0, 0), fraction("1/10"));
  EXPECT_EQ(second.R(0, 0), 2);
  EXPECT_EQ(problem.initial(0, 0), *read_exact("1e-30"));
  EXPECT_EQ(problem.x0(0), fraction("1/3"));
  EXPECT_EQ(problem.x0(1), Rational(0.1));

  const auto data = exact_data(system);
  for (int twice = 0; twice < 2; ++twice) {
    const auto stream = data->open();
    const auto& step = stream->next();
    EXPECT_EQ(step.y(0), fraction("2/3"));
    EXPECT_EQ(step.u(0), Rational(0.1));
    stream->next();
    EXPECT_EQ(step.y(0), fraction("1/4"));
    EXPECT_EQ(step.u(0), fraction("1/10"));
  }
}

TEST(Exact, TheNearestDoubleNotAQuotientOfTwo) {
  // In double 0.1/0.3 is 0.33333333333333337: two roundings too many.
  EXPECT_NE(0.1 / 0.3, 1.0 / 3);
  EXPECT_EQ(read_toml(with(valid_toml(), "x0", "x0 = ['0.1/0.3', 0]")).x0(0), 1.0 / 3);
}

TEST(Exact, WithoutExactEntriesTheProblemIsThatOfTheDoubles) {
  const System system = read_toml(valid_toml());
  const ExactProblem exact = exact_problem(system);
  const auto written = std::get<Problem<CovarianceModel<double>>>(
      std::get<AnyProblem<double>>(problem(system, Parametrisation::covariance)));
  ASSERT_EQ(exact.models.size(), written.models.size());
  EXPECT_TRUE(exact.models[0].A == reference::rational(written.models[0].A));
  EXPECT_TRUE(exact.models[0].Q == reference::rational(written.models[0].Q));
  EXPECT_TRUE(exact.initial == reference::rational(written.initial));
  System without = system;
  without.data = nullptr;
  EXPECT_FALSE(exact_data(without));
}

TEST(Exact, SetValuesAreExactToo) {
  const System system = read_toml(valid_toml(), {{{"q", "1/3"}}, {}, {}});
  EXPECT_EQ(system.parameters.at("q"), 1.0 / 3);
  EXPECT_EQ(exact_problem(system).models[0].Q(0, 0), fraction("1/3"));
}

TEST(Exact, SimulatedDataAreDoubles) {
  const System system = read_toml(with(valid_toml(), "measurements", "measurements = { simulate = { seed = 3 } }"));
  const auto doubles = system.data->open();
  const auto exact = exact_data(system)->open();
  for (int k = 0; k < 3; ++k) EXPECT_EQ(exact->next().y(0), Rational(doubles->next().y(0)));
}

TEST(Exact, AReplacedDoubleCountsAsItself) {
  System system = read_toml(everywhere);
  system.A.matrices[0](0, 0) = 2;
  system.B = Sequence(Matrix<double>(Matrix<double>::Ones(2, 1)));
  const ExactProblem problem = exact_problem(system);
  EXPECT_EQ(problem.models[0].A(0, 0), 2);
  EXPECT_EQ(problem.models[0].B(0, 0), 1);
  EXPECT_EQ(problem.models[0].A(1, 1), fraction("1/3"));
  EXPECT_NE(write_system(system).find("[2, 0.0333"), std::string::npos) << write_system(system);
}

TEST(Exact, WrittenSystemsReadBackExactly) {
  for (const std::string& toml :
       {everywhere, with(everywhere, "measurements", "measurements = { simulate = { seed = 3 } }")}) {
    const System system = read_toml(toml), again = read_toml(write_system(system));
    expect_same(again, system);
    EXPECT_EQ(again.A.exact, system.A.exact);
    EXPECT_EQ(again.exact_x0, system.exact_x0);
    const ExactProblem x = exact_problem(system), y = exact_problem(again);
    ASSERT_EQ(x.models.size(), y.models.size());
    for (std::size_t k = 0; k < x.models.size(); ++k) {
      EXPECT_TRUE(x.models[k].A == y.models[k].A);
      EXPECT_TRUE(x.models[k].B == y.models[k].B);
      EXPECT_TRUE(x.models[k].C == y.models[k].C);
      EXPECT_TRUE(x.models[k].D == y.models[k].D);
      EXPECT_TRUE(x.models[k].Q == y.models[k].Q);
      EXPECT_TRUE(x.models[k].R == y.models[k].R);
    }
    EXPECT_TRUE(x.initial == y.initial);
    EXPECT_TRUE(x.x0 == y.x0);
    const auto left = exact_data(system)->open(), right = exact_data(again)->open();
    for (std::int64_t k = 0; k < system.steps; ++k) {
      const auto &a = left->next(), &b = right->next();
      EXPECT_TRUE(a.y == b.y);
      EXPECT_TRUE(a.u == b.u);
    }
  }
}

TEST(Exact, JsonHasThemToo) {
  const System system =
      read_system_text(R"({"name": "j", "steps": 1, "A": "1/3", "B": 1, "C": "1e-30", "Q": 1, "R": 1, "P0": 1})",
                       Format::json, "j.json");
  EXPECT_EQ(exact_problem(system).models[0].A(0, 0), fraction("1/3"));
}

void expect_refused(const std::string& key, const std::string& line, const std::vector<std::string>& parts) {
  SCOPED_TRACE(line);
  try {
    read_toml(with(valid_toml(), key, line));
    FAIL() << "was accepted";
  } catch (const InputError& error) {
    for (const std::string& part : parts)
      EXPECT_NE(std::string(error.what()).find(part), std::string::npos)
          << '"' << part << "\" is not in: " << error.what();
  }
}

TEST(Exact, RubbishIsRefused) {
  expect_refused("x0", "x0 = ['1/0', 0]", {"cart.toml:8:", "x0[0]", "divides by zero"});
  expect_refused("x0", "x0 = ['1e309', 0]", {"x0[0]", "\"1e309\", which is beyond the range of double"});
  expect_refused("x0", "x0 = ['-1e300/1e-300', 0]", {"x0[0]", "beyond the range of double"});
  expect_refused("x0", "x0 = ['1e-400', 0]", {"x0[0]", "\"1e-400\", which is not 0"});
  expect_refused("x0", "x0 = ['1e-99999', 0]", {"x0[0]", "beyond -10000"});
  expect_refused("q", "q = '1e-400'", {"parameters.q", "which is not 0"});
  // Of equal doubles, by their exact values.
  expect_refused("P0", "P0 = [[2, '1/3'], [0.3333333333333333, 1]]",
                 {"cart.toml:7:", "P0[1,0]", "/18014398509481984 exactly", "1/3 exactly", "symmetric"});
  expect_refused("P0", "P0 = [[1, 1], [1, '0.99999999999999999999']]",
                 {"cart.toml:7:", "P0", "negative eigenvalue", "exact"});
  expect_refused("P0", "P0 = [['1/9', '1/3'], ['1/3', '0.99999999999999999999']]", {"P0", "negative eigenvalue"});
  expect_refused("P0", "P0 = [['0.1', '0.2'], ['0.2', '0.39']]", {"P0", "semidefinite"});
}

TEST(Exact, SingularCovariancesAreCovariances) {
  EXPECT_NO_THROW(read_toml(with(valid_toml(), "P0", "P0 = [['1/9', '1/3'], ['1/3', 1]]")));
  EXPECT_NO_THROW(read_toml(with(valid_toml(), "P0", "P0 = [[0, 0], [0, '1e-30']]")));
  // 0.01 and 0.1 are rounded: what they leave of definiteness is not for the exact 1/1000 to decide.
  EXPECT_NO_THROW(read_toml(with(valid_toml(), "P0", "P0 = [['0.001', 0.01], [0.01, 0.1]]")));
}

TEST(Exact, WrittenExactlyIsWithoutARounding) {
  const auto written = [](const std::string& entry) {
    return written_exactly(read_toml(with(valid_toml(), "Q", "Q = " + entry)).Q.value, 0);
  };
  EXPECT_TRUE(written("'0.1'"));
  EXPECT_TRUE(written("0.5"));
  EXPECT_TRUE(written("3"));
  EXPECT_FALSE(written("0.1"));
  EXPECT_FALSE(written("'0.1*q'"));
}

}  // namespace
}  // namespace kfstab::properties::testing
