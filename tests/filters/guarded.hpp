#pragma once

#include <cmath>
#include <stdexcept>
#include <string>

#include <kfstab/filters/matrix.hpp>

namespace kfstab::test {

/// Which entries of a matrix may be touched.
enum class Allowed { all, lower, upper };

/// A matrix that throws when an entry outside the promised triangle, widened by `band` diagonals, is read or written.
/// The idea is tlapack's TestUploMatrix. The entries outside hold NaN, too.
template <class S>
class Guarded {
 public:
  using Scalar = S;

  Guarded(Matrix<S> entries, Allowed allowed, Index band = 0)
      : entries_(std::move(entries)), allowed_(allowed), band_(band) {
    for (Index j = 0; j < cols(); ++j)
      for (Index i = 0; i < rows(); ++i)
        if (!may_touch(i, j)) entries_(i, j) = S(std::nan(""));
  }

  Index rows() const { return entries_.rows(); }
  Index cols() const { return entries_.cols(); }
  S& operator()(Index i, Index j) { return entries_(checked(i, j), j); }
  const S& operator()(Index i, Index j) const { return entries_(checked(i, j), j); }

  bool may_touch(Index i, Index j) const {
    return allowed_ == Allowed::all || (allowed_ == Allowed::lower ? i + band_ >= j : i <= j + band_);
  }

  /// What may be touched, and zeros.
  Matrix<S> values() const {
    Matrix<S> X = entries_;
    for (Index j = 0; j < cols(); ++j)
      for (Index i = 0; i < rows(); ++i)
        if (!may_touch(i, j)) X(i, j) = S(0);
    return X;
  }

 private:
  Index checked(Index i, Index j) const {
    if (i < 0 || j < 0 || i >= rows() || j >= cols())
      throw std::out_of_range("(" + std::to_string(i) + "," + std::to_string(j) + ") is outside the matrix");
    if (!may_touch(i, j))
      throw std::logic_error("(" + std::to_string(i) + "," + std::to_string(j) + ") is in the forbidden triangle");
    return i;
  }

  Matrix<S> entries_;
  Allowed allowed_;
  Index band_;
};

}  // namespace kfstab::test
