#include <kfstab/properties/system_file.hpp>

#include <chrono>
#include <cmath>
#include <functional>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>

#include "systems.hpp"

namespace kfstab::properties::testing {
namespace {

namespace fs = std::filesystem;

/// Reading must fail, and the message must hold every part.
void expect_refused(const std::function<void()>& read, std::initializer_list<std::string> parts) {
  try {
    read();
    FAIL() << "was accepted; expected a message with \"" << *parts.begin() << '"';
  } catch (const InputError& error) {
    const std::string what = error.what();
    for (const std::string& part : parts) EXPECT_NE(what.find(part), std::string::npos) << '"' << part << "\" is not in: " << what;
    EXPECT_FALSE(error.found().empty());
    EXPECT_EQ(what.find('\n'), std::string::npos) << what;
  }
}
void expect_refused(const std::string& toml, std::initializer_list<std::string> parts, const Overrides& overrides = {}) {
  expect_refused([&] { read_toml(toml, overrides); }, parts);
}
void expect_line_refused(const std::string& key, const std::string& line, std::initializer_list<std::string> parts) {
  SCOPED_TRACE(line);
  expect_refused(with(valid_toml(), key, line), parts);
}
void expect_json_refused(const std::string& json, std::initializer_list<std::string> parts) {
  SCOPED_TRACE(json);
  expect_refused([&] { read_system_text(json, Format::json, "cart.json"); }, parts);
}

const std::string valid_json = R"({"name": "cart", "A": [[1, "T"], [0, 1]], "B": [["T^2/2"], ["T"]], "C": [[1, 0]], "Q": [["q"]],
  "R": [[0.25]], "P0": [[2, 0.5], [0.5, 1]], "x0": [1, -1], "steps": 3, "measurements": [[0.5], [1], [1.5]],
  "parameters": {"T": 0.5, "q": "2^-3"}})";

class Folder {
 public:
  Folder() : path_(fs::temp_directory_path() / ("kfstab-system-file-" + std::to_string(
      std::chrono::steady_clock::now().time_since_epoch().count()))) {
    fs::create_directory(path_);
  }
  ~Folder() { fs::remove_all(path_); }
  fs::path write(const std::string& name, const std::string& text) const {
    std::ofstream(path_ / name, std::ios::binary) << text;
    return path_ / name;
  }
  fs::path operator/(const std::string& name) const { return path_ / name; }

 private:
  fs::path path_;
};

TEST(SystemFile, ReadsWhatIsWritten) {
  const System system = read_toml(valid_toml());
  EXPECT_EQ(system.name, "cart");
  EXPECT_EQ(system.steps, 3);
  EXPECT_EQ(system.dimensions(), (Dimensions{2, 1, 1}));
  EXPECT_EQ(system.inputs(), 0);
  EXPECT_TRUE(system.time_invariant());
  EXPECT_EQ(system.A.at(0)(0, 1), 0.5);
  EXPECT_EQ(system.B.at(0)(0, 0), 0.125);
  EXPECT_EQ(system.Q.value.at(0)(0, 0), 0.125);
  EXPECT_EQ(system.x0, (Vector<double>(2) << 1, -1).finished());
  EXPECT_EQ(system.parameters, (std::map<std::string, double>{{"T", 0.5}, {"q", 0.125}}));
  const auto stream = system.data->open();
  EXPECT_EQ(stream->next().y(0), 0.5);
  EXPECT_EQ(stream->next().y(0), 1);
  EXPECT_EQ(stream->next().y(0), 1.5);
  EXPECT_THROW(stream->next(), std::out_of_range);
}

TEST(SystemFile, JsonSaysTheSame) {
  expect_same(read_system_text(valid_json, Format::json, "cart.json"), read_toml(valid_toml()));
}

