#pragma once

#include <cmath>
#include <limits>

#include <kfstab/filters/matrix.hpp>

namespace kfstab {

/// An elementary reflector H = I - tau u u', u = (1; v), that maps (alpha; x) to (beta; 0). Source: LAPACK DLARFG.
template <class Scalar>
struct Reflector {
  Scalar beta;
  Scalar tau;  ///< 0 where nothing had to be done (H = I), else in [1, 2]
};

/// Makes the reflector of (alpha; x), x_i = x(0) ... x(size-1), and overwrites x with v.
///
/// beta has the sign opposite to alpha's, so that alpha - beta never cancels. The entries are brought near
/// 1 before they are squared wherever a square could leave the range, so nothing over- or underflows that does not
/// have to. A NaN or an infinity among them gives a NaN.
template <class Scalar, class Access>
Reflector<Scalar> make_reflector(const Scalar& alpha, Index size, Access&& x) {
  using std::abs;
  using std::sqrt;
  Scalar largest(0);
  for (Index i = 0; i < size; ++i) {
    const Scalar a = abs(Scalar(x(i)));
    if (a > largest || !(a == a)) largest = a;  // a NaN stays: nothing is greater
  }
  if (largest == Scalar(0)) return {alpha, Scalar(0)};
  if (abs(alpha) > largest || !(alpha == alpha)) largest = abs(alpha);

  // Squares of numbers in [small, 1/small] neither overflow when summed nor lose digits to gradual underflow. Outside,
  // everything is divided by a power of two, which rounds nothing.
  static const Scalar small = sqrt(sqrt((std::numeric_limits<Scalar>::min)()));
  if (!(largest >= small && largest <= Scalar(1) / small) && is_finite(largest)) {
    using std::frexp;
    using std::ldexp;
    int exponent = 0;
    frexp(largest, &exponent);
    for (Index i = 0; i < size; ++i) x(i) = ldexp(Scalar(x(i)), -exponent);
    Reflector<Scalar> scaled = make_reflector(Scalar(ldexp(alpha, -exponent)), size, x);
    scaled.beta = ldexp(scaled.beta, exponent);
    return scaled;
  }
  Scalar norm = alpha * alpha;
  for (Index i = 0; i < size; ++i) norm += x(i) * x(i);
  norm = sqrt(norm);
  const Scalar beta = alpha < Scalar(0) ? norm : Scalar(-norm);
  const Scalar pivot = alpha - beta;
  for (Index i = 0; i < size; ++i) x(i) /= pivot;
  return {beta, (beta - alpha) / beta};
}

}  // namespace kfstab
