#include <algorithm>
#include <set>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/commands/commands.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/output.hpp>
#include <kfstab/experiments/pages.hpp>
#include <kfstab/experiments/progress.hpp>
#include <kfstab/experiments/results.hpp>
#include <kfstab/experiments/selection.hpp>
#include <kfstab/properties/expression.hpp>
#include <kfstab/properties/input_error.hpp>
#include <kfstab/reports/markdown.hpp>
#include <kfstab/reports/terminal.hpp>

namespace kfstab::experiments {
namespace {

std::vector<Claim> select_claims(const std::string& expression) {
  const Selection selects(expression, "claim");
  std::vector<Claim> selected;
  for (Claim& claim : all_claims())
    if (selects(claim.id)) selected.push_back(std::move(claim));
  if (selected.empty())
    throw NothingSelected(fmt::format("no claim matches '{}'; `kfstab list claims` prints their names", expression));
  return selected;
}

/// The values of --set; a name that no selected claim knows is refused.
std::map<std::string, double> values_of(const SetArguments& set, const std::vector<Claim>& selected) {
  std::set<std::string> unique;
  for (const Claim& claim : selected)
    for (const Parameter& parameter : claim.parameters) unique.insert(parameter.name);
  const std::vector<std::string> known(unique.begin(), unique.end());

  std::map<std::string, double> values;
  const properties::Expressions evaluate({});
  for (const auto& [name, text] : set) {
    properties::Place place;
    place.origin = "--set";
    place.field = name;
    if (!unique.contains(name))
      throw properties::InputError(place, fmt::format("'{}'", name),
                                   "a parameter of the selected claims; `kfstab list claims` prints them" +
                                       properties::did_you_mean(name, known));
    try {
      values[name] = evaluate(text);
    } catch (const properties::ExpressionError& error) {
      throw properties::InputError(place, fmt::format("'{}' ({})", text, error.what()), "a number or an expression");
    }
  }
  return values;
}

/// Nothing but the table: which checks held in every run, and how often the others did.
int seeds_command(const ClaimArguments& arguments, const std::vector<Claim>& selected,
                  const std::map<std::string, double>& set, Effort effort) {
  const auto random = std::ranges::count_if(
      selected, [](const Claim& c) { return std::ranges::count(c.parameters, "seed", &Parameter::name) > 0; });
  std::vector<Stability> found;
  {
    Progress progress("claims", std::ssize(selected) + random * (arguments.seeds - 1));
    found = run_seeds(selected, set, effort, arguments.jobs, arguments.seeds, [&] { progress.advance(); });
  }
  reports::Table table;
  table.header = {"", "claim", "seeds", "confirmed", "checks that held with every seed", "others, and how often they held"};
  using enum reports::Alignment;
  table.alignment = {right, left, right, right, right, left};
  bool all = true;
  for (const Stability& one : found) {
    std::ptrdiff_t always = 0;
    std::string others;
    for (const auto& [check, times] : one.checks) {
      if (times == one.runs) ++always;
      else others += fmt::format("{}{} ({})", others.empty() ? "" : "; ", check, times);
    }
    all = all && one.confirmed == one.runs;
    table.rows.push_back({fmt::format("C{}", one.claim.number), one.claim.id, one.runs == 1 ? "-" : fmt::format("{}", one.runs),
                          fmt::format("{}", one.confirmed), fmt::format("{} of {}", always, one.checks.size()), others});
  }
  fmt::print("{}", arguments.rendering.only_markdown() ? reports::render_markdown(table) : reports::render_text(table));
  if (interrupted()) {
    fmt::print(stderr, "kfstab: interrupted; the table is of what was finished\n");
    return Exit::interrupted;
  }
  return all ? Exit::ok : Exit::failed;
}

}  // namespace

int claim_command(const ClaimArguments& arguments) {
  const auto selected = select_claims(arguments.claims);
  const auto set = values_of(arguments.set, selected);
  const Effort effort = arguments.quick ? Effort::quick : Effort::full;
  for (const Claim& claim : selected) settings_of(claim, set, effort);  // refuses what is out of range before any work
  if (arguments.seeds > 0) return seeds_command(arguments, selected, set, effort);
  Output output(arguments.out, arguments.claims.empty() ? "claim" : "claim-" + arguments.claims, arguments.json,
                arguments.rendering);

  std::vector<ClaimResult> results;
  {
    Progress progress("claims", static_cast<std::int64_t>(selected.size()));
    results = run_claims(selected, set, effort, arguments.jobs, [&] { progress.advance(); });
  }
  const Context made = context();
  output.write(claims_document(results, made), claims_json(results, set, made));

  const auto passed = std::ranges::count_if(
      results, [](const ClaimResult& r) { return r.verdict() == reports::Verdict::confirmed; });
  if (output.only_markdown()) {
    output.print(verdict_table(results));
  } else {
    for (const ClaimResult& result : results) {
      output.print(fmt::format("C{}  {}: {}\n", result.claim.number, result.claim.title, name(result.verdict())));
      output.print(reports::render_text(reports::Checks{result.findings.checks}) + "\n");
    }
    output.print(fmt::format("Plots, data and the page: {}\n", output.report().string()));
    output.print(fmt::format("{} passed, {} failed\n", passed, static_cast<std::ptrdiff_t>(results.size()) - passed));
  }
  if (interrupted()) {
    fmt::print(stderr, "kfstab: interrupted; the claims that were finished are written\n");
    return Exit::interrupted;
  }
  return passed == static_cast<std::ptrdiff_t>(results.size()) ? Exit::ok : Exit::failed;
}

}  // namespace kfstab::experiments
