#pragma once

#include <map>
#include <string>
#include <vector>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/run.hpp>

/// Results as JSON, for programs. docs/results.md describes both schemas. Numbers that are not finite are null, with the
/// word ("nan", "inf", "-inf") beside them.
namespace kfstab::experiments {

/// Schema kfstab.run/1.
std::string run_json(const std::vector<SystemRun>& runs);

/// Schema kfstab.claims/1. parameters: what was set for all.
std::string claims_json(const std::vector<ClaimResult>& results, const std::map<std::string, double>& parameters);

/// Schema kfstab.list/1: the systems, filters and claims that there are, or those of `what`.
std::string list_json(const std::string& what);

}  // namespace kfstab::experiments
