// The built tool as its users see it: a child process with its own folder, environment, stdout, stderr and exit code.

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "reports/scratch.hpp"

#include <nlohmann/json.hpp>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/claim.hpp>
#include <kfstab/filters/registry.hpp>

namespace fs = std::filesystem;
using nlohmann::json;

extern char** environ;

namespace {

/// How the tool is started. Without a PATH of its own it does not find gnuplot: pictures cost most of a run's time.
struct Start {
  std::vector<std::string> arguments;
  std::vector<std::string> environment{};   ///< "NAME=VALUE", beside what has no KFSTAB_ in it
  std::optional<std::size_t> file_size{};   ///< no file may become larger
  std::optional<double> interrupt_after{};  ///< seconds
  bool stderr_is_terminal = false;
  std::string stdout_to{};  ///< a device, instead of being caught
  std::string stderr_to{};
};

struct Outcome {
  int exit_code = -1;  ///< 128 + signal for a child that was killed
  std::string out, err;
  long max_resident_kib = 0;
};

class Tool : public ScratchFolder {
 protected:
  void SetUp() override {
    ScratchFolder::SetUp();
    here = folder / "here";
    fs::create_directory(here);
  }

  /// Runs the tool in the folder `here`.
  Outcome run(const Start& start) const {
    int out[2], err[2];
    if (::pipe(out) != 0) throw std::runtime_error("pipe");
    if (start.stderr_is_terminal ? ::openpty(&err[0], &err[1], nullptr, nullptr, nullptr) != 0 : ::pipe(err) != 0)
      throw std::runtime_error("pipe or terminal");
    std::fflush(nullptr);
    const pid_t child = ::fork();
    if (child == 0) {
      ::dup2(start.stdout_to.empty() ? out[1] : ::open(start.stdout_to.c_str(), O_WRONLY), STDOUT_FILENO);
      ::dup2(start.stderr_to.empty() ? err[1] : ::open(start.stderr_to.c_str(), O_WRONLY), STDERR_FILENO);
      for (const int end : {out[0], out[1], err[0], err[1]}) ::close(end);
      execute(start);
    }
    ::close(out[1]);
    ::close(err[1]);
    const auto begin = std::chrono::steady_clock::now();
    bool interrupted = !start.interrupt_after;
    Outcome outcome;
    std::vector<std::pair<int, std::string*>> open{{out[0], &outcome.out}, {err[0], &outcome.err}};
    while (!open.empty()) {
      std::vector<pollfd> waiting;
      for (const auto& [end, text] : open) waiting.push_back({end, POLLIN, 0});
      ::poll(waiting.data(), waiting.size(), 20);
      if (!interrupted &&
          std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() > *start.interrupt_after) {
        ::kill(child, SIGINT);
        interrupted = true;
      }
      for (std::size_t i = waiting.size(); i-- > 0;) {
        if (waiting[i].revents == 0) continue;
        char buffer[4096];
        const ssize_t size = ::read(open[i].first, buffer, sizeof buffer);
        if (size > 0) {
          open[i].second->append(buffer, static_cast<std::size_t>(size));
        } else {
          ::close(open[i].first);
          open.erase(open.begin() + static_cast<std::ptrdiff_t>(i));
        }
      }
    }
    int status = 0;
    rusage usage{};
    ::wait4(child, &status, 0, &usage);
    outcome.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    outcome.max_resident_kib = usage.ru_maxrss;
    return outcome;
  }
  Outcome run(std::vector<std::string> arguments) const { return run(Start{.arguments = std::move(arguments)}); }

  json results(const fs::path& out = "out") const { return json::parse(read(here / out / "results.json")); }

  /// A file of that text, run: expects a refusal that says all of the words, and nothing written.
  void expect_refused(const std::string& text, const std::vector<std::string>& words) const {
    put(here / "bad.toml", text);
    const Outcome outcome = run({"run", "bad.toml", "--out", "out"});
    EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
    EXPECT_EQ(outcome.err.find("kfstab: bad.toml:"), 0u) << outcome.err;
    for (const auto& word : words)
      EXPECT_NE(outcome.err.find(word), std::string::npos) << "no '" << word << "' in " << outcome.err;
    EXPECT_EQ(count(outcome.err, "\n"), 1u) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    EXPECT_FALSE(fs::exists(here / "out"));
  }

  fs::path here;

 private:
  [[noreturn]] void execute(const Start& start) const {
    std::vector<std::string> environment;
    for (char** entry = environ; *entry; ++entry) {
      const std::string text = *entry;
      if (text.find("KFSTAB_") != 0 && text.find("PATH=") != 0) environment.push_back(text);
    }
    if (std::ranges::none_of(start.environment, [](const std::string& e) { return e.starts_with("PATH="); }))
      environment.push_back("PATH=/nonexistent");
    environment.insert(environment.end(), start.environment.begin(), start.environment.end());
    std::vector<std::string> arguments = start.arguments;
    arguments.insert(arguments.begin(), "kfstab");
    const auto pointers = [](std::vector<std::string>& texts) {
      std::vector<char*> result;
      for (auto& text : texts) result.push_back(text.data());
      result.push_back(nullptr);
      return result;
    };
    if (start.file_size) {
      const rlimit limit{*start.file_size, *start.file_size};
      ::setrlimit(RLIMIT_FSIZE, &limit);
    }
    for (const int signal : {SIGINT, SIGPIPE, SIGXFSZ}) std::signal(signal, SIG_DFL);
    if (::chdir(here.c_str()) == 0)
      ::execve(KFSTAB_TOOL_PATH, pointers(arguments).data(), pointers(environment).data());
    ::_exit(127);
  }
};

/// A valid system; lines are replaced to spoil it.
std::string cart(const std::string& key = "", const std::string& line = "") {
  std::string text;
  for (const auto& [name, value] : std::vector<std::pair<std::string, std::string>>{{"name", "\"cart\""},
                                                                                    {"A", "[[1, 0.5], [0, 1]]"},
                                                                                    {"B", "[[0.125], [0.5]]"},
                                                                                    {"C", "[[1, 0]]"},
                                                                                    {"Q", "[[\"q\"]]"},
                                                                                    {"R", "[[1]]"},
                                                                                    {"P0", "[[2, 0.5], [0.5, 1]]"},
                                                                                    {"steps", "5"}})
    text += (name == key ? line : name + " = " + value) + "\n";
  return text + "[parameters]\nq = 0.25\n";
}

std::vector<std::string> filters_of(const json& results) {
  std::vector<std::string> ids;
  for (const auto& filter : results["systems"][0]["filters"]) ids.push_back(filter["id"]);
  return ids;
}

/// Whether a line starts with the word.
bool has_row(const std::string& table, std::string_view word) {
  std::string row = "\n";
  row.append(word).append(" ");
  return table.find(row) != table.npos;
}

std::string user_path() { return std::string("PATH=") + std::getenv("PATH"); }

}  // namespace

