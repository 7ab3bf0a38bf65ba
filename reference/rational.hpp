#pragma once

#include <boost/multiprecision/gmp.hpp>

#include <kfstab/filters/problem.hpp>

/// Numbers without rounding: what a system's entries are where they were written exactly ("1/3", "1e-30"), and what the
/// oracles of the tests compute in.
namespace kfstab::reference {

using Rational = boost::multiprecision::number<boost::multiprecision::gmp_rational, boost::multiprecision::et_off>;

/// A problem in exact numbers. The covariance parametrisation serves for all: S0 S0' and (T'T)^{-1} are rational.
using ExactProblem = Problem<CovarianceModel<Rational>>;
using ExactData = DataOf<Rational>;

}  // namespace kfstab::reference
