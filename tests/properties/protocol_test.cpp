#include <kfstab/properties/protocol.hpp>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <thread>

#include <dlfcn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fmt/format.h>

#include <kfstab/properties/check.hpp>
#include <kfstab/properties/data.hpp>
#include <kfstab/properties/failure_message.hpp>
#include <kfstab/properties/input_error.hpp>
#include <kfstab/properties/json_line.hpp>
#include <kfstab/properties/typed_filter.hpp>

#include "properties/foreign/in_process.hpp"
#include "properties/systems.hpp"

using namespace kfstab;
using namespace kfstab::properties;
using kfstab::properties::testing::InProcess;
using namespace std::chrono_literals;
namespace fs = std::filesystem;

namespace {

std::string foreign(const std::string& mode, const std::string& file = "") {
  return fmt::format("exec {} {} {}", KFSTAB_FOREIGN_FILTER, mode, file);
}

/// Three states, two noises, two outputs, an input, and missing measurements; nothing symmetric but what has to be.
System demanding() {
  System system;
  system.name = "demanding";
  Matrix<double> A(3, 3), B(3, 2), C(2, 3), D(3, 1), Q(2, 2), R(2, 2), P0(3, 3);
  A << 0.9, 0.3, -0.1, 1.0 / 3, 1.1, 0.2, 0, -0.7, 0.5;
  B << 1, 0.1, 0, 2, -0.5, 1e-7;
  C << 1, 0, 2e5, 0.3, -1, 0;
  D << 1, -2, 0.1;
  Q << 2, 0.3, 0.3, 1e-3;
  R << 1e3, 0.1, 0.1, 0.7;
  P0 << 3, 1, 0.5, 1, 2, 0.1, 0.5, 0.1, 1;
  system.A = A;
  system.B = B;
  system.C = C;
  system.D = D;
  system.Q.value = Q;
  system.R.value = R;
  system.P0.value = P0;
  system.x0 = Vector<double>::LinSpaced(3, -1, 0.7);
  system.steps = 12;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Matrix<double> y(2, 12), u(1, 12);
  for (Index k = 0; k < 12; ++k) {
    const double t = static_cast<double>(k);
    y.col(k) << std::sin(t) * 1e5, std::cos(t);
    u(0, k) = k == 0 ? -0.0 : t / 7;
  }
  y(0, 3) = y(1, 5) = y(0, 7) = y(1, 7) = nan;
  system.data = std::make_shared<Recorded>(y, u);
  return system;
}

System small() {
  System system = demanding();
  system.data = nullptr;
  system.steps = 4;
  return system;
}

struct Outcome {
  Ending ending;
  std::vector<Answer> answers;
};

Outcome run(Subject& subject, const System& system) {
  Outcome outcome;
  outcome.ending = subject.run(system, [&](std::int64_t, const Answer& answer) {
    outcome.answers.push_back(answer);
    return true;
  });
  return outcome;
}

void expect_same(const Outcome& left, const Outcome& right) {
  ASSERT_EQ(left.answers.size(), right.answers.size()) << left.ending.reason << right.ending.reason;
  for (std::size_t k = 0; k < left.answers.size(); ++k) {
    const Answer &a = left.answers[k], &b = right.answers[k];
    const std::string at = fmt::format("step {}", k);
    properties::testing::expect_same_bits(a.held, b.held, "P, " + at);
    properties::testing::expect_same_bits(*a.state, *b.state, "x, " + at);
    ASSERT_EQ(a.gain.has_value(), b.gain.has_value()) << at;
    if (a.gain) properties::testing::expect_same_bits(*a.gain, *b.gain, "K, " + at);
  }
}

Limits hasty() {
  Limits limits;
  limits.reply = limits.startup = 500ms;
  limits.output = 1 << 20;
  return limits;
}

/// The fault that ends a run.
SubjectFault fault_of(const std::string& command, const Limits& limits = hasty()) {
  try {
    const auto subject = exec_subject(command, limits);
    const Outcome outcome = run(*subject, small());
    ADD_FAILURE() << command << ": no fault, " << outcome.ending.reason;
  } catch (const SubjectFault& fault) {
    return fault;
  }
  return {SubjectFault::Kind::limit, ""};
}

Ending ending_of(const std::string& mode) { return run(*exec_subject(foreign(mode), hasty()), small()).ending; }

void expect_has(const std::string& text, const std::string& part) {
  EXPECT_NE(text.find(part), text.npos) << "no \"" << part << "\" in: " << text;
}

/// The processes that a test program wrote down, and whether they are still there a moment later.
class Written {
 public:
  Written() : path_(fs::temp_directory_path() / fmt::format("kfstab-protocol-test-{}", ::getpid())) {
    fs::remove(path_);
  }
  ~Written() { fs::remove(path_); }
  std::string path() const { return path_.string(); }

