#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/context.hpp>
#include <kfstab/experiments/run.hpp>
#include <kfstab/reports/document.hpp>
#include <kfstab/reports/plot.hpp>

/// Results as documents, for people: what the terminal and the pages show.
namespace kfstab::experiments {

/// A name in kebab-case, as anchors are.
std::string anchor_of(const std::string& name);

/// The table of a run: a row a filter.
reports::Table run_table(const SystemRun& run);

/// The page of a run: for each system its table and its figures (error of P under its bound, asymmetry, smallest
/// eigenvalue, gain error), and what each filter computes.
reports::Document run_document(const std::vector<SystemRun>& runs, const Context& made = context());

/// The table of verdicts, and the page of the claims.
reports::Table verdict_table(const std::vector<ClaimResult>& results);
reports::Document claims_document(const std::vector<ClaimResult>& results, const Context& made = context());

/// As what results are written, beside results.json, which always is.
struct Rendering {
  bool html = true;                                  ///< index.html
  bool markdown = false;                             ///< report.md
  bool pdf = false;                                  ///< report.pdf, and a PDF of each figure
  reports::Medium medium = reports::Medium::screen;  ///< what the figures are for

  /// Where Markdown alone is asked for, stdout is Markdown too.
  bool only_markdown() const { return markdown && !html && !pdf; }
  reports::Drawing drawing() const { return {medium, pdf}; }
};

/// Writes results.json (none if `json` is empty), every figure of the document, drawn on all cores, and the document into
/// the folder. Warnings (no gnuplot, no browser for a PDF) go to stderr, one a cause. Throws reports::FileError.
void write_results(const reports::Document& document, const std::string& json, const std::filesystem::path& folder,
                   const Rendering& rendering = {});

}  // namespace kfstab::experiments
