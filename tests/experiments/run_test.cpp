#include <kfstab/experiments/run.hpp>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/selection.hpp>
#include <kfstab/properties/data.hpp>

using namespace kfstab;
using namespace kfstab::experiments;

namespace {

/// Three states, two outputs, stable, well conditioned; nothing is the identity, some states are not measured.
const std::string benign = R"(
name = "benign"
A = [[0.75, 0.5, 0], [-0.5, 0.75, 0.25], [0, 0, 0.5]]
B = [[0.25], [0], [0.5]]
C = [[1, 0, 1], [0, 0.5, 0]]
Q = 2
R = [[1, 0.25], [0.25, 0.5]]
P0 = [[4, 1, 0], [1, 2, 0.5], [0, 0.5, 1]]
x0 = [1, -2, 0.5]
steps = 60
)";

/// Two nearly equal measurements, d apart, come at step 2: with d = 2^-24 unsymmetrised filters are indefinite from
/// then on, with d = 2^-28 what holds P finds Re singular.
const std::string late_system = R"(
name = "late"
A = { identity = 3 }
B = [[], [], []]
C = { list = [[[1, 0, 0], [0, 1, 0]], [[1, 0, 0], [0, 1, 0]], [[1, 1, 1], [1, 1, "1 + d"]], [[1, 0, 0], [0, 1, 0]], [[1, 0, 0], [0, 1, 0]]] }
Q = []
R = { list = [{ identity = 2 }, { identity = 2 }, { identity = 2, scale = "d^2" }, { identity = 2 }, { identity = 2 }] }
P0 = { identity = 3 }
steps = 5
[parameters]
d = "2^-24"
)";

properties::System system_of_text(const std::string& text, const std::string& d = "") {
  properties::Overrides overrides;
  if (!d.empty()) overrides.parameters["d"] = d;
  return properties::read_system_text(text, properties::Format::toml, "test", overrides);
}

SystemRun run_text(const std::string& text, const std::string& filters, const std::string& d = "") {
  return run(system_of_text(text, d), select_filters(filters), {});
}

const FilterRun& find(const SystemRun& result, const std::string& id) {
  for (const FilterRun& f : result.filters)
    if (f.metadata->id == id) return f;
  throw std::invalid_argument("no " + id);
}

const std::string symmetric = "^(ckf|joseph|srcf|srif)$";

}  // namespace

TEST(Run, DescribesTheSystemAndKeepsTheOrderOfFilters) {
  const SystemRun result = run(find_system("local-level", {{{"q", "2"}}, 4, {}}), select_filters(symmetric), {});
  EXPECT_EQ(result.name, "local-level");
  EXPECT_FALSE(result.description.empty());
  EXPECT_FALSE(result.source.empty());
  EXPECT_EQ(result.dimensions.n, 1);
  EXPECT_EQ(result.dimensions.m, 1);
  EXPECT_EQ(result.dimensions.p, 1);
  EXPECT_EQ(result.parameters.at("q"), 2);
  EXPECT_EQ(result.steps_asked, 4);
  EXPECT_EQ(result.steps_done, 4);
  ASSERT_EQ(result.filters.size(), 4u);
  EXPECT_EQ(result.filters[0].metadata->id, "ckf");
  EXPECT_EQ(result.filters[3].metadata->id, "srif");
}

TEST(Run, EveryFilterStaysAtRoundingLevelWhereNothingIsHard) {
  const SystemRun result = run_text(benign, "");
  EXPECT_FALSE(result.reference_error);
  EXPECT_GE(result.certified_digits, 30);
  EXPECT_GT(result.working_digits, result.certified_digits);
  for (const FilterRun& f : result.filters) {
    SCOPED_TRACE(f.metadata->id);
    ASSERT_FALSE(f.refused) << *f.refused;
    EXPECT_FALSE(f.first_failure);
    EXPECT_FALSE(f.first_indefinite);
    EXPECT_EQ(f.failure, Status::ok);
    EXPECT_EQ(f.gain_error.count(), 60);
    EXPECT_GT(f.gain_error.largest(), 0) << "nothing was measured";
    if (f.metadata->holds == Held::gain) {
      EXPECT_LT(f.gain_error.largest(), 1e-13);
      EXPECT_EQ(f.covariance_error.count(), 0) << "it holds no P";
      continue;
    }
    for (const Series* series : {&f.covariance_error, &f.asymmetry, &f.smallest_eigenvalue, &f.bound})
      EXPECT_EQ(series->count(), 60);
    EXPECT_GT(f.covariance_error.largest(), 0) << "nothing was measured";
    EXPECT_LE(f.covariance_error.largest(), f.bound.largest());
    EXPECT_LE(f.gain_error.largest(), 30 * f.bound.largest());
    EXPECT_GT(f.smallest_eigenvalue.smallest(), 0);
    EXPECT_GE(f.correct_digits, 14);
    EXPECT_DOUBLE_EQ(f.correct_digits, -std::log10(std::max(0x1p-53, f.covariance_error.last())));
  }
}

