#include <kfstab/experiments/traces.hpp>

#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>

#include <gtest/gtest.h>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/run.hpp>
#include <kfstab/experiments/selection.hpp>
#include <kfstab/filters/registry.hpp>

using namespace kfstab;
using namespace kfstab::experiments;
using reference::Errors;

namespace {

properties::System nearly_dependent(double d, std::int64_t steps) {
  const Matrix<double> C{{1., 1., 1.}, {1., 1., 1 + d}}, I = Matrix<double>::Identity(3, 3);
  return system_of("nearly-dependent", I, Matrix<double>::Zero(3, 1), C, d * Matrix<double>::Identity(2, 2), I, steps);
}

}  // namespace

TEST(Traces, AreWhatARunMeasures) {
  const auto system = find_system("constant-velocity");
  const std::vector<std::string> ids = {"ckf", "joseph", "srcf", "srif", "csrf"};
  const auto traced = traces(system, ids);
  ASSERT_EQ(traced.size(), ids.size());
  for (const std::string& id : ids) {
    const auto ran = run(system, {find_filter(id)}, {}).filters.front();
    const Trace& trace = traced.at(id);
    ASSERT_EQ(trace.errors.size(), static_cast<std::size_t>(system.steps)) << id;
    EXPECT_EQ(trace.end, Status::ok) << id;
    EXPECT_EQ(trace.worst(&Errors::gain), ran.gain_error.largest()) << id;
    if (id != "csrf") {
      EXPECT_EQ(trace.worst(&Errors::covariance), ran.covariance_error.largest()) << id;
    }
    if (system.data) {
      EXPECT_EQ(trace.worst(&Errors::state), ran.state_error.largest()) << id;
    }
  }
}

TEST(Traces, EndWhereAFilterBreaksDown) {
  const auto traced = traces(nearly_dependent(0x1p-40, 5), {"ckf", "srcf"});
  const Trace& broken = traced.at("ckf");
  EXPECT_NE(broken.end, Status::ok);
  EXPECT_LT(broken.errors.size(), 5u);
  EXPECT_EQ(broken.worst(&Errors::covariance), std::numeric_limits<double>::infinity());
  EXPECT_TRUE(broken.lost_definiteness());
  const Trace& whole = traced.at("srcf");
  EXPECT_EQ(whole.end, Status::ok);
  EXPECT_EQ(whole.errors.size(), 5u);
  EXPECT_LT(whole.worst(&Errors::covariance), 1);
  EXPECT_FALSE(whole.lost_definiteness());
}

TEST(Traces, WorstIsTheLargestFromAStepOnAndInfiniteForWhatIsNotThere) {
  Trace trace;
  Errors errors{};
  for (const double error : {3., 1., 2.}) {
    errors.covariance = error;
    errors.information = std::numeric_limits<double>::quiet_NaN();
    errors.positive_semidefinite = true;
    trace.errors.push_back(errors);
  }
  EXPECT_EQ(trace.worst(&Errors::covariance), 3);
  EXPECT_EQ(trace.worst(&Errors::covariance, 1), 2);
  EXPECT_EQ(trace.worst(&Errors::information), std::numeric_limits<double>::infinity());
  EXPECT_FALSE(trace.lost_definiteness());
  trace.errors[1].positive_semidefinite = false;
  EXPECT_TRUE(trace.lost_definiteness());
}

TEST(Traces, RefuseAFilterThatDoesNotApply) {
  auto system = nearly_dependent(.5, 3);
  EXPECT_THROW(traces(system, {"no-such-filter"}), std::logic_error);
  system.A = Matrix<double>(Matrix<double>::Zero(3, 3));
  EXPECT_THROW(traces(system, {"srif"}), std::logic_error);
  EXPECT_NO_THROW(traces(system, {"srcf"}));
}

TEST(FilterIds, AreThoseSelectedInTheRegistrysOrder) {
  const auto all = filter_ids([](const Metadata&) { return true; });
  ASSERT_EQ(all.size(), filters().size());
  for (std::size_t i = 0; i < all.size(); ++i) EXPECT_EQ(all[i], filters()[i].id);
  EXPECT_TRUE(filter_ids([](const Metadata&) { return false; }).empty());
  EXPECT_EQ(filter_ids([](const Metadata& m) { return m.holds == Held::ud_factors; }), std::vector<std::string>{"ud"});
}
