#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <stdexcept>
#include <string>
#include <system_error>

#include <CLI/CLI.hpp>
#include <fmt/core.h>

#include <kfstab/experiments/commands/commands.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/selection.hpp>
#include <kfstab/filters/kernels.hpp>
#include <kfstab/properties/input_error.hpp>
#include <kfstab/properties/plugin_host.hpp>
#include <kfstab/properties/subject.hpp>
#include <kfstab/reports/files.hpp>

#include <kfstab_revision.hpp>

namespace {

using namespace kfstab::experiments;

/// Splits the name=value of --set.
SetArguments split(const std::vector<std::string>& words) {
  SetArguments set;
  for (const std::string& word : words) {
    const auto equals = word.find('=');
    if (equals == std::string::npos || equals == 0 || equals + 1 == word.size())
      throw CLI::ValidationError("--set", fmt::format("found '{}', expected name=value", word));
    if (!set.emplace(word.substr(0, equals), word.substr(equals + 1)).second)
      throw CLI::ValidationError("--set", fmt::format("'{}' is set twice", word.substr(0, equals)));
  }
  return set;
}

/// --format and --for.
Rendering rendering_of(const std::vector<std::string>& formats, const std::string& medium) {
  const auto has = [&](const char* format) { return std::ranges::count(formats, format) > 0; };
  Rendering rendering{has("html"), has("markdown"), has("pdf")};
  if (medium == "slide") rendering.medium = kfstab::reports::Medium::slide;
  if (medium == "print") rendering.medium = kfstab::reports::Medium::print;
  if (medium == "paper") rendering.medium = kfstab::reports::Medium::paper;
  return rendering;
}

int command_line(int argc, char** argv) {
  CLI::App app{"kfstab, a laboratory for the numerical stability of Kalman filters"};
  app.set_version_flag("--version", fmt::format("kfstab {} ({})", KFSTAB_VERSION, KFSTAB_REVISION));
  app.require_subcommand(0, 1);  // none is told below: CLI11 says "required" for a command that it does not know, too
  app.failure_message([](const CLI::App* a, const CLI::Error& e) {
    return fmt::format("kfstab: {}\nRun with --help for what is expected{}.\n", e.what(),
                       a->get_subcommands().empty() ? "" : " of " + a->get_subcommands().front()->get_name());
  });
  app.footer(
      "Exit codes: 0 all well; 1 a claim is refuted or inconclusive, a law failed; 2 usage or bad input; 3 a fault of kfstab;\n"
      "4 a filter of yours died, hung, flooded or broke a limit; 5 nothing selected; 130 interrupted. Every flag has an environment twin: --filters is KFSTAB_FILTERS.");
  int exit_code = Exit::ok;
  // What is parsed with a callback of its own reads its environment twins alone: those of a command that was not called
  // neither spoil this one nor, where two share a variable, win over its flags.
  const auto add_command = [&app](const std::string& name, const std::string& text) {
    auto* command = app.add_subcommand(name, text);
    command->parse_complete_callback([] {});
    return command;
  };
  std::vector<std::string> set;
  std::string format = "text";
  std::vector<std::string> formats{"html"};
  std::string medium = "screen";
  const auto add_set = [&set](CLI::App* command, const std::string& text) {
    command->add_option("--set", set, text)->envname("KFSTAB_SET")->type_name("NAME=VALUE")->take_all()->expected(1);
  };
  const auto add_rendering = [&formats, &medium](CLI::App* command) {
    command->add_option("--format", formats, "of the report: html, markdown, pdf, or several with commas between")
        ->envname("KFSTAB_FORMAT")->delimiter(',')->check(CLI::IsMember({"html", "markdown", "pdf"}))
        ->expected(1)->take_all()->type_name("LIST")->default_str("html");
    command->add_option("--for", medium, "what the figures are for: screen, slide (large type, thick lines), print (small,\n"
                        "in greys) or paper (text set by LaTeX); all but screen come as PDF too")
        ->envname("KFSTAB_FOR")->check(CLI::IsMember({"screen", "slide", "print", "paper"}))->type_name("MEDIUM")
        ->default_str("screen");
  };

  const auto add_foreign = [](CLI::App* command, ForeignArguments& foreign) {
    command->add_option("--exec", foreign.commands, "a filter of yours, as a shell command that speaks protocol 1 (docs/protocol.md)")
        ->envname("KFSTAB_EXEC")->type_name("CMD")->take_all()->expected(1);
    command->add_option("--plugin", foreign.plugins, "a filter of yours, as a shared library (kfstab_filter.h)")
        ->envname("KFSTAB_PLUGIN")->type_name("LIB")->take_all()->expected(1);
    command->add_option("--timeout", foreign.timeout, "seconds that a filter of yours may take for a step")
        ->envname("KFSTAB_TIMEOUT")->type_name("SECONDS")->check(CLI::Range(0.001, 1e6).description(""))->capture_default_str();
    command->add_option("--memory", foreign.memory, "MiB of address space that it may take; 0: no limit")
        ->envname("KFSTAB_MEMORY")->type_name("MIB")->check(CLI::Range(0.0, 1e9).description(""))->capture_default_str();
  };

  RunArguments run;
  auto* run_app = add_command("run", "Run filters through a system, beside a certified reference");
  run_app->add_option("SYSTEM", run.systems, "a name that `list systems` prints, or a file (.toml, .json)")->required();
  run_app->add_option("--filters", run.filters, "regular expression on filter ids; a leading - excludes")
      ->envname("KFSTAB_FILTERS")->type_name("REGEX");
  add_foreign(run_app, run.foreign);
  run_app->add_option("--steps", run.steps, "steps to run, instead of the system's own")
      ->envname("KFSTAB_STEPS")->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 53).description(""));
  run_app->add_option("--seed", run.seed, "seed of simulated data, instead of the system's own")->envname("KFSTAB_SEED");
  run_app->add_option("--digits", run.digits, "digits the reference has to certify")
      ->envname("KFSTAB_DIGITS")->check(CLI::Range(15, 750).description(""))->capture_default_str();
  run_app->add_option("--jobs", run.jobs, "systems at once; 0: one a core")
      ->envname("KFSTAB_JOBS")->check(CLI::Range(0, 1024).description(""))->capture_default_str();
  add_set(run_app, "value of one of the system's [parameters]");
  run_app->add_option("--out", run.out, "folder for the results; else ./kfstab-out/run-SYSTEM")->envname("KFSTAB_OUT")->type_name("DIR");
  run_app->add_option("--json", run.json, "the results as JSON into this file too; - for stdout, and nothing else there")
      ->envname("KFSTAB_JSON")->type_name("FILE");
  add_rendering(run_app);
  run_app->callback([&] {
    run.set = split(set);
    run.rendering = rendering_of(formats, medium);
    exit_code = run_command(run);
  });

  CompareArguments comparison;
  auto* compare_app = add_command("compare", "Filters side by side on one system, over whatever is made to vary, and which to take");
  compare_app->add_option("SYSTEM", comparison.system, "a name that `list systems` prints, or a file (.toml, .json)")->required();
  compare_app->add_option("--filters", comparison.filters, "regular expression on filter ids; a leading - excludes")
      ->envname("KFSTAB_FILTERS")->type_name("REGEX");
  add_foreign(compare_app, comparison.foreign);
  compare_app
      ->add_option("--scan", comparison.scans,
                   "twice at most; NAME one of [parameters], an entry R[0,0], scale:Q or bits;\n"
                   "VALUES 24,53,64 or from:to:log:count or from:to:lin:count")
      ->envname("KFSTAB_SCAN")->type_name("NAME=VALUES")->take_all()->expected(1);
  compare_app->add_option("--steps", comparison.steps, "steps to run, instead of the system's own")
      ->envname("KFSTAB_STEPS")->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 53).description(""));
  compare_app->add_option("--seed", comparison.seed, "seed of simulated data, instead of the system's own")->envname("KFSTAB_SEED");
  compare_app->add_option("--accurate", comparison.accurate, "digits of P and K from which on a word is long enough")
      ->envname("KFSTAB_ACCURATE")->check(CLI::Range(0.0, 70.0).description(""))->capture_default_str();
  compare_app->add_option("--jobs", comparison.jobs, "points at once; 0: one a core")
      ->envname("KFSTAB_JOBS")->check(CLI::Range(0, 1024).description(""))->capture_default_str();
  add_set(compare_app, "value of one of the system's [parameters]");
  compare_app->add_option("--out", comparison.out, "folder for the results; else ./kfstab-out/compare-SYSTEM")
      ->envname("KFSTAB_OUT")->type_name("DIR");
  compare_app->add_option("--json", comparison.json, "the results as JSON into this file too; - for stdout, and nothing else there")
      ->envname("KFSTAB_JSON")->type_name("FILE");
  add_rendering(compare_app);
  compare_app->callback([&] {
    comparison.set = split(set);
    comparison.rendering = rendering_of(formats, medium);
    exit_code = compare_command(comparison);
  });

  ExplainArguments explanation;
  auto* explain_app = add_command("explain", "Where the digits went: steps, entries, cancellations");
  explain_app->add_option("SYSTEM|RESULTS", explanation.subject, "a system as `run` takes it, or the results.json of a run, or its folder")->required();
  explain_app->add_option("--filters", explanation.filters, "regular expression on filter ids; a leading - excludes")
      ->envname("KFSTAB_FILTERS")->type_name("REGEX");
  explain_app->add_option("--steps", explanation.steps, "steps to run, instead of the system's own")
      ->envname("KFSTAB_STEPS")->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 53).description(""));
  explain_app->add_option("--seed", explanation.seed, "seed of simulated data, instead of the system's own")->envname("KFSTAB_SEED");
  add_set(explain_app, "value of one of the system's [parameters]");
  explain_app->add_option("--out", explanation.out, "folder for the results; else ./kfstab-out/explain-SYSTEM")
      ->envname("KFSTAB_OUT")->type_name("DIR");
  explain_app->add_option("--json", explanation.json, "the results as JSON into this file too; - for stdout, and nothing else there")
      ->envname("KFSTAB_JSON")->type_name("FILE");
  add_rendering(explain_app);
  explain_app->callback([&] {
    explanation.set = split(set);
    explanation.rendering = rendering_of(formats, medium);
    exit_code = explain_command(explanation);
  });

  ReferenceArguments reference;
  auto* reference_app =
      add_command("reference", "Print what is true of a system, to certified digits, for others to test against");
  reference_app->add_option("SYSTEM", reference.system, "a name that `list systems` prints, or a file (.toml, .json)")
      ->required();
  reference_app->add_option("--digits", reference.digits, "digits to certify, and to print at most")
      ->envname("KFSTAB_DIGITS")->check(CLI::Range(1, 750).description(""))->capture_default_str();
  reference_app->add_option("--steps", reference.steps, "steps to compute, instead of the system's own")
      ->envname("KFSTAB_STEPS")->check(CLI::Range(std::int64_t{1}, std::int64_t{1} << 53).description(""));
  reference_app->add_option("--seed", reference.seed, "seed of simulated data, instead of the system's own")
      ->envname("KFSTAB_SEED");
  add_set(reference_app, "value of one of the system's [parameters]; 1e-30 and 1/3 are exact");
  reference_app->add_option("--json", reference.json, "all steps as JSON into this file, none on the terminal; - for stdout")
      ->envname("KFSTAB_JSON")->type_name("FILE");
  reference_app->add_option("--cache", reference.cache, "folder that keeps what was computed; processes may share it")
      ->envname("KFSTAB_CACHE")->type_name("DIR");
  reference_app->callback([&] {
    reference.set = split(set);
    exit_code = reference_command(reference);
  });

  ClaimArguments claim;
  auto* claim_app = add_command("claim", "Measure claims of the literature, and judge them");
  claim_app->add_option("REGEX", claim.claims, "regular expression on claim ids; after --, a leading - excludes; else all");
  add_set(claim_app, "value of a parameter of the selected claims");
  claim_app->add_flag("--quick", claim.quick, "with fewer frames and steps: a first look")->envname("KFSTAB_QUICK");
  claim_app->add_option("--seeds", claim.seeds, "run what draws systems with the seeds 1 ... N, and print how often each check held: a table, no files")
      ->envname("KFSTAB_SEEDS")->type_name("N")->check(CLI::Range(1, 10000).description(""));
  claim_app->add_option("--jobs", claim.jobs, "claims at once; 0: one a core")
      ->envname("KFSTAB_JOBS")->check(CLI::Range(0, 1024).description(""))->capture_default_str();
  claim_app->add_option("--out", claim.out, "folder for the results; else ./kfstab-out/claim-REGEX")->envname("KFSTAB_OUT")->type_name("DIR");
  claim_app->add_option("--json", claim.json, "the results as JSON into this file too; - for stdout, and nothing else there")
      ->envname("KFSTAB_JSON")->type_name("FILE");
  add_rendering(claim_app);
  claim_app->callback([&] {
    claim.set = split(set);
    claim.rendering = rendering_of(formats, medium);
    exit_code = claim_command(claim);
  });

  CheckArguments check;
  bool quick = false, thorough = false;
  std::string checked_filters;
  auto* check_app = add_command("check", "Check a filter by laws on random systems: the smallest that breaks one, and what it means");
  auto* filters_option = check_app->add_option("--filters", checked_filters, "filters that come with kfstab: regular expression on ids; a leading - excludes")
      ->envname("KFSTAB_FILTERS")->type_name("REGEX");
  check_app->add_flag("--batch", check.batch, "those of --filters of which kfstab has batches (ckf, srcf, srif), in batches: systems of one shape side by side")
      ->envname("KFSTAB_BATCH")->needs(filters_option);
  add_foreign(check_app, check.foreign);
  check_app->add_option("--laws", check.laws, "regular expression on law ids; a leading - excludes")->envname("KFSTAB_LAWS")->type_name("REGEX");
  auto* cases_option = check_app->add_option("--cases", check.cases, "systems to draw")
      ->envname("KFSTAB_CASES")->check(CLI::Range(0, 10000000).description(""))->capture_default_str();
  auto* quick_option = check_app->add_flag("--quick", quick, "50 cases")->envname("KFSTAB_QUICK")->excludes(cases_option);
  check_app->add_flag("--thorough", thorough, "2000 cases")->envname("KFSTAB_THOROUGH")->excludes(cases_option)->excludes(quick_option);
  check_app->add_option("--seed", check.seed, "of the systems that are drawn")->envname("KFSTAB_SEED")->capture_default_str();
  check_app->add_option("--budget", check.budget, "seconds after which no further case is begun; 0: none")
      ->envname("KFSTAB_BUDGET")->check(CLI::NonNegativeNumber.description(""))->type_name("SECONDS")->capture_default_str();
  check_app->add_option("--jobs", check.jobs, "filters at once; 0: one a core")
      ->envname("KFSTAB_JOBS")->check(CLI::Range(0, 1024).description(""))->capture_default_str();
  check_app->add_option("--replay", check.replay, "try this system file and no other")->envname("KFSTAB_REPLAY")->type_name("FILE");
  check_app->add_option("--regressions", check.regressions, "folder of system files: tried first; what fails is added to it")
      ->envname("KFSTAB_REGRESSIONS")->type_name("DIR");
  check_app->add_option("--expect", check.expect, "file of laws that are known to fail, an id a line; one that holds fails, too")
      ->envname("KFSTAB_EXPECT")->type_name("FILE");
  check_app->add_option("--json", check.json, "the results as JSON into this file; - for stdout")->envname("KFSTAB_JSON")->type_name("FILE");
  check_app->add_option("--junit", check.junit, "the results as JUnit XML into this file; - for stdout")->envname("KFSTAB_JUNIT")->type_name("FILE");
  check_app->add_option("--markdown", check.markdown, "the results as Markdown into this file; - for stdout")->envname("KFSTAB_MARKDOWN")->type_name("FILE");
  bool with_fingerprint = false;
  auto* fingerprint_option = check_app->add_flag("--fingerprint,!--no-fingerprint", with_fingerprint,
      "of what kind the filter is, among those of kfstab; else unless --quick or --replay")->envname("KFSTAB_FINGERPRINT");
  check_app->add_option("--out", check.out, "folder for the page and the figures of the fingerprint; else none")->envname("KFSTAB_OUT")->type_name("DIR");
  add_rendering(check_app);
  check_app->callback([&] {
    if (filters_option->count() > 0) check.filters = checked_filters;
    if (quick) check.cases = 50;
    if (thorough) check.cases = 2000;
    check.fingerprint = fingerprint_option->count() > 0 ? with_fingerprint : !check.out.empty() || (!quick && check.replay.empty());
    check.rendering = rendering_of(formats, medium);
    exit_code = check_command(check);
  });

  ReportArguments report;
  auto* report_app = add_command("report", "Render stored results again, or say what changed between two");
  report_app->add_option("RESULTS", report.results, "a results.json or the folder with it; of two, what changed from the first")
      ->required()->expected(1, 2);
  report_app->add_option("--out", report.out, "folder for the report; else ./kfstab-out/report-NAME")->envname("KFSTAB_OUT")->type_name("DIR");
  add_rendering(report_app);
  report_app->callback([&] {
    report.rendering = rendering_of(formats, medium);
    exit_code = report_command(report);
  });

  std::string demo_out;
  auto* demo_app = add_command("demo", "See a filter diverge, and the claims confirmed, in a minute");
  demo_app->add_option("--out", demo_out, "folder for the results; else ./kfstab-out/demo")->envname("KFSTAB_OUT")->type_name("DIR");
  demo_app->callback([&] { exit_code = demo_command(demo_out); });

  std::string what;
  auto* list_app = add_command("list", "List the systems, filters, claims and laws that come with kfstab");
  list_app->add_option("WHAT", what, "systems, filters, claims or laws; else all")
      ->check(CLI::IsMember({"systems", "filters", "claims", "laws"}));
  list_app->add_option("--format", format, "text, markdown for a README, or json for a program")
      ->envname("KFSTAB_FORMAT")->check(CLI::IsMember({"text", "markdown", "json"}))->capture_default_str();
  list_app->callback([&] { exit_code = list_command(what, format); });

  try {
    app.parse(argc, argv);
    if (app.get_subcommands().empty()) throw CLI::RequiredError("A command");
  } catch (const CLI::ParseError& error) {
    // CLI11 has codes of its own, 100 and more; ours say 2 for all of them.
    return app.exit(error) == 0 ? Exit::ok : Exit::usage;
  }
  return exit_code;
}

