#include <kfstab/reports/markdown.hpp>

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

}  // namespace kfstab::reports
