#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <unistd.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <kfstab/experiments/check_report.hpp>
#include <kfstab/experiments/commands/commands.hpp>
#include <kfstab/experiments/fingerprint_page.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/output.hpp>
#include <kfstab/experiments/progress.hpp>
#include <kfstab/experiments/selection.hpp>
#include <kfstab/filters/kernels.hpp>
#include <kfstab/properties/system_file.hpp>
#include <kfstab/reports/files.hpp>

namespace kfstab::experiments {
namespace {

namespace fs = std::filesystem;
using properties::Law;

std::vector<Law> select_laws(const std::string& expression) {
  const Selection selects(expression, "--laws");
  std::vector<Law> selected;
  for (const Law& law : properties::all_laws())
    if (selects(law.id)) selected.push_back(law);
  if (selected.empty())
    throw NothingSelected(fmt::format("no law matches '{}'; `kfstab list laws` prints their names", expression));
  return selected;
}

/// The laws that a file names, one a line; what follows a # is a comment.
std::set<std::string> expected_failures(const std::string& path) {
  std::set<std::string> ids;
  if (path.empty()) return ids;
  properties::Place place;
  place.origin = path;
  std::ifstream file(path);
  if (!file) throw properties::InputError(place, "no file that can be read", "laws that are known to fail, one a line");
  std::vector<std::string> known;
  for (const Law& law : properties::all_laws()) known.emplace_back(law.id);
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    std::istringstream words(line.substr(0, line.find('#')));
    std::string id, more;
    if (!(words >> id)) continue;
    place.line = number;
    if (words >> more) throw properties::InputError(place, fmt::format("'{}' after '{}'", more, id), "one law a line");
    if (std::ranges::find(known, id) == known.end())
      throw properties::InputError(
          place, fmt::format("'{}'", id),
          "the id of a law; `kfstab list laws` prints them" + properties::did_you_mean(id, known));
    ids.insert(id);
  }
  return ids;
}

/// The systems to try first: those of a folder in the order of their names, then that of --replay.
std::vector<properties::System> replayed(const CheckArguments& arguments) {
  std::vector<properties::System> systems;
  std::error_code none;
  if (!arguments.regressions.empty() && fs::exists(arguments.regressions, none)) {
    if (!fs::is_directory(arguments.regressions)) {
      properties::Place place;
      place.origin = "--regressions";
      throw properties::InputError(place, fmt::format("'{}'", arguments.regressions), "a folder");
    }
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(arguments.regressions))
      if (entry.path().extension() == ".toml" || entry.path().extension() == ".json") files.push_back(entry.path());
    std::ranges::sort(files);
    for (const fs::path& file : files) systems.push_back(properties::read_system(file));
  }
  if (!arguments.replay.empty()) systems.push_back(properties::read_system(arguments.replay));
  return systems;
}

/// Each failure's system into the folder, under a name that says whose and which; one that is there already stays.
std::vector<std::string> write_regressions(const std::string& folder, const properties::CheckReport& report) {
  std::vector<std::string> files(report.laws.size());
  if (folder.empty()) return files;
  std::string subject = report.subject.name;
  for (char& c : subject)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '.') c = '-';
  for (std::size_t i = 0; i < report.laws.size(); ++i) {
    const auto& outcome = report.laws[i];
    if (!outcome.failure) continue;
    std::error_code error;
    fs::create_directories(folder, error);
    properties::System system = outcome.failure->system;
    system.name = fmt::format("{}-{}", subject, outcome.law.id);
    system.description = fmt::format("{} does not hold of {} here", outcome.law.id, report.subject.name);
    const fs::path path = fs::path(folder) / (system.name + ".toml");
    reports::write_file(path, properties::write_system(system));
    files[i] = path.string();
  }
  return files;
}

void write(const std::string& path, const std::string& content) {
  if (path.empty()) return;
  if (path == "-")
    fmt::print("{}", content);
  else
    reports::write_file(path, content);
}

const char* kind_name(properties::SubjectFault::Kind kind) {
  using enum properties::SubjectFault::Kind;
  switch (kind) {
    case died: return "died";
    case hung: return "hung";
    case flooded: return "flooded";
    case limit: return "limit";
  }
  return "";
}

/// One filter to be checked: made in the thread that checks it.
struct SubjectOnOffer {
  std::string selected_by;
  std::function<std::unique_ptr<properties::Subject>()> make;
};

/// As a word of the shell.
std::string quoted(const std::string& text) {
  std::string word = "'";
  for (const char c : text) word += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return word + "'";
}