// What there is.

TEST_F(Tool, HelpAndVersionGoToStdout) {
  const Outcome help = run({"--help"});
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_EQ(help.err, "");
  for (const char* word : {"run", "reference", "claim", "demo", "list", "Exit codes"})
    EXPECT_NE(help.out.find(word), std::string::npos) << word;
  const Outcome of_run = run({"run", "--help"});
  EXPECT_EQ(of_run.exit_code, 0);
  for (const char* word :
       {"--filters", "--steps", "--seed", "--digits", "--jobs", "--set", "--out", "--json", "KFSTAB_FILTERS"})
    EXPECT_NE(of_run.out.find(word), std::string::npos) << word;
  const Outcome version = run({"--version"});
  EXPECT_EQ(version.exit_code, 0);
  EXPECT_EQ(version.out.find("kfstab "), 0u) << version.out;
  EXPECT_EQ(count(version.out, "\n"), 1u);
}

TEST_F(Tool, ListsSystemsFiltersAndClaims) {
  const auto systems = run({"list", "systems"}), filters = run({"list", "filters"}), claims = run({"list", "claims"}),
             laws = run({"list", "laws"});
  for (const auto& outcome : {systems, filters, claims, laws}) {
    EXPECT_EQ(outcome.exit_code, 0);
    EXPECT_EQ(outcome.err, "");
  }
  for (const auto& entry : kfstab::experiments::catalogue())
    EXPECT_TRUE(has_row(systems.out, entry.name)) << entry.name;
  for (const auto& metadata : kfstab::filters()) EXPECT_TRUE(has_row(filters.out, metadata.id)) << metadata.id;
  for (const auto& claim : kfstab::experiments::all_claims())
    EXPECT_NE(claims.out.find(claim.id), std::string::npos) << claim.id;
  EXPECT_EQ(run({"list"}).out, systems.out + "\n" + filters.out + "\n" + claims.out + "\n" + laws.out);
}

// Wrong usage: always 2, never one of CLI11's own codes, with a word about it on stderr and nothing on stdout.

TEST_F(Tool, WrongUsageIsTwo) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{}, "A command"},
      {{"frobnicate"}, "frobnicate"},
      {{"--frobnicate"}, "--frobnicate"},
      {{"run"}, "SYSTEM"},
      {{"run", "local-level", "--frobnicate"}, "--frobnicate"},
      {{"run", "local-level", "--steps"}, "--steps"},
      {{"run", "local-level", "--steps", "0"}, "--steps"},
      {{"run", "local-level", "--steps", "-3"}, "--steps"},
      {{"run", "local-level", "--steps", "many"}, "--steps"},
      {{"run", "local-level", "--digits", "2000"}, "--digits"},
      {{"run", "local-level", "--jobs", "-1"}, "--jobs"},
      {{"run", "local-level", "--seed", "x"}, "--seed"},
      {{"run", "local-level", "--set", "q"}, "expected name=value"},
      {{"run", "local-level", "--set", "q=1", "--set", "q=2"}, "set twice"},
      {{"run", "local-level", "--set", "nosuch=1"}, "nosuch"},
      {{"run", "local-level", "--set", "q=one"}, "q"},
      {{"run", "local-level", "--filters", "("}, "expected a regular expression"},
      {{"claim", "["}, "expected a regular expression"},
      {{"claim", "dyer", "--set", "nosuch=1"}, "nosuch"},
      {{"claim", "asymmetry-growth", "--set", "r=0.5"}, "from 1.02 to 2"},
      {{"claim", "asymmetry-growth", "--set", "r=x"}, "expected a number"},
      {{"list", "frobs"}, "frobs"},
      {{"run", "missing.toml"}, "missing.toml: found no such file"},
      {{"reference"}, "SYSTEM"},
      {{"reference", "local-level", "rotation"}, "rotation"},
      {{"reference", "local-level", "--digits", "0"}, "--digits"},
      {{"reference", "local-level", "--digits", "751"}, "--digits"},
      {{"reference", "local-level", "--steps", "0"}, "--steps"},
      {{"reference", "local-level", "--set", "q=1e-400"}, "which is not 0"},
      {{"reference", "local-level", "--set", "nosuch=1"}, "nosuch"},
      {{"reference", "local-level", "--filters", "ckf"}, "--filters"},
      {{"reference", "missing.toml"}, "missing.toml: found no such file"},
      {{"reference", "local-level", "--json", "."}, "it is a folder"},
      {{"reference", "local-level", "--json", "missing/x.json"}, "cannot write missing/x.json"},
      {{"run", "missing/x"}, "missing/x: found no such file"},
      {{"run", "dyer-mcreynold"}, "did you mean 'dyer-mcreynolds'?"},
  };
  for (const auto& [arguments, word] : cases) {
    const Outcome outcome = run(arguments);
    SCOPED_TRACE(arguments.empty() ? "(no argument)" : arguments.back());
    EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
    EXPECT_EQ(outcome.err.find("kfstab: "), 0u) << outcome.err;
    EXPECT_NE(outcome.err.find(word), std::string::npos) << "no '" << word << "' in " << outcome.err;
    EXPECT_EQ(outcome.out, "");
  }
  EXPECT_FALSE(fs::exists(here / "kfstab-out")) << "nothing is written";
}