TEST(Run, TheBoundIsAboveTheErrorsOfSymmetricFormsAtEveryStep) {
  for (const char* name : {"double-integrator", "rotation", "two-rates"}) {
    const SystemRun result = run(find_system(name, {{}, 150, {}}), select_filters(symmetric), {});
    for (const FilterRun& f : result.filters) {
      ASSERT_FALSE(f.refused) << *f.refused;
      const auto errors = f.covariance_error.points(), bound = f.bound.points();
      ASSERT_EQ(errors.step, bound.step);
      for (std::size_t k = 0; k < errors.step.size(); ++k) {
        EXPECT_LE(errors.value[k], bound.value[k]) << name << ", " << f.metadata->id << ", step " << k;
        EXPECT_GE(bound.value[k], 0x1p-53) << name << ", " << f.metadata->id << ", step " << k;
      }
      const auto gain_errors = f.gain_error.points(), gain_bound = f.gain_bound.points();
      if (!holds_root(f.metadata->holds) && f.metadata->holds != Held::covariance) {
        EXPECT_TRUE(gain_bound.step.empty()) << f.metadata->id;
        continue;
      }
      ASSERT_EQ(gain_errors.step, gain_bound.step);
      for (std::size_t k = 0; k < gain_errors.step.size(); ++k)
        EXPECT_LE(gain_errors.value[k], gain_bound.value[k]) << name << ", " << f.metadata->id << ", step " << k;
    }
  }
}

TEST(Run, SaysWhatTheSystemDoesToAnErrorWhicheverFiltersRun) {
  const SystemRun one = run(find_system("rotation", {{}, 30, {}}), select_filters("^ckf$"), {});
  const AnalysisRun& analysis = one.analysis;
  for (const Series* series :
       {&analysis.gamma, &analysis.log10_amplification, &analysis.innovation_condition, &analysis.cosine})
    EXPECT_EQ(series->count(), 30);
  // Submultiplicative: no more than the product of the gammas
  double sum = 0;
  const auto gamma = analysis.gamma.points().value, all = analysis.log10_amplification.points().value;
  for (std::size_t k = 0; k < gamma.size(); ++k) {
    sum += 2 * std::log10(gamma[k]);
    // a few roundings a step, of the product and of the sum of logarithms
    const double rounding = 16 * 0x1p-53 * static_cast<double>(k + 1) * (1 + std::abs(sum));
    EXPECT_LE(all[k], sum + rounding) << k;
    if (k == 0) {
      EXPECT_NEAR(all[k], sum, rounding);
    }
  }
}

TEST(Run, AnUnsymmetrisedFilterLeavesTheBoundWhereASymmetricOneDoesNot) {
  const SystemRun result =
      run(find_system("asymmetry-divergence", {{}, 250, {}}), select_filters("^(ckf|ckf-gain)$"), {});
  EXPECT_LT(find(result, "ckf").covariance_error.largest(), find(result, "ckf").bound.largest());
  EXPECT_GT(find(result, "ckf-gain").covariance_error.largest(), 100 * find(result, "ckf-gain").bound.largest());
  EXPECT_GT(find(result, "ckf-gain").asymmetry.last(), 1e-10);
  EXPECT_EQ(find(result, "ckf").asymmetry.largest(), 0);
}

TEST(Run, WithoutDataThereIsNoStateCurve) {
  const SystemRun without = run_text(benign, symmetric);
  for (const FilterRun& f : without.filters) EXPECT_EQ(f.state_error.count(), 0) << f.metadata->id;
  const SystemRun with = run_text(benign + "measurements = { simulate = { seed = 1 } }\n", symmetric);
  for (const FilterRun& f : with.filters) {
    EXPECT_EQ(f.state_error.count(), 60) << f.metadata->id;
    EXPECT_GT(f.state_error.largest(), 0) << f.metadata->id;
    EXPECT_LT(f.state_error.largest(), 1e-12) << f.metadata->id;
  }
}