TEST(SystemFile, ShortFormsOfMatrices) {
  const System system = read_toml(
      "name = 'short'\nsteps = 2\nA = { identity = 2, scale = 'c' }\nB = { diagonal = [1, 'c'] }\nC = [[1, 0]]\n"
      "Q_root = { diagonal = [2, 3] }\nR = 'c^2'\nS0 = { identity = 2 }\n[parameters]\nc = 3\n");
  EXPECT_EQ(system.A.at(0), (Matrix<double>(2, 2) << 3, 0, 0, 3).finished());
  EXPECT_EQ(system.B.at(0), (Matrix<double>(2, 2) << 1, 0, 0, 3).finished());
  EXPECT_EQ(system.R.value.at(0)(0, 0), 9);
  EXPECT_EQ(system.Q.written, Covariance::Written::root);
  EXPECT_EQ(system.R.written, Covariance::Written::covariance);
  EXPECT_EQ(system.P0.written, Covariance::Written::root);
  EXPECT_EQ(system.x0, Vector<double>::Zero(2));
  EXPECT_FALSE(system.data);
}

TEST(SystemFile, SizesOfZero) {
  const System no_noise = read_toml("name = 'a'\nsteps = 1\nA = 2\nB = [[]]\nC = []\nQ = []\nR = []\nP0 = 1\n");
  EXPECT_EQ(no_noise.dimensions(), (Dimensions{1, 0, 0}));
  EXPECT_EQ(no_noise.B.at(0).rows(), 1);
  EXPECT_EQ(no_noise.C.at(0).cols(), 1);
  expect_same(read_toml(write_system(no_noise)), no_noise);
  const System nothing = read_toml("name = 'a'\nsteps = 1\nA = []\nB = []\nC = [[], []]\nQ = 1\nR = { identity = 2 }\nP0 = []\n");
  EXPECT_EQ(nothing.dimensions(), (Dimensions{0, 1, 2}));
  expect_same(read_toml(write_system(nothing)), nothing);
}

TEST(SystemFile, MatricesOverTime) {
  std::string text = with(valid_toml(), "A", "A = { period = [[[1, 1], [0, 1]], { identity = 2 }] }");
  text = with(text, "R", "R = { list = [1, 2, 3] }");
  const System system = read_toml(text);
  EXPECT_EQ(system.A.kind, Sequence::Kind::periodic);
  EXPECT_EQ(system.A.at(2)(0, 1), 1);
  EXPECT_EQ(system.A.at(3)(0, 1), 0);
  EXPECT_EQ(system.R.value.kind, Sequence::Kind::list);
  EXPECT_EQ(system.R.value.at(2)(0, 0), 3);
  EXPECT_FALSE(system.time_invariant());
  expect_same(read_toml(write_system(system)), system);

  Overrides fewer;
  fewer.steps = 2;
  const System shortened = read_toml(text, fewer);
  EXPECT_EQ(shortened.R.value.matrices.size(), 2U);
  expect_same(read_toml(write_system(shortened)), shortened);
}

TEST(SystemFile, Expressions) {
  const auto entry = [](const std::string& expression) {
    return read_toml(with(valid_toml(), "x0", "x0 = ['" + expression + "', 0]")).x0(0);
  };
  EXPECT_EQ(entry("q*T^3/3"), 0.125 * 0.125 / 3);
  EXPECT_EQ(entry("2^-20"), std::ldexp(1, -20));
  EXPECT_EQ(entry("-2^2"), -4);
  EXPECT_EQ(entry("2^3^2"), 512);
  EXPECT_EQ(entry("sqrt(2)*cos(pi/3) + exp(-1) - sin(1)"), std::sqrt(2.0) * std::cos(std::acos(-1.0) / 3) + std::exp(-1.0) - std::sin(1.0));
  EXPECT_EQ(entry("1e-3 + .5E+1"), 1e-3 + 5);
  EXPECT_EQ(entry("T > 0.25 ? 1 : 2"), 1);
  EXPECT_EQ(entry("min(3, q) + max(1, 2) + pow(2, 3) + atan2(0, 1) + abs(-1)"), 0.125 + 2 + 8 + 1);
  EXPECT_EQ(entry("1/3"), 1.0 / 3);
}