TEST_F(Tool, NothingSelectedIsFive) {
  for (const auto& arguments :
       {std::vector<std::string>{"run", "local-level", "--filters", "no-such-filter"}, {"claim", "no-such-claim"}}) {
    const Outcome outcome = run(arguments);
    EXPECT_EQ(outcome.exit_code, 5) << outcome.err;
    EXPECT_NE(outcome.err.find(arguments.back()), std::string::npos) << outcome.err;
    EXPECT_NE(outcome.err.find("kfstab list "), std::string::npos) << outcome.err;
  }
  EXPECT_FALSE(fs::exists(here / "kfstab-out"));
}

// Rubbish in a file: what, where, what was expected.

TEST_F(Tool, RefusesRubbishInAFile) {
  put(here / "good.toml", cart());
  EXPECT_EQ(run({"run", "good.toml", "--filters", "^ckf$"}).exit_code, 0) << "what is spoiled below is good";
  expect_refused(cart("A", "A = [[1, 0.5], [0, 1], [0, 0]]"), {"bad.toml:2:", "A", "3 x 2"});
  expect_refused(cart("A", "A = [[1, nan], [0, 1]]"), {"bad.toml:2:", "A[0,1]", "nan"});
  expect_refused(cart("Q", "B = [[1, 0], [0, 1]]\nQ = [[1, 0.5], [0.25, 1]]"), {"bad.toml:5:"});
  expect_refused(cart("P0", "P0 = [[2, 0.5], [0.25, 1]]"), {"bad.toml:7:", "P0[1,0]", "0.25", "symmetric"});
  expect_refused(cart("R", "R = [[-1]]"), {"bad.toml:6:", "R", "semidefinite"});
  expect_refused(cart("steps", "steps = 0"), {"bad.toml:8:9: steps: found 0", ">= 1"});
  expect_refused(cart("steps", "stpes = 5"), {"bad.toml:8:", "stpes", "did you mean 'steps'?"});
  expect_refused("A = [", {"bad.toml:1:"});
}

TEST_F(Tool, RefusesAnAsymmetricQ) {
  const std::string two =
      "name = \"two\"\nA = { identity = 2 }\nB = { identity = 2 }\nC = { identity = 2 }\n"
      "Q = [[1, 0.5], [0.25, 1]]\nR = [[1, 2], [2, 1]]\nP0 = { identity = 2 }\nsteps = 1\n";
  expect_refused(two, {"bad.toml:5:", "Q[1,0]", "found 0.25", "expected 0.5", "symmetric"});
  std::string indefinite = two;
  indefinite.replace(indefinite.find("0.5], [0.25"), 11, "0.5], [0.5");
  expect_refused(indefinite, {"bad.toml:6:", "R", "semidefinite"});
}

// Results.

