#pragma once

#include <cctype>
#include <cstdlib>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <kfstab/properties/check.hpp>
#include <kfstab/properties/diagnosis.hpp>
#include <kfstab/properties/failure_message.hpp>
#include <kfstab/properties/typed_filter.hpp>

/// All laws as GoogleTest cases for a filter of one's own, in one line of a test program:
///
///     #include <kfstab/properties/googletest.hpp>
///     KFSTAB_CHECK(MyFilter);
///
/// makes the tests MyFilter.Symmetry, MyFilter.GainOptimality ... , one a law. MyFilter is a CheckableFilter
/// (typed_filter.hpp). The systems are drawn as `kfstab check` draws them: KFSTAB_CASES (200) and KFSTAB_SEED (1986) in the
/// environment say how many and which. One check serves all tests that are run together; a test that is run alone checks
/// its law alone. A law that does not apply to what the filter answers is skipped.
///
/// In CMake: find_package(kfstab COMPONENTS check), target_link_libraries(... kfstab::check GTest::gtest_main). This header is
/// the only one that needs GoogleTest.
#define KFSTAB_CHECK(...) KFSTAB_CHECK_NAMED_(__LINE__, __VA_ARGS__)
#define KFSTAB_CHECK_NAMED_(line, ...) KFSTAB_CHECK_AT_(line, __VA_ARGS__)
#define KFSTAB_CHECK_AT_(line, ...)                                                              \
  [[maybe_unused]] static const bool kfstab_check_##line = ::kfstab::properties::register_tests( \
      #__VA_ARGS__, [] { return ::kfstab::properties::typed_subject<__VA_ARGS__>(#__VA_ARGS__); }, __FILE__, __LINE__)

namespace kfstab::properties {

namespace detail {

/// One filter's tests: they share a check.
class TestedFilter {
 public:
  explicit TestedFilter(std::function<std::unique_ptr<Subject>()> make) : make_(std::move(make)) {}

  const LawOutcome& outcome(const Law& law) {
    const bool alone = ::testing::UnitTest::GetInstance()->test_to_run_count() == 1;
    if (!report_) {
      report_ = run(alone ? std::vector<Law>{law} : all_laws());
      if (!report_->passed()) {
        if (const auto found = diagnose(report_->subject, report_->runs); !found.empty())
          diagnosis_ = "It " + found.front().sentence() + "\n";
        else if (const auto near = candidates(*report_); !near.empty())
          diagnosis_ = "A guess: it is like a filter that " + near.front().sentence() + "\n";
      }
    }
    for (const LawOutcome& outcome : report_->laws)
      if (outcome.law.id == law.id) return outcome;
    throw std::logic_error("no outcome of " + std::string(law.id));
  }

  /// What mistake the filter makes, if one explains what it answers; else the likeliest guess, if there is one.
  const std::string& diagnosis() const { return diagnosis_; }

 private:
  std::unique_ptr<CheckReport> run(std::vector<Law> laws) const {
    CheckOptions options;
    options.laws = std::move(laws);
    if (const char* cases = std::getenv("KFSTAB_CASES")) options.cases = std::atoi(cases);
    if (const char* seed = std::getenv("KFSTAB_SEED")) options.seed = std::strtoull(seed, nullptr, 10);
    const auto subject = make_();
    return std::make_unique<CheckReport>(check(*subject, options));
  }

  std::function<std::unique_ptr<Subject>()> make_;
  std::unique_ptr<CheckReport> report_;
  std::string diagnosis_;
};

class LawTest : public ::testing::Test {
 public:
  LawTest(std::shared_ptr<TestedFilter> filter, Law law, const char* file, int line)
      : filter_(std::move(filter)), law_(std::move(law)), file_(file), line_(line) {}

  void TestBody() override {
    const LawOutcome& outcome = filter_->outcome(law_);
    if (outcome.failure)
      ADD_FAILURE_AT(file_, line_) << failure_message(outcome) << filter_->diagnosis();
    else if (outcome.cases == 0)
      GTEST_SKIP() << law_.id << " applied to none of the systems";
  }

 private:
  std::shared_ptr<TestedFilter> filter_;
  Law law_;
  const char* file_;
  int line_;
};

/// "gain-optimality" as a test's name: GainOptimality. A '-' is an operator of --gtest_filter.
inline std::string test_name(std::string_view id) {
  std::string name;
  bool upper = true;
  for (const char c : id) {
    if (!std::isalnum(static_cast<unsigned char>(c))) {
      upper = true;
      continue;
    }
    name += upper ? static_cast<char>(std::toupper(static_cast<unsigned char>(c))) : c;
    upper = false;
  }
  return name;
}

}  // namespace detail

/// What KFSTAB_CHECK does, for filters that are made in another way. Always true.
inline bool register_tests(const std::string& name, std::function<std::unique_ptr<Subject>()> make, const char* file,
                           int line) {
  const auto filter = std::make_shared<detail::TestedFilter>(std::move(make));
  std::string suite;
  for (const char c : name)
    if (std::isalnum(static_cast<unsigned char>(c))) suite += c;
  for (const Law& law : all_laws())
    ::testing::RegisterTest(suite.c_str(), detail::test_name(law.id).c_str(), nullptr, nullptr, file, line,
                            [=]() -> ::testing::Test* { return new detail::LawTest(filter, law, file, line); });
  return true;
}

}  // namespace kfstab::properties
