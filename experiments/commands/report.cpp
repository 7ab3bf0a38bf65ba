#include <filesystem>
#include <variant>

#include <fmt/core.h>

#include <kfstab/experiments/commands/commands.hpp>
#include <kfstab/experiments/difference.hpp>
#include <kfstab/experiments/output.hpp>
#include <kfstab/experiments/pages.hpp>
#include <kfstab/experiments/results.hpp>
#include <kfstab/experiments/stored.hpp>

namespace kfstab::experiments {
namespace {

/// What a terminal shows of a long table.
reports::Table shortened(reports::Table table) {
  constexpr std::size_t most = 30;
  if (table.rows.size() <= most) return table;
  const std::size_t left_out = table.rows.size() - most;
  table.rows.resize(most);
  table.rows.push_back({fmt::format("... and {} more", left_out)});
  return table;
}

/// A name for the folder, from "results.json", "kfstab-out/claim/results.json" or "before.json".
std::string subject_of(const std::string& path) {
  const std::filesystem::path file(path);
  return (file.filename() == "results.json" ? std::filesystem::absolute(file).parent_path() : file.stem())
      .filename()
      .string();
}

int render_again(const ReportArguments& arguments) {
  const Stored stored = read_results_file(arguments.results.front());
  Output output(arguments.out, "report-" + subject_of(arguments.results.front()), "", arguments.rendering);
  if (const auto* run = std::get_if<StoredRun>(&stored)) {
    output.write(run_document(run->systems, run->context), run_json(run->systems, run->context));
    for (const SystemRun& system : run->systems) {
      output.print(run_table(system));
      output.print("\n");
    }
  } else {
    const auto& claims = std::get<StoredClaims>(stored);
    output.write(claims_document(claims.claims, claims.context),
                 claims_json(claims.claims, claims.parameters, claims.context));
    output.print(verdict_table(claims.claims));
  }
  if (!output.only_markdown()) output.print(fmt::format("Plots, data and the page: {}\n", output.report().string()));
  return Exit::ok;
}

int show_difference(const ReportArguments& arguments) {
  const std::string &before = arguments.results[0], &after = arguments.results[1];
  const Difference found = difference(read_results_file(before), read_results_file(after), before, after);
  Output output(arguments.out, fmt::format("report-{}-{}", subject_of(before), subject_of(after)), "",
                arguments.rendering);
  output.write(found.document, "");
  for (const reports::Section& section : found.document.sections) {
    output.print(fmt::format("{}{}\n", output.only_markdown() ? "## " : "", section.title));
    if (output.only_markdown()) output.print("\n");
    for (const reports::Block& block : section.blocks) {
      if (const auto* table = std::get_if<reports::Table>(&block)) output.print(shortened(*table));
      if (const auto* paragraph = std::get_if<reports::Paragraph>(&block)) output.print(paragraph->text + "\n");
    }
    output.print("\n");
  }
  if (!output.only_markdown()) output.print(fmt::format("The page: {}\n", output.report().string()));
  return found.worse ? Exit::failed : Exit::ok;
}

}  // namespace

int report_command(const ReportArguments& arguments) {
  return arguments.results.size() == 1 ? render_again(arguments) : show_difference(arguments);
}

}  // namespace kfstab::experiments
