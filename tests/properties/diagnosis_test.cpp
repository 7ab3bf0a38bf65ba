#include <kfstab/properties/diagnosis.hpp>

#include <algorithm>
#include <memory>
#include <set>
#include <string>

#include <gtest/gtest.h>

#include <kfstab/properties/check.hpp>

#include "foreign.hpp"

namespace kfstab::properties::testing {
namespace {

std::optional<std::vector<Answer>> plain(const System& system, const Traits& traits,
                                         std::span<const Mistake* const> made) {
  const auto numbers = covariance_numbers(system);
  return numbers ? reenact(system, *numbers, traits, made) : std::nullopt;
}

const Mistake& mistake(std::string_view id) { return *std::ranges::find(mistakes(), id, &Mistake::id); }

std::vector<Run> runs_of(Subject& subject, int count) {
  std::vector<Run> runs;
  Truths truths;
  Bench bench(subject, truths);
  const auto generator = systems(within(subject.traits(), {}));
  for (int i = 0; i < count; ++i) runs.push_back(bench.rerun(drawn_system(generator, 11, i, count)));
  return runs;
}

Traits predictor() {
  Traits traits;
  traits.name = "mistaken";
  return traits;
}

Traits filterer() {
  Traits traits = predictor();
  traits.instant = Instant::filtered;
  traits.starts_predicted = false;
  traits.gain = GainKind::filter;
  return traits;
}

TEST(PlainFilter, MistakesHaveNamesOfTheirOwnAndSentences) {
  std::set<std::string_view> ids;
  for (const Mistake& one : mistakes()) {
    EXPECT_TRUE(ids.insert(one.id).second) << one.id;
    EXPECT_FALSE(one.sentence.empty());
  }
}

// Without a mistake the plain filter is a Kalman filter: the built-in ones' laws hold of it, in both orders.
TEST(PlainFilter, IsRight) {
  for (const Traits& traits : {predictor(), filterer()}) {
    const auto subject = mistaken(traits, {});
    const CheckReport report = check(*subject);
    for (const LawOutcome& outcome : report.laws)
      EXPECT_TRUE(outcome.holds()) << outcome.law.id << " " << outcome.max_ratio;
    EXPECT_TRUE(diagnose(traits, report.runs).empty());
  }
}

/// Whether some system of the runs tells two mistakes apart.
bool told_apart(const Mistake& one, const Mistake& other, const Traits& traits, const std::vector<Run>& runs) {
  const Mistake* first = &one;
  const Mistake* second = &other;
  return std::ranges::any_of(runs, [&](const properties::Run& run) {
    const auto a = plain(run.system, traits, std::span(&first, 1)),
               b = plain(run.system, traits, std::span(&second, 1));
    if (!a || !b) return a.has_value() != b.has_value();
    for (std::size_t k = 0; k < a->size(); ++k)
      if (((*a)[k].held - (*b)[k].held).norm() > 1e-6 * (*a)[k].held.norm()) return true;
    return false;
  });
}

class Named : public ::testing::TestWithParam<bool> {};

// Each mistake is named, or one that answers the same on every system.
TEST_P(Named, EachMistakeIsRecognised) {
  const Traits traits = GetParam() ? predictor() : filterer();
  const auto right = mistaken(traits, {});
  const auto right_runs = runs_of(*right, 30);
  for (const Mistake& made : mistakes()) {
    const auto subject = mistaken(traits, {&made});
    const auto runs = runs_of(*subject, 30);
    const auto found = diagnose(traits, runs);
    // What no system shows (an answer's mistake in the wrong order of updates, say) cannot be named.
    const bool shows = std::ranges::any_of(runs, [&](const properties::Run& run) {
      const auto right_answers = plain(run.system, traits, {});
      if (!right_answers || run.answers.size() != right_answers->size()) return false;
      for (std::size_t k = 0; k < right_answers->size(); ++k) {
        const Answer &a = run.answers[k], &b = (*right_answers)[k];
        // Below half of the digits nobody calls it a mistake: that is what jitter of 1e-9 and the like come to, now and then.
        if ((a.held - b.held).norm() > 1e-6 * b.held.norm()) return true;
        if (a.gain && b.gain && (*a.gain - *b.gain).norm() > 1e-6 * b.gain->norm()) return true;
        if (a.state && b.state && (*a.state - *b.state).norm() > 1e-6 * b.state->norm()) return true;
      }
      return false;
    });
    if (!shows) continue;
    ASSERT_FALSE(found.empty()) << made.id;
    const bool named = std::ranges::any_of(found, [&](const Diagnosis& one) { return one.mistakes.front() == &made; });
    EXPECT_TRUE(named || !told_apart(*found.front().mistakes.front(), made, traits, runs))
        << made.id << " is taken for " << found.front().mistakes.front()->id;
    EXPECT_EQ(found.front().mistakes.size(), 1) << made.id;
  }
}

INSTANTIATE_TEST_SUITE_P(BothOrders, Named, ::testing::Bool(),
                         [](const auto& p) { return p.param ? "UpdatePredict" : "PredictUpdate"; });

TEST(Diagnosis, SaysHowSureItIs) {
  const auto subject = mistaken(predictor(), {&mistake("r-squared")});
  const auto found = diagnose(predictor(), runs_of(*subject, 40));
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found.front().confidence(), 1);
  EXPECT_GE(found.front().digits, 12);
  EXPECT_LE(found.front().right_digits, 6);
  EXPECT_EQ(found.front().sentence().find("answers as a filter that takes R for R^{1/2}"), 0);
}

TEST(Diagnosis, TwoMistakesAtOnce) {
  const auto subject = mistaken(predictor(), {&mistake("r-squared"), &mistake("a-transposed")});
  const auto found = diagnose(predictor(), runs_of(*subject, 40));
  ASSERT_FALSE(found.empty());
  ASSERT_EQ(found.front().mistakes.size(), 2);
  EXPECT_EQ(std::set<std::string_view>({found.front().mistakes[0]->id, found.front().mistakes[1]->id}),
            (std::set<std::string_view>{"a-transposed", "r-squared"}));
}

// In another coding (a root is held) the same mistake is the same: built-in filters fed with a wrong R.
TEST(Diagnosis, IsOfTheAnswersNotOfTheCode) {
  class Wrong final : public Subject {
   public:
    const Traits& traits() const override { return right_->traits(); }
    Ending run(const System& system, const std::function<bool(std::int64_t, const Answer&)>& each) override {
      System changed = system;
      for (Matrix<double>& R : changed.R.value.matrices)
        R *= system.R.written == Covariance::Written::root ? std::sqrt(2.0) : 2.0;
      return right_->run(changed, each);
    }

   private:
    std::unique_ptr<Subject> right_ = built_in("srcf");
  } subject;
  const auto found = diagnose(subject.traits(), runs_of(subject, 40));
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found.front().mistakes.front()->id, "r-doubled");
}

