#include <kfstab/filters/registry.hpp>

#include <gtest/gtest.h>

#include <cctype>
#include <set>
#include <stdexcept>
#include <string>

#include "filters/random_problem.hpp"

namespace kfstab::test {

TEST(Registry, HasEveryFilterOnce) {
  std::set<std::string_view> ids;
  for (const Metadata& metadata : filters()) EXPECT_TRUE(ids.insert(metadata.id).second) << metadata.id << " twice";
  for (const auto id : {"ckf", "ckf-textbook", "ckf-mixed", "ckf-gain", "ckf-cp", "ckf-downdate", "joseph", "srcf",
                        "srif", "ud", "potter", "carlson", "information", "svd",
                        "srcf-hessenberg", "srif-hessenberg"})
    EXPECT_TRUE(ids.contains(id)) << id;
}

TEST(Registry, MakesEveryFilterItNames) {
  for (const Metadata& metadata : filters()) {
    EXPECT_EQ(find_filter(metadata.id), &metadata);
    const auto filter = make_filter<double>(metadata.id);
    ASSERT_TRUE(filter) << metadata.id;
    EXPECT_EQ(&filter->metadata(), &metadata);
  }
}

TEST(Registry, KnowsNoOther) {
  for (const auto id : {"", "CKF", "ckf ", "kalman", "srcf-"}) {
    EXPECT_EQ(find_filter(id), nullptr) << id;
    try {
      make_filter<double>(id);
      ADD_FAILURE() << "'" << id << "' made a filter";
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find("'" + std::string(id) + "'"), std::string::npos) << error.what();
    }
  }
}

TEST(Registry, MetadataAreCompleteAndAgree) {
  for (const Metadata& metadata : filters()) {
    SCOPED_TRACE(metadata.id);
    for (const auto text : {metadata.title, metadata.update, metadata.operations, metadata.source})
      EXPECT_FALSE(text.empty());
    for (const char c : metadata.id) EXPECT_TRUE(std::islower(c) || std::isdigit(c) || c == '-');
    // Who holds a root takes roots, who holds information takes the inverses and therefore needs them to exist.
    switch (metadata.takes) {
      case Parametrisation::covariance: EXPECT_EQ(metadata.holds, Held::covariance); break;
      case Parametrisation::root: EXPECT_TRUE(holds_root(metadata.holds) || metadata.holds == Held::gain); break;
      case Parametrisation::information:
        EXPECT_TRUE(metadata.holds == Held::information_factor || metadata.holds == Held::information);
        EXPECT_EQ(metadata.instant, Instant::filtered);
        EXPECT_TRUE(metadata.needs.invertible_A);
        EXPECT_TRUE(metadata.needs.positive_definite_Q);
        EXPECT_TRUE(metadata.needs.positive_definite_R);
        EXPECT_TRUE(metadata.needs.positive_definite_P0);
    }
    if (metadata.asymmetry != Asymmetry::none) {
      EXPECT_EQ(metadata.holds, Held::covariance);
    }
  }
  // The five codings are five.
  std::set<Asymmetry> codings;
  for (const Metadata& metadata : filters())
    if (metadata.asymmetry != Asymmetry::none) {
      EXPECT_TRUE(codings.insert(metadata.asymmetry).second) << metadata.id;
    }
  EXPECT_EQ(codings.size(), 5u);
}

TEST(Registry, RefusesAProblemOfAnotherParametrisation) {
  const Case c{.d = {2, 1, 1}};
  for (const Metadata& metadata : filters())
    for (const auto takes : {Parametrisation::covariance, Parametrisation::root, Parametrisation::information}) {
      const auto filter = make_filter<double>(metadata.id);
      const auto problem = random_problem(takes, c, 1);
      EXPECT_EQ(parametrisation(problem), takes);
      if (takes == metadata.takes) {
        EXPECT_NO_THROW(filter->start(problem)) << metadata.id;
        continue;
      }
      try {
        filter->start(problem);
        ADD_FAILURE() << metadata.id << " took it";
      } catch (const std::invalid_argument& error) {
        EXPECT_NE(std::string(error.what()).find(metadata.id), std::string::npos) << error.what();
      }
    }
}

// One filter serves one problem after another, of other sizes too, and keeps nothing of the last.
TEST(Registry, AFilterMayBeStartedAgain) {
  for (const Metadata& metadata : filters()) {
    const auto used = make_filter<double>(metadata.id), fresh = make_filter<double>(metadata.id);
    const auto other = random_problem(metadata.takes, {.d = {4, 2, 3}, .inputs = 2}, 5);
    const auto problem = random_problem(metadata.takes, {.d = {3, 1, 2}, .inputs = 1}, 6);
    Dice dice(1);
    const Vector<double> y_other = dice.vector(3, 16), u_other = dice.vector(2, 16), y = dice.vector(2, 16),
                         input = dice.vector(1, 16);
    used->start(other);
    for (int k = 0; k < 3; ++k) ASSERT_TRUE(used->step(k, &y_other, &u_other).report);
    used->start(problem);
    fresh->start(problem);
    for (int k = 0; k < 3; ++k) {
      const auto again = used->step(k, &y, &input), first = fresh->step(k, &y, &input);
      ASSERT_TRUE(again.report && first.report);
      ASSERT_EQ(bool(again.held), metadata.holds != Held::gain) << metadata.id;
      if (again.held) {
        EXPECT_EQ(*again.held, *first.held) << metadata.id;
      }
      EXPECT_EQ(*again.gain, *first.gain) << metadata.id;
      EXPECT_EQ(*again.state, *first.state) << metadata.id;
    }
  }
}

TEST(StatusName, OfEach) {
  EXPECT_STREQ(name(Status::ok), "ok");
  EXPECT_STREQ(name(Status::singular_innovation), "singular_innovation");
  EXPECT_STREQ(name(Status::not_positive_definite), "not_positive_definite");
  EXPECT_STREQ(name(Status::singular_information), "singular_information");
  EXPECT_STREQ(name(Status::singular_measurement_noise), "singular_measurement_noise");
  EXPECT_STREQ(name(Status::no_convergence), "no_convergence");
  EXPECT_STREQ(name(Status::non_finite_input), "non_finite_input");
  EXPECT_STREQ(name(Status::overflow), "overflow");
}

}  // namespace kfstab::test
