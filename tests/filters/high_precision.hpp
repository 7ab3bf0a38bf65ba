#pragma once

#include <boost/multiprecision/mpfr.hpp>

namespace kfstab::test {

/// 50 decimal digits, the limbs in the object: no allocation, no precision shared by a process.
using HighPrecision =
    boost::multiprecision::number<boost::multiprecision::mpfr_float_backend<50, boost::multiprecision::allocate_stack>,
                                  boost::multiprecision::et_off>;

}  // namespace kfstab::test