/// stderr may be full or gone as well; then there is nobody to tell.
void complain(const std::string& message) { std::fputs(("kfstab: " + message + "\n").c_str(), stderr); }

}  // namespace

int main(int argc, char** argv) {
  // The laboratory studies the filters as their text has them, on every machine alike; kernels are for whoever links to them,
  // and here for who asks.
  ::setenv("KFSTAB_ISA", "plain", 0);
  try {
    kfstab::kernels::check_environment();
  } catch (const std::invalid_argument& error) {
    complain(error.what());
    return Exit::usage;
  }
  kfstab::reports::ignore_file_signals();
  // Not a command for people: the process in which --plugin loads a library.
  if (argc == 3 && argv[1] == std::string_view("plugin-host")) return kfstab::properties::serve_plugin(argv[2]);
  watch_for_interruption();
  try {
    const int exit_code = command_line(argc, argv);
    // A full disk or a reader that went away may show only now.
    if (std::fflush(stdout) != 0) throw std::system_error(errno, std::generic_category());
    return exit_code;
  } catch (const kfstab::properties::InputError& error) {
    complain(error.what());
    return Exit::usage;
  } catch (const kfstab::properties::SubjectFault& fault) {
    complain(fault.what());
    return Exit::foreign;
  } catch (const kfstab::reports::FileError& error) {
    complain(error.what());
    return Exit::usage;
  } catch (const NothingSelected& error) {
    complain(error.what());
    return Exit::nothing;
  } catch (const std::system_error& error) {
    // What fmt throws when it cannot write.
    if (std::ferror(stdout) == 0 && std::ferror(stderr) == 0) {
      complain(fmt::format("a fault of kfstab itself: {}", error.what()));
      return Exit::fault;
    }
    complain(fmt::format("cannot write standard output: {}", error.code().message()));
    return Exit::usage;
  } catch (const std::exception& error) {
    complain(fmt::format("a fault of kfstab itself: {}", error.what()));
    return Exit::fault;
  }
}