TEST_F(Tool, RunWritesTableFolderAndJson) {
  put(here / "cart.toml", cart());
  const Outcome outcome = run({"run", "cart.toml", "--filters", "^(ckf|srcf)$", "--json", "copy.json"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_NE(outcome.out.find("cart: n = 2, m = 1, p = 1, 5 steps"), std::string::npos) << outcome.out;
  EXPECT_TRUE(has_row(outcome.out, "ckf")) << outcome.out;
  EXPECT_TRUE(has_row(outcome.out, "srcf")) << outcome.out;
  EXPECT_NE(outcome.out.find("kfstab-out/run-cart/index.html"), std::string::npos) << outcome.out;
  const json document = results("kfstab-out/run-cart");
  EXPECT_EQ(document["schema"], "kfstab.run/1");
  EXPECT_EQ(filters_of(document), (std::vector<std::string>{"ckf", "srcf"}));
  EXPECT_EQ(document["systems"][0]["steps"], 5);
  EXPECT_EQ(read(here / "copy.json"), read(here / "kfstab-out/run-cart/results.json"));
  EXPECT_TRUE(fs::exists(here / "kfstab-out/run-cart/cart-covariance-error.csv"));
}

TEST_F(Tool, PicturesAreDrawnWhereGnuplotIs) {
  if (!fs::exists("/usr/bin/gnuplot")) GTEST_SKIP() << "no gnuplot here";
  const Outcome outcome =
      run({.arguments = {"run", "local-level", "--filters", "^ckf$", "--steps", "4", "--out", "out"},
           .environment = {user_path()}});
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_EQ(outcome.err, "");
  for (const char* file :
       {"local-level-covariance-error.svg", "local-level-covariance-error.png", "local-level-gain-error.svg",
        "local-level-asymmetry.png", "local-level-smallest-eigenvalue.svg"})
    EXPECT_GT(fs::file_size(here / "out" / file), 1000u) << file;
  EXPECT_NE(read(here / "out" / "index.html").find("<svg"), std::string::npos);
}

TEST_F(Tool, WithoutGnuplotThereIsAWarningAndTheDataAndScripts) {
  const Outcome outcome = run({"run", "local-level", "--filters", "^ckf$", "--steps", "4", "--out", "out"});
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_NE(outcome.err.find("kfstab: warning: "), std::string::npos) << outcome.err;
  EXPECT_EQ(count(outcome.err, "gnuplot was not found"), 1u) << outcome.err;
  for (const char* figure : {"covariance-error", "gain-error", "asymmetry", "smallest-eigenvalue"})
    for (const char* ending : {".csv", ".dat", ".gp"})
      EXPECT_TRUE(fs::exists(here / "out" / (std::string("local-level-") + figure + ending))) << figure << ending;
  EXPECT_TRUE(fs::exists(here / "out" / "index.html"));
}

TEST_F(Tool, JsonToStdoutStandsThereAlone) {
  const Outcome outcome =
      run({"run", "local-level", "--filters", "^ckf$", "--steps", "4", "--out", "out", "--json", "-"});
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_EQ(json::parse(outcome.out)["schema"], "kfstab.run/1");
  EXPECT_EQ(outcome.out, read(here / "out" / "results.json"));
  EXPECT_NE(outcome.err.find("local-level: n = 1"), std::string::npos) << "the table goes to stderr";
  const Outcome claim = run({"claim", "dyer", "--set", "steps=1", "--out", "out2", "--json", "-"});
  EXPECT_EQ(json::parse(claim.out)["schema"], "kfstab.claims/1");
}

TEST_F(Tool, ClaimsAreJudgedAndCounted) {
  const Outcome outcome = run({"claim", "dyer", "--set", "steps=2*2", "--out", "out"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_TRUE(outcome.out.ends_with("\n1 passed, 0 failed\n")) << outcome.out;
  const json document = results();
  EXPECT_EQ(document["schema"], "kfstab.claims/1");
  EXPECT_EQ(document["parameters"]["steps"], 4);
  EXPECT_EQ(document["claims"].size(), 1u);
  EXPECT_EQ(document["claims"][0]["verdict"], "confirmed");
  const Outcome all_but = run({"claim", "--out", "out", "--", "-^(?!dyer)"});
  EXPECT_EQ(results()["claims"][0]["id"], "dyer-mcreynolds") << all_but.err;
  EXPECT_EQ(results()["claims"].size(), 1u);
}

TEST_F(Tool, ABreakdownIsAResult) {
  const Outcome outcome =
      run({"run", "dyer-mcreynolds", "--set", "d=2^-30", "--steps", "2", "--filters", "^(ckf|srcf)$", "--out", "out"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(results()["systems"][0]["filters"][0]["failure"]["step"], 0);
  EXPECT_NE(outcome.out.find(results()["systems"][0]["filters"][0]["failure"]["status"].get<std::string>() + " at 0"),
            std::string::npos)
      << outcome.out;
}

TEST_F(Tool, WhereTheReferenceHasNoAnswerTheInputIsBad) {
  put(here / "none.toml",
      "name = \"none\"\nA = 0.5\nB = 1\nC = { list = [1, 0] }\nQ = 1\nR = { list = [1, 0] }\nP0 = 1\nsteps = 2\n");
  const Outcome outcome = run({"run", "none.toml", "--filters", "^ckf$", "--out", "out"});
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_NE(outcome.err.find("none: the reference has no answer"), std::string::npos) << outcome.err;
  EXPECT_EQ(count(outcome.err, "step 1"), 1u) << outcome.err;
  EXPECT_EQ(results()["systems"][0]["steps"], 1);
}

// Flags and their environment twins.

TEST_F(Tool, TheFlagWinsOverItsTwinAndTheTwinOverTheDefault) {
  const std::vector<std::string> twins = {"KFSTAB_FILTERS=^srcf$", "KFSTAB_STEPS=3",     "KFSTAB_SEED=5",
                                          "KFSTAB_OUT=twin",       "KFSTAB_SET=q=0.125", "KFSTAB_JSON=twin.json",
                                          "KFSTAB_DIGITS=60",      "KFSTAB_JOBS=1"};
  ASSERT_EQ(run({.arguments = {"run", "local-level"}, .environment = twins}).exit_code, 0);
  const json twin = results("twin");
  EXPECT_EQ(filters_of(twin), std::vector<std::string>{"srcf"});
  EXPECT_EQ(twin["systems"][0]["steps"], 3);
  EXPECT_EQ(twin["systems"][0]["parameters"]["q"], .125);
  EXPECT_EQ(twin["context"]["seed"], 5);
  EXPECT_GE(twin["systems"][0]["reference"]["certified_digits"].get<int>(), 60);
  EXPECT_TRUE(fs::exists(here / "twin.json"));

  const Outcome flags = run({.arguments = {"run", "local-level", "--filters", "^ckf$", "--steps", "2", "--seed", "6",
                                           "--out", "flag", "--set", "q=2", "--json", "flag.json", "--digits", "15"},
                             .environment = twins});
  ASSERT_EQ(flags.exit_code, 0) << flags.err;
  const json flag = results("flag");
  EXPECT_EQ(filters_of(flag), std::vector<std::string>{"ckf"});
  EXPECT_EQ(flag["systems"][0]["steps"], 2);
  EXPECT_EQ(flag["systems"][0]["parameters"]["q"], 2) << "KFSTAB_SET won over --set";
  EXPECT_EQ(flag["context"]["seed"], 6);
  EXPECT_LT(flag["systems"][0]["reference"]["certified_digits"].get<int>(), 60);
  EXPECT_TRUE(fs::exists(here / "flag.json"));
}

TEST_F(Tool, ABadTwinIsRefusedWhereItCountsAndNowhereElse) {
  const Outcome run_it = run({.arguments = {"run", "local-level"}, .environment = {"KFSTAB_STEPS=0"}});
  EXPECT_EQ(run_it.exit_code, 2);
  EXPECT_NE(run_it.err.find("--steps"), std::string::npos) << run_it.err;
  EXPECT_EQ(run({.arguments = {"list", "claims"}, .environment = {"KFSTAB_STEPS=0"}}).exit_code, 0);
}

// Folders.

TEST_F(Tool, ASecondRunReplacesTheFirstAndNothingElse) {
  ASSERT_EQ(run({"run", "double-integrator", "--filters", "^ckf$", "--steps", "3", "--out", "out"}).exit_code, 0);
  put(here / "out" / "notes.txt", "mine");
  ASSERT_EQ(run({"run", "local-level", "--filters", "^ckf$", "--steps", "4", "--out", "out"}).exit_code, 0);
  EXPECT_EQ(results()["systems"][0]["steps"], 4);
  EXPECT_FALSE(fs::exists(here / "out" / "double-integrator-gain-error.csv")) << "left over from the run before";
  EXPECT_EQ(read(here / "out" / "notes.txt"), "mine");
  const auto files = entries(here / "out");
  ASSERT_EQ(run({"run", "local-level", "--filters", "^ckf$", "--steps", "5", "--out", "out"}).exit_code, 0);
  EXPECT_EQ(results()["systems"][0]["steps"], 5);
  EXPECT_EQ(entries(here / "out"), files);
}

TEST_F(Tool, AForeignFolderIsNotTouched) {
  fs::create_directory(here / "foreign");
  put(here / "foreign" / "thesis.tex", "mine");
  for (const char* command : {"run", "claim"}) {
    const Outcome outcome = run({command, std::string(command) == "run" ? "local-level" : "dyer", "--out", "foreign"});
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_NE(outcome.err.find("cannot use folder foreign: it is not empty"), std::string::npos) << outcome.err;
    EXPECT_EQ(outcome.out, "") << "said before any work";
    EXPECT_EQ(entries(here / "foreign"), 1u);
    EXPECT_EQ(read(here / "foreign" / "thesis.tex"), "mine");
  }
}

TEST_F(Tool, WhatCannotBeWrittenIsSaid) {
  put(here / "file", "mine");
  for (const std::string out : {"file", "file/below", "/proc/kfstab"}) {
    const Outcome outcome = run({"run", "local-level", "--filters", "^ckf$", "--steps", "2", "--out", out});
    EXPECT_EQ(outcome.exit_code, 2) << out << ": " << outcome.err;
    EXPECT_NE(outcome.err.find(out), std::string::npos) << outcome.err;
    EXPECT_EQ(outcome.out, "") << "said before any work";
  }
  EXPECT_EQ(read(here / "file"), "mine");
  const Outcome json_file = run(
      {"run", "local-level", "--filters", "^ckf$", "--steps", "2", "--out", "out", "--json", "no/such/folder.json"});
  EXPECT_EQ(json_file.exit_code, 2);
  EXPECT_NE(json_file.err.find("no/such/folder.json"), std::string::npos) << json_file.err;
}

TEST_F(Tool, AFileSizeLimitIsSaidAndLeavesNoHalves) {
  const Outcome outcome = run({.arguments = {"run", "local-level", "--out", "out"}, .file_size = 8192});
  EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
  EXPECT_NE(outcome.err.find("cannot write out/results.json: File too large"), std::string::npos) << outcome.err;
  for (const auto& entry : fs::directory_iterator(here / "out")) EXPECT_EQ(entry.path().filename(), ".kfstab");
}

TEST_F(Tool, AFullStdoutOrStderrIsNoCrash) {
  for (const auto& arguments : {std::vector<std::string>{"list", "claims"},
                                {"list", "systems"},
                                {"run", "local-level", "--filters", "^ckf$", "--steps", "2"},
                                {"run", "local-level", "--filters", "^ckf$", "--steps", "2", "--json", "-"}}) {
    const Outcome outcome = run({.arguments = arguments, .stdout_to = "/dev/full"});
    EXPECT_EQ(outcome.exit_code, 2) << arguments.back() << ": " << outcome.err;
    EXPECT_NE(outcome.err.find("cannot write standard output"), std::string::npos)
        << arguments.back() << ": " << outcome.err;
  }
  EXPECT_EQ(run({.arguments = {"run", "no-such-system"}, .stderr_to = "/dev/full"}).exit_code, 2);
}

TEST_F(Tool, PathsAreRelativeToWhereTheUserStands) {
  fs::create_directory(folder / "systems");
  put(folder / "systems" / "data.csv", "y\n1\n2\n3\n");
  put(folder / "systems" / "cart.toml", cart("steps", "steps = 3\nmeasurements = { csv = \"data.csv\" }"));
  const Outcome outcome = run({"run", "../systems/cart.toml", "--filters", "^ckf$", "--out", "deep/er/out"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_GT(results("deep/er/out")["systems"][0]["filters"][0]["last"]["state_error"].get<double>(), -1);
  EXPECT_EQ(entries(folder / "systems"), 2u) << "nothing is written beside the system";
}

// Several systems, long runs, interruptions.

TEST_F(Tool, TwoSystemsAtOnceAreAsOneAfterTheOther) {
  const auto numbers = [&](const std::string& jobs) {
    const Outcome outcome = run({"run", "constant-velocity", "local-level", "local-level", "--filters", "^(ckf|srcf)$",
                                 "--steps", "40", "--jobs", jobs, "--out", "out"});
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    json document = results();
    for (auto& system : document["systems"])
      for (auto& filter : system["filters"]) filter.erase("seconds_per_step");
    return document["systems"];
  };
  const json one = numbers("1"), two = numbers("2");
  ASSERT_EQ(two.size(), 3u);
  EXPECT_EQ(two[0]["name"], "constant-velocity");
  EXPECT_EQ(two[1]["name"], "local-level");
  EXPECT_EQ(one, two);
  EXPECT_TRUE(fs::exists(here / "out" / "local-level-2-gain-error.csv")) << "a system twice has its figures twice";
}

TEST_F(Tool, InterruptedTheStepsDoneAreWrittenInBoundedMemory) {
  const Outcome outcome = run(
      {.arguments = {"run", "constant-velocity", "--filters", "^(ckf|srcf)$", "--steps", "10000000", "--out", "out"},
       .interrupt_after = 1.5,
       .stderr_is_terminal = true});
  EXPECT_EQ(outcome.exit_code, 130) << outcome.err;
  EXPECT_NE(outcome.err.find("run constant-velocity: "), std::string::npos)
      << "no progress on a terminal: " << outcome.err;
  EXPECT_NE(outcome.err.find(" of 10000000 ("), std::string::npos) << outcome.err;
  EXPECT_NE(outcome.err.find("kfstab: interrupted; the steps done are written"), std::string::npos) << outcome.err;
  EXPECT_EQ(outcome.out.find("\x1b"), std::string::npos) << "the progress went to stdout";
  EXPECT_LT(outcome.max_resident_kib, 300 * 1024);
  const json system = results()["systems"][0];
  EXPECT_EQ(system["interrupted"], true);
  EXPECT_EQ(system["steps_asked"], 10'000'000);
  const auto steps = system["steps"].get<std::int64_t>();
  EXPECT_GT(steps, 0);
  EXPECT_LT(steps, 10'000'000);
  for (const auto& filter : system["filters"]) {
    EXPECT_EQ(filter["curves"]["covariance_error"]["count"], steps);
    EXPECT_EQ(filter["curves"]["covariance_error"]["step"].back(), steps - 1);
    EXPECT_TRUE(filter["failure"].is_null());
  }
  EXPECT_TRUE(fs::exists(here / "out" / "index.html"));
}

TEST_F(Tool, InterruptedClaimsThatWereFinishedAreWritten) {
  const Outcome outcome = run({.arguments = {"claim", "--set", "frames=1000", "--out", "out"}, .interrupt_after = 1.});
  EXPECT_EQ(outcome.exit_code, 130) << outcome.err;
  EXPECT_NE(outcome.err.find("kfstab: interrupted"), std::string::npos) << outcome.err;
  const json document = results();
  EXPECT_EQ(document["schema"], "kfstab.claims/1");
  EXPECT_LT(document["claims"].size(), kfstab::experiments::all_claims().size());
  for (const auto& claim : document["claims"])
    EXPECT_NE(claim["id"], "innovation-conditioning") << "was cut short, and judged";
}

TEST_F(Tool, OffATerminalThereIsNoProgress) {
  const Outcome outcome = run({"run", "constant-velocity", "--filters", "^ckf$", "--steps", "3000", "--out", "out"});
  EXPECT_EQ(outcome.err.find("\x1b"), std::string::npos);
  EXPECT_EQ(outcome.err.find(" of 3000"), std::string::npos) << outcome.err;
}

// The reference: exact numbers in, certified digits out.

TEST_F(Tool, ReferencePrintsCertifiedDigits) {
  put(here / "cart.toml", cart("R", "R = \"1/3\""));
  const Outcome outcome = run({"reference", "cart.toml", "--digits", "40", "--steps", "2", "--set", "q=1e-30"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(outcome.err, "");
  EXPECT_EQ(outcome.out.find("cart: n = 2, m = 1, p = 1, 2 steps; the reference, to 40 digits\nk = 0, "), 0u)
      << outcome.out;
  // Re = P0[0,0] + R = 7/3, K = A P C' / Re = (2 + .5 / 2, .5) 3 / 7
  EXPECT_NE(outcome.out.find("  Re[0,0]           2.333333333333333333333333333333333333333\n"), std::string::npos)
      << outcome.out;
  EXPECT_NE(outcome.out.find("  K[0,0]            0.9642857142857142857142857142857142857143\n"), std::string::npos)
      << outcome.out;
  EXPECT_NE(outcome.out.find("\nk = 1, "), std::string::npos);
  EXPECT_EQ(outcome.out.find("x["), std::string::npos) << "there are no data";
  EXPECT_EQ(entries(here), 1u) << "nothing is written";
}

TEST_F(Tool, ReferencePrintsFirstAndLastStepsOfALongRun) {
  const Outcome outcome = run({"reference", "local-level", "--steps", "100"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(count(outcome.out, "digits certified\n"), 6u);
  EXPECT_NE(outcome.out.find("\nk = 3 to 96: left out here; --json FILE has them\nk = 97, "), std::string::npos)
      << outcome.out;
  EXPECT_EQ(count(run({"reference", "local-level", "--steps", "6"}).out, "left out"), 0u);
}

TEST_F(Tool, ReferenceAsJson) {
  const Outcome to_file = run({"reference", "local-level", "--steps", "20", "--digits", "60", "--json", "out.json"});
  EXPECT_EQ(to_file.exit_code, 0) << to_file.err;
  EXPECT_EQ(to_file.out, "20 steps: out.json\n");
  const std::string text = read(here / "out.json");
  EXPECT_EQ(text.find("{\n \"schema\": \"kfstab.reference/1\",\n \"context\": {"), 0u) << text.substr(0, 80);
  const json document = json::parse(text);
  EXPECT_EQ(document["system"]["name"], "local-level");
  EXPECT_EQ(document["digits"], 60);
  EXPECT_EQ(document["steps_asked"], 20);
  EXPECT_EQ(document["interrupted"], false);
  ASSERT_EQ(document["steps"].size(), 20u);
  for (int k = 0; k < 20; ++k) {
    const json& step = document["steps"][static_cast<std::size_t>(k)];
    EXPECT_EQ(step["k"], k);
    EXPECT_GE(step["certified_digits"].get<int>(), 60);
    EXPECT_EQ(step["P"][0][0].get<std::string>().size(), 61u) << "60 digits and a point: " << step["P"];
    for (const char* key : {"P_filtered", "K", "Re", "x", "log_likelihood", "y"})
      EXPECT_TRUE(step.contains(key)) << key;
  }
  const Outcome to_stdout = run({.arguments = {"reference", "local-level"},
                                 .environment = {"KFSTAB_STEPS=20", "KFSTAB_DIGITS=60", "KFSTAB_JSON=-"}});
  EXPECT_EQ(to_stdout.exit_code, 0);
  EXPECT_EQ(to_stdout.err, "");
  EXPECT_EQ(json::parse(to_stdout.out)["steps"], document["steps"]);
}

TEST_F(Tool, ReferenceWithoutAnAnswerKeepsWhatIsBeforeAndIsTwo) {
  const std::string certain =
      "name = \"certain\"\nsteps = 3\nA = 0\nB = [[]]\nC = 1\nQ = []\nR = { list = [1, 0, 1] }\nP0 = 1\n";
  put(here / "certain.toml", certain);
  const Outcome outcome = run({"reference", "certain.toml", "--json", "out.json"});
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_EQ(outcome.err.find("kfstab: certain: the reference has no answer: step 1: "), 0u) << outcome.err;
  const json document = json::parse(read(here / "out.json"));
  EXPECT_EQ(document["steps"].size(), 1u);
  EXPECT_NE(document["error"].get<std::string>().find("step 1"), std::string::npos);
  const Outcome printed = run({"reference", "certain.toml"});
  EXPECT_EQ(printed.exit_code, 2);
  EXPECT_EQ(count(printed.out, "digits certified\n"), 1u) << printed.out;
}

TEST_F(Tool, ReferenceOfMillionsOfStepsFitsAndIsInterrupted) {
  const std::size_t one = static_cast<std::size_t>(
      run({"reference", "local-level", "--steps", "1", "--json", "one.json"}).max_resident_kib);
  const Outcome outcome =
      run({.arguments = {"reference", "local-level", "--steps", "9000000", "--json", "out.json", "--cache", "cache"},
           .interrupt_after = 1.5,
           .stderr_is_terminal = true});
  EXPECT_EQ(outcome.exit_code, 130) << outcome.err;
  EXPECT_NE(outcome.err.find("interrupted; the steps done are written"), std::string::npos) << outcome.err;
  const json document = json::parse(read(here / "out.json"));
  EXPECT_EQ(document["interrupted"], true);
  EXPECT_EQ(document["steps_asked"], 9000000);
  EXPECT_EQ(entries(here / "cache"), 0u) << "half a trajectory is not kept";
  // A step is 300 bytes of text; beside them only buffers of 64 KiB each.
  EXPECT_LT(static_cast<std::size_t>(outcome.max_resident_kib), one + 4096) << document["steps"].size() << " steps";
}

TEST_F(Tool, ReferenceFromTheCacheIsTheSame) {
  const std::vector<std::string> arguments = {"reference", "rotation", "--steps", "40", "--cache", "cache"};
  auto with = [&](std::initializer_list<std::string> more) {
    auto all = arguments;
    all.insert(all.end(), more);
    return run(all);
  };
  const Outcome plain = run({"reference", "rotation", "--steps", "40"}), first = with({}), second = with({});
  EXPECT_EQ(first.exit_code, 0) << first.err;
  EXPECT_EQ(first.out, plain.out);
  EXPECT_EQ(second.out, plain.out);
  EXPECT_EQ(second.err, "");
  EXPECT_EQ(entries(here / "cache"), 1u);
  EXPECT_EQ(json::parse(with({"--json", "-"}).out)["steps"],
            json::parse(run({"reference", "rotation", "--steps", "40", "--json", "-"}).out)["steps"]);
  EXPECT_EQ(entries(here / "cache"), 1u) << "text and JSON are of one computation";
  put(here / "file", "");
  const Outcome refused = run({"reference", "rotation", "--cache", "file"});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.err.find("cannot create folder file"), std::string::npos) << refused.err;
}

TEST_F(Tool, ProcessesShareACache) {
  const Start start{.arguments = {"reference", "rotation", "--steps", "300", "--json", "-", "--cache", "cache"}};
  const json alone = json::parse(run({"reference", "rotation", "--steps", "300", "--json", "-"}).out)["steps"];
  for (int round = 0; round < 3; ++round) {
    std::vector<Outcome> outcomes(4);
    std::vector<std::thread> threads;
    for (Outcome& outcome : outcomes) threads.emplace_back([&] { outcome = run(start); });
    for (std::thread& thread : threads) thread.join();
    for (const Outcome& outcome : outcomes) {
      EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
      EXPECT_EQ(json::parse(outcome.out)["steps"], alone);
    }
    ASSERT_EQ(entries(here / "cache"), 1u);
    // The next round finds it torn.
    const fs::path file = fs::directory_iterator(here / "cache")->path();
    fs::resize_file(file, fs::file_size(file) / 2);
  }
}

TEST_F(Tool, ACacheThatCannotBeWrittenIsAWarning) {
  const Outcome outcome =
      run({.arguments = {"reference", "rotation", "--steps", "400", "--cache", "cache"}, .file_size = 70000});
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_NE(outcome.err.find("kfstab: warning: nothing is kept in the cache: cannot write cache/"), std::string::npos)
      << outcome.err;
  EXPECT_EQ(outcome.out, run({"reference", "rotation", "--steps", "400"}).out);
  EXPECT_EQ(entries(here / "cache"), 0u);
}

TEST_F(Tool, ReportRendersStoredResultsAgainWithoutRunning) {
  ASSERT_EQ(run({"run", "local-level", "--steps", "5", "--out", "out"}).exit_code, 0);
  const Outcome again = run({"report", "out", "--out", "again", "--format", "html,markdown"});
  EXPECT_EQ(again.exit_code, 0) << again.err;
  EXPECT_NE(again.out.find("local-level: n = 1"), std::string::npos) << again.out;
  EXPECT_EQ(read(here / "again" / "index.html"), read(here / "out" / "index.html"));
  EXPECT_EQ(read(here / "again" / "results.json"), read(here / "out" / "results.json"));
  EXPECT_EQ(read(here / "again" / "local-level-gain-error.csv"), read(here / "out" / "local-level-gain-error.csv"));
  EXPECT_TRUE(fs::exists(here / "again" / "report.md"));
  EXPECT_EQ(run({"report", "out/results.json", "--out", "out"}).exit_code, 0) << "into its own folder";
  EXPECT_EQ(read(here / "again" / "index.html"), read(here / "out" / "index.html"));
}

TEST_F(Tool, ReportOfTwoFailsIfAVerdictGotWorse) {
  ASSERT_EQ(run({"claim", "asymmetry-divergence", "--out", "good"}).exit_code, 0);
  json worse = results("good");
  worse["claims"][0]["checks"][0]["holds"] = false;
  put(here / "bad.json", worse.dump());
  const Outcome same = run({"report", "good", "good/results.json"});
  EXPECT_EQ(same.exit_code, 0) << same.err;
  EXPECT_NE(same.out.find("No verdict has changed."), std::string::npos) << same.out;
  const Outcome fallen = run({"report", "good", "bad.json", "--out", "difference"});
  EXPECT_EQ(fallen.exit_code, 1) << fallen.err;
  EXPECT_NE(fallen.out.find("asymmetry-divergence"), std::string::npos) << fallen.out;
  EXPECT_TRUE(fs::exists(here / "difference" / "index.html"));
  EXPECT_FALSE(fs::exists(here / "difference" / "results.json"));
  EXPECT_EQ(run({"report", "bad.json", "good"}).exit_code, 0) << "better is no fault";
}

TEST_F(Tool, ReportRefusesRubbishBeforeItWritesAnything) {
  put(here / "rubbish.json", "{");
  put(here / "future.json", R"({"schema": "kfstab.run/9"})");
  for (const char* file : {"rubbish.json", "future.json", "missing.json"}) {
    const Outcome outcome = run({"report", file, "--out", "out"});
    EXPECT_EQ(outcome.exit_code, 2) << file;
    EXPECT_NE(outcome.err.find(file), std::string::npos) << outcome.err;
    EXPECT_EQ(count(outcome.err, "\n"), 1u) << outcome.err;
  }
  EXPECT_FALSE(fs::exists(here / "out"));
  EXPECT_EQ(run({"report"}).exit_code, 2);
  EXPECT_EQ(run({"report", "future.json", "--for", "cinema"}).exit_code, 2);
}

TEST_F(Tool, FormatAndMediumHaveTheirTwinsInTheEnvironment) {
  const Outcome outcome = run(Start{.arguments = {"run", "local-level", "--steps", "3", "--out", "out"},
                                    .environment = {"KFSTAB_FORMAT=markdown,pdf", "KFSTAB_FOR=slide"}});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_TRUE(fs::exists(here / "out" / "report.md"));
  EXPECT_FALSE(fs::exists(here / "out" / "index.html"));
  EXPECT_NE(outcome.err.find("no report.pdf: chromium was not found"), std::string::npos) << outcome.err;
  EXPECT_NE(read(here / "out" / "local-level-asymmetry.gp").find("size 960,540"), std::string::npos);
}

TEST_F(Tool, ComparesOverAScanAndRecommends) {
  const Outcome outcome = run({"compare", "dyer-mcreynolds", "--filters", "^(ckf|joseph|srcf)$", "--scan",
                               "d=2^-28:2^-8:log:3", "--out", "out", "--json", "-"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  const json root = json::parse(outcome.out);
  EXPECT_EQ(root["schema"], "kfstab.compare/1");
  EXPECT_EQ(root, results());
  EXPECT_EQ(root["points"].size(), 3u);
  EXPECT_EQ(root["recommendation"]["filter"], "srcf");
  EXPECT_NE(outcome.err.find("Take srcf"), std::string::npos) << outcome.err;
  EXPECT_NE(outcome.err.find("sound at"), std::string::npos) << outcome.err;
  EXPECT_TRUE(fs::exists(here / "out/scan-covariance.csv"));
  EXPECT_NE(read(here / "out/index.html").find("Take srcf"), std::string::npos);
}

TEST_F(Tool, ComparesOverTwoScansWithBitsAmongThem) {
  const Outcome outcome = run({"compare", "double-integrator", "--steps", "20", "--filters", "^(ckf|srcf)$", "--scan", "bits=12,24",
                               "--scan", "scale:R=1,4", "--set", "q=0.5", "--out", "out", "--jobs", "1"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  const json root = results();
  ASSERT_EQ(root["points"].size(), 4u);
  EXPECT_EQ(root["system"]["parameters"]["q"], 0.5);
  EXPECT_EQ(root["points"][1]["bits"], 12);
  EXPECT_EQ(root["points"][1]["at"]["scale:R"], 4);
  EXPECT_NE(outcome.out.find("Words: "), std::string::npos) << outcome.out;
  EXPECT_TRUE(fs::exists(here / "out/scan-gain-1.csv"));
}

TEST_F(Tool, ComparesWithoutAScan) {
  const Outcome outcome = run({"compare", "local-level", "--filters", "^(ckf|srcf)$", "--out", "out"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_NE(outcome.out.find("Take ckf"), std::string::npos) << outcome.out;
  EXPECT_EQ(results()["points"].size(), 0u);
  EXPECT_TRUE(fs::exists(here / "out/local-level-covariance-error.csv"));
}

TEST_F(Tool, CompareRefusesRubbish) {
  const std::vector<std::vector<std::string>> rubbish = {
      {"--scan", "d"},
      {"--scan", "d=1:2:log"},
      {"--scan", "unknown=1,2"},
      {"--scan", "R[7,7]=1,2"},
      {"--scan", "R[0,1]=1,2"},
      {"--scan", "bits=2,3"},
      {"--scan", "d=1,2", "--scan", "d=1,2"},
      {"--scan", "d=1,2", "--scan", "bits=24,53", "--scan", "scale:R=1,2"},
      {"--scan", "d=1:2:lin:1000", "--scan", "scale:R=1:2:lin:1000"},
      {"--accurate", "-1"},
      {"--steps", "0"},
  };
  for (const auto& arguments : rubbish) {
    std::vector<std::string> all = {"compare", "dyer-mcreynolds", "--filters", "^ckf$", "--out", "out"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    const Outcome outcome = run(all);
    EXPECT_EQ(outcome.exit_code, 2) << arguments[1] << ": " << outcome.err;
    EXPECT_EQ(outcome.err.find("kfstab: "), 0u) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    EXPECT_FALSE(fs::exists(here / "out"));
  }
}

TEST_F(Tool, AnInterruptedComparisonKeepsThePointsDone) {
  const Outcome outcome = run({.arguments = {"compare", "double-integrator", "--filters", "^ckf$", "--scan", "q=1:2:lin:1000",
                                             "--jobs", "1", "--out", "out"},
                               .interrupt_after = 1.5});
  EXPECT_EQ(outcome.exit_code, 130) << outcome.err;
  EXPECT_NE(outcome.err.find("interrupted; the points done are written"), std::string::npos) << outcome.err;
  const json root = results();
  EXPECT_EQ(root["interrupted"], true);
  EXPECT_LT(root["points"].size(), 1000u);
}

TEST_F(Tool, ExplainsASystemAndAStoredRun) {
  const Outcome live = run({"explain", "dyer-mcreynolds", "--filters", "^(ckf|srcf)$", "--out", "live"});
  EXPECT_EQ(live.exit_code, 0) << live.err;
  EXPECT_NE(live.out.find("ckf loses "), std::string::npos) << live.out;
  EXPECT_NE(live.out.find("entry of P that is most wrong"), std::string::npos) << live.out;
  const json explained = results("live");
  EXPECT_EQ(explained["schema"], "kfstab.explain/1");
  EXPECT_EQ(explained["systems"][0]["filters"][0]["entry_errors"].size(), 3u);
  EXPECT_TRUE(fs::exists(here / "live/system-1-entries-1.csv"));

  ASSERT_EQ(run({"run", "dyer-mcreynolds", "--filters", "^(ckf|srcf|joseph)$", "--out", "run"}).exit_code, 0);
  const Outcome stored = run({"explain", "run/results.json", "--filters", "^(ckf|srcf)$", "--out", "stored"});
  EXPECT_EQ(stored.exit_code, 0) << stored.err;
  const json again = results("stored");
  ASSERT_EQ(again["systems"][0]["filters"].size(), 2u);
  EXPECT_EQ(again["systems"][0]["filters"][0]["losses"], explained["systems"][0]["filters"][0]["losses"]);

  EXPECT_EQ(run({"explain", "run/results.json", "--filters", "^ud$"}).exit_code, 5);
  EXPECT_EQ(run({"explain", "run/results.json", "--set", "d=1"}).exit_code, 2);
  EXPECT_EQ(run({"explain", "live/results.json"}).exit_code, 2);
  put(here / "broken.json", "{");
  EXPECT_EQ(run({"explain", "broken.json"}).exit_code, 2);
}