TEST(Run, KnownInputsReachFiltersAndReferenceAlike) {
  const SystemRun result = run(find_system("slicot-fb01sd"), select_filters(symmetric), {});
  for (const FilterRun& f : result.filters) {
    ASSERT_EQ(f.state_error.count(), 4) << f.metadata->id;
    EXPECT_LT(f.state_error.largest(), 1e-8) << f.metadata->id;
  }
}

TEST(Run, MeasurementsMayBeMissing) {
  const std::string gaps = benign + "measurements = { simulate = { seed = 1 } }\n";
  const auto written = system_of_text(gaps);
  properties::System system = written;
  Matrix<double> y(system.C.rows(), system.steps);
  const auto stream = system.data->open();
  for (Index k = 0; k < system.steps; ++k) y.col(k) = stream->next().y;
  y.col(3).setConstant(std::numeric_limits<double>::quiet_NaN());
  system.data = std::make_shared<properties::Recorded>(y, Matrix<double>(0, system.steps));
  const SystemRun result = run(system, select_filters("^(ckf|srcf|srif|csrf)$"), {});
  EXPECT_FALSE(result.reference_error);
  for (const char* id : {"ckf", "srcf", "srif"}) {
    EXPECT_EQ(find(result, id).state_error.count(), system.steps) << id;
    EXPECT_LT(find(result, id).state_error.largest(), 1e-12) << id;  // as WithoutDataThereIsNoStateCurve has it
  }
  EXPECT_NE(find(result, "csrf").refused->find("measurements are missing"), std::string::npos);
}

TEST(Run, WhatDoesNotApplyIsRefusedByNameAndTheOthersRun) {
  const std::string singular =
      "name = \"singular\"\nA = [[1, 1], [0, 0]]\nB = [[1], [1]]\nC = [[1, 0]]\nQ = 1\nR = 1\n"
      "P0 = { identity = 2 }\nsteps = 3\n";
  const SystemRun result = run_text(singular, "^(ckf|srcf|srif)$");
  ASSERT_TRUE(find(result, "srif").refused);
  EXPECT_EQ(*find(result, "srif").refused, "srif needs an invertible A: A is singular");
  EXPECT_EQ(find(result, "srif").covariance_error.count(), 0);
  for (const char* id : {"ckf", "srcf"}) {
    EXPECT_FALSE(find(result, id).refused);
    EXPECT_EQ(find(result, id).covariance_error.count(), 3);
  }
}

TEST(Run, RefusedByAllIsStillARun) {
  const SystemRun result = run(find_system("unexcited-mode", {{}, 4, {}}), select_filters("^srif$"), {});
  EXPECT_EQ(result.steps_done, 4);
  EXPECT_FALSE(result.reference_error);
  ASSERT_EQ(result.filters.size(), 1u);
  EXPECT_TRUE(result.filters[0].refused);
}

TEST(Run, AFailureIsRecordedAndNotSteppedOn) {
  const SystemRun result = run_text(late_system, "", "2^-28");
  EXPECT_EQ(result.steps_done, 5);
  for (const FilterRun& f : result.filters) {
    SCOPED_TRACE(f.metadata->id);
    if (f.metadata->needs.time_invariant) {
      ASSERT_TRUE(f.refused);
    } else if (f.metadata->holds == Held::information) {
      // P^{-1} formed is no better than Re formed.
      ASSERT_TRUE(f.first_failure);
      EXPECT_EQ(f.failure, Status::singular_information) << name(f.failure);
    } else if (f.metadata->holds == Held::covariance) {
      ASSERT_TRUE(f.first_failure);
      EXPECT_EQ(*f.first_failure, 2);
      EXPECT_TRUE(f.failure == Status::singular_innovation || f.failure == Status::not_positive_definite)
          << name(f.failure);
      // The two steps before are there, at rounding level; nothing after.
      for (const Series* series : {&f.covariance_error, &f.gain_error, &f.asymmetry, &f.smallest_eigenvalue, &f.bound})
        EXPECT_EQ(series->count(), 2);
      EXPECT_LT(f.covariance_error.largest(), 1e-14);
      EXPECT_TRUE(f.seconds_per_step > 0 && f.seconds_per_step < 1) << f.seconds_per_step;
    } else {
      EXPECT_FALSE(f.first_failure);
      EXPECT_EQ(f.covariance_error.count(), 5);
    }
  }
}

