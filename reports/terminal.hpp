#pragma once
// Tables and verdicts as plain text. Columns line up for any UTF-8; colour (ANSI) only if asked for.

#include <cstddef>
#include <string>
#include <string_view>

#include <kfstab/reports/document.hpp>

namespace kfstab::reports {

/// How many columns a terminal needs for the text: wide characters take two, combining ones none.
std::size_t display_width(std::string_view text);

/// The verdict's name; green, red or yellow.
std::string render_text(Verdict verdict, bool color = false);

/// Each ends with a line break; an empty one is an empty string.
std::string render_text(const Table& table);
std::string render_text(const Checks& checks, bool color = false);

}  // namespace kfstab::reports
