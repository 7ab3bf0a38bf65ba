// Laws against filters that somebody else wrote: right ones, of any coding, and one mistake for each law.

#include "foreign.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <gtest/gtest.h>

#include <kfstab/properties/check.hpp>
#include <kfstab/properties/system_file.hpp>

namespace kfstab::properties::testing {
namespace {

struct Seen {
  int cases = 0;
  Finding worst;
  std::string system;
};

/// Every law on random systems, and the worst that was found of each.
std::map<std::string, Seen> examined(std::unique_ptr<StepwiseFilter> filter, int cases, Options options = {}) {
  const auto tried = subject(std::move(filter));
  options = within(tried->traits(), options);
  const auto generator = systems(options);
  Truths truths;
  Bench bench(*tried, truths);
  std::map<std::string, Seen> seen;
  for (int number = 0; number < cases; ++number) {
    const System system = drawn_system(generator, 675, number, cases);
    bench.forget();
    truths.forget();
    if (refusal(tried->traits(), system)) continue;
    for (const Law& law : all_laws()) {
      const auto finding = law.examine(bench, system);
      if (!finding) continue;
      Seen& of_law = seen[std::string(law.id)];
      if (of_law.cases++ > 0 && finding->ratio <= of_law.worst.ratio) continue;
      of_law.worst = *finding;
      if (!(finding->ratio <= largest_ratio)) of_law.system = write_system(system);
    }
  }
  return seen;
}

// --- right ones -----------------------------------------------------------------------------------------------------------

struct Foreigner {
  Style style;
  bool single = false;
};

void PrintTo(const Foreigner& f, std::ostream* out) { *out << f.style.name; }

class RightForeigner : public ::testing::TestWithParam<Foreigner> {
 protected:
  void expect_lawful(int cases, const Options& options) {
    const auto& [style, single] = GetParam();
    std::unique_ptr<StepwiseFilter> filter;
    if (single)
      filter = std::make_unique<Foreign<float>>(style);
    else
      filter = std::make_unique<Foreign<double>>(style);
    for (const auto& [law, seen] : examined(std::move(filter), cases, options))
      EXPECT_LE(seen.worst.ratio, largest_ratio) << law << ": " << seen.worst.what << '\n' << seen.system;
  }
};

TEST_P(RightForeigner, ObeysEveryLaw) { expect_lawful(150, {}); }

TEST_P(RightForeigner, ObeysEveryLawOnIllConditionedSystems) {
  Options options;
  options.n.most = options.m.most = options.p.most = 4;
  options.most_steps = 25;
  options.worst_condition = 1e14;
  expect_lawful(50, options);
}

// name, starts predicted, Joseph's form, symmetrises, gain, answers S, has a state, forms Re^{-1}
const Foreigner foreigners[] = {
    {{"textbook", true, false, false, GainKind::filter, false, true}},
    {{"textbook_single", true, false, false, GainKind::filter, false, true}, true},
    {{"joseph", true, true, true, GainKind::predictor, false, true}},
    {{"joseph_single", true, true, true, GainKind::predictor, false, true}, true},
    {{"without_gain", true, false, true, std::nullopt, false, true}},
    {{"without_state", true, true, false, GainKind::filter, false, false}},
    {{"predict_update", false, false, false, GainKind::filter, false, true}},
    {{"predict_update_joseph", false, true, true, GainKind::filter, false, true}},
    {{"by_inverse", true, false, false, GainKind::predictor, false, true, true}},
    {{"predict_update_joseph_by_inverse", false, true, false, GainKind::filter, false, true, true}},
    {{"predict_update_single", false, true, false, GainKind::filter, false, true}, true},
};

INSTANTIATE_TEST_SUITE_P(Styles, RightForeigner, ::testing::ValuesIn(foreigners),
                         [](const auto& parameter) { return parameter.param.style.name; });

// --- wrong ones -----------------------------------------------------------------------------------------------------------

using Filter = Foreign<double>;
using Work = Filter::Work;

struct Mistake {
  std::string law;  ///< that it breaks
  std::string name;
  std::function<void(Filter&)> make;
  Style style = {"mistaken", true, false, true, GainKind::filter, false, true};
  double at_least = 1e4;
};

void PrintTo(const Mistake& m, std::ostream* out) { *out << m.name; }

const Style joseph = {"joseph", true, true, true, GainKind::filter, false, true};
const Style state_alone = {"state", true, false, true, GainKind::filter, false, true};
const Style without_gain = {"without gain", true, false, true, std::nullopt, false, true};

const Mistake mistakes[] = {
    {"answers", "ANaNInTheThirdStep",
     [](Filter& f) {
       f.answered = [](Answer& answer, std::int64_t k) {
         if (k == 2 && answer.held.size() > 0) answer.held(0, 0) = std::numeric_limits<double>::quiet_NaN();
       };
     }},
    {"symmetry", "ATriangleOfTheStepBefore",
     [](Filter& f) {
       f.after_all = [before = 0.0](Work& w) mutable {
         if (w.P.rows() < 2) return;
         if (w.k == 0) before = 0;
         std::swap(before, w.P(0, w.P.rows() - 1));
       };
     }},
    {"definiteness", "NoiseThatIsSubtracted",
     [](Filter& f) { f.after_predict = [](Work& w) { w.P -= 2 * w.B * w.Q * w.B.transpose(); }; }},
    {"measurement-never-hurts", "AnUpdateThatAdds",
     [](Filter& f) { f.before = [](Work& w) { w.R *= -1, w.R -= 2 * w.C * w.P * w.C.transpose(); }; }},
    {"noise-floor", "HalfOfTheNoise", [](Filter& f) { f.before = [](Work& w) { w.Q /= 2; }; }},
    {"time-update", "NoNoiseWithoutMeasurement",
     [](Filter& f) {
       f.before = [](Work& w) {
         if (!w.measured) w.Q.setZero();
       };
     }},
    {"information-identity", "RTwice", [](Filter& f) { f.before = [](Work& w) { w.R *= 2; }; }},
    {"filter-gain", "AGainThatIsScaled", [](Filter& f) { f.after_all = [](Work& w) { w.Kf *= 1.001; }; }},
    {"gain-innovation", "AGainThatIsScaled", [](Filter& f) { f.after_all = [](Work& w) { w.Kf *= 1.001; }; }},
    {"joseph", "ASmallerGainInTheTextbooksForm", [](Filter& f) { f.of_gain = [](Work& w) { w.Kf *= 0.9; }; }},
    {"gain-optimality", "ASmallerGainInJosephsForm", [](Filter& f) { f.of_gain = [](Work& w) { w.Kf *= 0.9; }; },
     joseph},
    {"duality", "AGainThatIsLate",
     [](Filter& f) {
       f.after_all = [late = Filter::M()](Work& w) mutable {
         if (w.k == 0) late = w.Kf;
         if (late.rows() == w.Kf.rows() && late.cols() == w.Kf.cols()) std::swap(late, w.Kf);
       };
     }},
    {"duality", "P0IsTakenAsARoot",
     [](Filter& f) {
       f.before = [](Work& w) {
         if (w.k == 0) w.P = (w.P * w.P.transpose()).eval();
       };
     }},
    {"duality", "AStateMovedByAnotherGain",
     [](Filter& f) { f.update_state = [](Work& w, const Filter::V& e) { w.x += 0.999 * (w.Kf * e); }; }},
    {"duality", "AnInputThatIsSubtracted", [](Filter& f) { f.before = [](Work& w) { w.D *= -1; }; }},
    {"state-update", "TheInnovationAfterTheUpdate",
     [](Filter& f) { f.update_state = [](Work& w, const Filter::V& e) { w.x += w.Kf * (e - w.C * (w.Kf * e)); }; }},
    {"zero-innovation", "ABiasOfTheMeasurement",
     [](Filter& f) { f.update_state = [](Work& w, const Filter::V& e) { w.x += w.Kf * (e.array() + 0.01).matrix(); }; },
     without_gain},
    {"log-likelihood", "WithoutLogTwoPi",
     [](Filter& f) {
       f.after_update = [](Work& w) {
         w.loglik += static_cast<double>(w.C.rows()) * std::log(2 * std::numbers::pi) / 2;
       };
     }},
    {"one-step", "ALittleMoreEachStep", [](Filter& f) { f.after_all = [](Work& w) { w.P *= 1 + 1e-8; }; }},
    {"trajectory", "P0IsTakenAsARoot",
     [](Filter& f) {
       f.before = [](Work& w) {
         if (w.k == 0) w.P = (w.P * w.P.transpose()).eval();
       };
     }},
    {"trajectory", "TheStateIsStartedAtZero",
     [](Filter& f) {
       f.before = [](Work& w) {
         if (w.k == 0) w.x.setZero();
       };
     }},
    {"batch", "EveryThirdMeasurementIsLeftOut",
     [](Filter& f) {
       f.before = [](Work& w) {
         if (w.k % 3 == 2) w.C.setZero();
       };
     }},
    {"steady-state", "AJitterOfEachStep",
     [](Filter& f) { f.after_all = [](Work& w) { w.P.diagonal().array() += 1e-6 * w.P.norm(); }; }},
    {"steady-state", "AGainThatIsFrozen",
     [](Filter& f) {
       f.of_gain = [frozen = Filter::M()](Work& w) mutable {
         if (w.k == 3) frozen = w.Kf;
         if (w.k > 3 && frozen.rows() == w.Kf.rows() && frozen.cols() == w.Kf.cols()) w.Kf = frozen;
       };
     },
     joseph},
    {"nis", "AStateThatIsNotUpdated", [](Filter& f) { f.update_state = [](Work&, const Filter::V&) {}; }, state_alone,
     60},
    {"nees", "AStateThatIsNotUpdated", [](Filter& f) { f.update_state = [](Work&, const Filter::V&) {}; }, state_alone,
     60},
    // Too sure of itself by a factor of four: of 60 chi-squared numbers with the mean 4 Chernoff's bound is at 9.8 sigma, 49 of
    // the ratio, if they do not depend on one another. And not sure enough.
    {"nees", "APThatIsAQuarter", [](Filter& f) { f.answered = [](Answer& a, std::int64_t) { a.held /= 4; }; }, state_alone,
     largest_ratio},
    {"nees", "VariancesInTheSquareOfAnotherUnit",
     [](Filter& f) { f.answered = [](Answer& a, std::int64_t) { a.held *= 1e4; }; }, state_alone, 60},
    {"whiteness", "AStateThatIsNotUpdated", [](Filter& f) { f.update_state = [](Work&, const Filter::V&) {}; },
     state_alone, 60},
};

class OneMistake : public ::testing::TestWithParam<Mistake> {};

TEST_P(OneMistake, BreaksItsLaw) {
  const Mistake& mistake = GetParam();
  auto filter = std::make_unique<Filter>(mistake.style);
  mistake.make(*filter);
  const auto seen = examined(std::move(filter), 150);
  ASSERT_TRUE(seen.contains(mistake.law)) << "it applied to no system";
  const Finding& worst = seen.at(mistake.law).worst;
  EXPECT_GT(worst.ratio, mistake.at_least) << worst.what;
  EXPECT_FALSE(worst.what.empty());
  RecordProperty("what", worst.what);
}

INSTANTIATE_TEST_SUITE_P(Mistakes, OneMistake, ::testing::ValuesIn(mistakes), [](const auto& parameter) {
  std::string law = parameter.param.law;
  std::ranges::replace(law, '-', '_');
  return law + "_" + parameter.param.name;
});

}  // namespace
}  // namespace kfstab::properties::testing
