#pragma once

#include <string>
#include <vector>

#include <kfstab/filters/metadata.hpp>
#include <kfstab/filters/problem.hpp>

/// How an asymmetry of P grows in the codings that do nothing to keep P symmetric, theory (3.i)-(3.v).
namespace kfstab::experiments {

/// The filters of the registry that do not keep P symmetric.
std::vector<const Metadata*> codings();

/// "(i)" ... "(v)"; "symmetric".
std::string coding_of(const Metadata& metadata);

/// (iii), (iv), (v): with one output their asymmetry goes by D+ = A D A', theory (3.7).
bool follows_A(Asymmetry coding);

/// P - P' after each step of a filter, started from a P0 that need not be symmetric. Ends where the filter breaks down,
/// or after the first asymmetry that exceeds `limit`.
std::vector<Matrix<double>> asymmetries(const Metadata& metadata, const AnyProblem<double>& problem, int steps,
                                        double limit);

/// ||D||_F / 2: the size of the antisymmetric part.
std::vector<double> norms(const std::vector<Matrix<double>>& asymmetries);

}  // namespace kfstab::experiments