TEST(SystemFile, ParametersInTermsOfEachOther) {
  const std::string text = with(with(valid_toml(), "T", "T = 'a/b'\nb = 4\na = 'c'\nc = 2"), "q", "q = 'T^2'");
  EXPECT_EQ(read_toml(text).parameters.at("q"), 0.25);
  Overrides set;
  set.parameters["b"] = "2^1";
  EXPECT_EQ(read_toml(text, set).parameters.at("q"), 1);
  set.parameters["T"] = "3*c";
  EXPECT_EQ(read_toml(text, set).A.at(0)(0, 1), 6);
  expect_refused(with(with(valid_toml(), "T", "T = 'q'"), "q", "q = '2*T'"), {"cart.toml:12:", "parameters.T", "leads back to itself"});
}

TEST(SystemFile, Overrides) {
  Overrides set;
  set.parameters["T"] = "0.25";
  EXPECT_EQ(read_toml(valid_toml(), set).A.at(0)(0, 1), 0.25);
  set.parameters = {{"t", "1"}};
  expect_refused(valid_toml(), {"cart.toml", "parameters.t", "\"t\"", "T, q", "did you mean 'T'"}, set);
  expect_refused("name = 'a'\nsteps = 1\nA = 1\nB = 1\nC = 1\nQ = 1\nR = 1\nP0 = 1\n", {"parameters.t", "the file has no [parameters]"}, set);
  set.parameters = {{"T", "1/0"}};
  expect_refused(valid_toml(), {"cart.toml:12:", "parameters.T", "divides by zero"}, set);
  set = {};
  set.steps = 2;
  EXPECT_EQ(read_toml(valid_toml(), set).steps, 2);
  set.steps = 4;
  expect_refused(valid_toml(), {"cart.toml:10:", "measurements", "3 rows", "4 for the 4 steps"}, set);
  set.steps = 0;
  expect_refused(valid_toml(), {"cart.toml:9:", "steps", "found 0", ">= 1"}, set);
}

TEST(SystemFile, WhatIsMissing) {
  for (const auto& [key, words] : std::map<std::string, std::string>{{"name", "name"}, {"A", "n x n"}, {"B", "n x m"}, {"C", "p x n"},
                                                                     {"Q", "Q_root"}, {"R", "R_root"}, {"P0", "S0"}, {"steps", ">= 1"}}) {
    SCOPED_TRACE(key);
    expect_refused(with(valid_toml(), key, ""), {"cart.toml: " + key + ": found no such key", words});
  }
}

