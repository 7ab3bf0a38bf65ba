#include <cstdio>
#include <deque>
#include <optional>

#include <fmt/core.h>
#include <nlohmann/json.hpp>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/commands/commands.hpp>
#include <kfstab/experiments/progress.hpp>
#include <kfstab/experiments/reference_steps.hpp>
#include <kfstab/experiments/results.hpp>
#include <kfstab/reports/files.hpp>

namespace kfstab::experiments {
namespace {

using nlohmann::ordered_json;

/// The schema's lines between what stands before and after them, to a file or to stdout.
class JsonSink {
 public:
  JsonSink(const std::string& path, const std::string& before) {
    if (path != "-") file_.emplace(path);
    write(before);
  }
  void operator()(std::string_view line) {
    if (!first_) write(",");
    first_ = false;
    write("\n  ");
    write(line);
  }
  void finish(const std::string& after) {
    write(after);
    if (file_) file_->commit();
  }

 private:
  void write(std::string_view text) {
    if (file_)
      file_->write(text);
    else
      fmt::print("{}", text);
  }

  std::optional<reports::PendingFile> file_;
  bool first_ = true;
};

void print_entries(const std::string& name, const ordered_json& value) {
  if (value.is_string()) {
    fmt::print("  {:<17} {}\n", name, value.get<std::string>());
    return;
  }
  for (std::size_t i = 0; i < value.size(); ++i) {
    if (value[i].is_string()) {
      print_entries(fmt::format("{}[{}]", name, i), value[i]);
      continue;
    }
    // A covariance is symmetric: its lower triangle says all.
    const bool symmetric = name != "K";
    for (std::size_t j = 0; j < value[i].size() && !(symmetric && j > i); ++j)
      print_entries(fmt::format("{}[{},{}]", name, i, j), value[i][j]);
  }
}

/// Steps for a reader: all of a few, else the first and the last ones.
class TextSink {
 public:
  void operator()(std::string_view line) {
    if (steps_++ < some) return print(line);
    last_.emplace_back(line);
    if (last_.size() > some) {
      last_.pop_front();
      ++left_out_;
    }
  }
  void finish() {
    if (left_out_ > 0) fmt::print("k = {} to {}: left out here; --json FILE has them\n", some, some + left_out_ - 1);
    for (const std::string& line : last_) print(line);
  }

 private:
  static constexpr std::size_t some = 3;

  static void print(std::string_view line) {
    const auto step = ordered_json::parse(line);
    fmt::print("k = {}, {} digits certified\n", step["k"].get<std::int64_t>(), step["certified_digits"].get<int>());
    for (const auto& [name, value] : step.items())
      if (name != "k" && name != "certified_digits") print_entries(name, value);
  }

  std::size_t steps_ = 0, left_out_ = 0;
  std::deque<std::string> last_;
};

}  // namespace

int reference_command(const ReferenceArguments& arguments) {
  const auto system = find_system(arguments.system, {arguments.set, arguments.steps, arguments.seed});
  ReferenceOutcome outcome;
  {
    Progress progress("reference " + system.name, system.steps);
    const ReferenceRequest request{arguments.digits, arguments.cache,
                                   [&](std::int64_t units) { progress.advance(units); }};
    if (arguments.json.empty()) {
      const auto d = system.dimensions();
      fmt::print("{}: n = {}, m = {}, p = {}, {} steps; the reference, to {} digits\n", system.name, d.n, d.m, d.p,
                 system.steps, arguments.digits);
      TextSink sink;
      outcome = reference_steps(system, request, std::ref(sink));
      sink.finish();
    } else {
      JsonSink sink(arguments.json, reference_json_before_steps(system, arguments.digits));
      outcome = reference_steps(system, request, std::ref(sink));
      sink.finish(reference_json_after_steps(system, outcome));
    }
  }
  if (!arguments.json.empty() && arguments.json != "-") fmt::print("{} steps: {}\n", outcome.steps, arguments.json);
  if (outcome.warning) fmt::print(stderr, "kfstab: warning: nothing is kept in the cache: {}\n", *outcome.warning);
  if (outcome.error) {
    fmt::print(stderr, "kfstab: {}: the reference has no answer: {}\n", system.name, *outcome.error);
    return Exit::usage;
  }
  if (outcome.interrupted) {
    fmt::print(stderr, "kfstab: interrupted; the steps done are written\n");
    return Exit::interrupted;
  }
  return Exit::ok;
}

}  // namespace kfstab::experiments
