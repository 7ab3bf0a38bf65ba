#include <kfstab/experiments/foreign.hpp>

#include <cstdlib>
#include <filesystem>

#include <sys/wait.h>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/run.hpp>
#include <kfstab/filters/registry.hpp>

#include "experiments/tool.hpp"
#include "properties/foreign/in_process.hpp"
#include "reports/scratch.hpp"

using namespace kfstab;
using namespace kfstab::experiments;
using kfstab::properties::Answer;
using kfstab::properties::Ending;
using kfstab::properties::StepInput;
using kfstab::properties::StepwiseFilter;
using kfstab::properties::SubjectFault;
using kfstab::properties::testing::InProcess;

namespace {

/// Predicts before it updates.
class Shifted final : public StepwiseFilter {
 public:
  Shifted() {
    traits_.name = "shifted";
    traits_.starts_predicted = false;
    traits_.instant = Instant::filtered;
    traits_.gain = GainKind::filter;
  }
  const properties::Traits& traits() const override { return traits_; }
  std::optional<Ending> start(const Dimensions&, const Vector<double>& x, const Matrix<double>& P) override {
    filter_.x = x;
    filter_.P = P;
    return std::nullopt;
  }
  std::variant<Answer, Ending> step(const StepInput& input) override {
    filter_.predict(input.A, input.B, input.Q);
    if (input.u) filter_.x += *input.D * *input.u;
    if (input.y) filter_.update(input.C, input.R, *input.y);
    Answer answer;
    answer.held = filter_.P;
    answer.state = filter_.x;
    answer.gain = filter_.K;
    return answer;
  }

 private:
  properties::Traits traits_;
  properties::testing::Textbook<double> filter_;
};

/// Does well until its step 3.
class Stopping final : public StepwiseFilter {
 public:
  explicit Stopping(bool fault) : fault_(fault) {}
  const properties::Traits& traits() const override { return filter_.traits(); }
  std::optional<Ending> start(const Dimensions& size, const Vector<double>& x, const Matrix<double>& P) override {
    step_ = 0;
    return filter_.start(size, x, P);
  }
  std::variant<Answer, Ending> step(const StepInput& input) override {
    if (step_++ == 3) {
      if (fault_) throw SubjectFault(SubjectFault::Kind::died, "it died of boredom");
      return Ending{Ending::Kind::refused, -1, "enough"};
    }
    return filter_.step(input);
  }

 private:
  InProcess filter_;
  bool fault_;
  int step_ = 0;
};

template <class Filter, class... Arguments>
Foreign foreign(Arguments... arguments) {
  return Foreign([=] { return std::make_unique<Filter>(arguments...); }, {});
}

SystemRun run_with(Foreign& one, const std::string& system, std::int64_t steps = 20) {
  RunOptions options;
  options.timed = false;
  options.foreign = {&one};
  return run(find_system(system, {{}, steps, {}}), {find_filter("ckf"), &one.metadata()}, options);
}

/// Of each step the error is below its bound.
void expect_bounded(const FilterRun& filter) {
  ASSERT_FALSE(filter.refused) << *filter.refused;
  const auto error = filter.covariance_error.points(), bound = filter.bound.points();
  ASSERT_EQ(error.value.size(), bound.value.size());
  ASSERT_FALSE(error.value.empty());
  for (std::size_t i = 0; i < error.value.size(); ++i)
    EXPECT_LE(error.value[i], bound.value[i]) << "step " << error.step[i];
}

}  // namespace

TEST(Foreign, JoinsARunAsACurveLikeAnyOther) {
  auto one = foreign<InProcess>();
  EXPECT_EQ(one.metadata().id, "in-process");
  const SystemRun result = run_with(one, "constant-velocity");
  expect_bounded(result.filters.back());
  EXPECT_GT(result.filters.back().gain_error.count(), 0);
  EXPECT_GT(result.filters.back().state_error.count(), 0);
}

TEST(Foreign, OneThatPredictsFirstSolvesTheSameProblem) {
  auto one = foreign<Shifted>();
  for (const char* system : {"constant-velocity", "two-rates"}) {
    const SystemRun result = run_with(one, system);
    expect_bounded(result.filters.back());
    EXPECT_EQ(result.filters.back().covariance_error.count(), result.filters.front().covariance_error.count());
  }
}