TEST(SystemFile, RubbishIn) {
  expect_line_refused("A", "A = [[1, 0], [0, 1], [1, 1]]", {"cart.toml:2:5: A: found a 3 x 2 matrix", "n x n, square"});
  expect_line_refused("A", "A = [[1, nan], [0, 1]]", {"cart.toml:2:10: A[0,1]: found nan", "finite"});
  expect_line_refused("A", "A = [[1, 0], [0, -inf]]", {"cart.toml:2:", "A[1,1]", "infinity", "finite"});
  expect_line_refused("A", "A = [[1, 0], [0]]", {"cart.toml:2:14: A[1]: found a row of 1", "2"});
  expect_line_refused("A", "A = [1, 0]", {"cart.toml:2:6: A[0]", "list of rows"});
  expect_line_refused("A", "A = [[1, true], [0, 1]]", {"A[0,1]", "a boolean", "expression of T, q"});
  expect_line_refused("A", "A = [[1, 1979-05-27], [0, 1]]", {"A[0,1]", "a date"});
  expect_line_refused("A", "A = [[1, [2]], [0, 1]]", {"A[0,1]", "a list"});
  expect_line_refused("A", "A = [[1, {}], [0, 1]]", {"A[0,1]", "a table"});
  expect_line_refused("A", "A = false", {"cart.toml:2:", "A", "a boolean"});
  expect_line_refused("A", "A = {}", {"cart.toml:2:", "A", "{ diagonal = [...] }"});
  expect_line_refused("A", "A = { identity = 2, diagonal = [1] }", {"cart.toml:2:", "A", "{ diagonal = [...] }"});
  expect_line_refused("A", "A = { scale = 2, diagonal = [1] }", {"cart.toml:2:", "A"});
  expect_line_refused("A", "A = { identity = 1000000000 }", {"cart.toml:2:", "A.identity", "1000000000", "from 0 to 1000"});
  expect_line_refused("A", "A = { identity = -1 }", {"A.identity", "-1"});
  expect_line_refused("A", "A = { identity = 2.5 }", {"A.identity", "2.5"});
  expect_line_refused("A", "A = { idntity = 2 }", {"cart.toml:2:17", "A.idntity", "unknown key", "did you mean 'identity'"});
  expect_line_refused("A", "A = { diagonal = 2 }", {"A.diagonal", "found 2", "a list"});
  expect_line_refused("A", "A = { list = [1, 2] }", {"cart.toml:2:14", "A.list", "2 matrices", "3, one for each step"});
  expect_line_refused("A", "A = { period = [] }", {"A.period", "an empty list"});
  expect_line_refused("A", "A = { period = [{identity = 2}, 1] }", {"cart.toml:2:", "A.period[1]", "1 x 1", "2 x 2"});
  expect_line_refused("A", "A = { period = [{ period = [1] }] }", {"A.period[0]", "unknown key"});
  expect_line_refused("A", "A = { period = [1], list = [1] }", {"cart.toml:2", "A"});
  expect_line_refused("B", "B = [[1]]", {"cart.toml:3:5: B: found a 1 x 1 matrix", "2 rows (n x m)"});
  expect_line_refused("C", "C = [[1]]", {"cart.toml:4:5: C: found a 1 x 1 matrix", "2 columns (p x n)"});
  expect_line_refused("C", "C = [1, 0]", {"cart.toml:4", "C[0]", "[[...], [...]], even if there is one"});
  expect_line_refused("Q", "Q = [[1, 0], [0, 1]]", {"cart.toml:5:5: Q: found a 2 x 2 matrix", "1 x 1 (m x m)"});
  expect_line_refused("Q", "Q = -1", {"cart.toml:5:5: Q: found a negative variance", "positive semidefinite"});
  expect_line_refused("R", "R = [['-T']]", {"cart.toml:6:", "R", "negative variance"});
  expect_line_refused("P0", "P0 = [[2, 0.5], [0.25, 1]]", {"cart.toml:7:18: P0[1,0]: found 0.25", "0.5", "symmetric"});
  expect_line_refused("P0", "P0 = [[1, 2], [2, 1]]", {"cart.toml:7:6: P0", "smallest eigenvalue of -1", "-n eps", "positive semidefinite"});
  expect_line_refused("P0", "P0 = [[0, 1], [1, 1]]", {"cart.toml:7:6: P0", "beside a variance", "positive semidefinite"});
  expect_line_refused("P0", "P0 = { list = [1] }", {"P0.list", "unknown key"});
  expect_line_refused("P0", "S0 = [[1, 2], [0, 1]]", {"cart.toml:7:11: S0[0,1]: found 2", "lower triangular"});
  expect_line_refused("Q", "Q = 1\nQ_root = 1", {"cart.toml:6:10: Q_root: found both Q and Q_root", "one of them"});
  expect_line_refused("P0", "P0 = {identity = 2}\nS0 = {identity = 2}", {"cart.toml:8:", "both P0 and S0"});
  expect_line_refused("x0", "x0 = [1]", {"cart.toml:8:6: x0: found 1 entries", "2 (n)"});
  expect_line_refused("x0", "x0 = 'T'", {"cart.toml:8:", "x0", "a list of 2 numbers"});
  expect_line_refused("x0", "x0 = [1, nan]", {"x0[1]", "nan"});
  for (const std::string steps : {"0", "-1", "2.5", "nan", "inf", "1e300", "'T'", "true", "[]"}) {
    SCOPED_TRACE(steps);
    expect_refused(with(valid_toml(), "steps", "steps = " + steps), {"cart.toml:9:9: steps: found "});
  }
  expect_line_refused("name", "name = 3", {"cart.toml:1:8: name: found 3", "a text"});
  expect_line_refused("name", "name = '../cart'", {"cart.toml:1:8: name", "letters, digits"});
  expect_line_refused("name", "name = ''", {"name", "1 to 100 letters"});
  expect_line_refused("name", "name = 'a'\ndescription = 1", {"cart.toml:2:15: description: found 1", "a text"});
  expect_line_refused("steps", "steps = 3\nmeasurments = []", {"cart.toml:10:", "measurments", "unknown key", "did you mean 'measurements'"});
  expect_refused(valid_toml() + "[extra]\n", {"cart.toml:14:", "extra", "unknown key"});
  expect_refused("", {"cart.toml: name: found no such key"});
}

