#pragma once

#include <string>
#include <utility>
#include <vector>

namespace kfstab::experiments {

/// Under what results were made: versions, compiler, flags, rounding, revision, machine. Pairs of name and value, in one
/// order everywhere: the pages' footers and the "context" of every results.json.
std::vector<std::pair<std::string, std::string>> context();

}  // namespace kfstab::experiments
