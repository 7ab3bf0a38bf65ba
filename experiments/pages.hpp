#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/run.hpp>
#include <kfstab/reports/document.hpp>

/// Results as documents, for people: what the terminal and the pages show.
namespace kfstab::experiments {

/// The table of a run: a row a filter.
reports::Table run_table(const SystemRun& run);

/// The page of a run: for each system its table and its figures (error of P under its bound, asymmetry, smallest
/// eigenvalue, gain error).
reports::Document run_document(const std::vector<SystemRun>& runs);

/// The table of verdicts, and the page of the claims.
reports::Table verdict_table(const std::vector<ClaimResult>& results);
reports::Document claims_document(const std::vector<ClaimResult>& results);

/// Writes index.html and every figure of the document into the folder, results.json beside them. Warnings (no gnuplot)
/// go to stderr, once. Throws reports::FileError.
void write_results(const reports::Document& document, const std::string& json, const std::filesystem::path& folder);

}  // namespace kfstab::experiments
