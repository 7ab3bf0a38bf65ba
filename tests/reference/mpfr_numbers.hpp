#pragma once

#include <limits>
#include <random>
#include <vector>

#include <boost/multiprecision/gmp.hpp>

#include <kfstab/reference/high_precision.hpp>

/// Numbers to multiply, of the kinds that make trouble, and what they are exactly.
namespace kfstab::reference::testing {

using ExactNumber = boost::multiprecision::number<boost::multiprecision::gmp_rational, boost::multiprecision::et_off>;

template <class T>
ExactNumber exact_number(const T& x) {
  ExactNumber q;
  mpfr_get_q(q.backend().data(), x.backend().data());
  return q;
}

inline ExactNumber power_of_two(long exponent) {
  ExactNumber q(1);
  if (exponent >= 0) {
    mpq_mul_2exp(q.backend().data(), q.backend().data(), static_cast<mp_bitcnt_t>(exponent));
  } else {
    mpq_div_2exp(q.backend().data(), q.backend().data(), static_cast<mp_bitcnt_t>(-exponent));
  }
  return q;
}

/// error / bound, for messages.
inline double ratio(const ExactNumber& error, const ExactNumber& bound) {
  return bound == 0 ? std::numeric_limits<double>::infinity() : static_cast<double>(ExactNumber(abs(error) / bound));
}

template <class T>
long precision_of(const T& x) {
  return static_cast<long>(mpfr_get_prec(x.backend().data()));
}

enum class Kind {
  full,      ///< all bits random, sizes within a few powers of two
  doubles,   ///< 53 bits and zeros
  ones,      ///< 1 - 2^-p: digits that carry to the very top
  sparse,    ///< three quarters zeros
  rows,      ///< rows, or columns, of very different size
  units,     ///< as matrices of states in very different units are: (i, j) of size d_i / d_j
  wild,      ///< exponents over an eighth of the precision
  hopeless,  ///< exponents over four times the precision
};
inline constexpr Kind kinds[] = {Kind::full, Kind::doubles, Kind::ones, Kind::sparse,
                                 Kind::rows, Kind::units,   Kind::wild, Kind::hopeless};

class Numbers {
 public:
  explicit Numbers(unsigned seed) : random_(seed) {}

  template <class T>
  Matrix<T> matrix(Index rows, Index cols, Kind kind) {
    Matrix<T> X(rows, cols);
    std::vector<int> scale(static_cast<std::size_t>(rows + cols));
    for (auto& s : scale) s = up_to(400) - 200;
    for (Index j = 0; j < cols; ++j)
      for (Index i = 0; i < rows; ++i) {
        T& x = X(i, j);
        const auto precision = static_cast<int>(precision_of(x));
        x = 0;
        if (kind == Kind::sparse && up_to(4) != 0) continue;
        if (kind == Kind::ones) {
          x = 1 - ldexp(T(1), -precision);
        } else {
          // 31 bits at a time, from the last
          for (int bits = kind == Kind::doubles ? 22 : precision; bits > -31; bits -= 31)
            x = ldexp(T(x + up_to(1 << 30) * 2), -31);
          if (x == 0) x = 1;
        }
        int exponent = kind == Kind::ones ? 0 : up_to(7) - 3;
        if (kind == Kind::rows) exponent += scale[static_cast<std::size_t>(i)];
        // the same scale for the columns of X and the rows of Y
        if (kind == Kind::units) exponent += 17 * static_cast<int>(i * i % 11) - 17 * static_cast<int>(j * j % 11);
        if (kind == Kind::wild) exponent += up_to(precision / 8);
        if (kind == Kind::hopeless) exponent += up_to(4 * precision);
        x = ldexp(T(up_to(2) == 0 ? -x : x), exponent);
      }
    return X;
  }

  int up_to(int end) { return static_cast<int>(random_() % static_cast<unsigned>(end)); }

 private:
  std::mt19937_64 random_;
};

}  // namespace kfstab::reference::testing
