#pragma once

#include <kfstab/experiments/compare.hpp>
#include <kfstab/experiments/context.hpp>
#include <kfstab/reports/document.hpp>

/// A comparison as a document: what the terminal and the page of `compare` show.
namespace kfstab::experiments {

/// A row a filter: the system as it is written.
reports::Table comparison_table(const Comparison& comparison);

/// A row a filter: what its worst is over the scans, and where. Empty without scans.
reports::Table scan_table(const Comparison& comparison);

/// The recommendation, the tables, and the figures: curves over one scan, heat maps over two, over the steps without
/// any.
reports::Document comparison_document(const Comparison& comparison, const Context& made = context());

}  // namespace kfstab::experiments
