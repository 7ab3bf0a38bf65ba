#pragma once

#include <kfstab/reference/detail/lockstep.hpp>

namespace kfstab::reference::detail {

/// Throws ReferenceError, saying which matrix of which model, unless the problem is one that the reference can read:
/// shapes, finite numbers, exact symmetry, nonsingular triangles and A^{-1}.
void check(const Source& source, bool with_data);

/// Throws ReferenceError, naming the step, unless y and u fit the model and are finite.
void check(const SourceData& data, const Source& source, std::int64_t k);

}  // namespace kfstab::reference::detail
