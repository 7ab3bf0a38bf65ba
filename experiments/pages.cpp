#include <kfstab/experiments/pages.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <sstream>

#include <fmt/core.h>
#include <oneapi/tbb/parallel_for.h>

#include <kfstab/experiments/context.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/reports/files.hpp>
#include <kfstab/reports/html.hpp>
#include <kfstab/reports/markdown.hpp>
#include <kfstab/reports/number.hpp>
#include <kfstab/reports/plot.hpp>
#include <kfstab/reports/program.hpp>

namespace kfstab::experiments {
namespace {

using reports::short_number;

std::string seconds_text(double seconds) {
  if (!std::isfinite(seconds)) return "";
  return fmt::format("{:.2f}", seconds * 1e6);
}

/// Id-safe: letters, digits and '-'.
reports::Figure run_figure(const SystemRun& run, const std::string& prefix, const std::string& id, std::string title,
                           std::string caption, std::string y_label, bool log, Series FilterRun::*of) {
  reports::Figure figure{prefix + "-" + id, std::move(title),          std::move(caption),
                         {"step k", false}, {std::move(y_label), log}, {}};
  for (const FilterRun& f : run.filters) {
    if (f.refused || (f.*of).count() == 0) continue;
    auto points = (f.*of).points();
    const std::string name(f.metadata->id);
    figure.curves.push_back({name, name, std::move(points.step), std::move(points.value),
                             reports::CurveRole::measured_line, color_of(name)});
  }
  return figure;
}

/// The first-order bounds: as the envelope that of the filters that hold P, or whichever there is; as lines the others.
/// Filters with the same bound share a curve.
void add_bounds(reports::Figure& figure, const SystemRun& run, Series FilterRun::*bound) {
  struct Kind {
    const char* name;
    bool (*is)(Held);
  };
  const Kind kinds[] = {{"P", [](Held h) { return h == Held::covariance; }},
                        {"S", holds_root},
                        {"T", [](Held h) { return h == Held::information_factor; }},
                        {"Y", [](Held h) { return h == Held::information; }}};
  for (const auto& [name, is_kind] : kinds) {
    const FilterRun* widest = nullptr;
    for (const FilterRun& f : run.filters)
      if (!f.refused && is_kind(f.metadata->holds) && (!widest || (f.*bound).count() > (widest->*bound).count()))
        widest = &f;
    if (!widest || (widest->*bound).count() == 0) continue;
    const bool envelope = figure.curves.empty() || figure.curves.front().role != reports::CurveRole::envelope;
    auto points = (widest->*bound).points();
    reports::Curve curve{fmt::format("bound-{}", name),
                         fmt::format("bound, holding {}", name),
                         std::move(points.step),
                         std::move(points.value),
                         envelope ? reports::CurveRole::envelope : reports::CurveRole::theory,
                         -1};
    figure.curves.insert(envelope ? figure.curves.begin() : figure.curves.end(), std::move(curve));
  }
}

/// In decades, on a linear axis: an amplification may be far beyond the range of double.
reports::Figure analysis_figure(const AnalysisRun& analysis, const std::string& prefix) {
  reports::Figure figure{
      prefix + "-error-analysis",
      "What the system does to an error",
      "By how many decades does an error grow, whichever filter made it? One step multiplies an error of P by at most "
      "||F||^2, all steps so far by ||F_k ... F_0||^2, which may be far less than the product of the former. Beside "
      "them what a step loses by itself where S is held, by the condition of Re^{1/2} and by the downdate; where "
      "P is held it is twice as much.",
      {"step k", false},
      {"decades", false},
      {}};
  const auto add = [&](const char* id, const char* label, const Series& of, double factor, bool is_log) {
    auto points = of.points();
    if (!is_log)
      for (double& value : points.value) value = std::log10(value);
    for (double& value : points.value) value *= factor;
    figure.curves.push_back(
        {id, label, std::move(points.step), std::move(points.value), reports::CurveRole::measured_line, -1});
  };
  add("gamma", "one step, ||F||^2", analysis.gamma, 2, false);
  add("amplification", "all steps, ||F_k ... F_0||^2", analysis.log10_amplification, 1, true);
  add("innovation-condition", "k(Re^{1/2})", analysis.innovation_condition, 1, false);
  add("angle", "1/cos", analysis.cosine, -1, false);
  return figure;
}

/// What each filter of the runs computes.
reports::Section filters_section(const std::vector<SystemRun>& runs) {
  reports::Section section{"filters", "What each filter computes", std::nullopt, {}};
  reports::Equations equations;
  std::set<std::string_view> known;
  for (const SystemRun& run : runs)
    for (const FilterRun& f : run.filters)
      if (!f.refused && !f.metadata->update.empty() && known.insert(f.metadata->id).second)
        equations.equations.push_back({std::string(f.metadata->update), std::string(f.metadata->id)});
  if (!equations.equations.empty()) section.blocks = {std::move(equations)};
  return section;
}

/// How to run a claim alone, and what it can be varied in.
void add_invitation(reports::Section& section, const ClaimResult& r) {
  std::string command = "kfstab claim '^" + r.claim.id + "$'";
  for (const auto& [parameter, value] : r.settings.values())
    command += fmt::format(" --set {}={}", parameter, reports::exact_number(value));
  section.blocks.push_back(
      reports::Paragraph{"The claim alone, with the parameters that it had here:", "Run it"});
  section.blocks.push_back(reports::Preformatted{command});
  if (r.claim.parameters.empty()) return;
  using enum reports::Alignment;
  reports::Table table{"What it can be varied in, each by --set NAME=VALUE; the prediction follows",
                       {"name", "here", "unless set", "from", "to", "what it is"},
                       {},
                       {left, right, right, right, right, left}};
  for (const Parameter& parameter : r.claim.parameters) {
    const auto set = r.settings.values().find(parameter.name);
    table.rows.push_back({parameter.name, set == r.settings.values().end() ? "" : short_number(set->second, 4),
                          short_number(parameter.value, 4), short_number(parameter.least, 4),
                          short_number(parameter.most, 4), parameter.meaning});
  }
  section.blocks.push_back(std::move(table));
}

}  // namespace

std::string anchor_of(const std::string& name) {
  std::string anchor;
  for (const char c : name)
    anchor += std::isalnum(static_cast<unsigned char>(c)) ? static_cast<char>(std::tolower(c)) : '-';
  return anchor;
}

reports::Table run_table(const SystemRun& run) {
  using enum reports::Alignment;
  reports::Table table;
  table.caption =
      fmt::format("{}: n = {}, m = {}, p = {}, {} steps, reference certified to {} digits", run.name, run.dimensions.n,
                  run.dimensions.m, run.dimensions.p, run.steps_done, run.certified_digits);
  table.header = {"filter", "P: end",    "worst",   "K: end",   "worst",  "x: end",
                  "worst",  "asymmetry", "min eig", "P < 0 at", "digits", "us/step"};
  table.alignment = {left, right, right, right, right, right, right, right, right, right, right, right};
  // A column that most runs do not need.
  const bool broken = std::ranges::any_of(run.filters, [](const FilterRun& f) { return f.first_failure.has_value(); });
  if (broken) table.header.push_back("broke down");
  for (const FilterRun& f : run.filters) {
    if (f.refused) {
      table.rows.push_back({std::string(f.metadata->id), "refused: " + *f.refused});
      continue;
    }
    if (f.gain_error.count() == 0 && f.covariance_error.count() == 0 && !f.first_failure) {
      table.rows.push_back({std::string(f.metadata->id)});  // no step was done
      continue;
    }
    const auto of = [](const Series& series, double (Series::*value)() const) {
      return series.count() > 0 ? short_number((series.*value)()) : "-";
    };
    const bool holds_P = f.metadata->holds != Held::gain;
    table.rows.push_back({std::string(f.metadata->id), of(f.covariance_error, &Series::last),
                          of(f.covariance_error, &Series::largest), of(f.gain_error, &Series::last),
                          of(f.gain_error, &Series::largest), of(f.state_error, &Series::last),
                          of(f.state_error, &Series::largest), of(f.asymmetry, &Series::largest),
                          of(f.smallest_eigenvalue, &Series::smallest),
                          !holds_P             ? "-"
                          : f.first_indefinite ? fmt::format("{}", *f.first_indefinite)
                                               : "never",
                          std::isnan(f.correct_digits) ? "-" : fmt::format("{:.1f}", f.correct_digits),
                          seconds_text(f.seconds_per_step)});
    if (f.first_failure) table.rows.back().push_back(fmt::format("{} at {}", failure_name(f.failure, f.stopped), *f.first_failure));
  }
  return table;
}

reports::Document run_document(const std::vector<SystemRun>& runs, const Context& made) {
  reports::Document document;
  document.title = runs.size() == 1 ? runs.front().name + ": filters compared" : "Filters compared";
  document.subtitle =
      "Relative errors against a certified reference that started from the very numbers each filter was given";
  document.context = made;
  std::set<std::string> anchors{"environment", "filters", "verdicts"};  // the page's own
  for (const SystemRun& run : runs) {
    // Systems may share a name, or differ in what an id cannot hold.
    const std::string base = run.name.empty() ? "system" : anchor_of(run.name);
    std::string anchor = base;
    for (int n = 2; !anchors.insert(anchor).second; ++n) anchor = fmt::format("{}-{}", base, n);
    reports::Section section;
    section.anchor = anchor;
    section.title = run.name;
    if (!run.description.empty()) section.blocks.push_back(reports::Paragraph{run.description});
    if (!run.source.empty()) section.blocks.push_back(reports::Paragraph{run.source, "Source"});
    if (run.interrupted)
      section.blocks.push_back(reports::Paragraph{fmt::format(
          "Interrupted after {} of {} steps: what follows is of the steps done.", run.steps_done, run.steps_asked)});
    if (run.reference_error)
      section.blocks.push_back(reports::Paragraph{
          fmt::format("The reference has no answer: {}. What follows is of the steps before.", *run.reference_error)});
    section.blocks.push_back(run_table(run));
    section.blocks.push_back(
        reports::Paragraph{"P is the covariance that a filter holds (predicted; filtered for srif), K its gain, x its "
                           "state: relative errors in the "
                           "Frobenius norm. Asymmetry is ||P - P'||/2 relative to P, min eig the smallest eigenvalue "
                           "of its symmetric part over the "
                           "run, P < 0 the first step at which that was exactly not positive semidefinite, digits the "
                           "correct ones of P at the end. A filter "
                           "that broke down was not stepped on."});

    const std::string& prefix = section.anchor;
    auto error = run_figure(
        run, prefix, "covariance-error", "Relative error of P",
        "How far is each filter's P from the true one? The grey region is the first-order bound for filters that "
        "hold P, the dashed lines those for filters that hold a factor S or T: errors below are what theory "
        "excuses, above them something else grows.",
        "relative error of P", true, &FilterRun::covariance_error);
    add_bounds(error, run, &FilterRun::bound);
    section.blocks.push_back(std::move(error));
    auto gain =
        run_figure(run, prefix, "gain-error", "Relative error of the gain",
                   "How far is each filter's gain from the true one? Bounds as above; of the gain of filters that hold "
                   "T there is none.",
                   "relative error of K", true, &FilterRun::gain_error);
    add_bounds(gain, run, &FilterRun::gain_bound);
    section.blocks.push_back(std::move(gain));
    section.blocks.push_back(
        run_figure(run, prefix, "asymmetry", "Asymmetry of P",
                   "Does P stay symmetric? Filters that compute one triangle or hold a factor have exactly 0.",
                   "||P - P'|| / 2, relative to ||P||", true, &FilterRun::asymmetry));
    section.blocks.push_back(
        run_figure(run, prefix, "smallest-eigenvalue", "Smallest eigenvalue of P",
                   "Does P stay positive definite? A value on the floor is zero or negative: no covariance.",
                   "smallest eigenvalue of P", true, &FilterRun::smallest_eigenvalue));
    section.blocks.push_back(analysis_figure(run.analysis, prefix));
    document.sections.push_back(std::move(section));
  }
  if (reports::Section filters = filters_section(runs); !filters.blocks.empty())
    document.sections.push_back(std::move(filters));
  return document;
}

reports::Table verdict_table(const std::vector<ClaimResult>& results) {
  using enum reports::Alignment;
  reports::Table table;
  table.header = {"", "claim", "verdict", "checks held", "what was claimed"};
  table.alignment = {right, left, left, right, left};
  for (const ClaimResult& r : results) {
    const auto held = std::ranges::count_if(r.findings.checks, &reports::Check::holds);
    table.rows.push_back({fmt::format("C{}", r.claim.number), r.claim.id, std::string(name(r.verdict())),
                          fmt::format("{} of {}", held, r.findings.checks.size()), r.claim.title});
  }
  return table;
}

reports::Document claims_document(const std::vector<ClaimResult>& results, const Context& made) {
  reports::Document document;
  document.title = "What the literature claims of Kalman filters in floating point, measured";
  document.subtitle = "Each verdict is computed from the checks below it, each with its prediction and its criterion";
  document.context = made;
  for (const ClaimResult& r : results) {
    reports::Section section;
    section.anchor = r.claim.id;
    section.title = fmt::format("C{}  {}", r.claim.number, r.claim.title);
    section.verdict = r.verdict();
    const auto say = [&](const char* label, const std::string& text) {
      if (!text.empty()) section.blocks.push_back(reports::Paragraph{text, label});
    };
    section.blocks.push_back(reports::Paragraph{r.claim.statement});
    if (!r.claim.mathematics.empty()) {
      reports::Equations equations;
      std::istringstream lines(r.claim.mathematics);
      for (std::string line; std::getline(lines, line);) equations.equations.push_back({line, ""});
      section.blocks.push_back(std::move(equations));
    }
    say("Setup", r.claim.setup);
    say("Prediction", r.claim.prediction);
    section.blocks.push_back(reports::Checks{r.findings.checks});
    for (const auto& figure : r.findings.figures) section.blocks.push_back(figure);
    say("What it means", r.claim.meaning);
    add_invitation(section, r);
    say("Source", r.claim.source);
    document.sections.push_back(std::move(section));
  }
  return document;
}

void write_results(const reports::Document& document, const std::string& json, const std::filesystem::path& path,
                   const Rendering& rendering) {
  const reports::Folder folder(path);
  // First what cannot be made again, then what can be drawn from it.
  if (!json.empty()) folder.write("results.json", json);
  std::vector<const reports::Figure*> figures;
  for (const auto& section : document.sections)
    for (const auto& block : section.blocks)
      if (const auto* figure = std::get_if<reports::Figure>(&block)) figures.push_back(figure);
  for (const auto* figure : figures) reports::write_sources(*figure, folder, rendering.drawing());
  std::vector<reports::PlotResult> drawn(figures.size());
  oneapi::tbb::parallel_for(std::size_t{0}, figures.size(), [&](std::size_t i) {
    drawn[i] = reports::draw_figure(*figures[i], folder, rendering.drawing());
  });

  const auto svg = [&](const reports::Figure& figure) { return reports::read_svg(figure, folder); };
  if (rendering.html || rendering.pdf) folder.write("index.html", reports::render_html(document, svg));
  if (rendering.markdown)
    folder.write("report.md", reports::render_markdown(
                                  document, [&](const reports::Figure& figure) { return !svg(figure).empty(); }));
  if (rendering.pdf) {
    folder.announce({"report.pdf"});
    if (const std::string reason = reports::print_pdf(path / "index.html", path / "report.pdf"); !reason.empty())
      fmt::print(stderr, "kfstab: warning: no report.pdf: {}\n", reason);
    if (!rendering.html) std::filesystem::remove(path / "index.html");  // it was the PDF's alone
  }

  // Most likely one cause, a gnuplot that is not there: told once.
  std::erase_if(drawn, [](const reports::PlotResult& result) { return result.warning.empty(); });
  if (!drawn.empty())
    fmt::print(stderr, "kfstab: warning: {}{}\n", drawn.front().warning,
               drawn.size() > 1 ? fmt::format(" ({} more figures likewise)", drawn.size() - 1) : "");
}

}  // namespace kfstab::experiments
