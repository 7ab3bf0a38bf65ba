// Filters in batches, as a subject, and what a check makes of a subject that runs many systems at once.
#include <algorithm>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <kfstab/properties/check.hpp>

#include "systems.hpp"

namespace kfstab::properties::testing {
namespace {

std::vector<System> drawn_systems(const Traits& traits, int count) {
  std::vector<System> drawn;
  const auto generator = systems(within(traits, {}));
  for (int number = 0; number < count; ++number) drawn.push_back(drawn_system(generator, 8, number, count));
  return drawn;
}

void expect_same_run(const Run& found, const Run& expected) {
  EXPECT_EQ(found.ending.kind, expected.ending.kind);
  EXPECT_EQ(found.ending.step, expected.ending.step);
  EXPECT_EQ(found.ending.reason, expected.ending.reason);
  ASSERT_EQ(found.answers.size(), expected.answers.size());
  for (std::size_t k = 0; k < found.answers.size(); ++k) {
    const Answer &is = found.answers[k], &other = expected.answers[k];
    expect_same_bits(is.held, other.held, "held");
    ASSERT_EQ(is.gain.has_value(), other.gain.has_value());
    if (is.gain) expect_same_bits(*is.gain, *other.gain, "gain");
    ASSERT_EQ(is.state.has_value(), other.state.has_value());
    if (is.state) expect_same_bits(*is.state, *other.state, "state");
  }
}

class Batches : public ::testing::TestWithParam<std::string_view> {
 protected:
  std::unique_ptr<Subject> subject_ = in_batches(GetParam());
};

TEST_P(Batches, ObeyEveryLaw) {
  CheckOptions options;
  options.cases = 300;
  const CheckReport report = check(*subject_, options);
  for (const LawOutcome& outcome : report.laws)
    EXPECT_TRUE(outcome.holds()) << outcome.law.id << ": " << outcome.failure->finding.what << '\n'
                                 << write_system(outcome.failure->system);
  EXPECT_EQ(report.subject.name, std::string(GetParam()) + "-batch");
  EXPECT_EQ(report.cases, options.cases);
  EXPECT_LT(report.refused, options.cases / 10);
}

// Shapes, lengths, with data and without, time-varying and not, all at once; some are refused, at the start or on the way.
TEST_P(Batches, AnswerTheSameInWhateverCompany) {
  auto all = drawn_systems(subject_->traits(), 200);
  System singular = read_toml(with(valid_toml(), "R", "R = [[0]]"));
  singular.C = Sequence(Matrix<double>::Zero(1, 2));
  all.push_back(singular);
  System time_varying = read_toml(with(valid_toml(), "R", "R = { list = [[[1]], [[0]], [[1]]] }"));
  time_varying.C = singular.C;
  all.push_back(time_varying);
  const auto runs = subject_->run_all(all);
  ASSERT_EQ(runs.size(), all.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    SCOPED_TRACE(write_system(all[i]));
    EXPECT_TRUE(same_numbers(runs[i].system, all[i]));
    expect_same_run(runs[i], subject_->run_all({all[i]}).front());
  }
  EXPECT_EQ(runs[200].ending.kind, Ending::Kind::refused);
  EXPECT_EQ(runs[201].ending.kind, Ending::Kind::refused);
}

// What it answers is what the filter answers alone, and so are the endings: step, and reason.
TEST_P(Batches, EndWhereTheFilterEnds) {
  const auto alone = built_in(GetParam());
  auto all = drawn_systems(subject_->traits(), 200);
  for (const char* R : {"R = [[0]]", "R = { list = [[[1]], [[0]], [[1]]] }"}) {
    System system = read_toml(with(valid_toml(), "R", R));
    system.C = Sequence(Matrix<double>::Zero(1, 2));
    all.push_back(system);
  }
  const auto runs = subject_->run_all(all), expected = alone->run_all(all);
  std::size_t steps = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    SCOPED_TRACE(write_system(all[i]));
    EXPECT_EQ(runs[i].ending.kind, expected[i].ending.kind);
    EXPECT_EQ(runs[i].ending.step, expected[i].ending.step);
    if (runs[i].ending.step >= 0) {  // else it has the name
      EXPECT_EQ(runs[i].ending.reason, expected[i].ending.reason);
    }
    ASSERT_EQ(runs[i].answers.size(), expected[i].answers.size());
    steps += runs[i].answers.size();
    for (std::size_t k = 0; k < runs[i].answers.size(); ++k) {
      EXPECT_EQ(runs[i].answers[k].gain.has_value(), expected[i].answers[k].gain.has_value());
      EXPECT_EQ(runs[i].answers[k].state.has_value(), expected[i].answers[k].state.has_value());
    }
  }
  EXPECT_GT(steps, 500u);
}

TEST_P(Batches, AreFollowedAsFarAsIsWanted) {
  const System system = read_toml(valid_toml());
  std::int64_t last = -1;
  const Ending ending = subject_->run(system, [&](std::int64_t k, const Answer&) {
    last = k;
    return k < 1;
  });
  EXPECT_EQ(last, 1);
  EXPECT_EQ(ending.kind, Ending::Kind::done);
}

INSTANTIATE_TEST_SUITE_P(Forms, Batches, ::testing::ValuesIn(batched_filters()),
                         [](const auto& parameter) { return std::string(parameter.param); });

TEST(InBatches, AreNotOfEveryFilter) {
  EXPECT_THROW(in_batches("ud"), std::invalid_argument);
  EXPECT_THROW(in_batches("none"), std::invalid_argument);
}

/// srcf; of many systems at once it may answer what is wrong.
class Many final : public Subject {
 public:
  double error = 0;
  std::vector<std::size_t> sizes_of_cases;  ///< those of which three at most, systems in disguise, are left out

  const Traits& traits() const override { return alone_->traits(); }
  std::size_t at_once() const override { return 8; }
  Ending run(const System& system, const std::function<bool(std::int64_t, const Answer&)>& each) override {
    return alone_->run(system, each);
  }
  std::vector<Run> run_all(const std::vector<System>& all) override {
    if (all.size() > 3) sizes_of_cases.push_back(all.size());
    auto runs = Subject::run_all(all);
    if (all.size() > 1)
      for (Run& run : runs)
        for (Answer& answer : run.answers) answer.held *= 1 + error;
    return runs;
  }

 private:
  std::unique_ptr<Subject> alone_ = built_in("srcf");
};

TEST(Check, RunsCasesAtOnce) {
  CheckOptions options;
  options.cases = 20;
  Many subject;
  const CheckReport report = check(subject, options);
  EXPECT_TRUE(report.passed());
  EXPECT_EQ(subject.sizes_of_cases, (std::vector<std::size_t>{8, 8, 4}));
  EXPECT_EQ(report.classes, check(*built_in("srcf"), options).classes);
}

// One unit in the last place.
TEST(Check, NoticesThatCompanyMatters) {
  CheckOptions options;
  options.cases = 20;
  Many subject;
  subject.error = 0x1p-52;
  const CheckReport report = check(subject, options);
  std::vector<std::string_view> broken;
  for (const LawOutcome& outcome : report.laws)
    if (!outcome.holds()) broken.push_back(outcome.law.id);
  EXPECT_NE(std::ranges::find(broken, "isolation"), broken.end()) << ::testing::PrintToString(broken);
}

}  // namespace
}  // namespace kfstab::properties::testing
