#include <kfstab/experiments/explain_page.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/core.h>

#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/reports/number.hpp>

namespace kfstab::experiments {
namespace {

using reports::short_number;

/// More digits would not fit their cells.
constexpr Index largest_with_numbers = 8;

/// Of an error; a value that is not finite leaves a gap.
std::vector<double> digits_lost(std::vector<double> errors) {
  for (double& error : errors) error = std::max(0.0, std::log10(error / u));
  return errors;
}

std::vector<double> decades(std::vector<double> values, double factor) {
  for (double& value : values) value = factor * std::log10(value);
  return values;
}

reports::Figure losses_figure(const Explained& one, const std::string& prefix) {
  reports::Figure figure{
      prefix + "-losses",
      "Digits lost, step by step",
      "When did each filter lose its digits? 0 is an error of one rounding, 16 that no digit of P is left (of the "
      "gain, for a filter that holds no P).",
      {"step k", false},
      {"digits lost", false},
      {},
      {}};
  for (const FilterRun& f : one.run.filters) {
    if (f.refused) continue;
    auto points = (f.metadata->holds == Held::gain ? f.gain_error : f.covariance_error).points();
    if (points.step.empty()) continue;
    const std::string id(f.metadata->id);
    figure.curves.push_back({id, id, std::move(points.step), digits_lost(std::move(points.value)),
                             reports::CurveRole::measured_line, color_of(id)});
  }
  return figure;
}

reports::Figure costs_figure(const Explained& one, const std::string& prefix) {
  reports::Figure figure{
      prefix + "-costs",
      "What each step may cost",
      "Which steps are hard on any filter? Digits that a step may cost a form that holds P, by theory (4.1): those of "
      "k(Re), and those of the downdate; a form that holds a root pays half of both. An information form pays those of "
      "k(A) and of 1/cos3, theory (4.3), and of k(T) if P is asked for. Beside them by how many decades F may enlarge an "
      "error from before.",
      {"step k", false},
      {"digits", false},
      {},
      {}};
  const AnalysisRun& analysis = one.run.analysis;
  const auto add = [&](const char* id, const char* label, const Series& of, double factor) {
    auto points = of.points();
    if (!points.step.empty())
      figure.curves.push_back({id, label, std::move(points.step), decades(std::move(points.value), factor),
                               reports::CurveRole::measured_line, -1});
  };
  add("condition", "k(Re)", analysis.innovation_condition, 2);
  add("angle", "1/cos^2", analysis.cosine, -2);
  add("information-A", "k(A), information forms", analysis.information.A, 1);
  add("information-angle", "1/cos3, information forms", analysis.information.inverse_cosine, 1);
  add("information-T", "k(T), information forms", analysis.information.T, 1);
  add("growth", "||F||^2", analysis.gamma, 2);
  return figure;
}

std::vector<reports::Figure> entry_figures(const Explained& one, const std::string& prefix) {
  std::vector<reports::HeatMap> panels;
  Index n = 0;
  for (const Explanation& e : one.filters) {
    if (e.entries.size() == 0) continue;
    n = e.entries.rows();
    reports::HeatMap map;
    map.id = std::string(e.filter->id);
    map.label = fmt::format("{}, step {}", e.filter->id, e.worst);
    for (Index i = 0; i < n; ++i)
      for (Index j = 0; j < n; ++j) map.values.push_back(std::max(0.0, std::log10(e.entries(i, j) / u)));
    panels.push_back(std::move(map));
  }
  std::vector<reports::Figure> figures;
  for (std::size_t first = 0; first < panels.size(); first += panels_a_figure) {
    reports::Figure& figure = figures.emplace_back();
    figure.id = fmt::format("{}-entries-{}", prefix, first / panels_a_figure + 1);
    figure.title = "Which entries of P lost most";
    figure.caption =
        "Of each entry of P at the filter's worst step: digits lost, log10 of |p^_ij - p_ij| / sqrt(p_ii p_jj) over u. "
        "Units of the states do not matter.";
    figure.x = {"column", false};
    figure.y = {"row", false};
    for (Index i = 0; i < n; ++i) figure.maps.x.push_back(static_cast<double>(i));
    figure.maps.y = figure.maps.x;
    figure.maps.color = {"digits lost", false};
    figure.maps.matrix = true;
    figure.maps.numbers = n <= largest_with_numbers;
    const auto last = std::min(panels.size(), first + panels_a_figure);
    figure.maps.panels.assign(panels.begin() + static_cast<std::ptrdiff_t>(first),
                              panels.begin() + static_cast<std::ptrdiff_t>(last));
  }
  return figures;
}

}  // namespace

reports::Table loss_table(const Explained& one) {
  using enum reports::Alignment;
  reports::Table table;
  table.caption = fmt::format("{}: where the digits went, {} steps", one.run.name, one.run.steps_done);
  table.header = {"filter",
                  "of",
                  "lost",
                  "by step",
                  "most at",
                  "digits",
                  "k(Re) there",
                  "1/cos^2",
                  "inversions (4.3)",
                  "||F||^2",
                  "asymmetry",
                  "half-word cancellations"};
  table.alignment = {left, left, right, right, right, right, right, right, right, right, right, right};
  const auto number = [](double value) { return std::isnan(value) ? std::string("-") : short_number(value); };
  for (const Explanation& e : one.filters) {
    const std::string id(e.filter->id);
    if (e.refused) {
      table.rows.push_back({id, "refused: " + *e.refused});
      continue;
    }
    std::vector<std::string> row = {id, std::string(1, e.of), fmt::format("{:.1f}", e.lost),
                                    fmt::format("{}", e.worst)};
    if (e.losses.empty()) {
      row.insert(row.end(), 6, "-");
    } else {
      const Loss& most = e.losses.front();
      const bool information = is_information(*e.filter);
      const double inversions = most.information.amplification() * most.information.T;
      row.insert(row.end(),
                 {fmt::format("{}", most.step), fmt::format("{:.1f}", most.digits),
                  information ? "-" : number(most.innovation_condition),
                  information ? "-" : number(1 / (most.cosine * most.cosine)),
                  !information                             ? "-"
                  : e.filter->holds == Held::information ? number(inversions * inversions)
                                                           : number(inversions),
                  number(most.growth)});
    }
    row.push_back(fmt::format("{:.0f} %", 100 * e.asymmetry));
    row.push_back(e.cancellations ? fmt::format("{} of {}", e.cancellations->half_word, e.cancellations->additions)
                                  : "-");
    table.rows.push_back(std::move(row));
  }
  return table;
}

reports::Document explain_document(const std::vector<Explained>& explained, const Context& made) {
  reports::Document document;
  document.title =
      explained.size() == 1 ? explained.front().run.name + ": where the digits went" : "Where the digits went";
  document.subtitle = "Correct digits against a certified reference; theory is docs/theory.md, sections 3 and 4";
  document.context = made;
  for (std::size_t i = 0; i < explained.size(); ++i) {
    const Explained& one = explained[i];
    reports::Section section;
    section.anchor = fmt::format("system-{}", i + 1);
    section.title = one.run.name;
    if (!one.run.description.empty()) section.blocks.emplace_back(reports::Paragraph{one.run.description});
    section.blocks.emplace_back(loss_table(one));
    for (const Explanation& e : one.filters) {
      std::string text;
      for (const std::string& sentence : e.sentences) text += (text.empty() ? "" : " ") + sentence;
      section.blocks.emplace_back(reports::Paragraph{std::move(text)});
    }
    section.blocks.emplace_back(losses_figure(one, section.anchor));
    if (one.run.analysis.gamma.count() > 0) section.blocks.emplace_back(costs_figure(one, section.anchor));
    for (reports::Figure& figure : entry_figures(one, section.anchor)) section.blocks.emplace_back(std::move(figure));
    document.sections.push_back(std::move(section));
  }
  return document;
}

}  // namespace kfstab::experiments
