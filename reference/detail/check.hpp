#pragma once

#include <kfstab/filters/problem.hpp>

namespace kfstab::reference::detail {

/// Throws ReferenceError, saying which matrix of which model, unless the problem is one that the reference can read:
/// shapes, finite numbers, exact symmetry, nonsingular triangles and A^{-1}.
void check(const AnyProblem<double>& problem, bool with_data);

/// Throws ReferenceError, naming the step, unless y and u fit the model and are finite.
void check(const StepData& data, const AnyProblem<double>& problem, std::int64_t k);

}  // namespace kfstab::reference::detail