  std::vector<pid_t> processes() const {
    std::vector<pid_t> found;
    std::ifstream file(path_);
    for (pid_t process; file >> process;) found.push_back(process);
    return found;
  }
  /// It is written by a process that nobody waits for.
  std::vector<pid_t> wait_for_processes() const {
    for (int i = 0; i < 500 && processes().empty(); ++i) std::this_thread::sleep_for(10ms);
    return processes();
  }

 private:
  fs::path path_;
};

bool runs(pid_t process) { return ::kill(process, 0) == 0 || errno != ESRCH; }

}  // namespace

// --- lines ----------------------------------------------------------------------------------------------------------------

TEST(JsonLine, NumbersReadBackBitByBit) {
  const double infinity = std::numeric_limits<double>::infinity();
  Vector<double> all(12);
  all << 0.0, -0.0, 1, -1, 0.1, 1.0 / 3, 1e300, 5e-324, 123456789012345678.0, 1e22, -infinity, infinity;
  JsonLine line;
  line.begin();
  line.vector("x", all);
  const std::string text = line.end();
  JsonMessage message;
  message.read(text.substr(0, text.size() - 1));
  Vector<double> read;
  ASSERT_TRUE(message.vector("x", 12, read));
  properties::testing::expect_same_bits(all, read, text);
  // No number may be taken for an integer by a language that has them.
  EXPECT_EQ(text.substr(0, 30), "{\"x\":[0.0,-0.0,1.0,-1.0,0.1,0.");
}

TEST(JsonLine, MatricesOfAnyShape) {
  JsonLine line;
  JsonMessage message;
  const Index sizes[][2] = {{0, 0}, {0, 3}, {3, 0}, {1, 1}, {1, 3}, {3, 1}, {2, 3}};
  for (const auto& [rows, cols] : sizes) {
    const Matrix<double> X = Matrix<double>::Random(rows, cols);
    JsonLine::Kept kept;
    for (int round = 0; round < 2; ++round) {
      line.begin();
      line.matrix("X", X, kept);
      const std::string text = line.end();
      message.read(std::string_view(text).substr(0, text.size() - 1));
      Matrix<double> read;
      ASSERT_TRUE(message.matrix("X", rows, cols, read)) << text;
      properties::testing::expect_same_bits(X, read, text);
    }
  }
}

TEST(JsonMessage, IsLenientWhereOthersWriteTheSameThingOtherwise) {
  JsonMessage message;
  message.read(
      R"( {"K":[1,2], "row":[[1],[2]],"one":3 ,"e":[],"n":[NaN,null,"nan",-Infinity], "o":{"a":[1,{"b":[]}],"x":"]"}, "loglik":-1} )");
  Matrix<double> X;
  Vector<double> x;
  EXPECT_TRUE(message.matrix("K", 2, 1, X));
  EXPECT_EQ(X(1, 0), 2);
  EXPECT_TRUE(message.matrix("K", 1, 2, X));
  EXPECT_TRUE(message.vector("row", 2, x));
  EXPECT_TRUE(message.matrix("one", 1, 1, X));
  EXPECT_TRUE(message.vector("one", 1, x));
  EXPECT_TRUE(message.matrix("e", 0, 4, X));
  EXPECT_TRUE(message.vector("n", 4, x));
  EXPECT_TRUE(std::isnan(x(0)) && std::isnan(x(1)) && std::isnan(x(2)) && x(3) < -1e308);
  EXPECT_EQ(message.number("loglik"), -1.0);
  EXPECT_FALSE(message.vector("absent", 1, x));
}