TEST(SystemFile, BadExpressions) {
  const auto bad = [](const std::string& expression, std::initializer_list<std::string> parts) {
    SCOPED_TRACE(expression);
    expect_refused(with(valid_toml(), "x0", "x0 = [0, \"" + expression + "\"]"), {"cart.toml:8:10: x0[1]: found ", "expression of T, q"});
    expect_refused(with(valid_toml(), "x0", "x0 = [0, \"" + expression + "\"]"), parts);
  };
  bad("1/0", {"divides by zero"});
  bad("1/(1/(T - T))", {"divides by zero"});
  bad("log(0)", {"divides by zero"});
  bad("sqrt(-1)", {"no real value"});
  bad("0/0", {"no real value"});
  bad("exp(1000)", {"beyond the range"});
  bad("1e308*10*0", {"beyond the range"});
  bad("tt*2", {"\"tt\" is no parameter", "did you mean 'T'"});
  bad("T*", {"T*"});
  bad("(T", {"(T"});
  bad("1,2", {"2 values"});
  bad("T = 3", {"T = 3"});
  bad("", {"an empty expression"});
  bad("sqrt", {"sqrt"});
  bad("sqrt(1, 2)", {"sqrt"});
  bad("1 2", {"1 2"});
  bad("_pi", {"_pi"});
  bad(std::string(5000, '1'), {"at most 4000"});
  bad(std::string(300, '(') + "1" + std::string(300, ')'), {"too deep"});
}

TEST(SystemFile, BadParameters) {
  expect_refused(with(valid_toml(), "T", "T = true"), {"cart.toml:12:5: parameters.T: found a boolean"});
  expect_refused(with(valid_toml(), "T", "T = nan"), {"cart.toml:12:5: parameters.T: found nan"});
  expect_refused(valid_toml() + "pi = 3\n", {"cart.toml:14:6: parameters.pi", "neither pi nor a function"});
  expect_refused(valid_toml() + "sqrt = 3\n", {"cart.toml:14:8: parameters.sqrt"});
  expect_refused(valid_toml() + "\"a b\" = 3\n", {"cart.toml:14", "\"a b\""});
  expect_refused(valid_toml() + "2a = 3\n", {"cart.toml:14", "\"2a\""});
  expect_refused(valid_toml() + "z = \"1/0\"\n", {"cart.toml:14:5: parameters.z", "divides by zero"});
  expect_refused("parameters = 3\n" + valid_toml().substr(0, valid_toml().find("[parameters]")), {"cart.toml:1:14: parameters: found 3"});
}

TEST(SystemFile, BadData) {
  expect_line_refused("measurements", "measurements = [[1], [2]]", {"cart.toml:10:16: measurements: found 2 rows", "3, one for each step"});
  expect_line_refused("measurements", "measurements = [[1], [2], [3, 4]]", {"cart.toml:10:", "measurements[2]: found 2 entries", "a row of 1"});
  expect_line_refused("measurements", "measurements = [[1], [nan], [3]]", {"measurements[1,0]: found nan"});
  expect_line_refused("measurements", "measurements = 3", {"cart.toml:10:", "found 3", "a list of rows"});
  expect_line_refused("measurements", "measurements = {}", {"cart.toml:10:", "found 0 keys", "one of csv and simulate"});
  expect_line_refused("measurements", "measurements = {csv = 'a.csv', simulate = {seed = 1}}", {"found 2 keys"});
  expect_line_refused("measurements", "measurements = {simulat = {seed = 1}}", {"unknown key", "did you mean 'simulate'"});
  expect_line_refused("measurements", "measurements = {simulate = 1}", {"measurements.simulate", "found 1", "seed"});
  expect_line_refused("measurements", "measurements = {simulate = {}}", {"measurements.simulate.seed", "no such key"});
  expect_line_refused("measurements", "measurements = {simulate = {seed = -1}}", {"measurements.simulate.seed: found -1", ">= 0"});
  expect_line_refused("measurements", "measurements = {simulate = {sed = 1}}", {"did you mean 'seed'"});
  expect_line_refused("measurements", "measurements = {csv = 'nowhere.csv'}", {"cart.toml:10:", "measurements.csv", "nowhere.csv", "no such file"});
  expect_line_refused("measurements", "measurements = {csv = 3}", {"measurements.csv: found 3", "the name of a CSV file"});
  expect_refused(valid_toml().replace(0, 0, "inputs = [1, 2, 3]\n"), {"cart.toml:1:10: inputs: found inputs without a D"});
  expect_refused(valid_toml().replace(0, 0, "D = [[1], [0]]\n"), {"cart.toml: inputs: found no such key", "D has 1 columns"});
  expect_refused(with(valid_toml(), "measurements", "D = [[1], [0]]\ninputs = [1, 2, 3]"), {"inputs without measurements"});
  expect_refused(valid_toml().replace(0, 0, "D = [[1]]\n"), {"cart.toml:1:5: D: found a 1 x 1 matrix", "2 rows (n x inputs)"});
}

