#pragma once
// A table as Markdown, as README files and issue trackers show it.

#include <string>

#include <kfstab/reports/document.hpp>

namespace kfstab::reports {

/// With a rule line, and what Markdown would take for markup escaped. The caption is left out.
std::string render_markdown(const Table& table);

}  // namespace kfstab::reports
