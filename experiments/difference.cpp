#include <kfstab/experiments/difference.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <set>

#include <fmt/core.h>

#include <kfstab/experiments/constants.hpp>
#include <kfstab/properties/input_error.hpp>
#include <kfstab/reports/number.hpp>

namespace kfstab::experiments {
namespace {

using reports::short_number;
using enum reports::Alignment;

bool same(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

/// "+12 %", "-99.9 %", or times where percents mean nothing any more.
std::string relative_change(double before, double after) {
  if (!std::isfinite(before) || !std::isfinite(after) || before == 0 || before == after) return "";
  const double ratio = after / before;
  if (ratio > 10 || (ratio > 0 && ratio < .1)) return fmt::format("x {}", short_number(ratio));
  return fmt::format("{}{} %", ratio >= 1 ? "+" : "", short_number(100 * (ratio - 1)));
}

/// How far a change is from none, to put the largest first.
double size_of_change(double before, double after) {
  if (!std::isfinite(before) || !std::isfinite(after)) return infinity;
  return std::abs(after - before) / std::max({std::abs(before), std::abs(after), 1e-300});
}

/// One section of tables; what there is nothing to say of is left out.
struct Pages {
  reports::Document document;

  void add(const std::string& anchor, const std::string& title, reports::Table table,
           const std::string& if_empty = "") {
    if (table.rows.empty() && if_empty.empty()) return;
    reports::Section section{anchor, title, std::nullopt, {}};
    if (table.rows.empty())
      section.blocks.push_back(reports::Paragraph{if_empty});
    else
      section.blocks.push_back(std::move(table));
    document.sections.push_back(std::move(section));
  }
};

/// What is in one list and not in the other.
reports::Table new_and_gone(const std::vector<std::string>& before, const std::vector<std::string>& after) {
  reports::Table table{"", {"what", ""}, {}, {}};
  const auto without = [&](const std::vector<std::string>& some, const std::vector<std::string>& others,
                           const char* word) {
    for (const std::string& one : some)
      if (std::ranges::find(others, one) == others.end()) table.rows.push_back({one, word});
  };
  without(after, before, "new");
  without(before, after, "gone");
  return table;
}

reports::Table contexts(const Context& before, const Context& after) {
  reports::Table table{"", {"", "before", "after"}, {}, {}};
  const auto value = [](const Context& context, const std::string& key) {
    const auto found = std::ranges::find(context, key, &Context::value_type::first);
    return found == context.end() ? std::string("-") : found->second;
  };
  std::vector<std::string> keys;
  for (const Context* context : {&before, &after})
    for (const auto& [key, text] : *context)
      if (std::ranges::find(keys, key) == keys.end()) keys.push_back(key);
  for (const std::string& key : keys)
    if (value(before, key) != value(after, key)) table.rows.push_back({key, value(before, key), value(after, key)});
  return table;
}

reports::Table parameters(const std::string& of, const std::map<std::string, double>& before,
                          const std::map<std::string, double>& after, reports::Table table) {
  for (const auto& [name, value] : before)
    if (const auto found = after.find(name); found != after.end() && !same(found->second, value))
      table.rows.push_back({of, name, reports::exact_number(value), reports::exact_number(found->second)});
  return table;
}

// ---- Claims --------------------------------------------------------------------------------------------------------

int rank(reports::Verdict verdict) {
  switch (verdict) {
    case reports::Verdict::confirmed: return 2;
    case reports::Verdict::inconclusive: return 1;
    case reports::Verdict::refuted: break;
  }
  return 0;
}

std::string holds(const reports::Check& before, const reports::Check& after) {
  const auto word = [](bool yes) { return yes ? "yes" : "no"; };
  if (before.holds == after.holds) return word(after.holds);
  return fmt::format("{} -> {}", word(before.holds), word(after.holds));
}

bool compare(Pages& pages, const StoredClaims& before, const StoredClaims& after) {
  bool worse = false;
  reports::Table verdicts{"", {"", "claim", "before", "after", ""}, {}, {right}};
  reports::Table set{"", {"claim", "parameter", "before", "after"}, {}, {left, left, right, right}};
  struct Row {
    bool turned;
    double size;
    std::vector<std::string> cells;
  };
  std::vector<Row> rows;
  std::vector<std::string> names[2];
  for (const ClaimResult& claim : before.claims) names[0].push_back(claim.claim.id);
  for (const ClaimResult& now : after.claims) {
    names[1].push_back(now.claim.id);
    const auto old = std::ranges::find(before.claims, now.claim.id, [](const ClaimResult& r) { return r.claim.id; });
    if (old == before.claims.end()) continue;
    const int change = rank(now.verdict()) - rank(old->verdict());
    worse = worse || change < 0;
    if (change != 0)
      verdicts.rows.push_back({fmt::format("C{}", now.claim.number), now.claim.id, std::string(name(old->verdict())),
                               std::string(name(now.verdict())), change < 0 ? "worse" : "better"});
    set = parameters(now.claim.id, old->settings.values(), now.settings.values(), std::move(set));
    for (const reports::Check& check : now.findings.checks) {
      const auto& checks = old->findings.checks;
      const auto was = std::ranges::find(checks, check.name, &reports::Check::name);
      const std::string of = now.claim.id + ": " + check.name;
      names[1].push_back(of);
      if (was == checks.end() || (same(was->measured, check.measured) && was->holds == check.holds)) continue;
      rows.push_back({was->holds != check.holds,
                      size_of_change(was->measured, check.measured),
                      {now.claim.id, check.name, short_number(was->measured, 4), short_number(check.measured, 4),
                       relative_change(was->measured, check.measured), holds(*was, check)}});
    }
    for (const reports::Check& check : old->findings.checks) names[0].push_back(now.claim.id + ": " + check.name);
  }
  // The checks of a claim that is new or gone say nothing that its own name does not.
  std::ranges::stable_sort(
      rows, [](const Row& a, const Row& b) { return std::pair(a.turned, a.size) > std::pair(b.turned, b.size); });
  reports::Table checks{"Those that turned first, then the largest changes",
                        {"claim", "check", "before", "after", "change", "holds"},
                        {},
                        {left, left, right, right, right, left}};
  for (Row& row : rows) checks.rows.push_back(std::move(row.cells));

  pages.add("changed-verdicts", "Verdicts", std::move(verdicts), "No verdict has changed.");
  pages.add("checks", "Checks", std::move(checks), "Every check that both have measured the same number.");
  pages.add("parameters", "Parameters", std::move(set));
  pages.add("new-and-gone", "New and gone", new_and_gone(names[0], names[1]));
  return worse;
}

// ---- Runs ----------------------------------------------------------------------------------------------------------

/// A step at which something bad happened; never: none.
std::string step_of(const std::optional<std::int64_t>& step) { return step ? fmt::format("step {}", *step) : "never"; }
bool earlier(const std::optional<std::int64_t>& now, const std::optional<std::int64_t>& before) {
  return now && (!before || *now < *before);
}

bool compare(Pages& pages, const StoredRun& before, const StoredRun& after) {
  bool worse = false;
  reports::Table soundness{"", {"system", "filter", "what", "before", "after", ""}, {}, {}};
  reports::Table numbers{"Relative errors, the smallest eigenvalue of P and digits, at the last step or at their worst",
                         {"system", "filter", "what", "before", "after", "change"},
                         {},
                         {left, left, left, right, right, right}};
  reports::Table set{"", {"system", "parameter", "before", "after"}, {}, {left, left, right, right}};
  std::vector<std::string> names[2];
  const auto key = [](const SystemRun& run, const FilterRun& f) {
    return fmt::format("{}: {}", run.name, f.metadata->id);
  };
  for (const SystemRun& run : before.systems) {
    names[0].push_back(run.name);
    for (const FilterRun& f : run.filters) names[0].push_back(key(run, f));
  }
  for (const SystemRun& run : after.systems) {
    names[1].push_back(run.name);
    for (const FilterRun& f : run.filters) names[1].push_back(key(run, f));
    const auto old = std::ranges::find(before.systems, run.name, &SystemRun::name);
    if (old == before.systems.end()) continue;
    auto given = [](const SystemRun& r) {
      auto values = r.parameters;
      values["steps"] = static_cast<double>(r.steps_done);
      if (r.seed) values["seed"] = static_cast<double>(*r.seed);
      return values;
    };
    set = parameters(run.name, given(*old), given(run), std::move(set));
    for (const FilterRun& f : run.filters) {
      const auto was =
          std::ranges::find(old->filters, f.metadata->id, [](const FilterRun& one) { return one.metadata->id; });
      if (was == old->filters.end()) continue;
      const std::string id(f.metadata->id);
      const auto judge = [&](const char* what, const std::string& then, const std::string& now, bool is_worse) {
        if (then == now) return;
        worse = worse || is_worse;
        soundness.rows.push_back({run.name, id, what, then, now, is_worse ? "worse" : "better"});
      };
      judge("refused", was->refused.value_or("no"), f.refused.value_or("no"), f.refused && !was->refused);
      judge("breaks down", step_of(was->first_failure), step_of(f.first_failure),
            earlier(f.first_failure, was->first_failure));
      judge("P indefinite", step_of(was->first_indefinite), step_of(f.first_indefinite),
            earlier(f.first_indefinite, was->first_indefinite));
      if (f.refused || was->refused) continue;
      const auto tell = [&](const char* what, double then, double now) {
        if (!same(then, now))
          numbers.rows.push_back(
              {run.name, id, what, short_number(then, 4), short_number(now, 4), relative_change(then, now)});
      };
      const auto series = [&](const char* what, Series FilterRun::*of, double (Series::*value)() const) {
        if ((f.*of).count() > 0 && ((*was).*of).count() > 0) tell(what, (((*was).*of).*value)(), ((f.*of).*value)());
      };
      series("P: end", &FilterRun::covariance_error, &Series::last);
      series("P: worst", &FilterRun::covariance_error, &Series::largest);
      series("K: end", &FilterRun::gain_error, &Series::last);
      series("K: worst", &FilterRun::gain_error, &Series::largest);
      series("x: end", &FilterRun::state_error, &Series::last);
      series("x: worst", &FilterRun::state_error, &Series::largest);
      series("asymmetry: worst", &FilterRun::asymmetry, &Series::largest);
      series("smallest eigenvalue", &FilterRun::smallest_eigenvalue, &Series::smallest);
      tell("digits", was->correct_digits, f.correct_digits);
    }
  }
  pages.add("soundness", "Breakdowns and definiteness", std::move(soundness),
            "No filter is refused, breaks down or loses definiteness where it did not before, nor is any cured.");
  pages.add("numbers", "Numbers", std::move(numbers), "Every number that both have is the same.");
  pages.add("parameters", "Parameters", std::move(set));
  pages.add("new-and-gone", "New and gone", new_and_gone(names[0], names[1]));
  return worse;
}

}  // namespace

Difference difference(const Stored& before, const Stored& after, const std::string& before_name,
                      const std::string& after_name) {
  if (before.index() != after.index()) {
    properties::Place place;
    place.origin = after_name;
    throw properties::InputError(
        place, std::holds_alternative<StoredRun>(after) ? "a run" : "claims",
        fmt::format("what {} has, {}", before_name, std::holds_alternative<StoredRun>(before) ? "a run" : "claims"));
  }
  Pages pages;
  pages.document.title = "What changed";
  pages.document.subtitle = fmt::format("From {} to {}", before_name, after_name);
  const auto context_of = [](const Stored& stored) {
    return std::visit([](const auto& one) { return one.context; }, stored);
  };
  bool worse = false;
  if (const auto* run = std::get_if<StoredRun>(&before))
    worse = compare(pages, *run, std::get<StoredRun>(after));
  else
    worse = compare(pages, std::get<StoredClaims>(before), std::get<StoredClaims>(after));
  pages.add("contexts", "Contexts", contexts(context_of(before), context_of(after)), "Both were made under the same.");
  return {std::move(pages.document), worse};
}

}  // namespace kfstab::experiments