TEST(SystemFile, BadJson) {
  const auto spoiled = [](const std::string& from, const std::string& to) {
    std::string text = valid_json;
    return text.replace(text.find(from), from.size(), to);
  };
  expect_json_refused(spoiled("[0, 1]", "[null, 1]"), {"cart.json: /A/1/0: A[1,0]: found null"});
  expect_json_refused(spoiled("[[0.25]]", "-1"), {"cart.json: /R: R: found a negative variance"});
  expect_json_refused(spoiled("\"steps\": 3", "\"steps\": 3, \"steps\": 4"), {"cart.json: /steps", "a second time"});
  expect_json_refused(spoiled("\"T\": 0.5", "\"T\": 0.5, \"T\": 0.5"), {"cart.json: /parameters/T", "a second time"});
  expect_json_refused(spoiled("\"T\": 0.5", "\"T\": 0.5, \"a/b~\": 0.5"), {"cart.json: /parameters/a~1b~0"});
  expect_json_refused(spoiled("0.25", "NaN"), {"cart.json", "line 2", "JSON"});
  expect_json_refused(spoiled("0.25", "1e999"), {"cart.json", "1e999"});
  expect_json_refused("[1, 2]", {"cart.json", "no table"});
  expect_json_refused("", {"cart.json", "JSON"});
  expect_json_refused("{\"name\": 1", {"cart.json", "JSON"});
  expect_json_refused(std::string(1000, '['), {"cart.json", "nested deeper than 64"});
  expect_json_refused("{\"A\": " + std::string(100, '[') + std::string(100, ']') + "}", {"cart.json", "nested deeper than 64"});
}

TEST(SystemFile, BadToml) {
  expect_refused("name = \"a\"\nA = [[1, 2\n", {"cart.toml:", "TOML"});
  expect_refused("name = \"a\"\nname = \"b\"\n", {"cart.toml:2:", "name", "TOML"});
  expect_refused("A = 1e999\n", {"cart.toml:1:"});
  expect_refused("\xff\xfe", {"cart.toml:1"});
  expect_refused("A = " + std::string(1000, '['), {"cart.toml:1"});
}

TEST(SystemFile, FilesThatCannotBeRead) {
  const Folder folder;
  expect_refused([&] { read_system(folder / "nowhere.toml"); }, {"nowhere.toml: found no such file"});
  expect_refused([&] { read_system(folder / ""); }, {"a folder", "a file"});
  const fs::path huge = folder.write("huge.toml", "");
  fs::resize_file(huge, std::uintmax_t{1} << 40);
  expect_refused([&] { read_system(huge); }, {"huge.toml: found 1099511627776 bytes", "at most 8388608", "CSV"});
  expect_refused([&] { read_system("/dev/zero"); }, {"/dev/zero", "more than 8388608 bytes"});
  const fs::path wrong = folder.write("wrong.toml", "steps = 0\n");
  expect_refused([&] { read_system(wrong); }, {"wrong.toml: name: found no such key"});
}

