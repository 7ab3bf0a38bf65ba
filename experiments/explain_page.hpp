#pragma once

#include <vector>

#include <kfstab/experiments/context.hpp>
#include <kfstab/experiments/explain.hpp>
#include <kfstab/reports/document.hpp>

/// An explanation as a document: what the terminal and the page of `explain` show.
namespace kfstab::experiments {

/// A row a filter: digits lost, the step that took most of them and what that step is like.
reports::Table loss_table(const Explained& explained);

/// For each system its table, its sentences, what filters lost and what steps cost as curves, the errors of the entries
/// of P as heat maps.
reports::Document explain_document(const std::vector<Explained>& explained, const Context& made = context());

}  // namespace kfstab::experiments