TEST(Foreign, AnEndIsRecordedAndTheOthersGoOn) {
  auto one = foreign<Stopping>(false);
  const SystemRun result = run_with(one, "constant-velocity");
  EXPECT_EQ(result.filters.back().first_failure, 3);
  EXPECT_EQ(result.filters.back().stopped, "says no: enough");
  EXPECT_EQ(result.filters.back().covariance_error.count(), 3);
  EXPECT_EQ(result.filters.front().covariance_error.count(), 20);
  EXPECT_FALSE(one.fault());
}

TEST(Foreign, AFaultEndsItForGood) {
  auto one = foreign<Stopping>(true);
  EXPECT_EQ(run_with(one, "constant-velocity").filters.back().first_failure, 3);
  EXPECT_EQ(one.fault(), "it died of boredom");
  EXPECT_EQ(run_with(one, "constant-velocity").filters.back().refused, "it died of boredom");
}

TEST(Foreign, IdsAreUnique) {
  const Foreign one([] { return std::make_unique<InProcess>(); }, {"in-process", "in-process-2"});
  EXPECT_EQ(one.metadata().id, "in-process-3");
}

// --- the commands ---------------------------------------------------------------------------------------------------------------

namespace {

using ForeignCommands = kfstab::test::ToolInFolder;

const std::string sick = KFSTAB_FOREIGN_FILTER;

}  // namespace

TEST_F(ForeignCommands, RunTakesPrograms) {
  ASSERT_EQ(kfstab("run constant-velocity --steps 20 --filters '^ckf$' --exec " KFSTAB_STARTER " --json -"), 0)
      << err();
  const auto parsed = nlohmann::json::parse(out());
  const auto& filters = parsed["systems"][0]["filters"];
  ASSERT_EQ(filters.size(), 2u);
  EXPECT_EQ(filters[1]["id"], "textbook-C");
  EXPECT_EQ(filters[1]["failure"], nullptr);
}

TEST_F(ForeignCommands, AProgramThatDiesIsFourAndTheRestIsThere) {
  ASSERT_EQ(kfstab("run constant-velocity --steps 20 --filters '^ckf$' --exec '" + sick + " crash' --json results"), 4)
      << err();
  EXPECT_NE(err().find("of signal 11 (Segmentation fault) at step 1"), std::string::npos) << err();
  const auto parsed = nlohmann::json::parse(read(folder / "results"));
  const auto& filters = parsed["systems"][0]["filters"];
  EXPECT_EQ(filters[0]["failure"], nullptr);
  EXPECT_EQ(filters[1]["failure"]["status"], "no_answer");
  EXPECT_EQ(filters[1]["failure"]["step"], 1);
  // Its results can be rendered again.
  EXPECT_EQ(kfstab("report kfstab-out/run-constant-velocity"), 0) << err();
}

TEST_F(ForeignCommands, CompareTakesPluginsAndTellsOfThem) {
  ASSERT_EQ(kfstab("compare constant-velocity --steps 20 --filters '^(ckf|srcf)$' --plugin " KFSTAB_STARTER_PLUGIN
                   " --scan scale:R=1e-4:1:log:3"),
            0)
      << err();
  EXPECT_NE(out().find("textbook-C keeps at least"), std::string::npos) << out();
  EXPECT_EQ(
      kfstab("compare constant-velocity --steps 20 --filters '^ckf$' --exec " KFSTAB_STARTER " --scan bits=24,53"), 0)
      << err();
}

TEST_F(ForeignCommands, CheckTakesBoth) {
  EXPECT_EQ(kfstab("check --cases 3 --exec " KFSTAB_STARTER " --plugin " KFSTAB_STARTER_PLUGIN), 0) << out() << err();
  EXPECT_EQ(kfstab("check --cases 3 --exec '" + sick + " shape'"), 1) << out() << err();
  EXPECT_EQ(kfstab("check --cases 3 --timeout 0.2 --exec '" + sick + " hang'"), 4) << out() << err();
  EXPECT_EQ(kfstab("check --cases 3 --exec /nowhere/filter"), 4) << out() << err();
  EXPECT_EQ(kfstab("check --cases 3 --exec 'read line; echo 1; read line'"), 2) << out() << err();
}