std::vector<SubjectOnOffer> candidates(const CheckArguments& arguments) {
  std::vector<SubjectOnOffer> all;
  if (arguments.filters && arguments.batch) {
    const auto batched = properties::batched_filters();
    for (const Metadata* metadata : select_filters(*arguments.filters))
      if (std::ranges::find(batched, metadata->id) != batched.end())
        all.push_back({fmt::format("--filters '^{}$' --batch", metadata->id),
                       [metadata] { return properties::in_batches(metadata->id); }});
    if (all.empty())
      throw NothingSelected(fmt::format("--batch: there are batches of {}, and none of them matches '{}'",
                                        fmt::join(batched, ", "), *arguments.filters));
  } else if (arguments.filters) {
    for (const Metadata* metadata : select_filters(*arguments.filters))
      all.push_back(
          {fmt::format("--filters '^{}$'", metadata->id), [metadata] { return properties::built_in(metadata->id); }});
  }
  const properties::Limits limits = arguments.foreign.limits();
  for (const std::string& command : arguments.foreign.commands)
    all.push_back({"--exec " + quoted(command), [=] { return properties::exec_subject(command, limits); }});
  for (const std::string& library : arguments.foreign.plugins)
    all.push_back({"--plugin " + quoted(library), [=] { return properties::plugin_subject(library, limits); }});
  return all;
}

}  // namespace

int check_command(const CheckArguments& arguments) {
  const auto subjects = candidates(arguments);
  if (subjects.empty()) {
    properties::Place place;
    place.origin = "check";
    throw properties::InputError(place, "no filter to check", "--filters REGEX, --exec CMD or --plugin LIB");
  }
  properties::CheckOptions options;
  options.cases = arguments.cases;
  options.seed = arguments.seed;
  options.budget = arguments.budget;
  options.laws = select_laws(arguments.laws);
  options.replay = replayed(arguments);
  // A system to be replayed alone is all that is asked for.
  if (!arguments.replay.empty()) options.cases = 0;
  options.interrupted = interrupted;
  const auto expected = expected_failures(arguments.expect);
  // The plain text steps no batches.
  if (arguments.batch && !kernels::in_use() && kernels::everywhere()) kernels::use(kernels::everywhere()->isa);

  std::optional<Output> output;
  if (!arguments.out.empty()) output.emplace(arguments.out, "check", "", arguments.rendering);

  std::vector<CheckedSubject> checked(subjects.size());
  {
    Progress progress("check", static_cast<std::int64_t>(subjects.size()) * options.cases);
    options.progress = [&](int) { progress.advance(); };
    tbb::task_arena arena(arguments.jobs > 0 ? arguments.jobs : tbb::task_arena::automatic);
    arena.execute([&] {
      tbb::parallel_for(std::size_t{0}, subjects.size(), [&](std::size_t i) {
        CheckedSubject& one = checked[i];
        one.selected_by = subjects[i].selected_by;
        one.expected = expected;
        try {
          const auto subject = subjects[i].make();
          const auto begin = std::chrono::steady_clock::now();
          const auto no_time_left = [&] {
            const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - begin;
            return interrupted() || (options.budget > 0 && passed.count() > options.budget);
          };
          properties::check(*subject, options, one.report);
          if (one.failed() > 0) one.diagnosis = properties::diagnose(one.report.subject, one.report.runs);
          if (one.failed() > 0 && one.diagnosis.empty())
            one.candidates = properties::candidates(one.report, no_time_left);
          if (!arguments.fingerprint) return;
          one.fingerprint = fingerprint(*subject, no_time_left);
          one.fingerprint_left_out = !one.fingerprint;
        } catch (const properties::SubjectFault& fault) {
          if (one.report.subject.name.empty()) one.report.subject.name = one.selected_by;
          one.fault = CheckedSubject::Fault{kind_name(fault.kind), fault.what()};
        }
      });
    });
  }
  for (CheckedSubject& one : checked) one.files = write_regressions(arguments.regressions, one.report);

  const Context made = context();
  const std::string json = check_json(checked, made);
  write(arguments.json, json);
  write(arguments.junit, check_junit(checked));
  write(arguments.markdown, check_markdown(checked));
  if (output) {
    std::vector<Fingerprint> fingerprints;
    for (const CheckedSubject& one : checked)
      if (one.fingerprint) fingerprints.push_back(*one.fingerprint);
    output->write(fingerprint_document(fingerprints, made), json);
  }
  const bool stdout_is_taken = arguments.json == "-" || arguments.junit == "-" || arguments.markdown == "-";
  std::FILE* out = stdout_is_taken ? stderr : stdout;
  const bool color = ::isatty(::fileno(out)) != 0;
  // Before the verdicts, which have the last line.
  if (output) fmt::print(out, "Plots, data and the page: {}\n\n", output->report().string());
  int passed = 0, failed = 0;
  for (const CheckedSubject& one : checked) {
    fmt::print(out, "{}{}", &one == &checked.front() ? "" : "\n", check_text(one, color));
    passed += one.passed();
    failed += one.failed();
  }
  if (checked.size() > 1) fmt::print(out, "\n{} filters: {} passed, {} failed\n", checked.size(), passed, failed);

  if (interrupted()) {
    fmt::print(stderr, "kfstab: interrupted; what was tried until then is written\n");
    return Exit::interrupted;
  }
  if (std::ranges::any_of(checked, [](const CheckedSubject& one) { return one.fault.has_value(); }))
    return Exit::foreign;
  return failed == 0 ? Exit::ok : Exit::failed;
}

}  // namespace kfstab::experiments
