#include <kfstab/reports/markdown.hpp>

#include <algorithm>
#include <variant>

#include <fmt/format.h>

#include <kfstab/reports/number.hpp>

namespace kfstab::reports {
namespace {

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '|' || c == '*' || c == '_' || c == '`' || c == '<' || c == '[' || c == ']' || c == '\\') result += '\\';
    result += c == '\n' ? ' ' : c;
  }
  return result;
}

std::string row_of(const std::vector<std::string>& cells, std::size_t columns) {
  std::string row = "|";
  for (std::size_t i = 0; i < columns; ++i) row += ' ' + (i < cells.size() ? escaped(cells[i]) : "") + " |";
  return row + '\n';
}

/// A paragraph: nothing in it begins a heading or a list.
std::string prose(const std::string& text) {
  const bool is_markup = !text.empty() && std::string_view("#>-+").find(text.front()) != std::string_view::npos;
  return (is_markup ? "\\" : "") + escaped(text);
}

/// Text as it is, between fences longer than any in it.
std::string fenced(const std::string& text) {
  std::string fence = "```";
  while (text.find(fence) != text.npos) fence += '`';
  return fmt::format("{0}\n{1}{2}{0}\n", fence, text, text.ends_with('\n') ? "" : "\n");
}

struct BlockText {
  const std::function<bool(const Figure&)>& has_picture;

  std::string operator()(const Paragraph& block) const {
    return block.label.empty() ? prose(block.text) + "\n"
                               : fmt::format("**{}.** {}\n", escaped(block.label), escaped(block.text));
  }
  std::string operator()(const Equations& block) const {
    std::size_t widest = 0;
    for (const Equation& equation : block.equations) widest = std::max(widest, equation.label.size());
    std::string text;
    for (const Equation& equation : block.equations)
      text += fmt::format("{:<{}}{}\n", equation.label, widest == 0 ? 0 : widest + 2, equation.text);
    return fenced(text);
  }
  std::string operator()(const Preformatted& block) const { return fenced(block.text); }
  std::string operator()(const Table& table) const {
    return (table.caption.empty() ? "" : prose(table.caption) + "\n\n") + render_markdown(table);
  }
  std::string operator()(const Checks& block) const {
    using enum Alignment;
    Table table{.caption = {},
                .header = {"check", "predicted", "measured", "holds", "criterion"},
                .rows = {},
                .alignment = {left, right, right, left, left}};
    for (const Check& check : block.checks)
      table.rows.push_back({check.name, short_number(check.predicted, 5), short_number(check.measured, 5),
                            check.holds ? "yes" : "no", check.criterion});
    return render_markdown(table);
  }
  std::string operator()(const Figure& figure) const {
    const std::string picture = has_picture(figure) ? fmt::format("![{}]({}.svg)", escaped(figure.title), figure.id)
                                                    : fmt::format("{} (not drawn; its numbers are in {}.csv)",
                                                                  escaped(figure.title), figure.id);
    return fmt::format("<a id=\"figure-{}\"></a>\n{}\n\n{}\n", figure.id, picture, prose(figure.caption));
  }
};

}  // namespace

std::string render_markdown(const Table& table) {
  const std::size_t columns = table.header.size();
  std::string text = row_of(table.header, columns) + "|";
  for (std::size_t i = 0; i < columns; ++i) {
    const Alignment alignment = i < table.alignment.size() ? table.alignment[i] : Alignment::left;
    text += alignment == Alignment::right ? " ---: |" : alignment == Alignment::center ? " :---: |" : " --- |";
  }
  text += '\n';
  for (const auto& row : table.rows) text += row_of(row, columns);
  return text;
}

std::string render_markdown(const Document& document, const std::function<bool(const Figure&)>& has_picture) {
  std::string text = fmt::format("# {}\n", escaped(document.title));
  if (!document.subtitle.empty()) text += fmt::format("\n{}\n", prose(document.subtitle));

  std::string verdicts;
  for (const Section& section : document.sections)
    if (section.verdict)
      verdicts += fmt::format("| [{}](#{}) | {} |\n", escaped(section.title), section.anchor, name(*section.verdict));
  if (!verdicts.empty()) text += "\n| | verdict |\n| --- | --- |\n" + verdicts;

  for (const Section& section : document.sections) {
    text += fmt::format("\n<a id=\"{}\"></a>\n\n## {}{}\n", section.anchor, escaped(section.title),
                        section.verdict ? fmt::format(": {}", name(*section.verdict)) : "");
    for (const Block& block : section.blocks) text += "\n" + std::visit(BlockText{has_picture}, block);
  }
  if (!document.context.empty()) {
    Table table{.caption = {}, .header = {"", ""}, .rows = {}, .alignment = {}};
    for (const auto& [key, value] : document.context) table.rows.push_back({key, value});
    text += "\n<a id=\"environment\"></a>\n\n## Environment\n\n" + render_markdown(table);
  }
  return text;
}

}  // namespace kfstab::reports
