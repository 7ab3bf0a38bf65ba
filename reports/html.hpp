#pragma once
// A document as one page that needs nothing else: no network, no other file.

#include <functional>
#include <string>

#include <kfstab/reports/document.hpp>

namespace kfstab::reports {

/// The SVG text of a figure, empty if there is none (then the page says so). See read_svg in plot.hpp.
using SvgSource = std::function<std::string(const Figure&)>;

/// The page. All text of the document is escaped; the SVGs are trusted and inlined, so that they stay interactive.
/// Sections with a verdict are summed up in a table at the top.
std::string render_html(const Document& document, const SvgSource& svg);

}  // namespace kfstab::reports
