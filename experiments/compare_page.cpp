#include <kfstab/experiments/compare_page.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>

#include <fmt/core.h>

#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/cost.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/pages.hpp>
#include <kfstab/reports/number.hpp>

namespace kfstab::experiments {
namespace {

using reports::short_number;

std::string decimals(double value) { return std::isnan(value) ? "-" : fmt::format("{:.1f}", value); }

double word(const Point& point) { return point.bits * std::log10(2.0); }

bool was_measured(const Point& point) { return point.done && !point.error; }

bool scans_bits(const Comparison& c) {
  return std::ranges::any_of(c.scans, [](const Scan& scan) { return scan.of == Scan::Of::bits; });
}

/// What a figure shows of a filter at a point.
struct Shown {
  const char* id;
  const char* of;
  double (*digits)(const Fare&);
};
constexpr Shown shown[] = {{"covariance", "P", [](const Fare& f) { return f.P.worst; }},
                           {"gain", "K", [](const Fare& f) { return f.K.worst; }},
                           {"state", "x", [](const Fare& f) { return f.x.worst; }}};

/// Digits lost, or those kept where the word itself is scanned.
double value(const Comparison& c, const Point& point, const Fare& own, const Shown& what) {
  if (!was_measured(point) || own.refused) return NaN;
  double kept = what.digits(own);
  // A filter that broke down keeps nothing, in its first step too.
  const bool has = !std::isnan(kept) || what.of[0] == 'K' || (what.of[0] == 'P' && own.filter->holds != Held::gain);
  if (own.first_failure && has) kept = 0;
  return scans_bits(c) ? kept : word(point) - kept;
}

bool indefinite(const Fare& own) { return !own.refused && (own.first_indefinite || own.first_failure); }

/// The least digits that the first-order bound leaves filters of a kind.
double bound(const Point& point, bool (*is)(Held)) {
  double least = NaN;
  for (const Fare& own : point.filters)
    if (!own.refused && is(own.filter->holds)) least = std::fmin(least, own.bound);
  return least;
}

reports::Figure curves(const Comparison& c, const Shown& what) {
  const Scan& scan = c.scans.front();
  const bool bits = scans_bits(c);
  const std::string verb = bits ? "kept" : "lost";
  reports::Figure figure;
  figure.id = fmt::format("scan-{}", what.id);
  figure.title = fmt::format("Digits {} of {} over {}", verb, what.of, scan.name);
  figure.caption = fmt::format("How many decimal digits of {} does each filter {} at its worst step? ", what.of,
                               bits ? "keep" : "lose");
  figure.x = {bits ? "bits of the mantissa" : scan.name, scan.log};
  figure.y = {fmt::format("digits {} of {}", verb, what.of), false};
  const auto add = [&](std::string id, std::string label, reports::CurveRole role, int color, auto of_point) {
    reports::Curve curve{std::move(id), std::move(label), {}, {}, role, color};
    for (const Point& point : c.points) {
      curve.x.push_back(point.at.front());
      curve.y.push_back(was_measured(point) ? of_point(point) : NaN);
    }
    if (std::ranges::any_of(curve.y, [](double y) { return std::isfinite(y); }))
      figure.curves.push_back(std::move(curve));
  };
  if (std::string_view(what.of) == "P") {
    const auto line = [bits](const Point& point, double kept) { return bits ? kept : word(point) - kept; };
    add("bound-P", "bound, holding P", bits ? reports::CurveRole::theory : reports::CurveRole::envelope, -1,
        [&](const Point& p) { return line(p, bound(p, [](Held h) { return h == Held::covariance; })); });
    add("bound-S", "bound, holding S", reports::CurveRole::theory, -1,
        [&](const Point& p) { return line(p, bound(p, holds_root)); });
    figure.caption += bits ? "The dashed lines are what the first-order bounds leave. "
                           : "The grey region is the first-order bound of filters that hold P, the dashed line that of "
                             "those that hold a root. ";
  }
  if (bits) add("word", "the whole word", reports::CurveRole::theory, -1, [](const Point& p) { return word(p); });
  for (std::size_t i = 0; i < c.filters.size(); ++i) {
    const std::string id(c.filters[i]->id);
    add(id, id, reports::CurveRole::measured_line, color_of(id),
        [&](const Point& p) { return value(c, p, p.filters[i], what); });
  }
  reports::Curve broken{"indefinite", "not definite", {}, {}, reports::CurveRole::measured_points, black_cross};
  for (const Point& point : c.points)
    for (const Fare& own : point.filters)
      if (was_measured(point) && indefinite(own)) {
        broken.x.push_back(point.at.front());
        broken.y.push_back(value(c, point, own, what));
      }
  if (std::ranges::any_of(broken.y, [](double y) { return std::isfinite(y); })) {
    figure.curves.push_back(std::move(broken));
    figure.caption += "Crossed out: P was not positive semidefinite at some step, or the filter broke down.";
  }
  return figure;
}

/// One panel a filter, some panels a figure.
std::vector<reports::Figure> heat_maps(const Comparison& c, const Shown& what) {
  const Scan &down = c.scans[0], &across = c.scans[1];
  const std::string verb = scans_bits(c) ? "kept" : "lost";
  std::vector<reports::HeatMap> panels;
  for (std::size_t i = 0; i < c.filters.size(); ++i) {
    reports::HeatMap map;
    map.id = map.label = std::string(c.filters[i]->id);
    for (const Point& point : c.points) {
      const bool there = was_measured(point);
      map.values.push_back(there ? value(c, point, point.filters[i], what) : NaN);
      map.outlined.push_back(there && indefinite(point.filters[i]));
    }
    if (std::ranges::any_of(map.values, [](double v) { return std::isfinite(v); })) panels.push_back(std::move(map));
  }
  std::vector<reports::Figure> figures;
  for (std::size_t first = 0; first < panels.size(); first += panels_a_figure) {
    reports::Figure& figure = figures.emplace_back();
    figure.id = fmt::format("scan-{}-{}", what.id, first / panels_a_figure + 1);
    figure.title = fmt::format("Digits {} of {} over {} and {}", verb, what.of, down.name, across.name);
    figure.caption = fmt::format(
        "How many decimal digits of {} does each filter {} at its worst step? Within the line P was not positive "
        "semidefinite at some step, or the filter broke down; hatched, it does not apply.",
        what.of, scans_bits(c) ? "keep" : "lose");
    figure.x = {across.name, across.log};
    figure.y = {down.name, down.log};
    figure.maps.x = across.values;
    figure.maps.y = down.values;
    figure.maps.color = {fmt::format("digits {} of {}", verb, what.of), false};
    figure.maps.outline = "not definite";
    const auto last = std::min(panels.size(), first + panels_a_figure);
    std::move(panels.begin() + static_cast<std::ptrdiff_t>(first), panels.begin() + static_cast<std::ptrdiff_t>(last),
              std::back_inserter(figure.maps.panels));
  }
  return figures;
}

std::string definiteness(const Fare& own) {
  if (own.first_failure) return fmt::format("{} at {}", failure_name(own.failure, own.stopped), *own.first_failure);
  if (own.filter->holds == Held::gain) return "-";
  return own.first_indefinite ? fmt::format("not definite at {}", *own.first_indefinite) : "yes";
}

}  // namespace

reports::Table comparison_table(const Comparison& c) {
  using enum reports::Alignment;
  const SystemRun& run = c.as_written;
  reports::Table table;
  table.caption = fmt::format(
      "{} as it is written: n = {}, m = {}, p = {}, {} steps; an error is multiplied by {} a step", run.name,
      run.dimensions.n, run.dimensions.m, run.dimensions.p, run.steps_done, short_number(c.base.forgetting, 3));
  table.header = {"filter", "P: end", "worst",     "bound", "K: end",     "worst",
                  "x: end", "worst",  "asymmetry", "sound", "operations", "us/step"};
  table.alignment = {left, right, right, right, right, right, right, right, right, left, right, right};
  for (std::size_t i = 0; i < c.filters.size() && i < c.base.filters.size(); ++i) {
    const Fare& own = c.base.filters[i];
    const std::string id(c.filters[i]->id);
    if (!own.filter) continue;
    if (own.refused) {
      table.rows.push_back({id, "refused: " + *own.refused});
      continue;
    }
    const double seconds = run.filters[i].seconds_per_step;
    table.rows.push_back(
        {id, decimals(own.P.end), decimals(own.P.worst), decimals(own.bound), decimals(own.K.end),
         decimals(own.K.worst), decimals(own.x.end), decimals(own.x.worst),
         std::isnan(own.asymmetry) ? "-" : short_number(own.asymmetry), definiteness(own),
         c.filters[i]->operations.empty() ? "-" : fmt::format("{:.0f}", operations(*c.filters[i], run.dimensions)),
         std::isnan(seconds) ? "-" : fmt::format("{:.2f}", seconds * 1e6)});
  }
  return table;
}

reports::Table scan_table(const Comparison& c) {
  using enum reports::Alignment;
  reports::Table table;
  if (c.scans.empty()) return table;
  const auto done = std::ranges::count_if(c.points, was_measured);
  table.caption = fmt::format("Over {} of {} points of the scan: fewest digits of all steps", done, c.points.size());
  table.header = {"filter", "sound at", "digits of P", "where", "digits of K", "where", "first not sound"};
  if (scans_bits(c)) table.header.push_back("bits it needs");
  table.alignment = {left, right, right, left, right, left, left, right};
  for (std::size_t i = 0; i < c.filters.size(); ++i) {
    std::size_t sound = 0, ran = 0;
    const Point *unsound = nullptr, *P = nullptr, *K = nullptr;
    for (const Point& point : c.points) {
      if (!was_measured(point) || point.filters[i].refused) continue;
      const Fare& own = point.filters[i];
      ++ran;
      if (own.sound())
        ++sound;
      else if (!unsound)
        unsound = &point;
      const auto fewer = [&](const Point*& least, Digits Fare::*of) {
        if (!std::isnan((own.*of).worst) && (!least || (own.*of).worst < (least->filters[i].*of).worst)) least = &point;
      };
      fewer(P, &Fare::P);
      fewer(K, &Fare::K);
    }
    const std::string id(c.filters[i]->id);
    if (ran == 0) {
      table.rows.push_back({id, "at no point"});
      continue;
    }
    table.rows.push_back(
        {id, fmt::format("{} of {}", sound, ran), P ? decimals(P->filters[i].P.worst) : "-", P ? place(c, *P) : "",
         K ? decimals(K->filters[i].K.worst) : "-", K ? place(c, *K) : "",
         unsound ? fmt::format("{}: {}", place(c, *unsound), definiteness(unsound->filters[i])) : "never"});
    if (scans_bits(c)) {
      const auto bits = fewest_bits(c, i);
      table.rows.back().push_back(bits ? fmt::format("{}", *bits) : "more");
    }
  }
  return table;
}

reports::Document comparison_document(const Comparison& c, const Context& made) {
  const SystemRun& run = c.as_written;
  reports::Document document;
  document.title = fmt::format("{}: which filter?", run.name);
  document.subtitle =
      "Correct decimal digits against a certified reference that started from the very numbers each filter was given";
  document.context = made;

  reports::Section answer;
  answer.anchor = "recommendation";
  answer.title = "Recommendation";
  for (const std::string& sentence : c.recommendation.sentences) answer.blocks.push_back(reports::Paragraph{sentence});
  answer.blocks.push_back(
      reports::Paragraph{"By rule, from the numbers below (docs/compare.md): a filter is sound at a point if it does "
                         "every step and its P is "
                         "positive semidefinite after each; of those sound at every point that keep the digits of P "
                         "and K to within one of the "
                         "best, at every point, the one with the fewest operations."});
  if (c.interrupted) answer.blocks.push_back(reports::Paragraph{"Interrupted: what follows is of the points done."});
  document.sections.push_back(std::move(answer));

  reports::Section base;
  base.anchor = "as-written";
  base.title = "The system as it is written";
  if (!run.description.empty()) base.blocks.push_back(reports::Paragraph{run.description});
  if (!run.source.empty()) base.blocks.push_back(reports::Paragraph{"Source: " + run.source});
  base.blocks.push_back(comparison_table(c));
  base.blocks.push_back(reports::Paragraph{
      "Correct decimal digits of P, of the gain K and of the state x: after the last step and at the worst one; bound: "
      "what the first-order bound leaves of P at the worst step. Operations: multiply-adds of a step by the formula of "
      "each "
      "form, lower terms left out."});
  document.sections.push_back(std::move(base));

  if (c.scans.empty()) {
    for (reports::Section& section : run_document({run}, made).sections) {
      section.title = "Step by step";
      document.sections.push_back(std::move(section));
    }
    return document;
  }
  reports::Section scan;
  scan.anchor = "scan";
  scan.title = "Over " + c.scans.front().name + (c.scans.size() > 1 ? " and " + c.scans.back().name : "");
  scan.blocks.push_back(scan_table(c));
  for (const Shown& what : shown) {
    const bool any = std::ranges::any_of(c.points, [&](const Point& point) {
      return was_measured(point) &&
             std::ranges::any_of(point.filters, [&](const Fare& own) { return !std::isnan(what.digits(own)); });
    });
    if (!any) continue;
    if (c.scans.size() == 1) {
      scan.blocks.push_back(curves(c, what));
    } else {
      for (reports::Figure& figure : heat_maps(c, what)) scan.blocks.push_back(std::move(figure));
    }
  }
  for (const Point& point : c.points)
    if (point.error)
      scan.blocks.push_back(reports::Paragraph{fmt::format("No answer at {}: {}", place(c, point), *point.error)});
  document.sections.push_back(std::move(scan));
  return document;
}

}  // namespace kfstab::experiments
