#pragma once

#include <kfstab/filters/matrix.hpp>

/// Definiteness decided exactly. A double is a dyadic rational, so the signs of the eigenvalues of a double matrix are
/// facts: here they are found, not estimated. Matrices are square; an unsymmetric X is judged by (X + X')/2, formed
/// exactly.
namespace kfstab::reference {

/// How many eigenvalues are positive, zero, negative.
struct Signature {
  Index positive = 0;
  Index zero = 0;
  Index negative = 0;

  friend bool operator==(const Signature&, const Signature&) = default;
};

/// By fraction-free LDL' in integers: Sylvester's law of inertia, no rounding. Cost grows as n^5 of word operations, at
/// worst; the predicates below ask it only when double cannot decide.
/// Throws ReferenceError if X is not square or not finite.
Signature signature(const Matrix<double>& X);

/// Whether no eigenvalue is negative. False for a matrix that is not finite; true for 0 x 0.
/// Throws ReferenceError if X is not square.
bool is_positive_semidefinite(const Matrix<double>& X);

/// Whether all eigenvalues are positive. Same conventions.
bool is_positive_definite(const Matrix<double>& X);

/// The smallest eigenvalue (the most negative, if any is), with at least three digits right however small beside ||X||:
/// double where it can decide, else as many digits as it takes; exactly 0 for a singular semidefinite X. NaN for a
/// matrix that is not finite, +infinity for 0 x 0.
double smallest_eigenvalue(const Matrix<double>& X);

/// The smallest eigenvalue of S S' formed exactly, S lower: its strict upper triangle is not read. Same digits, same
/// conventions; exactly 0 if S is singular. For P = (T'T)^{-1} no such care is needed: it is 1 / ||T||_2^2.
double smallest_eigenvalue_of_product(const Matrix<double>& S);

/// Whether det X = 0, of any square X; decided exactly. Throws ReferenceError if X is not square or not finite.
bool is_singular(const Matrix<double>& X);

/// ||X||_2, the largest singular value, right to nearly all digits. No overflow on the way.
double two_norm(const Matrix<double>& X);

}  // namespace kfstab::reference
