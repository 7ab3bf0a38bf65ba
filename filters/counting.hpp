#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include <Eigen/Core>

#include <kfstab/filters/matrix.hpp>

/// A number that counts what is done to it, for filters as for any text that is a template on its scalar:
///
///     kfstab::Operations& done = kfstab::operations();
///     done = {};
///     filter.step(model, &y);      // a filter of Counting<double>
///     done.multiplications; ...
///
/// The count is of the calling thread. Comparisons, is_finite, changes of sign and scaling by powers of two are not
/// counted.
namespace kfstab {

struct Operations {
  std::int64_t additions = 0;  ///< and subtractions
  std::int64_t multiplications = 0;
  std::int64_t divisions = 0;
  std::int64_t square_roots = 0;
  /// cancelled[b]: how many additions gave a result whose leading bit is b below that of the larger operand, b > 0, so
  /// that b leading bits of what was known are gone. Those that gave exactly 0 are in the last one.
  std::array<std::int64_t, 65> cancelled = {};

  /// Additions that lost `bits` or more.
  std::int64_t cancellations(int bits) const {
    std::int64_t sum = 0;
    for (std::size_t b = static_cast<std::size_t>(bits); b < cancelled.size(); ++b) sum += cancelled[b];
    return sum;
  }
};

/// The running count of this thread; set it to {} to begin anew.
inline Operations& operations() {
  thread_local Operations count;
  return count;
}

template <class T>
class Counting {
 public:
  Counting() = default;
  Counting(int value) : value_(static_cast<T>(value)) {}
  Counting(double value) : value_(static_cast<T>(value)) {}

  const T& value() const { return value_; }
  explicit operator T() const { return value_; }

  Counting operator-() const { return of(-value_); }
  Counting& operator+=(const Counting& o) { return *this = *this + o; }
  Counting& operator-=(const Counting& o) { return *this = *this - o; }
  Counting& operator*=(const Counting& o) { return *this = *this * o; }
  Counting& operator/=(const Counting& o) { return *this = *this / o; }

  friend Counting operator+(const Counting& a, const Counting& b) { return sum(a.value_, b.value_); }
  friend Counting operator-(const Counting& a, const Counting& b) { return sum(a.value_, -b.value_); }
  friend Counting operator*(const Counting& a, const Counting& b) {
    ++operations().multiplications;
    return of(a.value_ * b.value_);
  }
  friend Counting operator/(const Counting& a, const Counting& b) {
    ++operations().divisions;
    return of(a.value_ / b.value_);
  }
  friend bool operator==(const Counting& a, const Counting& b) { return a.value_ == b.value_; }
  friend auto operator<=>(const Counting& a, const Counting& b) { return a.value_ <=> b.value_; }

  friend Counting abs(const Counting& a) {
    using std::abs;
    return of(abs(a.value_));
  }
  friend Counting sqrt(const Counting& a) {
    using std::sqrt;
    ++operations().square_roots;
    return of(sqrt(a.value_));
  }
  friend Counting frexp(const Counting& a, int* exponent) {
    using std::frexp;
    return of(frexp(a.value_, exponent));
  }
  friend Counting ldexp(const Counting& a, int exponent) {
    using std::ldexp;
    return of(ldexp(a.value_, exponent));
  }

 private:
  static Counting of(const T& value) {
    Counting result;
    result.value_ = value;
    return result;
  }

  static Counting sum(const T& a, const T& b) {
    using std::abs;
    using std::frexp;
    Operations& count = operations();
    ++count.additions;
    const T result = a + b;
    // Of opposite signs: otherwise nothing cancels.
    if ((a < T(0)) != (b < T(0)) && a != T(0) && b != T(0) && result - result == T(0)) {
      if (result == T(0)) {
        ++count.cancelled.back();
      } else {
        int before = 0, after = 0;
        frexp(abs(a) > abs(b) ? a : b, &before);
        frexp(result, &after);
        if (after < before) ++count.cancelled[static_cast<std::size_t>(before - after < 64 ? before - after : 64)];
      }
    }
    return of(result);
  }

  T value_{};
};

/// Asked of the number itself: a test is no operation.
template <class T>
bool is_finite(const Counting<T>& x) {
  return is_finite(x.value());
}

}  // namespace kfstab

template <class T>
struct std::numeric_limits<kfstab::Counting<T>> : std::numeric_limits<T> {
  using Scalar = kfstab::Counting<T>;
  static Scalar min() { return Scalar((std::numeric_limits<T>::min)()); }
  static Scalar max() { return Scalar((std::numeric_limits<T>::max)()); }
  static Scalar lowest() { return Scalar(std::numeric_limits<T>::lowest()); }
  static Scalar epsilon() { return Scalar(std::numeric_limits<T>::epsilon()); }
  static Scalar infinity() { return Scalar(std::numeric_limits<T>::infinity()); }
  static Scalar quiet_NaN() { return Scalar(std::numeric_limits<T>::quiet_NaN()); }
};

namespace Eigen {
template <class T>
struct NumTraits<kfstab::Counting<T>> : GenericNumTraits<kfstab::Counting<T>> {
  using Real = kfstab::Counting<T>;
  using NonInteger = Real;
  using Nested = Real;
  using Literal = Real;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 1,
    ReadCost = 1,
    AddCost = 1,
    MulCost = 1
  };
  static Real epsilon() { return std::numeric_limits<Real>::epsilon(); }
  static Real dummy_precision() { return NumTraits<T>::dummy_precision(); }
  static Real highest() { return (std::numeric_limits<Real>::max)(); }
  static Real lowest() { return std::numeric_limits<Real>::lowest(); }
  static int digits10() { return std::numeric_limits<T>::digits10; }
};
}  // namespace Eigen
