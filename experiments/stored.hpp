#pragma once

#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/context.hpp>
#include <kfstab/experiments/run.hpp>

/// Results that were stored, read back: what a report is made of, without running anything.
namespace kfstab::experiments {

/// A results.json of schema kfstab.run/1. The curves are the thinned ones. What a filter is called, holds and computes
/// is what the file says, also where this kfstab has no such filter.
struct StoredRun {
  Context context;
  std::vector<SystemRun> systems;
  /// The filters' metadata and their texts, to which `systems` points.
  std::shared_ptr<const void> owner;
};

/// A results.json of schema kfstab.claims/1. The claims cannot be measured again: they have no `measure`.
struct StoredClaims {
  Context context;
  std::map<std::string, double> parameters;
  std::vector<ClaimResult> claims;
};

using Stored = std::variant<StoredRun, StoredClaims>;

/// Reads the text of a results.json. `origin` is the file's name, for messages.
/// Throws properties::InputError for what is not JSON, has another schema or a later version of it, or lacks a key.
Stored read_results(std::string_view text, const std::string& origin);

/// Of a file; a folder stands for the results.json in it. Throws reports::FileError too.
Stored read_results_file(const std::string& path);

}  // namespace kfstab::experiments
