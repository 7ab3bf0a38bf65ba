#pragma once

#include <gtest/gtest.h>

#include <algorithm>

#include <kfstab/filters/registry.hpp>

#include "filters/plain_recursion.hpp"
#include "filters/random_problem.hpp"
#include "tolerance.hpp"

namespace kfstab::test {

inline const Case cases[] = {
    {.d = {4, 2, 2}, .period = 3, .inputs = 1},
    {.d = {4, 2, 2}, .period = 1, .inputs = 2},
    {.d = {3, 1, 1}, .period = 2, .data = false},
    {.d = {2, 3, 5}, .period = 3, .inputs = 1},
    {.d = {3, 2, 3}, .period = 3},
    {.d = {5, 2, 3}, .period = 4, .inputs = 1},
    {.d = {3, 5, 1}, .period = 2, .inputs = 1},
    {.d = {4, 0, 2}, .period = 3, .inputs = 1},
    {.d = {3, 2, 0}, .period = 3, .inputs = 1},
    {.d = {3, 0, 0}, .period = 2, .inputs = 1},
    {.d = {1, 1, 1}, .period = 3, .inputs = 1},
    {.d = {1, 1, 3}, .period = 2},
    {.d = {1, 3, 1}, .period = 1},
    {.d = {0, 0, 0}},
    {.d = {0, 1, 2}, .period = 2},
    {.d = {4, 3, 2}, .period = 3, .inputs = 1, .singular = true},
    {.d = {2, 1, 3}, .period = 1, .singular = true},
};

/// Runs every filter of the registry, in this scalar, beside the plain recursion, on every case that it applies to. The
/// recursion has no bound for csrf, whose errors depend on its rotations: chandrasekhar_test.cpp has.
template <class Scalar>
void every_filter_follows_the_plain_recursion(std::uint64_t seeds) {
  for (const Metadata& metadata : filters()) {
    if (metadata.holds == Held::gain) continue;
    double worst = 0;
    for (const Case& c : cases) {
      if (!applies(metadata, c)) continue;
      for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
        SCOPED_TRACE(std::string(metadata.id) + ": " + c.text() + " seed=" + std::to_string(seed));
        const AnyProblem<double> problem = random_problem(metadata.takes, c, seed);
        const AnyProblem<Scalar> rounded = cast<Scalar>(problem);
        PlainRecursion recursion(problem, metadata, static_cast<double>(unit_roundoff<Scalar>()));
        const auto filter = make_filter<Scalar>(metadata.id);
        filter->start(rounded);
        Dice dice(1000 + seed);
        for (int k = 0; k < 5; ++k) {
          const Vector<double> y = dice.vector(c.d.p, 48), input = dice.vector(c.inputs, 16);
          const Vector<Scalar> y_rounded = cast<Scalar>(y), input_rounded = cast<Scalar>(input);
          recursion.step(k, c.data ? &y : nullptr, c.data && c.inputs ? &input : nullptr);
          const Step<Scalar> step =
              filter->step(k, c.data ? &y_rounded : nullptr, c.data && c.inputs ? &input_rounded : nullptr);
          ASSERT_EQ(step.report.status, Status::ok) << name(step.report.status) << " in step " << k;
          ASSERT_TRUE(step.held && step.gain);
          ASSERT_EQ(step.state != nullptr, c.data);
          ASSERT_EQ(step.held->rows(), c.d.n);
          ASSERT_EQ(step.held->cols(), c.d.n);
          ASSERT_EQ(step.gain->rows(), c.d.n);
          ASSERT_EQ(step.gain->cols(), c.d.p);
          const Judgement is =
              recursion.judge(exact(*step.held), exact(*step.gain), step.state ? exact(*step.state) : Exact{});
          // A NaN fails: it is not at most 30.
          EXPECT_LE(is.held.ratio(), threshold) << "step " << k << ": held is off by " << is.held.error;
          EXPECT_LE(is.gain.ratio(), threshold) << "step " << k << ": the gain is off by " << is.gain.error;
          EXPECT_LE(is.state.ratio(), threshold) << "step " << k << ": the state is off by " << is.state.error;
          worst = std::max({worst, is.held.ratio(), is.gain.ratio(), is.state.ratio()});
        }
      }
    }
    ::testing::Test::RecordProperty(std::string(metadata.id), std::to_string(worst));
  }
}

}  // namespace kfstab::test
