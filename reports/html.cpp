#include <kfstab/reports/html.hpp>

#include <algorithm>
#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <stdexcept>
#include <string_view>

#include <fmt/format.h>
#include <kainjow/mustache.hpp>

#include <kfstab/reports/mathml.hpp>
#include <kfstab/reports/number.hpp>

namespace kfstab::reports {

extern const std::string_view page_template;  // page.mustache, by CMake

namespace {

using kainjow::mustache::data;

/// For {{#key}}...{{/key}}: mustache takes an empty text for present.
data if_any(const std::string& text) { return text.empty() ? data(false) : data(text); }

// A key that is missing in an object is looked up in those around it: each object therefore sets all its keys.
data object(std::initializer_list<std::pair<const char*, data>> members) {
  data result(data::type::object);
  for (const auto& [key, value] : members) result.set(key, value);
  return result;
}

data list() { return data(data::type::list); }

/// A gnuplot SVG as part of a page: without what belongs to a file of its own, and with gnuplot's script, which is the
/// larger half of it, only in the page's first. gnuplot's script looks for the settings in a figure's second script
/// element, so an empty first one stays.
class Inliner {
 public:
  std::string operator()(std::string svg) {
    svg.erase(0, svg.find("<svg"));
    erase_attribute(svg, " onload=\"");  // calls what this script does not have
    const std::size_t begin = svg.find("<script"), end = svg.find("</script>", begin);
    if (end == svg.npos) return svg;
    const std::string_view script(svg.data() + begin, end - begin);
    if (script.find("gnuplot_svg = function") == script.npos) return svg;
    if (std::exchange(has_script_, true)) svg.replace(begin, end - begin, "<script>");
    return svg;
  }

 private:
  static void erase_attribute(std::string& svg, std::string_view start) {
    const std::size_t begin = svg.find(start);
    if (begin == svg.npos || begin > svg.find('>')) return;
    const std::size_t end = svg.find('"', begin + start.size());
    if (end != svg.npos) svg.erase(begin, end + 1 - begin);
  }

  bool has_script_ = false;
};

std::string_view css_class(const Table& table, std::size_t column) {
  constexpr std::array<std::string_view, 3> classes{"left", "right", "center"};
  return column < table.alignment.size() ? classes[static_cast<std::size_t>(table.alignment[column])] : "left";
}

data cell(const Table& table, const std::vector<std::string>& row, std::size_t column) {
  return object({{"text", column < row.size() ? row[column] : ""}, {"alignment", std::string(css_class(table, column))}});
}

/// A row of the table below a figure: of a curve, or of a heat map, which has no first value and no last.
data in_numbers(const std::string& label, const std::vector<double>& all, bool ordered) {
  std::vector<double> values;
  std::copy_if(all.begin(), all.end(), std::back_inserter(values), [](double value) { return std::isfinite(value); });
  const auto number = [&](auto which) { return values.empty() ? std::string("–") : short_number(which(), 3); };
  return object({{"label", label},
                 {"points", fmt::format("{}", values.size())},
                 {"first", ordered ? number([&] { return values.front(); }) : "–"},
                 {"last", ordered ? number([&] { return values.back(); }) : "–"},
                 {"smallest", number([&] { return *std::min_element(values.begin(), values.end()); })},
                 {"largest", number([&] { return *std::max_element(values.begin(), values.end()); })}});
}

/// What the template is given for each kind of block: an object whose one key is the kind.
class BlockData {
 public:
  explicit BlockData(const SvgSource& svg) : svg_(svg) {}

  data operator()(const Paragraph& block) const {
    return object({{"paragraph", object({{"label", if_any(block.label)}, {"text", block.text}})}});
  }

  data operator()(const Equations& block) const {
    data rows = list();
    const bool labelled = std::ranges::any_of(block.equations, [](const Equation& e) { return !e.label.empty(); });
    for (const Equation& equation : block.equations)
      rows << object({{"has_label", labelled}, {"label", equation.label}, {"mathml", render_mathml(equation.text)}});
    return object({{"equations", object({{"rows", rows}})}});
  }

  data operator()(const Preformatted& block) const { return object({{"preformatted", object({{"text", block.text}})}}); }

  data operator()(const Table& table) const {
    std::size_t columns = table.header.size();
    for (const auto& row : table.rows) columns = std::max(columns, row.size());
    data header = list(), rows = list();
    for (std::size_t c = 0; c < table.header.size(); ++c) header << cell(table, table.header, c);
    for (const auto& row : table.rows) {
      data cells = list();
      for (std::size_t c = 1; c < columns; ++c) cells << cell(table, row, c);
      rows << object({{"first", columns > 0 ? cell(table, row, 0) : data(false)}, {"cells", cells}});
    }
    return object({{"table", object({{"name", table.caption.empty() ? "Table" : table.caption},
                                     {"caption", if_any(table.caption)},
                                     {"has_header", !table.header.empty()},
                                     {"header", header},
                                     {"rows", rows}})}});
  }