TEST(JsonMessage, SaysWhatIsWrong) {
  JsonMessage message;
  const auto complaint = [&](const std::string& line) -> std::string {
    try {
      message.read(line);
      Matrix<double> X;
      message.matrix("P", 2, 2, X);
    } catch (const Malformed& why) {
      return why.what();
    }
    return "none";
  };
  EXPECT_EQ(complaint(R"({"P":[[1,2],[3,4]]})"), "none");
  EXPECT_EQ(complaint(R"({"P":[[1,2,3],[3,4,5]]})"), "has a wrong P: it is 2 x 3, expected 2 x 2");
  EXPECT_EQ(complaint(R"({"P":[[1,2],[3]]})"),
            "has a wrong P: it is ragged: row 0 has 2 entries, row 1 has 1, expected 2 x 2");
  EXPECT_EQ(complaint(R"({"P":[1,2,3,4]})"), "has a wrong P: it is an array of 4 numbers, expected 2 x 2");
  EXPECT_EQ(complaint(R"({"P":"none"})"), "has a wrong P: it is a string, expected 2 x 2");
  EXPECT_EQ(complaint(R"({"P":[[1,2],[3,"x"]]})"), "has a wrong P: it is an array of other things, expected 2 x 2");
  EXPECT_EQ(complaint(R"({"P":[[1,2],3,4]})"), "has a wrong P: it is an array of other things, expected 2 x 2");
  EXPECT_EQ(complaint(R"({"P":1,"P":2})"), "has \"P\" twice");
  EXPECT_EQ(complaint("Step 1"), "is not a JSON object");
  EXPECT_EQ(complaint(""), "is not a JSON object");
  EXPECT_EQ(complaint(R"({"P":[1,2)"), "is not JSON: it ends after 9 characters, expected ']'");
  EXPECT_EQ(complaint(R"({"P":[1,2]} and more)"),
            "is not JSON: something else stands at character 13, expected nothing more");
  EXPECT_EQ(complaint(R"({"P":)" + std::string(100000, '[')),
            "is not JSON: something else stands at character 70, expected less depth");
}

// --- answers --------------------------------------------------------------------------------------------------------------

TEST(Protocol, AnswersAreThoseOfTheSameCodeInProcess) {
  const auto here = subject(std::make_unique<InProcess>());
  const auto there = exec_subject(foreign("correct"));
  const Outcome expected = run(*here, demanding());
  EXPECT_EQ(expected.answers.size(), 12u);
  expect_same(expected, run(*there, demanding()));
  // Once more, with the texts of the matrices that were kept, and of another size in between.
  System one = demanding();
  const Matrix<double> unity = Matrix<double>::Ones(1, 1);
  one.A = Matrix<double>(0.5 * unity);
  one.B = one.C = unity;
  one.D = Matrix<double>(1, 0);
  one.Q.value = one.R.value = one.P0.value = unity;
  one.x0 = Vector<double>::Ones(1);
  one.data = nullptr;
  expect_same(run(*here, one), run(*there, one));
  expect_same(expected, run(*there, demanding()));
}

TEST(Protocol, NoNoiseNoMeasurement) {
  const auto here = subject(std::make_unique<InProcess>());
  const auto there = exec_subject(foreign("correct"));
  System bare = small();
  bare.B = Matrix<double>(3, 0);
  bare.Q.value = Matrix<double>(0, 0);
  bare.C = Matrix<double>(0, 3);
  bare.R.value = Matrix<double>(0, 0);
  const Outcome outcome = run(*there, bare);
  EXPECT_EQ(outcome.ending.kind, Ending::Kind::done) << outcome.ending.reason;
  EXPECT_EQ(outcome.answers.size(), 4u);
  expect_same(run(*here, bare), outcome);
}

