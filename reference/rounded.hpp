#pragma once

#include <compare>
#include <cstdint>
#include <limits>
#include <memory>

#include <mpfr.h>

#include <kfstab/filters/any_filter.hpp>
#include <kfstab/filters/matrix.hpp>
#include <kfstab/filters/problem.hpp>

/// Filters at any number of bits: what would be left of one in a shorter or a longer word.
///
///     RoundedFilter filter(*find_filter("srcf"), 24);
///     const AnyProblem<double> given = rounded(problem, 24);   // what a word of 24 bits can be given
///     Trajectory truth(given, rounded(data, 24));
///     filter.start(given);
///     for (k = 0; k < steps; ++k) {
///       truth.advance();
///       errors = truth.measure(filter.metadata(), filter.step(k, &y, &u));
///     }
namespace kfstab::reference {

/// A binary floating-point number whose mantissa, in bits, is chosen at run time: every operation is rounded to
/// nearest, ties to even, to as many bits as this thread rounds to at the time. There is no underflow, no overflow
/// short of 2^(10^9), and no denormal number; otherwise 24 bits are IEEE single, 53 double, 113 quadruple precision.
///
/// The limbs lie in the object: no allocation. A copy is exact, whatever the number of bits.
class Rounded {
 public:
  static constexpr int least_bits = 8, most_bits = 237;

  /// How many bits this thread rounds to: 53 until RoundedBits says otherwise.
  static int bits() { return bits_; }

  Rounded() { zero(); }
  Rounded(int value) {
    zero();
    mpfr_set_si(&number_, value, MPFR_RNDN);
  }
  Rounded(double value) {
    zero();
    mpfr_set_d(&number_, value, MPFR_RNDN);
  }
  Rounded(const Rounded& o) { copy(o); }
  Rounded& operator=(const Rounded& o) {
    if (this != &o) copy(o);
    return *this;
  }

  /// Rounded once; infinite or denormalised where it is out of the range of double.
  explicit operator double() const { return mpfr_get_d(&number_, MPFR_RNDN); }
  mpfr_srcptr data() const { return &number_; }
  /// The bits that it has been rounded to.
  int precision() const { return static_cast<int>(number_._mpfr_prec); }

  Rounded operator-() const { return unary(mpfr_neg, *this); }
  Rounded& operator+=(const Rounded& o) { return in_place(mpfr_add, o); }
  Rounded& operator-=(const Rounded& o) { return in_place(mpfr_sub, o); }
  Rounded& operator*=(const Rounded& o) { return in_place(mpfr_mul, o); }
  Rounded& operator/=(const Rounded& o) { return in_place(mpfr_div, o); }
  friend Rounded operator+(const Rounded& a, const Rounded& b) { return binary(mpfr_add, a, b); }
  friend Rounded operator-(const Rounded& a, const Rounded& b) { return binary(mpfr_sub, a, b); }
  friend Rounded operator*(const Rounded& a, const Rounded& b) { return binary(mpfr_mul, a, b); }
  friend Rounded operator/(const Rounded& a, const Rounded& b) { return binary(mpfr_div, a, b); }

  friend bool operator==(const Rounded& a, const Rounded& b) { return mpfr_equal_p(&a.number_, &b.number_) != 0; }
  friend std::partial_ordering operator<=>(const Rounded& a, const Rounded& b) {
    if (mpfr_unordered_p(&a.number_, &b.number_)) return std::partial_ordering::unordered;
    return mpfr_cmp(&a.number_, &b.number_) <=> 0;
  }

  friend Rounded abs(const Rounded& a) { return unary(mpfr_abs, a); }
  friend Rounded sqrt(const Rounded& a) { return unary(mpfr_sqrt, a); }
  friend Rounded frexp(const Rounded& a, int* exponent) {
    *exponent = mpfr_regular_p(&a.number_) ? static_cast<int>(mpfr_get_exp(&a.number_)) : 0;
    return ldexp(a, -*exponent);
  }
  friend Rounded ldexp(const Rounded& a, int exponent) {
    Rounded result;
    mpfr_mul_2si(&result.number_, &a.number_, exponent, MPFR_RNDN);
    return result;
  }

 private:
  friend class RoundedBits;
  static constexpr int limbs = (most_bits + GMP_NUMB_BITS - 1) / GMP_NUMB_BITS;
  inline static thread_local int bits_ = 53;

  void zero() { mpfr_custom_init_set(&number_, MPFR_ZERO_KIND, 0, bits_, limbs_); }
  void copy(const Rounded& o) {
    number_ = o.number_;
    number_._mpfr_d = limbs_;
    for (int i = 0; i * GMP_NUMB_BITS < o.precision(); ++i) limbs_[i] = o.limbs_[i];
  }

