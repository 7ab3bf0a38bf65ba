// The ledger under deliberate damage. A laboratory that confirms its claims whatever happens to its filters and its
// reference measures nothing: each fault here must turn the verdict of the claims that are named beside it.

#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include <gtest/gtest.h>

#include <kfstab/filters/instances.hpp>

#include "damage/filters.hpp"
#include "damage/reference.hpp"
#include "experiments/claims.hpp"
#include "filters/in_batch.hpp"
#include "filters/with_kernels.hpp"

using namespace kfstab;
using experiments::Effort;
using reference::detail::Lockstep;
using reference::detail::Source;
using reports::Verdict;

namespace {

enum class Fault {
  none,
  /// None either, but in the classes of this test.
  none_rewritten,
  /// None either, but ckf, srcf and srif are filters of a batch.
  none_in_a_batch,
  gram_schmidt,
  symmetrised,
  without_cosine,
  reference_in_double,
};

Fault fault = Fault::none;

}  // namespace

// ---- What the linker hands out --------------------------------------------------------------------------------------

namespace right {

std::unique_ptr<AnyFilter<double>> make_filter(std::string_view id) __asm__("__real_" KFSTAB_MAKE_FILTER);
std::unique_ptr<Lockstep> low(int pair, const Source& source, bool with_data) __asm__("__real_" KFSTAB_LOW_LOCKSTEP);
std::unique_ptr<Lockstep> high(int pair, const Source& source, bool with_data) __asm__("__real_" KFSTAB_HIGH_LOCKSTEP);

}  // namespace right

namespace damaged {

std::unique_ptr<AnyFilter<double>> make_filter(std::string_view id) __asm__("__wrap_" KFSTAB_MAKE_FILTER);
std::unique_ptr<Lockstep> low(int pair, const Source& source, bool with_data) __asm__("__wrap_" KFSTAB_LOW_LOCKSTEP);
std::unique_ptr<Lockstep> high(int pair, const Source& source, bool with_data) __asm__("__wrap_" KFSTAB_HIGH_LOCKSTEP);

std::unique_ptr<AnyFilter<double>> make_filter(std::string_view id) {
  const auto make = [id]<class Filter>(std::type_identity<Filter>) -> std::unique_ptr<AnyFilter<double>> {
    return std::make_unique<FilterOf<Filter>>(*find_filter(id));
  };
  if (id == "srcf" && fault == Fault::none_rewritten)
    return make(std::type_identity<damage::ArrayFilter<damage::Householder>>{});
  if (id == "srcf" && fault == Fault::gram_schmidt)
    return make(std::type_identity<damage::ArrayFilter<damage::GramSchmidt>>{});
  if (id == "ckf-gain" && fault == Fault::none_rewritten) return make(std::type_identity<damage::Coding3<false>>{});
  if (id == "ckf-gain" && fault == Fault::symmetrised) return make(std::type_identity<damage::Coding3<true>>{});
  if (fault == Fault::none_in_a_batch)
    if (auto filter = test::in_batch(id)) return filter;
  return right::make_filter(id);
}

std::unique_ptr<Lockstep> damage(std::unique_ptr<Lockstep> right, const Source& source) {
  if (fault == Fault::without_cosine) return std::make_unique<damage::WithoutCosine>(std::move(right));
  if (fault == Fault::reference_in_double && std::holds_alternative<const AnyProblem<double>*>(source))
    return std::make_unique<damage::InDouble>(std::move(right), source);
  return right;
}

std::unique_ptr<Lockstep> low(int pair, const Source& source, bool with_data) {
  return damage(right::low(pair, source, with_data), source);
}

std::unique_ptr<Lockstep> high(int pair, const Source& source, bool with_data) {
  return damage(right::high(pair, source, with_data), source);
}

}  // namespace damaged

// ---- The ledger -----------------------------------------------------------------------------------------------------

namespace {

/// The claims that are not confirmed any more, and why not.
std::map<std::string, std::string> turned_by(Fault which) {
  fault = which;
  const auto results = experiments::run_claims(experiments::all_claims(), {}, Effort::quick, 0, [] {});
  fault = Fault::none;
  EXPECT_EQ(results.size(), experiments::all_claims().size());
  std::map<std::string, std::string> turned;
  for (const auto& result : results)
    if (result.verdict() != Verdict::confirmed) turned[result.claim.id] = experiments::failing(result);
  return turned;
}

void expect_turned(Fault which, const std::vector<std::string>& claims) {
  const auto turned = turned_by(which);
  std::string all;
  for (const auto& [claim, why] : turned) all += claim + "\n" + why;
  for (const auto& claim : claims)
    EXPECT_TRUE(turned.contains(claim)) << claim << " is confirmed in spite of the fault. Turned are\n" << all;
  testing::Test::RecordProperty("turned", all);
}

}  // namespace

TEST(Damage, NoneTurnsNoVerdict) {
  for (const auto& [claim, why] : turned_by(Fault::none_rewritten)) ADD_FAILURE() << claim << "\n" << why;
}

// What the ledger says of a filter is true of many at once, too.
TEST(Damage, NoneInABatchTurnsNoVerdict) {
  const test::WithKernels fastest(test::all_kernels().back());
  for (const auto& [claim, why] : turned_by(Fault::none_in_a_batch)) ADD_FAILURE() << claim << "\n" << why;
}

TEST(Damage, GramSchmidtForHouseholderInTheSquareRootFilter) {
  expect_turned(Fault::gram_schmidt, {"innovation-conditioning", "post-array-angle", "dyer-mcreynolds", "scalar-roots",
                                      "weak-prior"});
}

TEST(Damage, SymmetrisedCoding3) {
  expect_turned(Fault::symmetrised, {"asymmetry-growth", "asymmetry-divergence", "asymmetry-without-bound",
                                     "noise-free-modes", "rls-forgetting"});
}

TEST(Damage, WithoutTheAngleOfThePostArray) { expect_turned(Fault::without_cosine, {"post-array-angle"}); }

TEST(Damage, ReferenceInDouble) {
  expect_turned(Fault::reference_in_double, {"innovation-conditioning", "post-array-angle", "dyer-mcreynolds",
                                             "scalar-roots", "unexcited-mode", "weak-prior"});
}