TEST(Protocol, HelloMakesTheTraits) {
  const auto plain = exec_subject(foreign("correct"));
  EXPECT_EQ(plain->traits().name, "a correct filter");
  EXPECT_EQ(plain->traits().gain, GainKind::filter);
  EXPECT_TRUE(plain->traits().starts_predicted);
  EXPECT_EQ(plain->traits().roundoff, 0x1p-53);
  EXPECT_EQ(exec_subject(foreign("single"))->traits().roundoff, 0x1p-24);
  const auto shifted = exec_subject(foreign("predict-update"));
  EXPECT_FALSE(shifted->traits().starts_predicted);
  EXPECT_EQ(shifted->traits().instant, Instant::filtered);
  const std::string needy =
      R"(read hello; echo '{"name":"x","cycle":"update-predict","gain":"none","needs":["invertible-A","time-invariant","measurement-every-step"]}'; read stop)";
  const auto needs = exec_subject(needy);
  EXPECT_TRUE(needs->traits().needs.invertible_A && needs->traits().needs.time_invariant &&
              needs->traits().measurement_every_step);
  EXPECT_FALSE(needs->traits().needs.positive_definite_R);
  EXPECT_EQ(needs->traits().holds, Held::information);
  EXPECT_EQ(needs->traits().gain, std::nullopt);
}

TEST(Protocol, AHelloThatIsNoneIsBadInput) {
  const auto complaint = [](const std::string& answer) -> std::string {
    try {
      exec_subject("read hello; echo '" + answer + "'; read stop");
    } catch (const InputError& error) {
      return error.found() + ", expected " + error.expected();
    }
    return "none";
  };
  EXPECT_EQ(complaint(R"({"cycle":"update-predict","gain":"none"})"), "none");
  EXPECT_EQ(complaint(R"({"gain":"none"})"), "nothing, expected \"update-predict\" or \"predict-update\"");
  EXPECT_EQ(complaint(R"({"cycle":"update-predict","gain":"kalman"})"),
            "\"kalman\", expected \"predictor\" or \"filter\" or \"none\"");
  expect_has(complaint(R"({"cycle":"update-predict","gain":"none","needs":["luck"]})"),
             "\"luck\", expected \"invertible-A\"");
  expect_has(complaint("Hello!"), "is not a JSON object: \"Hello!\"");
}

TEST(Protocol, ARootIsJudgedAsWhatItIs) {
  const auto root = exec_subject(foreign("root"));
  const Outcome outcome = run(*root, small());
  ASSERT_EQ(outcome.answers.size(), 4u);
  EXPECT_EQ(outcome.answers[0].holds, Held::covariance_root);
  EXPECT_EQ(root->traits().holds, Held::covariance_root);
}

TEST(Protocol, RefusalsAndWrongAnswersEndTheRunAndNoMore) {
  Ending ending = ending_of("refusing");
  EXPECT_EQ(ending.kind, Ending::Kind::refused);
  EXPECT_EQ(ending.step, 1);
  EXPECT_EQ(ending.reason, "I would rather not");
  ending = ending_of("two-states");
  EXPECT_EQ(ending.kind, Ending::Kind::refused);
  EXPECT_EQ(ending.step, -1);
  EXPECT_EQ(ending.reason, "two states alone");
  ending = ending_of("nan");
  EXPECT_EQ(ending.kind, Ending::Kind::no_answer);
  EXPECT_EQ(ending.step, 1);
  expect_has(ending.reason, "NaN");
  ending = ending_of("shape");
  EXPECT_EQ(ending.kind, Ending::Kind::no_answer);
  expect_has(ending.reason, "wrong P: it is 3 x 4, expected 3 x 3");
  ending = ending_of("rubbish");
  EXPECT_EQ(ending.kind, Ending::Kind::no_answer);
  expect_has(ending.reason, "is not a JSON object: \"Step 1\"");
}

