#include <filesystem>
#include <fstream>
#include <optional>

#include <fmt/core.h>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/commands/commands.hpp>
#include <kfstab/experiments/explain.hpp>
#include <kfstab/experiments/explain_page.hpp>
#include <kfstab/experiments/output.hpp>
#include <kfstab/experiments/progress.hpp>
#include <kfstab/experiments/results.hpp>
#include <kfstab/experiments/selection.hpp>
#include <kfstab/experiments/stored.hpp>
#include <kfstab/properties/input_error.hpp>

namespace kfstab::experiments {
namespace {

/// A folder, or a JSON file that says its schema: what is neither names a system.
bool names_results(const std::string& word) {
  if (std::filesystem::is_directory(word)) return true;
  if (!word.ends_with(".json") || !std::filesystem::is_regular_file(word)) return false;
  std::ifstream file(word);
  std::string beginning(100, '\0');
  file.read(beginning.data(), static_cast<std::streamsize>(beginning.size()));
  return beginning.find("\"schema\"") != std::string::npos;
}

/// The runs in a file of results, of the filters that are selected.
StoredRun stored_run(const ExplainArguments& arguments) {
  properties::Place place;
  place.origin = arguments.subject;
  if (!arguments.set.empty() || arguments.steps || arguments.seed)
    throw properties::InputError(place, "--set, --steps or --seed",
                                 "none of them: this run is over; name the system to run it anew");
  Stored stored = read_results_file(arguments.subject);
  auto* run = std::get_if<StoredRun>(&stored);
  if (!run) throw properties::InputError(place, "results of claims", "those of a run, kfstab.run/1");
  const Selection selects(arguments.filters, "--filters");
  bool any = false;
  for (SystemRun& system : run->systems) {
    std::erase_if(system.filters, [&](const FilterRun& f) { return !selects(f.metadata->id); });
    any = any || !system.filters.empty();
  }
  if (!any)
    throw NothingSelected(fmt::format("{}: none of its filters matches '{}'", arguments.subject, arguments.filters));
  return std::move(*run);
}

}  // namespace

int explain_command(const ExplainArguments& arguments) {
  std::vector<Explained> explained;
  std::optional<StoredRun> stored;
  std::optional<properties::System> system;
  std::string subject = "results";
  if (names_results(arguments.subject)) {
    stored = stored_run(arguments);
    if (stored->systems.size() == 1) subject = stored->systems.front().name;
  } else {
    system = find_system(arguments.subject, {arguments.set, arguments.steps, arguments.seed});
    subject = system->name;
  }
  const auto selected = stored ? std::vector<const Metadata*>{} : select_filters(arguments.filters);
  Output output(arguments.out, "explain-" + subject, arguments.json, arguments.rendering);
  if (stored) {
    for (SystemRun& run : stored->systems) explained.push_back(explain(std::move(run)));
  } else {
    Progress progress("explain " + subject, system->steps);
    explained.push_back(explain(*system, selected, {[&](std::int64_t units) { progress.advance(units); }}));
  }
  const Context made = stored ? stored->context : context();
  output.write(explain_document(explained, made), explain_json(explained, made));

  bool failed = false, interrupted = false;
  for (const Explained& one : explained) {
    output.print(loss_table(one));
    output.print("\n");
    for (const Explanation& e : one.filters)
      for (const std::string& sentence : e.sentences) output.print(sentence + "\n");
    interrupted = interrupted || one.run.interrupted;
    if (one.run.reference_error) {
      fmt::print(stderr, "kfstab: {}: the reference has no answer: {}\n", one.run.name, *one.run.reference_error);
      failed = true;
    }
  }
  if (!output.only_markdown()) output.print(fmt::format("\nPlots, data and the page: {}\n", output.report().string()));
  if (interrupted) {
    fmt::print(stderr, "kfstab: interrupted; the steps done are written\n");
    return Exit::interrupted;
  }
  return failed ? Exit::usage : Exit::ok;
}

}  // namespace kfstab::experiments
