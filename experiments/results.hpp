#pragma once

#include <map>
#include <string>
#include <vector>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/compare.hpp>
#include <kfstab/experiments/context.hpp>
#include <kfstab/experiments/explain.hpp>
#include <kfstab/experiments/reference_steps.hpp>
#include <kfstab/experiments/run.hpp>

/// Results as JSON, for programs. docs/results.md describes the schemas. Numbers that are not finite are null, with the
/// word ("nan", "inf", "-inf") beside them.
namespace kfstab::experiments {

/// Schema kfstab.run/1.
std::string run_json(const std::vector<SystemRun>& runs, const Context& made = context());

/// Schema kfstab.compare/1.
std::string compare_json(const Comparison& comparison, const Context& made = context());

/// Schema kfstab.explain/1.
std::string explain_json(const std::vector<Explained>& explained, const Context& made = context());

/// Schema kfstab.claims/1. parameters: what was set for all.
std::string claims_json(const std::vector<ClaimResult>& results, const std::map<std::string, double>& parameters,
                        const Context& made = context());

/// Schema kfstab.reference/1 but for its steps, which are too many to be held: what stands before them, the opening bracket
/// included, and what after.
std::string reference_json_before_steps(const properties::System& system, int digits);
std::string reference_json_after_steps(const properties::System& system, const ReferenceOutcome& outcome);

/// Schema kfstab.list/1: the systems, filters and claims that there are, or those of `what`.
std::string list_json(const std::string& what);

}  // namespace kfstab::experiments
