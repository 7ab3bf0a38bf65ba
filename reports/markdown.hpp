#pragma once
// Documents and tables as Markdown, as README files and issue trackers show them.

#include <functional>
#include <string>

#include <kfstab/reports/document.hpp>

namespace kfstab::reports {

/// With a rule line, and what Markdown would take for markup escaped. The caption is left out.
std::string render_markdown(const Table& table);

/// The whole document, with what render_html has: verdicts first, with links to their sections; anchors; the context
/// last. Equations stay in plain notation. Figures are ID.svg beside the file; of those that has_picture denies the
/// title alone is given.
std::string render_markdown(const Document& document, const std::function<bool(const Figure&)>& has_picture);

}  // namespace kfstab::reports
