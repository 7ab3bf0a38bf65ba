#include <kfstab/reports/terminal.hpp>

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <kfstab/reports/number.hpp>

namespace kfstab::reports {
namespace {

/// The character at the front and its length in bytes; a byte that is no UTF-8 is a character of its own.
std::pair<char32_t, std::size_t> first_character(std::string_view text) {
  const auto byte = [&](std::size_t k) { return static_cast<unsigned char>(text[k]); };
  const unsigned lead = byte(0);
  const std::size_t length = lead < 0x80 ? 1 : lead >= 0xF0 && lead < 0xF8 ? 4 : lead >= 0xE0 ? 3 : lead >= 0xC2 ? 2 : 1;
  if (length == 1 || lead >= 0xF8 || text.size() < length) return {lead, 1};
  char32_t character = lead & (0xFFu >> (length + 1));
  for (std::size_t k = 1; k < length; ++k) {
    if ((byte(k) & 0xC0u) != 0x80u) return {lead, 1};
    character = character << 6 | (byte(k) & 0x3Fu);
  }
  return {character, length};
}

struct Interval {
  char32_t first, last;
};

template <std::size_t N>
bool in(const std::array<Interval, N>& intervals, char32_t c) {
  return std::any_of(intervals.begin(), intervals.end(), [c](Interval i) { return i.first <= c && c <= i.last; });
}

std::size_t width_of(char32_t c) {
  // Combining marks, joiners, variation selectors; East Asian wide and full-width, emoji.
  constexpr std::array<Interval, 6> none{
      {{0x300, 0x36F}, {0x1AB0, 0x1AFF}, {0x200B, 0x200F}, {0x20D0, 0x20FF}, {0xFE00, 0xFE0F}, {0xFE20, 0xFE2F}}};
  constexpr std::array<Interval, 8> two{{{0x1100, 0x115F},
                                         {0x2E80, 0xA4CF},
                                         {0xAC00, 0xD7A3},
                                         {0xF900, 0xFAFF},
                                         {0xFE30, 0xFE6F},
                                         {0xFF00, 0xFF60},
                                         {0x1F300, 0x1FAFF},
                                         {0x20000, 0x3FFFD}}};
  return in(none, c) ? 0 : in(two, c) ? 2 : 1;
}

/// The cell as it is printed: on one line, for a table's lines are its rows.
std::string cell(const std::vector<std::string>& row, std::size_t column) {
  std::string text = column < row.size() ? row[column] : "";
  std::replace_if(text.begin(), text.end(), [](unsigned char c) { return c < 0x20 || c == 0x7F; }, ' ');
  return text;
}

std::string padded(const std::string& text, std::size_t width, Alignment alignment) {
  const std::size_t blank = width - std::min(width, display_width(text));
  const std::size_t before = alignment == Alignment::right ? blank : alignment == Alignment::center ? blank / 2 : 0;
  return std::string(before, ' ') + text + std::string(blank - before, ' ');
}

std::string colored(std::string_view text, std::string_view code, bool color) {
  return color ? fmt::format("\x1b[{}m{}\x1b[0m", code, text) : std::string(text);
}

constexpr std::string_view green = "32", red = "31", yellow = "33";

}  // namespace

std::size_t display_width(std::string_view text) {
  std::size_t width = 0;
  while (!text.empty()) {
    const auto [character, length] = first_character(text);
    width += width_of(character);
    text.remove_prefix(length);
  }
  return width;
}

std::string render_text(Verdict verdict, bool color) {
  return colored(name(verdict), verdict == Verdict::confirmed ? green : verdict == Verdict::refuted ? red : yellow, color);
}

std::string render_text(const Table& table) {
  std::size_t columns = table.header.size();
  for (const auto& row : table.rows) columns = std::max(columns, row.size());
  if (columns == 0) return {};

  std::vector<std::size_t> widths(columns, 0);
  for (std::size_t c = 0; c < columns; ++c) {
    widths[c] = display_width(cell(table.header, c));
    for (const auto& row : table.rows) widths[c] = std::max(widths[c], display_width(cell(row, c)));
  }
  const auto line = [&](const std::vector<std::string>& row) {
    std::string text;
    for (std::size_t c = 0; c < columns; ++c) {
      if (c > 0) text += "  ";
      text += padded(cell(row, c), widths[c], c < table.alignment.size() ? table.alignment[c] : Alignment::left);
    }
    text.erase(text.find_last_not_of(' ') + 1);
    return text + '\n';
  };

  std::string text;
  if (!table.caption.empty()) text += table.caption + '\n';
  if (!table.header.empty()) {
    text += line(table.header);
    for (std::size_t c = 0; c < columns; ++c) text += (c > 0 ? "  " : "") + std::string(widths[c], '-');
    text += '\n';
  }
  for (const auto& row : table.rows) text += line(row);
  return text;
}

// One line a check with the numbers in columns, and below a check that fails what was asked of it.
std::string render_text(const Checks& checks, bool color) {
  std::size_t name_width = 0;
  for (const Check& check : checks.checks) name_width = std::max(name_width, display_width(check.name));
  std::string text;
  for (const Check& check : checks.checks) {
    text += colored(check.holds ? "ok  " : "FAIL", check.holds ? green : red, color);
    text += fmt::format("  {}  predicted {:>10}  measured {:>10}", padded(check.name, name_width, Alignment::left),
                        short_number(check.predicted, 5), short_number(check.measured, 5));
    text += check.criterion.empty() ? "\n" : fmt::format("\n      {}\n", check.criterion);
  }
  return text;
}

}  // namespace kfstab::reports