TEST(Run, AFailureAtTheFirstStepLeavesNothing) {
  const SystemRun result = run(find_system("dyer-mcreynolds", {{{"d", "2^-30"}}, 3, {}}), select_filters("^ckf$"), {});
  const FilterRun& f = result.filters.front();
  ASSERT_TRUE(f.first_failure);
  EXPECT_EQ(*f.first_failure, 0);
  EXPECT_EQ(f.covariance_error.count(), 0);
  EXPECT_TRUE(std::isnan(f.covariance_error.largest()));
  EXPECT_TRUE(std::isnan(f.covariance_error.last()));
  EXPECT_TRUE(std::isnan(f.seconds_per_step));
  EXPECT_TRUE(std::isnan(f.correct_digits));
}

TEST(Run, TheFirstIndefiniteStepIsRecorded) {
  const SystemRun result = run_text(late_system, "");
  for (const char* id : {"ckf-gain", "ckf-textbook"}) {
    const FilterRun& f = find(result, id);
    ASSERT_TRUE(f.first_indefinite) << id;
    EXPECT_EQ(*f.first_indefinite, 2) << id << ": the steps before are easy";
    EXPECT_LT(f.smallest_eigenvalue.smallest(), 0) << id;
    EXPECT_EQ(f.covariance_error.count(), 5) << id << ": indefinite is no failure";
  }
  for (const char* id : {"srcf", "srif"}) {
    EXPECT_FALSE(find(result, id).first_indefinite) << id;
    EXPECT_GT(find(result, id).smallest_eigenvalue.smallest(), 0) << id;
  }
}

TEST(Run, WhereTheReferenceHasNoAnswerTheStepsBeforeAreKept) {
  const std::string no_answer =
      "name = \"no-answer\"\nA = 0.5\nB = 1\nC = { list = [1, 1, 0, 1] }\nQ = 1\n"
      "R = { list = [1, 1, 0, 1] }\nP0 = 1\nsteps = 4\n";
  const SystemRun result = run_text(no_answer, "^(ckf|srcf)$");
  ASSERT_TRUE(result.reference_error);
  EXPECT_NE(result.reference_error->find("step 2"), std::string::npos) << *result.reference_error;
  EXPECT_NE(result.reference_error->find("Re is not positive definite"), std::string::npos) << *result.reference_error;
  EXPECT_EQ(result.steps_done, 2);
  EXPECT_EQ(result.steps_asked, 4);
  EXPECT_FALSE(result.interrupted);
  for (const FilterRun& f : result.filters) {
    EXPECT_EQ(f.covariance_error.count(), 2) << f.metadata->id;
    EXPECT_FALSE(f.first_failure) << f.metadata->id;
  }
}

TEST(Run, AsManyDigitsAreCertifiedAsAskedFor) {
  const auto system = system_of_text(benign);
  EXPECT_GE(run(system, select_filters("^ckf$"), {.digits = 90, .progress = {}}).certified_digits, 90);
}

TEST(Run, AStepsTimeIsFiniteAndProgressIsToldOncePerStep) {
  std::int64_t told = 0;
  const SystemRun result = run(system_of_text(benign), select_filters(symmetric),
                               {.digits = 30, .progress = [&](std::int64_t units) { told += units; }});
  EXPECT_EQ(told, 60);
  for (const FilterRun& f : result.filters)
    EXPECT_TRUE(f.seconds_per_step > 1e-10 && f.seconds_per_step < 1e-2)
        << f.metadata->id << ": " << f.seconds_per_step;
}

TEST(Run, IsTheSameTwice) {
  const auto system = find_system("constant-velocity", {{}, 40, {}});
  const SystemRun one = run(system, select_filters(""), {}), two = run(system, select_filters(""), {});
  for (std::size_t i = 0; i < one.filters.size(); ++i) {
    EXPECT_EQ(one.filters[i].covariance_error.points().value, two.filters[i].covariance_error.points().value);
    EXPECT_EQ(one.filters[i].state_error.points().value, two.filters[i].state_error.points().value);
  }
}

using RunDeathTest = ::testing::Test;

/// In a process of its own: the request stays for ever.
TEST(RunDeathTest, InterruptedKeepsWhatIsDone) {
  const auto interrupt_at_step_five = [] {
    watch_for_interruption();
    std::int64_t told = 0;
    const SystemRun result =
        run(system_of_text(benign), select_filters("^(ckf|srif)$"), {.digits = 30, .progress = [&](std::int64_t units) {
                                                                       if ((told += units) == 5) std::raise(SIGINT);
                                                                     }});
    bool good = interrupted() && result.interrupted && result.steps_done == 5 && result.steps_asked == 60 &&
                result.certified_digits >= 30;
    for (const FilterRun& f : result.filters)
      good = good && f.covariance_error.count() == 5 && f.covariance_error.largest() < 1e-13 && !f.first_failure &&
             std::isnan(f.seconds_per_step);
    std::_Exit(good ? 0 : 1);
  };
  EXPECT_FALSE(interrupted());
  EXPECT_EXIT(interrupt_at_step_five(), ::testing::ExitedWithCode(0), "");
}