  template <class Operation>
  static Rounded unary(Operation operation, const Rounded& a) {
    Rounded result;
    operation(&result.number_, &a.number_, MPFR_RNDN);
    return result;
  }
  template <class Operation>
  static Rounded binary(Operation operation, const Rounded& a, const Rounded& b) {
    Rounded result;
    operation(&result.number_, &a.number_, &b.number_, MPFR_RNDN);
    return result;
  }
  template <class Operation>
  Rounded& in_place(Operation operation, const Rounded& o) {
    if (precision() == bits_) {
      operation(&number_, &number_, &o.number_, MPFR_RNDN);
      return *this;
    }
    return *this = binary(operation, *this, o);
  }

  __mpfr_struct number_;
  mp_limb_t limbs_[limbs] = {};
};

/// From here to the end of the block this thread rounds to that many bits.
class RoundedBits {
 public:
  /// Throws ReferenceError for fewer than Rounded::least_bits or more than Rounded::most_bits.
  explicit RoundedBits(int bits);
  ~RoundedBits() { Rounded::bits_ = before_; }
  RoundedBits(const RoundedBits&) = delete;
  RoundedBits& operator=(const RoundedBits&) = delete;

 private:
  int before_;
};

}  // namespace kfstab::reference

/// epsilon is that of the bits that this thread rounds to. min() and max() are not the smallest and largest numbers,
/// but leave room to square their squares; both are powers of two, exact at any number of bits.
template <>
struct std::numeric_limits<kfstab::reference::Rounded> {
  using Scalar = kfstab::reference::Rounded;
  static constexpr bool is_specialized = true, is_signed = true, is_integer = false, is_exact = false;
  static constexpr bool has_infinity = true, has_quiet_NaN = true;
  static constexpr int radix = 2, digits = Scalar::most_bits, digits10 = Scalar::most_bits * 3 / 10;
  static Scalar min() { return ldexp(Scalar(1), -(1 << 24)); }
  static Scalar max() { return ldexp(Scalar(1), 1 << 24); }
  static Scalar lowest() { return -max(); }
  static Scalar epsilon() { return ldexp(Scalar(1), 1 - Scalar::bits()); }
  static Scalar infinity() { return Scalar(std::numeric_limits<double>::infinity()); }
  static Scalar quiet_NaN() { return Scalar(std::numeric_limits<double>::quiet_NaN()); }
};

template <>
struct Eigen::NumTraits<kfstab::reference::Rounded> : GenericNumTraits<kfstab::reference::Rounded> {
  using Real = kfstab::reference::Rounded;
  using NonInteger = Real;
  using Nested = Real;
  using Literal = Real;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 1,
    ReadCost = 4,
    AddCost = 16,
    MulCost = 16
  };
  static Real epsilon() { return std::numeric_limits<Real>::epsilon(); }
  static Real dummy_precision() { return Real(16) * epsilon(); }
  static Real highest() { return (std::numeric_limits<Real>::max)(); }
  static Real lowest() { return std::numeric_limits<Real>::lowest(); }
  static int digits10() { return Real::bits() * 3 / 10; }
};

namespace kfstab::reference {

/// Exact where Number holds that many bits, as every rung of the reference does.
template <class Number>
Number exact(const Rounded& x) {
  Number y;
  mpfr_set(y.backend().data(), x.data(), MPFR_RNDN);
  return y;
}
template <class Number, int Rows, int Cols>
Matrix<Number, Rows, Cols> exact(const Matrix<Rounded, Rows, Cols>& X) {
  Matrix<Number, Rows, Cols> Y(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(i, j) = exact<Number>(X(i, j));
  return Y;
}

/// Of such numbers, exactly: as those of doubles in definiteness.hpp.
bool is_positive_semidefinite(const Matrix<Rounded>& X);
bool is_positive_definite(const Matrix<Rounded>& X);
double smallest_eigenvalue(const Matrix<Rounded>& X);

/// Every number of a problem, or of data, rounded to that many bits; doubles have 53, so more bits change nothing. A
/// covariance stays symmetric; whether it stays definite is the caller's to see.
AnyProblem<double> rounded(const AnyProblem<double>& problem, int bits);
std::shared_ptr<const Data> rounded(std::shared_ptr<const Data> data, int bits);

/// A filter of the registry that computes with that many bits, and is given doubles: what has more bits is rounded on
/// the way in. Each may be stepped in a thread of its own.
class RoundedFilter {
 public:
  /// Throws ReferenceError as RoundedBits does.
  RoundedFilter(const Metadata& metadata, int bits);
  RoundedFilter(const RoundedFilter&) = delete;  // what it steps points into it
  RoundedFilter& operator=(const RoundedFilter&) = delete;

  const Metadata& metadata() const { return filter_->metadata(); }
  int bits() const { return bits_; }
  /// As of AnyFilter, but that the problem need not outlive the call.
  void start(const AnyProblem<double>& problem);
  Step<Rounded> step(std::int64_t k, const Vector<double>* y, const Vector<double>* u);

 private:
  int bits_;
  AnyProblem<Rounded> problem_;
  std::unique_ptr<AnyFilter<Rounded>> filter_;
};

}  // namespace kfstab::reference