// --- guesses ------------------------------------------------------------------------------------------------------------------

CheckReport checked(Subject& subject) {
  CheckOptions options;
  options.cases = 60;
  options.shrinking = 0;
  return check(subject, options);
}

std::vector<std::string> named(const std::vector<Candidate>& found) {
  std::vector<std::string> ids;
  for (const Candidate& one : found) ids.emplace_back(one.mistake->id);
  return ids;
}

std::string list(const std::vector<Candidate>& found) {
  std::string text;
  for (const Candidate& one : found) text += std::string(one.mistake->id) + ": " + one.sentence() + "\n";
  return text;
}

class Guessed : public ::testing::TestWithParam<std::string_view> {};

// A mistake, and every number that is answered is off besides, by up to 1e-5, as no mistake has it: no re-enactment does the
// same, but the mistake is still the greater part of what is wrong.
TEST_P(Guessed, UnderADisturbance) {
  class Disturbed final : public Subject {
   public:
    explicit Disturbed(std::unique_ptr<Subject> filter) : filter_(std::move(filter)) {}
    const Traits& traits() const override { return filter_->traits(); }
    Ending run(const System& system, const std::function<bool(std::int64_t, const Answer&)>& each) override {
      return filter_->run(system, [&](std::int64_t k, const Answer& answer) {
        Answer disturbed = answer;
        const auto off = [this](double x) { return x * (1 + 1e-5 * std::sin(static_cast<double>(++count_))); };
        disturbed.held = answer.held.unaryExpr(off);
        if (answer.gain) disturbed.gain = answer.gain->unaryExpr(off);
        if (answer.state) disturbed.state = answer.state->unaryExpr(off);
        return each(k, disturbed);
      });
    }

   private:
    std::unique_ptr<Subject> filter_;
    int count_ = 0;
  } subject(mistaken(predictor(), {&mistake(GetParam())}));
  const CheckReport report = checked(subject);
  const auto found = candidates(report);
  ASSERT_FALSE(found.empty());
  EXPECT_LE(found.size(), 3u);
  const auto ids = named(found);
  EXPECT_NE(std::ranges::find(ids, GetParam()), ids.end()) << list(found);
  for (const Candidate& one : found) {
    EXPECT_GT(one.systems, 0);
    EXPECT_LE(one.alike, one.either);
    EXPECT_GE(one.likeness, 0);
    EXPECT_LE(one.likeness, 1);
    EXPECT_NE(one.sentence().find(std::string(one.mistake->sentence)), std::string::npos);
  }
}

INSTANTIATE_TEST_SUITE_P(Mistakes, Guessed,
                         ::testing::Values("r-squared", "q-forgotten", "a-transposed", "p0-as-factor", "update-added",
                                           "gain-frozen", "x-not-updated"),
                         [](const auto& parameter) {
                           std::string name(parameter.param);
                           std::ranges::replace(name, '-', '_');
                           return name;
                         });

// Somebody else's filter that computes in single precision and does not say so, and forgets Q.
TEST(Candidates, QForgottenInSinglePrecision) {
  auto filter = std::make_unique<Foreign<float>>(Style{.name = "single", .gain = GainKind::predictor});
  filter->traits().roundoff = unit_roundoff<double>();
  filter->before = [](Foreign<float>::Work& w) { w.Q.setZero(); };
  const auto wrong = subject(std::move(filter));
  const CheckReport report = checked(*wrong);
  EXPECT_TRUE(diagnose(report.subject, report.runs).empty());
  const auto found = candidates(report);
  const auto ids = named(found);
  EXPECT_NE(std::ranges::find(ids, "q-forgotten"), ids.end()) << list(found);
}

// Where there is no time left there is no guess; and none where nothing comes near.
TEST(Candidates, StopWhenTold) {
  const auto wrong = mistaken(predictor(), {&mistake("r-squared")});
  EXPECT_TRUE(candidates(checked(*wrong), [] { return true; }).empty());
}

TEST(Diagnosis, OfARightFilterNothing) {
  for (const char* id : {"ckf", "srcf", "srif", "ckf-mixed", "ud"}) {
    const auto subject = built_in(id);
    EXPECT_TRUE(diagnose(subject->traits(), runs_of(*subject, 40)).empty()) << id;
  }
}

}  // namespace
}  // namespace kfstab::properties::testing