TEST(SystemFile, Csv) {
  const Folder folder;
  folder.write("data.csv", "\xEF\xBB\xBFt, \"y\", u2,u1\r\n0, 0.5, 7, 1\r\n1, 1e0, 8, 2\r\n2,+1.5,9,3\r\n\r\n");
  const fs::path file = folder.write("cart.toml", with(valid_toml(), "measurements",
      "measurements = { csv = 'data.csv' }\nD = [[1, 0], [0, 1]]\ninputs = { csv = 'data.csv' }"));
  const System system = read_system(file);
  const auto stream = system.data->open();
  for (int k = 0; k < 3; ++k) {
    const StepData& step = stream->next();
    EXPECT_EQ(step.y(0), 0.5 * (k + 1));
    EXPECT_EQ(step.u(0), k + 1);
    EXPECT_EQ(step.u(1), k + 7);
  }
  expect_same(read_toml(write_system(system)), system);

  const auto bad = [&](const std::string& csv, std::initializer_list<std::string> parts) {
    SCOPED_TRACE(csv);
    folder.write("data.csv", csv);
    folder.write("cart.toml", with(valid_toml(), "measurements", "measurements = { csv = 'data.csv' }"));
    expect_refused([&] { read_system(folder / "cart.toml"); }, parts);
  };
  bad("y1\n1\n2\n", {"cart.toml:10:", "found 2 rows in", "data.csv", "3, one for each step"});
  bad("y1\n1\n2\n3\n4\n", {"found 4 rows in", "data.csv"});
  bad("a\n1\n2\n3\n", {"data.csv:1: found no column y1", "first line that names"});
  bad("1\n2\n3\n", {"data.csv:1: found no column y1"});
  bad("y1,y2\n1,1\n2,2\n3,3\n", {"data.csv:1: found a column \"y2\"", "1 columns y1"});
  bad("y,y1\n1,1\n2,2\n3,3\n", {"data.csv:1: found the column y1 twice"});
  bad("y1\n1\ntwo\n3\n", {"data.csv:3: y1: found \"two\"", "a number"});
  bad("y1\n1\n2 3\n3\n", {"data.csv:3: y1: found \"2 3\""});
  bad("y1\n1\nnan\n3\n", {"data.csv:3: y1: found \"nan\"", "finite"});
  bad("y1\n1\n1e999\n3\n", {"data.csv:3: y1: found \"1e999\"", "finite"});
  bad("y1\n1\n2,3\n3\n", {"data.csv:3: found 2 cells", "1, as the first line has"});
  bad("", {"data.csv:1: found no column y1"});
  folder.write("data.csv", "");
  fs::resize_file(folder / "data.csv", std::uintmax_t{1} << 40);
  expect_refused([&] { read_system(folder / "cart.toml"); }, {"cart.toml:10:", "data.csv", "1099511627776 bytes"});
}

// Both formats and a CSV file say the same; what is written reads back, bit by bit.
TEST(SystemFile, MissingMeasurements) {
  std::string two = with(with(valid_toml(), "C", "C = [[1, 0], [0, 1]]"), "R", "R = {identity = 2}");
  const System system =
      read_toml(with(two, "measurements", "measurements = [[0.5, 'missing'], ['missing', 'missing'], ['1/3', 2]]"));
  Matrix<double> y(2, 3);
  const auto stream = system.data->open();
  for (Index k = 0; k < 3; ++k) y.col(k) = stream->next().y;
  EXPECT_EQ(y(0, 0), 0.5);
  EXPECT_TRUE(std::isnan(y(1, 0)) && std::isnan(y(0, 1)) && std::isnan(y(1, 1)));
  EXPECT_EQ(y(1, 2), 2);
  expect_same(read_toml(write_system(system)), system);
  EXPECT_NE(write_system(system).find("[0.5, \"missing\"]"), std::string::npos);
  EXPECT_NE(write_system(system).find("[\"1/3\", 2]"), std::string::npos);

  std::string json = valid_json;
  json.replace(json.find("[1], [1.5]"), 10, "\"missing\", [\"missing\"]");
  expect_same(read_system_text(json, Format::json, "cart.json"),
              read_toml(with(valid_toml(), "measurements", "measurements = [0.5, 'missing', 'missing']")));

  const Folder folder;
  folder.write("data.csv", "y2,y1\n,0.5\n missing ,\"\"\n2,0.25\n");
  const System from_csv =
      read_system(folder.write("cart.toml", with(two, "measurements", "measurements = { csv = 'data.csv' }")));
  expect_same(from_csv, read_toml(with(two, "measurements",
                                       "measurements = [[0.5, 'missing'], ['missing', 'missing'], [0.25, 2]]")));
}

