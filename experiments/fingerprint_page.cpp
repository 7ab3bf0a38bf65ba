#include <kfstab/experiments/fingerprint_page.hpp>

#include <algorithm>
#include <cctype>
#include <cmath>

#include <fmt/core.h>

#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/pages.hpp>
#include <kfstab/reports/number.hpp>

namespace kfstab::experiments {
namespace {

using reports::short_number;

/// What a figure of a ladder shows.
struct LadderFigure {
  const char* ladder;
  const char* title;
  const char* question;
  const char* y;
  bool gain;  ///< the error of K, where it is answered; else that of P
  double powers[2];
  const char* lines[2];
};
constexpr LadderFigure ladder_figures[] = {
    {"innovation",
     "Nearly dependent measurements",
     "How many digits does one step lose when the innovations are nearly dependent? What holds "
     "P loses k^2, what holds a "
     "root k.",
     "relative error of K",
     true,
     {2, 1},
     {"theory: u k^2", "theory: u k"}},
    {"prior",
     "A weak prior",
     "How much does it cost to start from knowing next to nothing? What holds P loses the "
     "prior's variance, what holds a "
     "root the root of it.",
     "worst relative error of P in 6 steps",
     false,
     {1, .5},
     {"theory: u prior", "theory: u prior^1/2"}},
    {"accurate",
     "Two nearly equal, accurate measurements",
     "How long does it last when two measurements come to say the same, ever more exactly? What "
     "holds P ends near 1/d = "
     "2^26, what holds a root near 2^52.",
     "worst relative error of P in 4 steps",
     false,
     {2, 1},
     {"theory: u/d^2", "theory: u/d"}},
    {"graded",
     "Variances of very different size",
     "What becomes of the small variances of a graded P0 under the large ones? Without process "
     "noise det P is known; what "
     "holds P loses k(P0), most roots the root of it.",
     "worst error of ln det P in 4 steps",
     false,
     {1, .5},
     {"theory: u k", "theory: u k^1/2"}},
    {"dynamics",
     "A nearly singular A",
     "Who inverts A? An information filter loses k(A), by normal equations its square; what "
     "holds P or S loses nothing.",
     "relative error of P after 2 steps",
     false,
     {2, 1},
     {"theory: u k^2", "theory: u k"}}};

/// Those that stand for their kind, and those that are like the subject.
std::vector<std::string_view> beside(const Fingerprint& f, std::vector<std::string_view> typical) {
  for (const Metadata* one : f.alike())
    if (std::ranges::find(typical, one->id) == typical.end()) typical.push_back(one->id);
  return typical;
}

bool any_finite(const std::vector<double>& values) {
  return std::ranges::any_of(values, [](double v) { return std::isfinite(v); });
}

reports::Curve of_subject(const Fingerprint& f, std::vector<double> x, std::vector<double> y) {
  return {"subject",    f.subject.name + ", this one",       std::move(x),
          std::move(y), reports::CurveRole::measured_points, black_cross};
}

reports::Figure ladder_figure(const Fingerprint& f, const LadderFigure& what, const std::string& prefix) {
  const Climb& own = f.climb(what.ladder);
  const bool gain = (what.gain && any_finite(own.K)) || !any_finite(own.P);
  const auto errors = [gain](const Climb& climb) { return gain ? climb.K : climb.P; };
  reports::Figure figure;
  figure.id = fmt::format("{}-{}", prefix, what.ladder);
  figure.title = what.title;
  figure.caption =
      fmt::format("{} A curve has a gap where its filter breaks down or has a P of no use.", what.question);
  figure.x = {std::string(own.difficulty), true};
  figure.y = {gain == what.gain ? what.y : gain ? "worst relative error of K" : "worst relative error of P", true};
  for (const std::string_view id : beside(f, {"ckf", "joseph", "srcf", "srif", "information"})) {
    const Climb& climb = registry_fingerprint(id).climb(what.ladder);
    if (any_finite(errors(climb)))
      figure.curves.push_back(measured(id, climb.at, errors(climb), reports::CurveRole::measured_line));
  }
  figure.curves.push_back(of_subject(f, own.at, errors(own)));
  for (int i = 0; i < 2; ++i)
    figure.curves.push_back(theory_line(fmt::format("theory-{}", i + 1), what.lines[i], own.at,
                                        [&](double x) { return u * std::pow(x, what.powers[i]); }));
  return figure;
}

std::vector<double> steps_of(const AsymmetryRun& run) {
  std::vector<double> steps;
  for (std::size_t k = 0; k < run.curve.size(); ++k) steps.push_back(static_cast<double>(k + 1));
  return steps;
}

reports::Figure asymmetry_figure(const Fingerprint& f, std::string_view which, const std::string& prefix) {
  const bool one = which == "one-output";
  const AsymmetryRun& own = f.asymmetry(which);
  reports::Figure figure;
  figure.id = fmt::format("{}-asymmetry-{}", prefix, which);
  const bool stable = which == "two-outputs";
  figure.title = one      ? "Asymmetry: an unstable A, one output"
                 : stable ? "Asymmetry: a stable A, two outputs"
                          : "Asymmetry: an unstable A, two outputs";
  figure.caption = fmt::format(
      "Does P stay symmetric? {} What is on the floor is symmetric to the last bit.",
      one ? fmt::format(
                "The asymmetry that rounding makes grows by |l1 l2| = {:.4g} a step in codings (iii), (iv), (v), and "
                "is forgotten in (i).",
                own.product)
      : stable
          ? std::string("Although A is stable, the asymmetry that rounding makes grows in codings (ii), (iv) and (v).")
          : std::string("In coding (i) the asymmetry that rounding makes is forgotten if Re is taken as computed, and "
                        "grows if only "
                        "one of its triangles is."));
  figure.x = {"step k", false};
  figure.y = {"asymmetry, ||P - P'|| / 2 relative to ||P||", true};
  for (const std::string_view id : beside(f, {"ckf-textbook", "ckf-mixed", "ckf-gain", "ckf-cp"})) {
    const AsymmetryRun& run = registry_fingerprint(id).asymmetry(which);
    figure.curves.push_back(measured(id, steps_of(run), run.curve, reports::CurveRole::measured_line));
  }
  // Every tenth: a cross a step would be a band.
  reports::Curve subject = of_subject(f, {}, {});
  for (std::size_t k = 0; k < own.curve.size(); k += 10) add_point(subject, static_cast<double>(k + 1), own.curve[k]);
  figure.curves.push_back(std::move(subject));
  if (one) {
    auto line = theory_line("theory", fmt::format("theory: u {:.4g}^k", own.product));
    for (int k = 0; k <= 300; k += 10) add_point(line, k, u * std::pow(own.product, k));
    figure.curves.push_back(std::move(line));
  }
  return figure;
}

std::string slope_text(const Line& line) {
  return std::isnan(line.slope) ? "-" : fmt::format("{:.2f} ± {:.2f}", line.slope, line.half_width);
}

std::string at(const std::optional<double>& difficulty) { return difficulty ? short_number(*difficulty) : "never"; }

}  // namespace

reports::Table slope_table(const Fingerprint& f) {
  using enum reports::Alignment;
  const Fingerprint* nearest = f.neighbours.empty() ? nullptr : &registry_fingerprint(f.neighbours.front().filter->id);
  reports::Table table;
  table.caption =
      "Digits lost per decade of difficulty, with 95 % confidence intervals; - where nothing is lost, or all at once";
  table.header = {"ladder", "difficulty", "K", "P", "not definite from", "breaks down at"};
  table.alignment = {left, left, right, right, right, right};
  if (nearest)
    for (const char* of : {"K", "P"}) {
      table.header.push_back(fmt::format("{}: {}", nearest->subject.name, of));
      table.alignment.push_back(right);
    }
  for (const Climb& climb : f.climbs) {
    table.rows.push_back({std::string(climb.id), std::string(climb.symbol), slope_text(climb.K_slope),
                          slope_text(climb.P_slope), f.subject.holds == Held::gain ? "-" : at(climb.indefinite),
                          at(climb.broken)});
    if (climb.refused) table.rows.back()[2] = "not taken: " + *climb.refused;
    if (nearest) {
      const Climb& other = nearest->climb(climb.id);
      table.rows.back().push_back(slope_text(other.K_slope));
      table.rows.back().push_back(slope_text(other.P_slope));
    }
  }
  return table;
}

reports::Section fingerprint_section(const Fingerprint& f, const std::string& prefix) {
  using enum reports::Alignment;
  reports::Section section;
  section.anchor = prefix;
  section.title = "Fingerprint of " + f.subject.name;
  section.blocks.push_back(reports::Paragraph{fmt::format("{} {}.", f.subject.name, sentence(f))});
  section.blocks.push_back(
      reports::Paragraph{fmt::format("On ordinary systems it errs by {:.1e}: that of an arithmetic with u = {:.1e}, "
                                     "where double has {:.1e}. {} steps.",
                                     f.ordinary_error, f.roundoff, u, f.steps)});
  section.blocks.push_back(slope_table(f));
  for (const LadderFigure& what : ladder_figures)
    if (any_finite(f.climb(what.ladder).P) || any_finite(f.climb(what.ladder).K))
      section.blocks.push_back(ladder_figure(f, what, prefix));
  if (f.subject.holds == Held::covariance)
    for (const char* which : {"one-output", "two-outputs", "unstable-two-outputs"})
      if (!f.asymmetry(which).curve.empty()) section.blocks.push_back(asymmetry_figure(f, which, prefix));
  if (!f.neighbours.empty()) {
    reports::Table table{
        "How far it is from the filters of the registry: decades between their errors, and between their "
        "asymmetries, the mean over all ladders",
        {"filter", "decades", "holds"},
        {},
        {left, right, left}};
    for (const Neighbour& one : f.neighbours)
      table.rows.push_back(
          {std::string(one.filter->id), fmt::format("{:.2f}", one.distance), notation(one.filter->holds)});
    section.blocks.push_back(std::move(table));
  }
  return section;
}

reports::Document fingerprint_document(const std::vector<Fingerprint>& fingerprints, const Context& made) {
  reports::Document document;
  document.title = fingerprints.size() == 1 ? fingerprints.front().subject.name + ": of what kind is it?"
                                            : "Filters: of what kind are they?";
  document.subtitle =
      "How each loses digits where theory says that digits are lost, against a certified reference, among the filters "
      "of "
      "the registry";
  document.context = made;
  for (std::size_t i = 0; i < fingerprints.size(); ++i)
    document.sections.push_back(fingerprint_section(
        fingerprints[i], fingerprints.size() == 1
                             ? "fingerprint"
                             : fmt::format("{}-{}", anchor_of(fingerprints[i].subject.name), i + 1)));
  return document;
}

}  // namespace kfstab::experiments