TEST(Protocol, ALineTooManyIsSeenAndPutsNothingOutOfStep) {
  const auto echo = exec_subject(foreign("echo"));
  for (int round = 0; round < 3; ++round) {
    const Outcome outcome = run(*echo, small());
    EXPECT_EQ(outcome.ending.kind, Ending::Kind::no_answer);
    // Seen with the answer of step 1, or before the next request, as the two are read.
    EXPECT_LE(outcome.answers.size(), 2u);
  }
}

TEST(Protocol, SlowAndTalkativeFiltersAreLeftInPeace) {
  const auto here = subject(std::make_unique<InProcess>());
  const Outcome expected = run(*here, small());
  expect_same(expected, run(*exec_subject(foreign("slow"), hasty()), small()));
  expect_same(expected, run(*exec_subject(foreign("talkative"), hasty()), small()));
}

TEST(Protocol, RequestsAndAnswersLongerThanAPipe) {
  // 60,000 numbers, a megabyte, either way: a pipe holds 64 KiB.
  System large = small();
  const Index n = 200;
  large.A = Matrix<double>(Matrix<double>::Random(n, n) / 20);
  large.B = Matrix<double>(Matrix<double>::Ones(n, 1));
  large.Q.value = Matrix<double>(Matrix<double>::Ones(1, 1));
  large.C = Matrix<double>(Matrix<double>::Random(1, n));
  large.D = Matrix<double>(n, 0);
  large.R.value = Matrix<double>(Matrix<double>::Ones(1, 1));
  large.P0.value = Matrix<double>(Matrix<double>::Identity(n, n));
  large.x0 = Vector<double>::Zero(n);
  large.steps = 2;
  const auto here = subject(std::make_unique<InProcess>());
  expect_same(run(*here, large), run(*exec_subject(foreign("correct")), large));
}

// --- faults ---------------------------------------------------------------------------------------------------------------

TEST(Protocol, FaultsAreNamed) {
  SubjectFault fault = fault_of(foreign("crash"));
  EXPECT_EQ(fault.kind, SubjectFault::Kind::died);
  expect_has(fault.what(), "died of signal 11");
  expect_has(fault.what(), "at step 1 (n = 3, m = 2, p = 2)");
  expect_has(fault.what(), "\n  about to follow a null pointer");
  fault = fault_of(foreign("exit"));
  EXPECT_EQ(fault.kind, SubjectFault::Kind::died);
  expect_has(fault.what(), "ended with exit code 3 at step 1");
  fault = fault_of("/nowhere/filter");
  EXPECT_EQ(fault.kind, SubjectFault::Kind::died);
  expect_has(fault.what(), "ended with exit code 127 when it was asked for its name");
  fault = fault_of(foreign("hang"));
  EXPECT_EQ(fault.kind, SubjectFault::Kind::hung);
  expect_has(fault.what(), "did not answer within 0.5 s at step 1");
  fault = fault_of(foreign("unflushed"));
  EXPECT_EQ(fault.kind, SubjectFault::Kind::hung);
  Limits patient = hasty();
  patient.reply = 10s;
  fault = fault_of(foreign("flood"), patient);
  EXPECT_EQ(fault.kind, SubjectFault::Kind::flooded);
  fault = fault_of(foreign("flood-line"), patient);
  EXPECT_EQ(fault.kind, SubjectFault::Kind::flooded);
  expect_has(fault.what(), "more than 1 MiB");
  patient.memory = std::uint64_t{256} << 20;
  fault = fault_of(foreign("hungry"), patient);
  EXPECT_EQ(fault.kind, SubjectFault::Kind::limit);
  expect_has(fault.what(), "its limit is 256 MiB");
}

