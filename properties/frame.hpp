#pragma once

#include <kfstab/filters/matrix.hpp>

/// The QR factorisation of random matrices, compiled once.
namespace kfstab::properties {

/// Q of X = QR, R with a positive diagonal, X with at least as many rows as columns: of a Gaussian X it is uniform over
/// all orthonormal frames.
Matrix<double> orthonormal_frame(const Matrix<double>& X);

/// The first min(rows, cols) columns of R', that is lower L with L L' = X'X, a diagonal >= 0.
Matrix<double> lower_root_of_gram(const Matrix<double>& X);

}  // namespace kfstab::properties
