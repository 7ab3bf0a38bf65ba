#pragma once

#include <boost/multiprecision/mpfr.hpp>

#include <kfstab/filters/matrix.hpp>

/// The one public header that brings in multiprecision: for sources and tests that compute in it themselves. Everything
/// else in this room speaks double.
namespace kfstab::reference {

/// A number of fixed precision, at least Digits decimal digits. Not mpfr_float: its precision is a process-wide static
/// (Boost 1.74), so that two trajectories in two threads would change each other's. The limbs lie in the object: no
/// allocation.
template <unsigned Digits>
using Real = boost::multiprecision::number<
    boost::multiprecision::mpfr_float_backend<Digits, boost::multiprecision::allocate_stack>,
    boost::multiprecision::et_off>;

/// Enough for what stands beside the trajectory: tests, backward errors.
using HighPrecision = Real<50>;

/// Exact: every rung holds every double.
template <class Number>
Number exact(double x) {
  return Number(x);
}

/// Rounded to the nearest double, ties to even, once; infinite beyond the range of double, denormalised below it.
template <class Number>
double round_to_double(const Number& x) {
  return mpfr_get_d(x.backend().data(), MPFR_RNDN);
}

/// Exact, entry by entry.
template <class Number, int Rows, int Cols>
Matrix<Number, Rows, Cols> exact(const Matrix<double, Rows, Cols>& X) {
  Matrix<Number, Rows, Cols> Y(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(i, j) = exact<Number>(X(i, j));
  return Y;
}

}  // namespace kfstab::reference