TEST(Protocol, AfterAFaultItIsStartedAnew) {
  const auto subject = exec_subject(foreign("crash"), hasty());
  for (int round = 0; round < 2; ++round) {
    std::size_t answers = 0;
    EXPECT_THROW(subject->run(small(), [&](std::int64_t, const Answer&) { return ++answers, true; }), SubjectFault);
    EXPECT_EQ(answers, 1u);
  }
}

TEST(Protocol, NothingIsLeftRunning) {
  for (const char* mode : {"correct", "grandchild", "session"}) {
    const Written written;
    {
      const auto subject = exec_subject(foreign(mode, written.path()));
      run(*subject, small());
      ASSERT_EQ(written.wait_for_processes().size(), 1u) << mode;
      EXPECT_TRUE(runs(written.processes().front())) << mode;
    }
    EXPECT_FALSE(runs(written.processes().front())) << mode;
  }
}

TEST(Protocol, NothingIsLeftRunningBehindAProgramThatEnded) {
  // Its grandchild lives on, with its pipes in hand, and the news of its death comes all the same.
  const Written written;
  const auto begin = std::chrono::steady_clock::now();
  const std::string leaves = fmt::format(
      "setsid sh -c 'trap \"\" TERM HUP; echo $$ >>{}; sleep 1000; sleep 1000' & while [ ! -s {} ]; do sleep 0.01; "
      "done; exit 5",
      written.path(), written.path());
  Limits limits;
  limits.startup = 20s;
  const SubjectFault fault = fault_of(leaves, limits);
  expect_has(fault.what(), "ended with exit code 5");
  EXPECT_LT(std::chrono::steady_clock::now() - begin, 15s);
  ASSERT_EQ(written.processes().size(), 1u);
  EXPECT_FALSE(runs(written.processes().front()));
}

TEST(Protocol, NothingIsLeftRunningWhenKfstabIsKilled) {
  const Written written;
  const pid_t victim = ::fork();
  if (victim == 0) {
    const auto subject = exec_filter(foreign("session", written.path()));
    for (;;) ::pause();
  }
  ASSERT_EQ(written.wait_for_processes().size(), 1u);
  const pid_t left = written.processes().front();
  ::kill(victim, SIGKILL);
  int status = 0;
  ::waitpid(victim, &status, 0);
  for (int i = 0; i < 1000 && runs(left); ++i) std::this_thread::sleep_for(10ms);
  EXPECT_FALSE(runs(left));
}

TEST(Protocol, ManyAtOnceDoNotHoldEachOthersPipes) {
  std::vector<std::unique_ptr<Subject>> subjects;
  for (int i = 0; i < 4; ++i) subjects.push_back(exec_subject(foreign("correct")));
  for (const auto& subject : subjects) EXPECT_EQ(run(*subject, small()).answers.size(), 4u);
  // In the order of their making: the later ones hold nothing of the earlier.
  const auto begin = std::chrono::steady_clock::now();
  for (auto& subject : subjects) subject.reset();
  EXPECT_LT(std::chrono::steady_clock::now() - begin, 10s);
}

// --- shared libraries, and the starters -------------------------------------------------------------------------------------

namespace {

/// Every law on a few systems: that a correct filter passes thousands is not the question of this test.
void expect_passes(Subject& subject) {
  CheckOptions options;
  options.cases = 6;
  const CheckReport report = check(subject, options);
  for (const LawOutcome& outcome : report.laws)
    if (outcome.failure) ADD_FAILURE() << report.subject.name << "\n" << failure_message(outcome);
  EXPECT_GT(report.steps, 0);
}

}  // namespace

TEST(Plugin, TheStarterInCPasses) {
  const auto plugin = plugin_subject(KFSTAB_STARTER_PLUGIN, {}, KFSTAB_FOREIGN_FILTER);
  EXPECT_EQ(plugin->traits().name, "textbook (C)");
  expect_passes(*plugin);
}

