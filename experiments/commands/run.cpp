#include <algorithm>
#include <filesystem>
#include <optional>

#include <fmt/core.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/commands/commands.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/output.hpp>
#include <kfstab/experiments/pages.hpp>
#include <kfstab/experiments/progress.hpp>
#include <kfstab/experiments/results.hpp>
#include <kfstab/experiments/run.hpp>
#include <kfstab/experiments/selection.hpp>

namespace kfstab::experiments {

int run_command(const RunArguments& arguments) {
  auto selected = select_filters(arguments.filters);
  std::vector<properties::System> systems;
  std::int64_t steps = 0;
  std::string subject;
  for (const std::string& word : arguments.systems) {
    systems.push_back(find_system(word, {arguments.set, arguments.steps, arguments.seed}));
    steps += systems.back().steps;
    if (!subject.empty()) subject += "+";
    subject += systems.back().name;
  }
  const auto foreign = open_foreign(arguments.foreign);
  RunOptions options{.digits = arguments.digits};
  for (const auto& one : foreign) {
    selected.push_back(&one->metadata());
    options.foreign.push_back(one.get());
  }
  Output output(arguments.out, "run-" + subject, arguments.json, arguments.rendering);

  std::vector<SystemRun> results(systems.size());
  {
    Progress progress("run " + subject, steps);
    const auto one = [&](std::size_t i) {
      std::int64_t pending = 0;
      RunOptions own = options;
      own.progress = [&](std::int64_t units) {
        // The clock is asked at every step of slow runs, seldom in fast ones.
        if (++pending % 16 == 0) progress.advance(16 * units);
      };
      results[i] = run(systems[i], selected, own);
    };
    oneapi::tbb::task_arena arena(arguments.jobs == 0 ? oneapi::tbb::task_arena::automatic : arguments.jobs);
    arena.execute([&] { oneapi::tbb::parallel_for(std::size_t{0}, systems.size(), one); });
  }

  const Context made = context();
  output.write(run_document(results, made), run_json(results, made));
  bool failed = false;
  for (const SystemRun& result : results) {
    output.print(run_table(result));
    output.print("\n");
    if (result.reference_error) {
      fmt::print(stderr, "kfstab: {}: the reference has no answer: {}\n", result.name, *result.reference_error);
      failed = true;
    }
  }
  if (!output.only_markdown()) output.print(fmt::format("Plots, data and the page: {}\n", output.report().string()));
  if (std::ranges::any_of(results, &SystemRun::interrupted)) {
    fmt::print(stderr, "kfstab: interrupted; the steps done are written\n");
    return Exit::interrupted;
  }
  if (report_faults(foreign)) return Exit::foreign;
  return failed ? Exit::usage : Exit::ok;
}

}  // namespace kfstab::experiments
