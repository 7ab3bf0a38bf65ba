#pragma once

#include <kfstab/filters/problem.hpp>

namespace kfstab::reference {

/// Whether both are one problem in exact numbers, whatever their parametrisations: as many models, the same A, B, C, D,
/// Q, R, P0, x0 and E w, where S0 S0' = P0, (T0'T0)^{-1} = P0, (A^{-1})^{-1} = A and so on hold without a rounding. Then
/// one Trajectory is the truth about both. No root is taken and nothing inverted: the products are compared. False for
/// numbers that are not finite.
bool same_numbers(const AnyProblem<double>& left, const AnyProblem<double>& right);

}  // namespace kfstab::reference
