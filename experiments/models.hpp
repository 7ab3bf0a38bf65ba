#pragma once

#include <cstdint>
#include <string>

#include <boost/random/mersenne_twister.hpp>

#include <kfstab/filters/matrix.hpp>
#include <kfstab/properties/system.hpp>

/// What the systems of the claims are made of. Their entries have short mantissas, so that S0 S0', R^{1/2} R^{T/2} and
/// B Q B' are exact in double, and every filter gets the same problem whatever its parametrisation.
namespace kfstab::experiments {

using Random = boost::random::mt19937_64;

/// r (cos t, -sin t; sin t, cos t).
Matrix<double> rotation(double r, double t);

/// Every entry to the nearest multiple of 2^-bits.
Matrix<double> round_to(const Matrix<double>& X, int bits);

/// Independent standard normal entries.
Matrix<double> random_normal(Random& random, Index rows, Index cols);

/// A random orthogonal matrix, uniformly distributed (Haar).
Matrix<double> random_orthogonal(Random& random, Index n);

/// The time-invariant system of A, B, C with Q = I, R = R_root R_root', P0 = S0 S0', x0 = 0, no data.
properties::System system_of(std::string name, const Matrix<double>& A, const Matrix<double>& B,
                             const Matrix<double>& C, const Matrix<double>& R_root, const Matrix<double>& S0,
                             std::int64_t steps);

/// A system of random A, rho(A) = radius, B and C, entries to 18 bits; R = I, P0 = I.
properties::System random_system(Random& random, Dimensions dimensions, double radius, std::int64_t steps);

/// The problem of a system in one parametrisation. Throws std::logic_error where there is none: a claim's own system.
AnyProblem<double> problem_of(const properties::System& system, Parametrisation form);

/// The colour slot of a filter: the same in every figure.
int color_of(std::string_view filter);

}  // namespace kfstab::experiments
