#include <kfstab/experiments/reference_steps.hpp>

#include <algorithm>

#include "reference/support.hpp"
#include "reports/scratch.hpp"

#include <nlohmann/json.hpp>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/step_cache.hpp>
#include <kfstab/properties/exact.hpp>

namespace kfstab::experiments {
namespace {

using nlohmann::json;
using properties::System;
using reference::Rational;
using reference::testing::Wide;
using reference::testing::wide;

const std::string tracking = R"(
name = "tracking"
steps = 3
A = { period = [[[1, "1/3"], [0, "0.9"]], [[1, 0.1], [0, 1]]] }
B = [["1/18"], ["1/3"]]
C = [[1, 0], ["0.1", 1]]
D = [["-1/7"], [1]]
Q_root = "0.3"
R = [["0.1", "1/20"], ["1/20", 1]]
P0 = { identity = 2, scale = "1e5" }
x0 = ["2/3", 1]
measurements = [["1/3", 1], [2, 0.3], ["-0.1", 0]]
inputs = ["0.1", 0, 0.7]
)";

/// Two measurements that differ by 1e-30, with noise far below: nothing of it is left in double.
const std::string dyer = R"(
name = "dyer"
steps = 2
A = { identity = 3 }
B = [[], [], []]
C = [[1, 1, 1], [1, 1, "1.000000000000000000000000000001"]]
Q = []
R = { identity = 2, scale = "1e-60" }
P0 = { identity = 3 }
measurements = [["1/3", "0.1"], [2, 3]]
)";

System system_of(const std::string& text) {
  return properties::read_system_text(text, properties::Format::toml, "test");
}

std::vector<std::string> lines(const System& system, ReferenceRequest request = {}) {
  std::vector<std::string> taken;
  const auto outcome = reference_steps(system, request, [&](std::string_view line) { taken.emplace_back(line); });
  EXPECT_EQ(outcome.steps, static_cast<std::int64_t>(taken.size()));
  EXPECT_FALSE(outcome.error) << *outcome.error;
  EXPECT_FALSE(outcome.warning) << *outcome.warning;
  return taken;
}

Rational power_of_ten(long exponent) { return *properties::read_exact("1e" + std::to_string(exponent)); }

/// One unit in the last place that the text has.
Rational last_place(const std::string& text) {
  const std::size_t e = std::min(text.find('e'), text.size()), point = std::min(text.find('.'), e);
  const long exponent = e == text.size() ? 0 : std::stol(text.substr(e + 1));
  return power_of_ten(exponent - static_cast<long>(point == e ? 0 : e - point - 1));
}

std::size_t digits(const std::string& text) {
  const std::string mantissa = text.substr(0, text.find('e'));
  const std::size_t first = mantissa.find_first_of("123456789");
  return first == std::string::npos
             ? 0
             : static_cast<std::size_t>(std::count_if(mantissa.begin() + static_cast<long>(first), mantissa.end(),
                                                      [](char c) { return c != '.'; }));
}

/// What is printed may be off by a unit in its last place: half of one by rounding there, half by what was certified.
void expect_right(const json& entry, const Rational& truth, std::size_t most, const std::string& what) {
  const std::string text = entry.get<std::string>();
  ASSERT_TRUE(properties::read_exact(text)) << what << ": " << text;
  EXPECT_LE(abs(Rational(*properties::read_exact(text) - truth)), text == "0" ? Rational(0) : last_place(text))
      << what << ": " << text << " for " << truth;
  EXPECT_LE(digits(text), most) << what;
  EXPECT_TRUE(truth == 0 || digits(text) > 0) << what << ": " << text;
}
void expect_right(const json& entries, const Matrix<Rational>& truth, std::size_t most, const std::string& what) {
  ASSERT_EQ(entries.size(), static_cast<std::size_t>(truth.rows())) << what;
  for (Index i = 0; i < truth.rows(); ++i) {
    const json& row = entries[static_cast<std::size_t>(i)];
    ASSERT_EQ(row.size(), static_cast<std::size_t>(truth.cols())) << what;
    for (Index j = 0; j < truth.cols(); ++j)
      expect_right(row[static_cast<std::size_t>(j)], truth(i, j), most,
                   what + "[" + std::to_string(i) + "," + std::to_string(j) + "]");
  }
}

