#include <algorithm>

#include <fmt/core.h>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/commands/commands.hpp>
#include <kfstab/experiments/compare.hpp>
#include <kfstab/experiments/compare_page.hpp>
#include <kfstab/experiments/output.hpp>
#include <kfstab/experiments/progress.hpp>
#include <kfstab/experiments/results.hpp>
#include <kfstab/experiments/selection.hpp>
#include <kfstab/properties/input_error.hpp>

namespace kfstab::experiments {
namespace {

constexpr std::size_t most_points = 10000;

std::vector<Scan> scans_of(const std::vector<std::string>& texts) {
  std::vector<Scan> scans;
  std::size_t points = 1;
  const auto refuse = [](const std::string& found, const std::string& expected) {
    properties::Place place;
    place.origin = "--scan";
    throw properties::InputError(place, found, expected);
  };
  for (const std::string& text : texts) {
    scans.push_back(parse_scan(text));
    points *= scans.back().values.size();
  }
  if (scans.size() > 2) refuse(fmt::format("{} scans", scans.size()), "two at most");
  if (scans.size() == 2 && scans[0].name == scans[1].name)
    refuse(fmt::format("{} twice", scans[0].name), "two different names");
  if (points > most_points) refuse(fmt::format("{} points", points), fmt::format("at most {}", most_points));
  return scans;
}

}  // namespace

int compare_command(const CompareArguments& arguments) {
  CompareOptions options{.system = arguments.system,
                         .overrides = {arguments.set, arguments.steps, arguments.seed},
                         .filters = select_filters(arguments.filters),
                         .foreign = {},
                         .scans = scans_of(arguments.scans),
                         .accurate = arguments.accurate,
                         .jobs = arguments.jobs,
                         .progress = {}};
  const auto foreign = open_foreign(arguments.foreign);
  for (const auto& one : foreign) {
    options.filters.push_back(&one->metadata());
    options.foreign.push_back(one.get());
  }
  const std::string subject = find_system(options.system, options.overrides).name;
  check_scans(options);
  Output output(arguments.out, "compare-" + subject, arguments.json, arguments.rendering);

  std::int64_t points = 1;
  for (const Scan& scan : options.scans) points *= static_cast<std::int64_t>(scan.values.size());
  Comparison result;
  {
    Progress progress("compare " + subject, options.scans.empty() ? 1 : points + 1);
    options.progress = [&](std::int64_t units) { progress.advance(units); };
    result = compare(options);
  }
  const Context made = context();
  output.write(comparison_document(result, made), compare_json(result, made));
  output.print(comparison_table(result));
  output.print("\n");
  if (!result.scans.empty()) {
    output.print(scan_table(result));
    output.print("\n");
  }
  for (const std::string& sentence : result.recommendation.sentences) output.print(sentence + "\n");
  if (!output.only_markdown()) output.print(fmt::format("\nPlots, data and the page: {}\n", output.report().string()));

  if (result.interrupted) {
    fmt::print(stderr, "kfstab: interrupted; the points done are written\n");
    return Exit::interrupted;
  }
  if (result.base.error)
    fmt::print(stderr, "kfstab: {}: the reference has no answer: {}\n", subject, *result.base.error);
  const auto has_no_answer = [](const Point& point) { return point.error.has_value(); };
  const auto failed = std::ranges::count_if(result.points, has_no_answer);
  if (failed > 0)
    fmt::print(stderr, "kfstab: {}: the reference has no answer at {} of {} points; the first: {}\n", subject, failed,
               result.points.size(), *std::ranges::find_if(result.points, has_no_answer)->error);
  if (report_faults(foreign)) return Exit::foreign;
  const bool nothing = result.points.empty() ? result.base.error.has_value() : failed == points;
  return nothing ? Exit::usage : Exit::ok;
}

}  // namespace kfstab::experiments