TEST(SystemFile, NothingElseIsMissing) {
  expect_line_refused("measurements", "measurements = [[1], ['mising'], [3]]", {"measurements[1,0]", "mising"});
  expect_line_refused("A", "A = [[1, 'missing'], [0, 1]]", {"A[0,1]", "\"missing\" is no parameter"});
  expect_line_refused("x0", "x0 = [1, 'missing']", {"x0[1]"});
  expect_refused(
      with(valid_toml(), "measurements", "measurements = [1, 2, 3]\nD = [[1], [0]]\ninputs = [1, 'missing', 3]"),
      {"cart.toml:12:", "inputs[1]", "missing"});
  const Folder folder;
  folder.write("data.csv", "u,y\n1,1\n,2\n3,3\n");
  const fs::path file = folder.write(
      "cart.toml", with(valid_toml(), "measurements",
                        "measurements = { csv = 'data.csv' }\nD = [[1], [0]]\ninputs = { csv = 'data.csv' }"));
  expect_refused([&] { read_system(file); }, {"data.csv:3: u: found an empty cell", "a number"});
}

TEST(SystemFile, TheExampleOfTheDocumentationIsRead) {
  std::ifstream file(fs::path(KFSTAB_SOURCE_DIR) / "docs/systems.md");
  std::string text((std::istreambuf_iterator<char>(file)), {});
  const auto begin = text.find("```toml\n") + 8;
  std::string example = text.substr(begin, text.find("```", begin) - begin);
  const System system = read_system_text(example, Format::toml, "tracking.toml");
  EXPECT_EQ(system.dimensions(), (Dimensions{2, 1, 1}));
  EXPECT_EQ(system.inputs(), 1);
  EXPECT_EQ(system.R.value.kind, Sequence::Kind::periodic);
  ASSERT_TRUE(system.data);

  const std::string message =
      "tracking.toml:7:7: A[0,1]: found \"dz\", where \"dz\" is no parameter, constant or function, expected a number or an "
      "expression of dt, q, r; did you mean 'dt'?";
  EXPECT_NE(text.find(message), std::string::npos);
  example.replace(example.find("\"dt\""), 4, "\"dz\"");
  expect_refused([&] { read_system_text(example, Format::toml, "tracking.toml"); }, {message});
}

TEST(SystemFile, RoundTripKeepsEveryBit) {
  System system = read_toml(valid_toml());
  system.description = "quotes \" and \\ and\na second line, \t a tab, \x7f and \xC3\xA9";
  system.source = "#[x]";
  system.A = Matrix<double>((Matrix<double>(2, 2) << 0.1, -0.0, 5e-324, 1.7976931348623157e308).finished());
  system.x0 << 1.0 / 3, 123456789012345678.0;
  system.parameters["tiny"] = 2.2250738585072014e-308;
  expect_same(read_toml(write_system(system)), system);
  system.data = nullptr;
  expect_same(read_toml(write_system(system)), system);
}

TEST(SystemFile, NearMisses) {
  const std::vector<std::string> known = {"simulate", "csv", "period", "list", "rotation", "radar"};
  EXPECT_EQ(near_misses("radra", known), (std::vector<std::string>{"radar"}));
  EXPECT_EQ(near_misses("Rotation", known), (std::vector<std::string>{"rotation"}));
  EXPECT_TRUE(near_misses("xyzzy", known).empty());
  EXPECT_TRUE(near_misses("", known).empty());
  EXPECT_EQ(did_you_mean("rotatoin", known), "; did you mean 'rotation'?");
  EXPECT_EQ(did_you_mean("xyzzy", known), "");
}

}  // namespace
}  // namespace kfstab::properties::testing