/// The exact filter beside each line.
void expect_all_right(const System& system, int most) {
  const auto data = properties::exact_data(system);
  reference::ExactFilter filter(properties::exact_problem(system), data);
  const auto asked = static_cast<std::size_t>(most);
  std::int64_t k = 0;
  for (const std::string& text : lines(system, {.digits = most, .cache = {}, .progress = {}})) {
    const json line = json::parse(text);
    filter.advance();
    const reference::ExactStep& step = filter.step();
    const std::string at = system.name + " k = " + std::to_string(k) + " ";
    EXPECT_EQ(line["k"], k);
    EXPECT_GE(line["certified_digits"].get<int>(), most);
    expect_right(line["P"], step.P_predicted, asked, at + "P");
    expect_right(line["P_filtered"], step.P_filtered, asked, at + "P_filtered");
    expect_right(line["K"], step.predictor_gain, asked, at + "K");
    expect_right(line["Re"], step.innovation, asked, at + "Re");
    if (data) {
      for (Index i = 0; i < step.x_predicted.size(); ++i)
        expect_right(line["x"][static_cast<std::size_t>(i)], step.x_predicted(i), asked, at + "x");
      const std::string printed = line["log_likelihood"];
      EXPECT_LE(abs(Wide(wide(*properties::read_exact(printed)) - reference::testing::log_likelihood(step))),
                wide(last_place(printed)))
          << at << printed;
      EXPECT_EQ(digits(printed), asked) << at << printed;
    } else {
      EXPECT_FALSE(line.contains("x") || line.contains("log_likelihood") || line.contains("y")) << text;
    }
    ++k;
  }
  EXPECT_EQ(k, system.steps);
}

TEST(ReferenceSteps, MissingMeasurementsAreSaidToBe) {
  const std::string gaps =
      "name = 'gaps'\nsteps = 3\nA = 2\nB = 1\nC = [[1], [1]]\nQ = 1\nR = {diagonal = [1, 3]}\nP0 = 1\n"
      "measurements = [[1, 2], ['missing', 2], ['missing', 'missing']]\n";
  const auto all = lines(system_of(gaps), {.digits = 10, .cache = {}, .progress = {}});
  ASSERT_EQ(all.size(), 3U);
  const json first = json::parse(all[0]), second = json::parse(all[1]), third = json::parse(all[2]);
  EXPECT_EQ(first["y"], json::array({"1", "2"}));
  EXPECT_TRUE(first.contains("log_likelihood"));
  EXPECT_EQ(second["y"], json::array({"missing", "2"}));
  EXPECT_FALSE(second.contains("log_likelihood"));
  EXPECT_EQ(second["K"][0][0], "0");
  EXPECT_EQ(third["y"], json::array({"missing", "missing"}));
  EXPECT_EQ(third["P"], third["P_filtered"]);
}

TEST(ReferenceSteps, EveryPrintedDigitIsRight) {
  for (const int most : {1, 17, 60}) {
    expect_all_right(system_of(tracking), most);
    expect_all_right(system_of(dyer), most);
    expect_all_right(find_system("slicot-fb01qd"), most);
    expect_all_right(find_system("local-level", {{}, 5, {}}), most);
    expect_all_right(find_system("rotation", {{}, 6, {}}), most);
  }
}

TEST(ReferenceSteps, DataStandBesideThem) {
  const json line = json::parse(lines(system_of(tracking)).front());
  EXPECT_EQ(line["y"], json({"1/3", "1"}));
  EXPECT_EQ(line["u"], json({"1/10"}));
  EXPECT_EQ(json::parse(lines(system_of(tracking)).back())["u"], json({"0.7"}));
}

TEST(ReferenceSteps, WithoutOutputsThereIsNoGain) {
  const auto taken = lines(system_of("name = 'a'\nsteps = 1\nA = 2\nB = 1\nC = []\nQ = '1/3'\nR = []\nP0 = 1\n"));
  ASSERT_EQ(taken.size(), 1u);
  const json line = json::parse(taken[0]);
  EXPECT_EQ(line["Re"], json::array());
  EXPECT_EQ(line["K"], json::array({json::array()}));
  EXPECT_EQ(line["P"], json::array({json::array({"1.00000000000000000000000000000"})}));
}

