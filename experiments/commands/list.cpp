#include <fmt/core.h>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/commands/commands.hpp>
#include <kfstab/experiments/results.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/law.hpp>
#include <kfstab/reports/markdown.hpp>
#include <kfstab/reports/number.hpp>
#include <kfstab/reports/terminal.hpp>

namespace kfstab::experiments {
namespace {

std::string needs_of(const Needs& needs) {
  std::string text;
  const auto add = [&text](bool needed, const char* what) {
    if (needed) text += (text.empty() ? "" : ", ") + std::string(what);
  };
  add(needs.invertible_A, "A invertible");
  if (needs.positive_definite_Q && needs.positive_definite_R && needs.positive_definite_P0) {
    add(true, "Q, R, P0 > 0");
  } else {
    add(needs.positive_definite_Q, "Q > 0");
    add(needs.positive_definite_R, "R > 0");
    add(needs.positive_definite_P0, "P0 > 0");
  }
  add(needs.time_invariant, "time-invariant");
  return text;
}

reports::Table systems_table() {
  reports::Table table{"Systems", {"name", "n", "m", "p", "steps", "parameters", "description", "source"}, {}, {}};
  using enum reports::Alignment;
  table.alignment = {left, right, right, right, right, left, left, left};
  for (const CatalogueEntry& entry : catalogue()) {
    const auto system = find_system(std::string(entry.name));
    const auto d = system.dimensions();
    std::string parameters;
    for (const auto& [name, value] : system.parameters)
      parameters += fmt::format("{}{}={}", parameters.empty() ? "" : " ", name, reports::short_number(value, 4));
    table.rows.push_back({system.name, fmt::format("{}", d.n), fmt::format("{}", d.m), fmt::format("{}", d.p),
                          fmt::format("{}", system.steps), parameters, system.description, system.source});
  }
  return table;
}

reports::Table filters_table() {
  reports::Table table{"Filters", {"id", "form", "holds", "update", "needs", "operations", "source"}, {}, {}};
  for (const Metadata& f : filters()) {
    table.rows.push_back({std::string(f.id), std::string(f.title), notation(f.holds), std::string(f.update), needs_of(f.needs),
                          std::string(f.operations), std::string(f.source)});
  }
  return table;
}

reports::Table claims_table() {
  reports::Table table{"Claims", {"", "id", "what is claimed", "parameters"}, {}, {}};
  for (const Claim& claim : all_claims()) {
    std::string parameters;
    for (const Parameter& p : claim.parameters)
      parameters += fmt::format("{}{}={}", parameters.empty() ? "" : " ", p.name, reports::short_number(p.value, 4));
    table.rows.push_back({fmt::format("C{}", claim.number), claim.id, claim.title, parameters});
  }
  return table;
}

reports::Table laws_table() {
  reports::Table table{"Laws", {"id", "what holds", "where", "asks the reference", "if it does not hold"}, {}, {}};
  for (const properties::Law& law : properties::all_laws()) {
    table.rows.push_back({std::string(law.id), std::string(law.statement), std::string(law.assumptions),
                          law.reference ? "yes" : "", std::string(law.failure)});
  }
  return table;
}

}  // namespace

int list_command(const std::string& what, const std::string& format) {
  if (format == "json") {
    std::fputs(list_json(what).c_str(), stdout);
    return Exit::ok;
  }
  const bool markdown = format == "markdown";
  bool first = true;
  const auto show = [&](const char* name, reports::Table (*make)()) {
    if (!what.empty() && what != name) return;
    const auto table = make();
    fmt::print("{}{}", first ? "" : "\n", markdown ? reports::render_markdown(table) : reports::render_text(table));
    first = false;
  };
  show("systems", systems_table);
  show("filters", filters_table);
  show("claims", claims_table);
  show("laws", laws_table);
  return Exit::ok;
}

}  // namespace kfstab::experiments