  data operator()(const Checks& block) const {
    data rows = list();
    for (const Check& check : block.checks)
      rows << object({{"name", check.name},
                      {"predicted", short_number(check.predicted, 5)},
                      {"measured", short_number(check.measured, 5)},
                      {"outcome", check.holds ? "holds" : "fails"},
                      {"answer", check.holds ? "yes" : "no"},
                      {"criterion", if_any(check.criterion)}});
    return object({{"checks", object({{"rows", rows}})}});
  }

  data operator()(const Figure& figure) {
    std::string svg = svg_ ? svg_(figure) : "";
    const bool has_svg = svg.find("<svg") != svg.npos;
    const bool first = has_svg && !figure.curves.empty() && !std::exchange(has_figure_, true);
    if (has_svg) svg = inlined_(std::move(svg));
    data curves = list();
    for (const Curve& curve : figure.curves) curves << in_numbers(curve.label, curve.y, true);
    for (const HeatMap& panel : figure.maps.panels) curves << in_numbers(panel.label, panel.values, false);
    return object({{"figure", object({{"id", figure.id},
                                      {"number", fmt::format("{}", ++figures_)},
                                      {"title", figure.title},
                                      {"caption", if_any(figure.caption)},
                                      {"x_label", figure.x.label},
                                      {"y_label", figure.y.label},
                                      {"has_svg", has_svg},
                                      {"first", first},
                                      {"svg", svg},
                                      {"what", figure.maps.panels.empty() ? "curves" : "maps"},
                                      {"curves", curves}})}});
  }

 private:
  const SvgSource& svg_;
  Inliner inlined_;
  bool has_figure_ = false;
  int figures_ = 0;
};

/// "2 of 3", or "" for a section without checks.
std::string checks_that_hold(const Section& section) {
  std::size_t all = 0, hold = 0;
  for (const Block& block : section.blocks)
    if (const auto* checks = std::get_if<Checks>(&block)) {
      all += checks->checks.size();
      hold += static_cast<std::size_t>(std::count_if(checks->checks.begin(), checks->checks.end(), [](const Check& c) { return c.holds; }));
    }
  return all == 0 ? "" : fmt::format("{} of {}", hold, all);
}

/// "3 confirmed, 1 refuted".
std::string summary(const Document& document) {
  std::string text;
  for (Verdict verdict : {Verdict::confirmed, Verdict::refuted, Verdict::inconclusive}) {
    const auto count = std::count_if(document.sections.begin(), document.sections.end(), [&](const Section& s) { return s.verdict == verdict; });
    if (count > 0) text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count, name(verdict));
  }
  return text;
}

void check(const Document& document) {
  std::set<std::string_view> anchors{"environment", "verdicts"}, figures;
  for (const Section& section : document.sections) {
    if (!anchors.insert(section.anchor).second)
      throw std::invalid_argument(fmt::format("two sections have the anchor {:?}, or it is the page's own", section.anchor));
    for (const Block& block : section.blocks)
      if (const auto* figure = std::get_if<Figure>(&block); figure && !figures.insert(figure->id).second)
        throw std::invalid_argument(fmt::format("two figures have the id {:?}", figure->id));
  }
}

}  // namespace

std::string render_html(const Document& document, const SvgSource& svg) {
  check(document);
  data sections = list(), verdicts = list(), contents = list(), context = list();
  bool has_verdicts = false, has_contents = false;
  BlockData block_data(svg);
  for (const Section& section : document.sections) {
    data blocks = list();
    for (const Block& block : section.blocks) blocks << std::visit(block_data, block);
    const std::string verdict(section.verdict ? name(*section.verdict) : "");
    const data entry = object({{"anchor", section.anchor}, {"title", section.title}, {"verdict", if_any(verdict)}, {"checks", checks_that_hold(section)}});
    (section.verdict ? verdicts : contents) << entry;
    (section.verdict ? has_verdicts : has_contents) = true;
    sections << object({{"anchor", section.anchor}, {"title", section.title}, {"verdict", if_any(verdict)}, {"blocks", blocks}});
  }
  for (const auto& [key, value] : document.context) context << object({{"key", key}, {"value", value}});

  kainjow::mustache::mustache page{std::string(page_template)};
  if (!page.is_valid()) throw std::logic_error("page.mustache: " + page.error_message());
  return page.render(object({{"title", document.title},
                             {"subtitle", if_any(document.subtitle)},
                             {"has_verdicts", has_verdicts},
                             {"verdicts", verdicts},
                             {"summary", if_any(summary(document))},
                             {"has_contents", has_verdicts ? has_contents || !document.context.empty() : document.sections.size() > 2},
                             {"contents_title", has_verdicts ? "Also in this report" : "Contents"},
                             {"contents", contents},
                             {"sections", sections},
                             {"has_context", !document.context.empty()},
                             {"context", context}}));
}

}  // namespace kfstab::reports