TEST(ReferenceSteps, AnErrorEndsThemAndIsNamed) {
  // What step 0 leaves is certain, and step 1 measures it without noise.
  const System system =
      system_of("name = 'a'\nsteps = 3\nA = 0\nB = [[]]\nC = 1\nQ = []\nR = { list = [1, 0, 1] }\nP0 = '1/3'\n");
  std::vector<std::string> taken;
  const auto outcome = reference_steps(system, {}, [&](std::string_view line) { taken.emplace_back(line); });
  EXPECT_EQ(taken.size(), 1u);
  EXPECT_EQ(outcome.steps, 1);
  EXPECT_FALSE(outcome.interrupted);
  ASSERT_TRUE(outcome.error);
  EXPECT_NE(outcome.error->find("step 1"), std::string::npos) << *outcome.error;
  EXPECT_NE(outcome.error->find("positive definite"), std::string::npos) << *outcome.error;
}

class CachedSteps : public ScratchFolder {
 protected:
  ReferenceRequest request(int most = 30) const { return {most, (folder / "cache").string(), {}}; }
  std::filesystem::path only_file() const { return std::filesystem::directory_iterator(folder / "cache")->path(); }
};

TEST_F(CachedSteps, AHitGivesTheSameLines) {
  const System system = system_of(tracking);
  const auto computed = lines(system);
  EXPECT_EQ(lines(system, request()), computed);
  EXPECT_EQ(entries(folder / "cache"), 1u);
  EXPECT_EQ(lines(system, request()), computed);
  EXPECT_EQ(entries(folder / "cache"), 1u);
  // That it was a hit shows where something else was planted.
  StepCache::Entry planted(StepCache(folder / "cache"), only_file().stem().string());
  planted.add("planted");
  planted.commit();
  EXPECT_EQ(lines(system, request()), std::vector<std::string>{"planted"});
}

TEST_F(CachedSteps, ATornFileIsComputedAgainAndReplaced) {
  const System system = system_of(tracking);
  const auto computed = lines(system, request());
  const auto file = only_file();
  const std::string whole = read(file);
  for (const std::string& spoilt : {whole.substr(0, whole.size() / 2), std::string(), std::string("rubbish\n")}) {
    put(file, spoilt);
    EXPECT_EQ(lines(system, request()), computed);
    EXPECT_EQ(read(file), whole);
  }
  EXPECT_EQ(entries(folder / "cache"), 1u);
}

TEST_F(CachedSteps, WhateverChangesTheNumbersIsAnotherEntry) {
  lines(system_of(tracking), request());
  std::size_t expected = 1;
  const auto expect_another = [&](const System& system, int most = 30) {
    lines(system, request(most));
    EXPECT_EQ(entries(folder / "cache"), ++expected);
  };
  // Equal as doubles, all of them; not as numbers.
  for (const auto& [old, changed] :
       std::vector<std::pair<std::string, std::string>>{{"\"0.9\"", "0.9"},
                                                        {"[[\"1/18\"]", "[[0.05555555555555555]"},
                                                        {"[\"0.1\", 1]]", "[0.1, 1]]"},
                                                        {"\"-1/7\"", "\"-1.000000000000000000001/7\""},
                                                        {"Q_root = \"0.3\"", "Q_root = 0.3"},
                                                        {"\"1/20\"", "0.05"},
                                                        {"\"1e5\"", "\"1.00000000000000000001e5\""},
                                                        {"\"2/3\"", "\"2.00000000000000000001/3\""},
                                                        {"\"-0.1\"", "-0.1"},
                                                        {"inputs = [\"0.1\"", "inputs = [0.1"}}) {
    std::string text = tracking;
    for (std::size_t at = 0; (at = text.find(old, at)) != text.npos; at += changed.size())
      text.replace(at, old.size(), changed);
    ASSERT_NE(text, tracking);
    expect_another(system_of(text));
  }
  expect_another(system_of(tracking), 31);
  System shorter = system_of(tracking);
  shorter.steps = 2;
  expect_another(shorter);
  System without = system_of(tracking);
  without.data = nullptr;
  expect_another(without);
  // The name is no number.
  System renamed = system_of(tracking);
  renamed.name = "other";
  lines(renamed, request());
  EXPECT_EQ(entries(folder / "cache"), expected);
}

TEST_F(CachedSteps, WhatEndedInAnErrorIsNotKept) {
  const System system = system_of("name = 'a'\nsteps = 1\nA = 1\nB = [[]]\nC = 1\nQ = []\nR = 0\nP0 = 0\n");
  for (int twice = 0; twice < 2; ++twice)
    EXPECT_TRUE(reference_steps(system, request(), [](std::string_view) {}).error);
  EXPECT_EQ(entries(folder / "cache"), 0u);
}

}  // namespace
}  // namespace kfstab::experiments
