#pragma once

#include <memory>
#include <optional>

#include <kfstab/filters/matrix.hpp>

namespace kfstab::properties {

/// A matrix of numbers with 100 decimal digits: room enough that what is computed in it and rounded to double is, for
/// any matrix whose condition number is below some 10^60, the exact value rounded once. Immutable; copies share.
///
/// The arithmetic stays in precise.cpp, so that this header costs its users nothing.
class Precise {
 public:
  struct Numbers;

  /// Exactly X.
  Precise(const Matrix<double>& X);
  static Precise identity(Index n);

  Index rows() const;
  Index cols() const;

  /// Each entry rounded to the nearest double; infinite beyond its range.
  Matrix<double> rounded() const;
  Precise transposed() const;
  /// Rows and columns both in the opposite order.
  Precise reversed() const;

  friend Precise operator+(const Precise& X, const Precise& Y);
  friend Precise operator-(const Precise& X, const Precise& Y);
  friend Precise operator*(const Precise& X, const Precise& Y);
  friend Precise operator*(double factor, const Precise& X);

  /// The diagonal multiplied by (1 + relative): X + relative diag(X).
  Precise with_diagonal_raised(double relative) const;

  /// Lower L with LL' = X and a diagonal >= 0, from X's lower triangle; a pivot of 0 gives a column of 0. Nothing if X is not
  /// positive semidefinite. A pivot counts as 0 when less than 10^-70 is left of the terms that it was subtracted from.
  std::optional<Precise> lower_root() const;
  /// Nothing if X is singular, by the same measure of a pivot.
  std::optional<Precise> inverse() const;
  /// Some entry of the diagonal is 0; for a root: it is singular.
  bool has_zero_on_diagonal() const;

  /// The Frobenius norm.
  double norm() const;
  /// The condition number in the 1-norm; infinite if singular, 1 if there is nothing (0 x 0).
  double condition() const;

 private:
  explicit Precise(std::shared_ptr<const Numbers> numbers) : numbers_(std::move(numbers)) {}

  std::shared_ptr<const Numbers> numbers_;
};

}  // namespace kfstab::properties