TEST(Plugin, ALibraryThatIsNoneIsNamed) {
  const auto complaint = [](const std::string& library) -> std::string {
    try {
      plugin_filter(library, {}, KFSTAB_FOREIGN_FILTER);
    } catch (const SubjectFault& fault) {
      return fault.what();
    }
    return "none";
  };
  expect_has(complaint("nowhere.so"), "./nowhere.so: cannot open shared object file");
  // It exports nothing of ours.
  Dl_info c_library;
  ASSERT_NE(::dladdr(reinterpret_cast<void*>(&std::exit), &c_library), 0);
  expect_has(complaint(c_library.dli_fname), "undefined symbol: kfstab_filter_abi");
}

TEST(Protocol, TheStarterInCppPasses) { expect_passes(*exec_subject(KFSTAB_STARTER)); }

// --- C++ types ----------------------------------------------------------------------------------------------------------------

namespace {

struct OwnType {
  kfstab::properties::testing::Textbook<double> filter;
  double factor = 1;  ///< 1 is right

  void start(const Vector<double>& x, const Matrix<double>& P) {
    if (x.size() > 7) throw std::length_error("seven states at most");
    filter.x = x;
    filter.P = P;
  }
  bool step(const StepInput& in) {
    if (in.y && in.y->size() > 6) return false;
    if (in.y) filter.update(in.C, factor * in.R, *in.y);
    filter.predict(in.A, in.B, in.Q);
    if (in.u) filter.x += *in.D * *in.u;
    return true;
  }
  Vector<double> state() const { return filter.x; }
  Matrix<double> covariance() const { return filter.P; }
  Matrix<double> filter_gain() const { return filter.K; }
};

struct Mistaken : OwnType {
  Mistaken() { factor = 2; }
  static Traits traits() {
    Traits traits;
    traits.name = "twice R";
    traits.measurement_every_step = true;
    return traits;
  }
};

static_assert(CheckableFilter<OwnType> && CheckableFilter<Mistaken>);
static_assert(!CheckableFilter<Traits>);

}  // namespace

TEST(TypedFilter, IsASubjectLikeAnother) {
  const auto here = subject(std::make_unique<InProcess>());
  const auto typed = typed_subject<OwnType>("OwnType");
  EXPECT_EQ(typed->traits().name, "OwnType");
  EXPECT_EQ(typed->traits().gain, GainKind::filter);
  expect_same(run(*here, demanding()), run(*typed, demanding()));
}

TEST(TypedFilter, MaySayNo) {
  const auto typed = typed_subject<OwnType>("OwnType");
  System many = small();
  many.C = Matrix<double>(Matrix<double>::Ones(7, 3));
  many.R.value = Matrix<double>(Matrix<double>::Identity(7, 7));
  EXPECT_EQ(run(*typed, many).ending.reason, "it returned false");
  System large = small();
  large.A = Matrix<double>(Matrix<double>::Identity(8, 8));
  large.B = Matrix<double>(Matrix<double>::Ones(8, 2));
  large.C = Matrix<double>(Matrix<double>::Ones(2, 8));
  large.D = Matrix<double>(8, 0);
  large.P0.value = Matrix<double>(Matrix<double>::Identity(8, 8));
  large.x0 = Vector<double>::Zero(8);
  const Outcome outcome = run(*typed, large);
  EXPECT_EQ(outcome.ending.kind, Ending::Kind::refused);
  EXPECT_EQ(outcome.ending.reason, "seven states at most");
}

TEST(TypedFilter, AMistakeIsFoundAndTold) {
  const auto mistaken = typed_subject<Mistaken>("unused");
  EXPECT_EQ(mistaken->traits().name, "twice R");
  EXPECT_TRUE(mistaken->traits().measurement_every_step);
  CheckOptions options;
  options.cases = 10;
  const CheckReport report = check(*mistaken, options);
  EXPECT_FALSE(report.passed());
  for (const LawOutcome& outcome : report.laws)
    if (outcome.failure) {
      const std::string text = failure_message(outcome);
      expect_has(text, std::string(outcome.law.id));
      expect_has(text, "The smallest system on which it shows:");
      expect_has(text, "P0 = ");
    }
}
