#pragma once

#include <cstdint>
#include <vector>

#include <kfstab/reference/error.hpp>
#include <kfstab/reference/rational.hpp>

/// An oracle: what a filter computes, by the definition and without a recursion.
namespace kfstab::reference {

/// Mean and covariance of a state, given measurements.
struct Conditioned {
  Vector<Rational> x;
  Matrix<Rational> P;
  /// Of the measurements it is given, stacked: log p(y) = -(p count log 2 pi + log determinant + weighted) / 2, with
  /// determinant = det cov y and weighted = (y - E y)' (cov y)^{-1} (y - E y).
  Rational determinant = 1, weighted = 0;
};

/// x_k given y_0 ... y_{count-1}: of x_{k|k-1} count is k, of x_{k|k} k + 1; smoothed states come the same way.
///
/// Every state and measurement is a linear map of what is independent, x_0, w_0, w_1 ..., v_0, v_1 ..., theory (1.1);
/// so their joint covariance is M diag(P0, Q, ..., R, ...) M', and
///
///     x = E x_k + cov(x_k, y) (cov y)^{-1} (y - E y),    P = cov x_k - cov(x_k, y) (cov y)^{-1} cov(y, x_k)
///
/// are one solve with a matrix of p count rows, exact in rational numbers. Nothing is reused from step to step.
///
/// @param data  y and u of the steps 0 ... max(k, count) - 1 at least; without any, means are not computed
/// Throws ReferenceError if cov y is singular.
Conditioned condition(const ExactProblem& problem, std::int64_t k, std::int64_t count,
                      const std::vector<StepDataOf<Rational>>& data = {});

}  // namespace kfstab::reference
