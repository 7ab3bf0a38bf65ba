#pragma once

#include <memory>
#include <optional>
#include <string_view>

#include <kfstab/properties/system.hpp>
#include <kfstab/reference/rational.hpp>

/// A system without rounding: each entry that was written exactly is what was written, each other one the very double.
namespace kfstab::properties {

/// The number that a text holds if it is a decimal or a fraction of two: "0.1", "-2.5E+3", "1/3", "-7/2e10". Nothing if it
/// is anything else, divides by zero or has more than 4000 characters. Throws ExpressionError for a power of ten beyond
/// +-10000.
std::optional<reference::Rational> read_exact(std::string_view text);

/// The number of an entry beside which the double x stands: what was written, or x where the two do not go together.
reference::Rational exact_value(const ExactEntry& entry, double x);

/// Matrix number k of the sequence, as it lies there.
Matrix<reference::Rational> exact_matrix(const Sequence& sequence, std::size_t k);

/// Whether the matrix was written without a rounding: each entry is exact, or a double that its own shortest decimal
/// equals ("0.5" and "3", but not "0.1").
bool written_exactly(const Sequence& sequence, std::size_t k);

/// The system in exact numbers: roots multiplied out, L L', where they were written. As many models as problem() makes.
reference::ExactProblem exact_problem(const System& system);

/// The system's data in exact numbers; null if it has none. They share the system's data, and outlive the system.
std::shared_ptr<const reference::ExactData> exact_data(const System& system);

}  // namespace kfstab::properties
