#pragma once

#include <string>
#include <utility>
#include <vector>

namespace kfstab::experiments {

using Context = std::vector<std::pair<std::string, std::string>>;

/// Under what results were made: versions, compiler, flags, rounding, revision, machine. Pairs of name and value, in one
/// order everywhere: the pages' footers and the "context" of every results.json.
Context context();

}  // namespace kfstab::experiments