/// A user who is not content with one Ctrl-C gets what the system does.
TEST(RunDeathTest, ASecondInterruptionEndsTheProcess) {
  const auto twice = [] {
    watch_for_interruption();
    std::raise(SIGINT);
    if (!interrupted()) std::_Exit(1);
    std::raise(SIGINT);
    std::_Exit(0);
  };
  EXPECT_EXIT(twice(), ::testing::KilledBySignal(SIGINT), "");
}

// Trajectories of the reference: as many as there are problems that differ as exact numbers.

TEST(Run, ProblemsOfTheSameNumbersShareATrajectory) {
  // Roots and inverses of everything are dyadic, so that the three problems are one.
  const std::string dyadic = R"(
name = "dyadic"
A = [[1, 0.5], [0, 0.5]]
B = [[1], [0.5]]
C = [[1, 0]]
Q = 0.25
R = 4
P0 = { diagonal = [16, 1] }
steps = 20
measurements = { simulate = { seed = 1 } }
)";
  const SystemRun together = run_text(dyadic, symmetric);
  EXPECT_EQ(together.trajectories, 1);
  for (const FilterRun& shared : together.filters) {
    const SystemRun apart = run_text(dyadic, "^" + std::string(shared.metadata->id) + "$");
    EXPECT_EQ(apart.trajectories, 1);
    const FilterRun& alone = apart.filters.front();
    // Errors of a few u, of truths that agree to 30 digits at least: equal to 30 - 16 digits but for the order of sums.
    const double tolerance = 1e-12;
    const auto expect_same = [&](const Series& x, const Series& y, const char* what) {
      ASSERT_EQ(x.count(), y.count()) << what;
      const auto a = x.points().value, b = y.points().value;
      for (std::size_t k = 0; k < a.size(); ++k)
        EXPECT_NEAR(a[k], b[k], tolerance * std::fabs(a[k])) << shared.metadata->id << ", " << what << ", step " << k;
    };
    expect_same(shared.covariance_error, alone.covariance_error, "covariance");
    expect_same(shared.gain_error, alone.gain_error, "gain");
    expect_same(shared.state_error, alone.state_error, "state");
    expect_same(shared.bound, alone.bound, "bound");
  }
}

TEST(Run, ProblemsOfDifferentNumbersDoNot) {
  // P0 has no root in double, A no inverse.
  EXPECT_EQ(run_text(benign, symmetric).trajectories, 3);
  EXPECT_EQ(run_text(benign, "^(ckf|joseph|srcf)$").trajectories, 2);
  EXPECT_EQ(run_text(benign, "^(ckf|joseph)$").trajectories, 1);
}

// Errors are of the size of the word's roundoff, below the bound for that roundoff, and of the size of nothing smaller.
TEST(Run, FiltersMayHaveAnyNumberOfBits) {
  const auto system = system_of_text(benign);
  for (const int bits : {16, 24, 80}) {
    const SystemRun result = run(system, select_filters(symmetric), {.bits = bits});
    EXPECT_FALSE(result.reference_error);
    for (const FilterRun& f : result.filters) {
      SCOPED_TRACE(std::string(f.metadata->id) + " at " + std::to_string(bits));
      EXPECT_EQ(f.covariance_error.count(), 60);
      EXPECT_LE(f.covariance_error.largest(), f.bound.largest());
      EXPECT_GT(f.covariance_error.largest(), std::ldexp(1, -bits - 8));
      EXPECT_FALSE(f.first_indefinite);
      EXPECT_TRUE(std::isnan(f.seconds_per_step)) << "the time of a simulated word says nothing";
    }
  }
}

TEST(Run, StepsMayBeObserved) {
  std::int64_t seen = 0;
  const SystemRun result = run(system_of_text(benign), select_filters("^(ckf|srcf)$"),
                               {.timed = false, .observe = [&](const Observation& now) {
                                  ++seen;
                                  EXPECT_EQ(now.truth.k(), now.k);
                                  EXPECT_TRUE(now.step.held && now.errors.covariance >= 0);
                                }});
  EXPECT_EQ(seen, 2 * result.steps_done);
  EXPECT_TRUE(std::isnan(result.filters[0].seconds_per_step));
}
