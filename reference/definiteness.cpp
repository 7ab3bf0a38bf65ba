#include <kfstab/reference/definiteness.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <kfstab/reference/detail/dense.hpp>
#include <kfstab/reference/error.hpp>
#include <kfstab/reference/rational.hpp>
#include <kfstab/reference/rounded.hpp>

namespace kfstab::reference {
namespace {

using Integers = Matrix<Integer>;

template <class Number>
void require_square(const Matrix<Number>& X, const char* what) {
  if (X.rows() != X.cols())
    throw ReferenceError(std::string(what) + " of a matrix that is not square: " + std::to_string(X.rows()) + " x " +
                         std::to_string(X.cols()));
}

/// x 2^shift as an integer; shift is such that it is one.
Integer scaled_integer(double x, int shift) {
  if (x == 0) return 0;
  int exponent = 0;
  const auto mantissa = static_cast<long long>(std::ldexp(std::frexp(x, &exponent), 53));
  const int bits = exponent - 53 + shift;
  Integer result = mantissa;
  if (bits >= 0)
    result <<= static_cast<unsigned>(bits);
  else
    result >>= static_cast<unsigned>(-bits);  // exact: the bits that go are 0
  return result;
}

/// Exponent of the last bit of x that is set.
int last_bit(double x) {
  int exponent = 0;
  auto mantissa = static_cast<long long>(std::ldexp(std::frexp(x, &exponent), 53));
  exponent -= 53;
  for (; mantissa % 2 == 0; mantissa /= 2) ++exponent;
  return exponent;
}

// The same of a number of any precision.

Integer scaled_integer(const Rounded& x, int shift) {
  if (x == Rounded(0)) return 0;
  Integer result;
  const auto bits = mpfr_get_z_2exp(result.backend().data(), x.data()) + shift;
  if (bits >= 0)
    result <<= static_cast<unsigned>(bits);
  else
    result >>= static_cast<unsigned>(-bits);
  return result;
}

int last_bit(const Rounded& x) {
  Integer mantissa;
  const auto exponent = mpfr_get_z_2exp(mantissa.backend().data(), x.data());
  return static_cast<int>(exponent) + static_cast<int>(mpz_scan1(mantissa.backend().data(), 0));
}

int leading_bit(double x) { return std::ilogb(x); }
int leading_bit(const Rounded& x) { return static_cast<int>(mpfr_get_exp(x.data())) - 1; }

/// X as integers of one scale, X(i, j) 2^(row_shift(i) + column_shift(j) + common).
template <class Number>
Integers integers(const Matrix<Number>& X, const std::vector<int>& row_shift, const std::vector<int>& column_shift) {
  int common = std::numeric_limits<int>::min();
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      if (X(i, j) != Number(0))
        common = std::max(common, -(last_bit(X(i, j)) + row_shift[static_cast<std::size_t>(i)] +
                                    column_shift[static_cast<std::size_t>(j)]));
  Integers Y(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      Y(i, j) = scaled_integer(
          X(i, j), row_shift[static_cast<std::size_t>(i)] + column_shift[static_cast<std::size_t>(j)] + common);
  return Y;
}

/// A positive multiple of a diagonal congruence of X + X': the signature of X's symmetric part. Scaled so that the
/// diagonal is of one size, which keeps the integers short for states of very different units.
template <class Number>
Integers symmetric_integers(const Matrix<Number>& X) {
  const Index n = X.rows();
  std::vector<int> shift(static_cast<std::size_t>(n), 0);
  for (Index i = 0; i < n; ++i)
    if (X(i, i) != Number(0)) shift[static_cast<std::size_t>(i)] = -leading_bit(X(i, i)) / 2;
  Integers Y = integers(X, shift, shift);
  for (Index j = 0; j < n; ++j)
    for (Index i = j; i < n; ++i) {
      Y(i, j) += Y(j, i);
      Y(j, i) = Y(i, j);
    }
  return Y;
}

void divide_exactly(Integer& x, const Integer& by) {
  mpz_divexact(x.backend().data(), x.backend().data(), by.backend().data());
}

/// Signs of the pivots of LDL' by Bareiss's fraction-free elimination: after step k every entry is a minor of the
/// matrix, so divisions leave no remainder. Pivots are taken from the diagonal; where it is all 0 but the rest is not,
/// adding row and column j to row and column i puts 2 x_ij there (a unimodular congruence, so entries stay minors).
/// With semidefinite_only, stops at the first sign that says no, leaving one negative in the count.
Signature inertia(Integers X, bool semidefinite_only) {
  const Index n = X.rows();
  Signature found;
  Integer previous = 1;
  for (Index k = 0; k < n; ++k) {
    Index pivot = k;
    while (pivot < n && X(pivot, pivot) == 0) ++pivot;
    if (pivot == n) {
      Index row = k, column = k;
      for (Index j = k; j < n && row == column; ++j)
        for (Index i = j + 1; i < n; ++i)
          if (X(i, j) != 0) {
            row = i;
            column = j;
            break;
          }
      if (row == column) {
        found.zero = n - k;
        return found;
      }
      if (semidefinite_only) {
        found.negative = 1;
        return found;
      }
      for (Index l = k; l < n; ++l) X(row, l) += X(column, l);
      for (Index l = k; l < n; ++l) X(l, row) += X(l, column);
      pivot = row;
    }
    if (pivot != k) {
      for (Index l = k; l < n; ++l) std::swap(X(k, l), X(pivot, l));
      for (Index l = k; l < n; ++l) std::swap(X(l, k), X(l, pivot));
    }
    // The pivot of LDL' is this minor over the one before.
    if ((X(k, k) > 0) == (previous > 0)) {
      ++found.positive;
    } else {
      ++found.negative;
      if (semidefinite_only) return found;
    }
    Integer product;
    for (Index j = k + 1; j < n; ++j)
      for (Index i = j; i < n; ++i) {
        X(i, j) *= X(k, k);
        product = X(i, k) * X(j, k);
        X(i, j) -= product;
        divide_exactly(X(i, j), previous);
        X(j, i) = X(i, j);
      }
    previous = X(k, k);
  }
  return found;
}

/// True only if the symmetric part of X is positive definite. A Cholesky factorisation that runs to its end shows
/// X' >= -n g D D', D D' the diagonal, g = (n + 1) u / (1 - (n + 1) u) (Demmel 1989; Higham, Accuracy and Stability of
/// Numerical Algorithms, theorem 10.5 and what follows); so taking twice as much, and the rounding of the symmetric
/// part, off the diagonal first leaves room, for a rounding of the entries to double too. Where products might underflow
/// it does not try.
bool surely_positive_definite(const Matrix<double>& X) {
  const Index n = X.rows();
  const double margin = 2 * static_cast<double>(n + 1) * static_cast<double>(n + 4) * unit_roundoff<double>();
  if (margin > 0.1) return false;
  Matrix<double> L(n, n);
  for (Index j = 0; j < n; ++j) {
    if (!(X(j, j) > 0x1p-900) || X(j, j) > 0x1p1000) return false;
    for (Index i = j; i < n; ++i) L(i, j) = i == j ? X(j, j) * (1 - margin) : (X(i, j) / 2 + X(j, i) / 2);
  }
  for (Index j = 0; j < n; ++j) {
    double pivot = L(j, j);
    for (Index l = 0; l < j; ++l) pivot -= L(j, l) * L(j, l);
    if (!(pivot > 0)) return false;
    L(j, j) = std::sqrt(pivot);
    for (Index i = j + 1; i < n; ++i) {
      double sum = L(i, j);
      for (Index l = 0; l < j; ++l) sum -= L(i, l) * L(j, l);
      L(i, j) = sum / L(j, j);
    }
  }
  return true;
}

Matrix<double> symmetric_part(const Matrix<double>& X) { return X / 2 + X.transpose() / 2; }

/// Scaled so that the largest entry is about 1; the exponent taken out comes back. No overflow on the way to norms.
int scale_to_one(Matrix<double>& X) {
  const double largest = X.size() > 0 ? X.cwiseAbs().maxCoeff() : 0.0;
  if (largest == 0) return 0;
  const int exponent = std::ilogb(largest);
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) X(i, j) = std::ldexp(X(i, j), -exponent);
  return exponent;
}

/// Eigenvalues of a symmetric matrix, unordered, and the vectors to them, by cyclic Jacobi rotations in double.
/// Backward error a modest multiple of n u ||H||. Eigen's solver would take this source four times as long to compile.
struct Spectrum {
  Vector<double> values;
  Matrix<double> vectors;

  explicit Spectrum(Matrix<double> H) : vectors(Matrix<double>::Identity(H.rows(), H.rows())) {
    const Index n = H.rows();
    const auto rotate = [](double& a, double& b, double c, double s) {
      const double old = a;
      a = c * old - s * b;
      b = s * old + c * b;
    };
    for (int sweep = 0; sweep < 60; ++sweep) {
      bool rotated = false;
      for (Index q = 1; q < n; ++q)
        for (Index p = 0; p < q; ++p) {
          const double off = H(p, q);
          // what cannot change either diagonal entry in double is done with
          if (std::abs(off) <= 0x1p-60 * std::max(std::abs(H(p, p)), std::abs(H(q, q))) || off == 0) {
            H(p, q) = H(q, p) = 0;
            continue;
          }
          rotated = true;
          const double theta = (H(q, q) - H(p, p)) / (2 * off);
          const double t = (theta < 0 ? -1 : 1) / (std::abs(theta) + std::hypot(1.0, theta));
          const double c = 1 / std::hypot(1.0, t), s = t * c;
          for (Index l = 0; l < n; ++l) rotate(H(l, p), H(l, q), c, s);
          for (Index l = 0; l < n; ++l) rotate(H(p, l), H(q, l), c, s);
          for (Index l = 0; l < n; ++l) rotate(vectors(l, p), vectors(l, q), c, s);
          H(p, q) = H(q, p) = 0;
        }
      if (!rotated) break;
    }
    values = H.diagonal();
  }

  Index smallest() const {
    Index at = 0;
    values.minCoeff(&at);
    return at;
  }
};

/// True only if v' X v < 0 for the eigenvector v that double believes in, evaluated in 50 digits with all their
/// rounding allowed for.
bool surely_indefinite(const Matrix<double>& X) {
  Matrix<double> H = symmetric_part(X);
  scale_to_one(H);
  const Spectrum spectrum(std::move(H));
  const Index smallest = spectrum.smallest();
  if (!(spectrum.values(smallest) < 0)) return false;
  using Number = Real<50>;
  const auto v = [&](Index i) { return Number(spectrum.vectors(i, smallest)); };
  Number sum = 0, size = 0, term;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) {
      term = Number(X(i, j)) * v(i) * v(j);
      sum += term;
      size += abs(term);
    }
  return sum < 0 && Number(-sum) > Number(size * 1e-40);
}

/// True only if X is nonsingular: ||I - Y X|| < 1 for some Y shows it. Its rounding is within (n + 2) u |Y| |X|, of
/// which twice as much is added; where products might overflow or underflow it does not try.
bool surely_nonsingular(const Matrix<double>& X) {
  const Index n = X.rows();
  Matrix<double> Y;
  if (!detail::invert(X, Y) || !all_finite(Y)) return false;
  const double large = std::max(X.cwiseAbs().maxCoeff(), Y.cwiseAbs().maxCoeff());
  if (large > 0x1p400) return false;
  double norm = 0;
  for (Index i = 0; i < n; ++i) {
    double row = 0;
    for (Index j = 0; j < n; ++j) {
      double sum = i == j ? 1 : 0, size = sum;
      for (Index l = 0; l < n; ++l) {
        sum -= Y(i, l) * X(l, j);
        size += std::abs(Y(i, l) * X(l, j));
      }
      row += std::abs(sum) + 2 * static_cast<double>(n + 2) * unit_roundoff<double>() * size;
    }
    norm = std::max(norm, row);
  }
  return norm < 0.5;
}

/// X = U T U' with T tridiagonal, by Householder reflections; only the diagonal and subdiagonal of T are kept.
template <class Number>
struct Tridiagonal {
  std::vector<Number> diagonal, subdiagonal;
};

template <class Number>
Tridiagonal<Number> tridiagonalise(Matrix<Number> X) {
  const Index n = X.rows();
  Tridiagonal<Number> T;
  Number scratch;
  for (Index k = 0; k + 1 < n; ++k) {
    T.diagonal.push_back(X(k, k));
    Number rest = 0;
    for (Index i = k + 2; i < n; ++i) detail::add_product(rest, X(i, k), X(i, k), scratch);
    if (rest == 0) {
      T.subdiagonal.push_back(X(k + 1, k));
      continue;
    }
    const Number norm = sqrt(Number(rest + X(k + 1, k) * X(k + 1, k)));
    const Number alpha = X(k + 1, k) > 0 ? Number(-norm) : norm;
    std::vector<Number> v(static_cast<std::size_t>(n)), w(static_cast<std::size_t>(n));
    const auto at = [](Index i) { return static_cast<std::size_t>(i); };
    for (Index i = k + 1; i < n; ++i) v[at(i)] = X(i, k);
    v[at(k + 1)] -= alpha;
    const Number beta = 2 / Number(rest + v[at(k + 1)] * v[at(k + 1)]);
    // X - v w' - w v' with w = beta X v - (beta^2 / 2) (v' X v) v
    Number half = 0;
    for (Index i = k + 1; i < n; ++i) {
      Number sum = 0;
      for (Index j = k + 1; j < n; ++j) detail::add_product(sum, X(i, j), v[at(j)], scratch);
      w[at(i)] = beta * sum;
      detail::add_product(half, w[at(i)], v[at(i)], scratch);
    }
    half *= beta / 2;
    for (Index i = k + 1; i < n; ++i) detail::subtract_product(w[at(i)], half, v[at(i)], scratch);
    for (Index j = k + 1; j < n; ++j)
      for (Index i = j; i < n; ++i) {
        detail::subtract_product(X(i, j), v[at(i)], w[at(j)], scratch);
        detail::subtract_product(X(i, j), w[at(i)], v[at(j)], scratch);
        X(j, i) = X(i, j);
      }
    T.subdiagonal.push_back(alpha);
  }
  T.diagonal.push_back(X(n - 1, n - 1));
  return T;
}

/// Whether T has an eigenvalue below x: Sturm's sequence meets a negative pivot.
template <class Number>
bool eigenvalue_below(const Tridiagonal<Number>& T, const Number& x, const Number& tiny) {
  Number pivot = T.diagonal[0] - x;
  for (std::size_t i = 1; i < T.diagonal.size(); ++i) {
    if (pivot < 0) return true;
    if (pivot == 0) pivot = tiny;
    pivot = T.diagonal[i] - x - T.subdiagonal[i - 1] * T.subdiagonal[i - 1] / pivot;
  }
  return pivot < 0;
}

/// |lambda_min| of the symmetric part of X, known to be not 0, of the given sign, and at most `bound`; by bisection,
/// first of its exponent, then of itself. Negative if it is below what Digits can resolve.
template <unsigned Digits, class Entry>
double smallest_magnitude(const Matrix<Entry>& X, int sign, double bound) {
  using Number = Real<Digits>;
  const Index n = X.rows();
  Matrix<Number> exact_X(n, n);
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i < n; ++i) exact_X(i, j) = (exact<Number>(X(i, j)) + exact<Number>(X(j, i))) / 2;
  const Number size = detail::frobenius(exact_X);
  const Number floor = size * detail::power_of_ten<Number>(15 - static_cast<int>(Digits));
  const Number tiny = size * detail::power_of_ten<Number>(-2 * static_cast<int>(Digits));
  const Tridiagonal<Number> T = tridiagonalise(exact_X);
  const auto reaches = [&](const Number& a) {
    return sign < 0 ? eigenvalue_below(T, Number(-a), tiny) : !eigenvalue_below(T, a, tiny);
  };
  if (!reaches(floor)) return -1;
  long low = mpfr_get_exp(floor.backend().data()) - 1, high = mpfr_get_exp(Number(bound).backend().data()) + 1;
  while (high - low > 1) {
    const long middle = low + (high - low) / 2;
    (reaches(Number(ldexp(Number(1), static_cast<int>(middle)))) ? low : high) = middle;
  }
  Number a = ldexp(Number(1), static_cast<int>(low)), b = ldexp(Number(1), static_cast<int>(high));
  for (int bit = 0; bit < 24; ++bit) {
    const Number middle = (a + b) / 2;
    (reaches(middle) ? a : b) = middle;
  }
  return round_to_double(Number((a + b) / 2));
}

/// 1 / ||S^{-1}||_2^2 for nonsingular lower S; negative if S is too ill-conditioned for Digits.
template <unsigned Digits>
double smallest_squared_singular_value(const Matrix<double>& S) {
  using Number = Real<Digits>;
  Matrix<Number> L = detail::zeros<Number>(S.rows(), S.cols());
  for (Index j = 0; j < S.cols(); ++j)
    for (Index i = j; i < S.rows(); ++i) L(i, j) = S(i, j);
  const Matrix<Number> inverse = detail::lower_inverse(L);
  const Number norm = detail::two_norm(inverse);
  // substitution is off by at most the condition number, in relative terms
  if (Number(detail::frobenius(L) * norm) > detail::power_of_ten<Number>(static_cast<int>(Digits) - 20)) return -1;
  return round_to_double(Number(1 / Number(norm * norm)));
}

/// X rounded to double, and whether that is X itself.
Matrix<double> as_double(const Matrix<Rounded>& X, bool& same) {
  Matrix<double> Y(X.rows(), X.cols());
  same = true;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) {
      Y(i, j) = static_cast<double>(X(i, j));
      same = same && mpfr_cmp_d(X(i, j).data(), Y(i, j)) == 0;
    }
  return Y;
}

/// Of X, which `nearly` is rounded to double.
template <unsigned Digits, class Number>
double smallest_eigenvalue_of(const Matrix<Number>& X, const Matrix<double>& nearly) {
  require_square(X, "smallest eigenvalue");
  if (X.rows() == 0) return std::numeric_limits<double>::infinity();
  if (!all_finite(nearly)) return std::numeric_limits<double>::quiet_NaN();
  Matrix<double> H = symmetric_part(nearly);
  const int exponent = scale_to_one(H);
  const Vector<double> eigenvalues = Spectrum(std::move(H)).values;
  const double smallest = eigenvalues.minCoeff();
  const double size = eigenvalues.cwiseAbs().maxCoeff();
  // Backward error of the solver, a modest multiple of n u ||X||, against three digits.
  const double doubt = 1e4 * static_cast<double>(X.rows() + 4) * unit_roundoff<double>() * size;
  if (std::abs(smallest) > doubt) return std::ldexp(smallest, exponent);

  int sign = 1;
  if (!is_positive_semidefinite(X))
    sign = -1;
  else if (!is_positive_definite(X))
    return 0;
  const double bound = std::max(std::ldexp(2 * doubt, exponent), std::numeric_limits<double>::min());
  double magnitude = smallest_magnitude<Digits>(X, sign, bound);
  if (magnitude < 0) magnitude = smallest_magnitude<800>(X, sign, bound);
  if (magnitude < 0) throw ReferenceError("smallest eigenvalue below 1e-785 of the largest: out of reach");
  return sign * magnitude;
}

}  // namespace

Signature signature(const Matrix<double>& X) {
  require_square(X, "signature");
  if (!all_finite(X)) throw ReferenceError("signature of a matrix that is not finite");
  return inertia(symmetric_integers(X), false);
}

bool is_positive_semidefinite(const Matrix<double>& X) {
  require_square(X, "definiteness");
  if (!all_finite(X)) return false;
  if (X.rows() == 0 || surely_positive_definite(X)) return true;
  if ((X.diagonal().array() < 0).any() || surely_indefinite(X)) return false;
  return inertia(symmetric_integers(X), true).negative == 0;
}

bool is_positive_definite(const Matrix<double>& X) {
  require_square(X, "definiteness");
  if (!all_finite(X)) return false;
  if (X.rows() == 0 || surely_positive_definite(X)) return true;
  if ((X.diagonal().array() <= 0).any() || surely_indefinite(X)) return false;
  return inertia(symmetric_integers(X), true).positive == X.rows();
}

bool is_positive_semidefinite(const Matrix<Rounded>& X) {
  require_square(X, "definiteness");
  if (!all_finite(X)) return false;
  bool same = true;
  const Matrix<double> nearly = as_double(X, same);
  if (same) return is_positive_semidefinite(nearly);
  return surely_positive_definite(nearly) || inertia(symmetric_integers(X), true).negative == 0;
}

bool is_positive_definite(const Matrix<Rounded>& X) {
  require_square(X, "definiteness");
  if (!all_finite(X)) return false;
  bool same = true;
  const Matrix<double> nearly = as_double(X, same);
  if (same) return is_positive_definite(nearly);
  return surely_positive_definite(nearly) || inertia(symmetric_integers(X), true).positive == X.rows();
}

double smallest_eigenvalue(const Matrix<double>& X) { return smallest_eigenvalue_of<50>(X, X); }

double smallest_eigenvalue(const Matrix<Rounded>& X) {
  bool same = true;
  const Matrix<double> nearly = as_double(X, same);
  return same ? smallest_eigenvalue(nearly) : smallest_eigenvalue_of<100>(X, nearly);
}

double smallest_eigenvalue_of_product(const Matrix<double>& S) {
  require_square(S, "smallest eigenvalue");
  if (S.rows() == 0) return std::numeric_limits<double>::infinity();
  if (!all_finite(Matrix<double>(S.triangularView<Eigen::Lower>()))) return std::numeric_limits<double>::quiet_NaN();
  if ((S.diagonal().array() == 0).any()) return 0;
  double value = smallest_squared_singular_value<50>(S);
  if (value < 0) value = smallest_squared_singular_value<800>(S);
  if (value < 0) throw ReferenceError("smallest eigenvalue of S S': k(S) above 1e780, out of reach");
  return value;
}

bool is_singular(const Matrix<double>& X) {
  require_square(X, "singularity");
  if (!all_finite(X)) throw ReferenceError("singularity of a matrix that is not finite");
  const Index n = X.rows();
  if (n == 0) return false;
  if (surely_nonsingular(X)) return false;
  std::vector<int> row_shift(static_cast<std::size_t>(n), 0), column_shift(static_cast<std::size_t>(n), 0);
  for (Index i = 0; i < n; ++i) {
    const double largest = X.row(i).cwiseAbs().maxCoeff();
    if (largest == 0) return true;
    row_shift[static_cast<std::size_t>(i)] = -std::ilogb(largest);
  }
  Integers Z = integers(X, row_shift, column_shift);
  Integer previous = 1, product;
  for (Index k = 0; k < n; ++k) {
    Index pivot = k;
    while (pivot < n && Z(pivot, k) == 0) ++pivot;
    if (pivot == n) return true;
    if (pivot != k)
      for (Index l = k; l < n; ++l) std::swap(Z(k, l), Z(pivot, l));
    for (Index i = k + 1; i < n; ++i)
      for (Index j = k + 1; j < n; ++j) {
        Z(i, j) *= Z(k, k);
        product = Z(i, k) * Z(k, j);
        Z(i, j) -= product;
        divide_exactly(Z(i, j), previous);
      }
    previous = Z(k, k);
  }
  return false;
}

double two_norm(const Matrix<double>& X) {
  if (X.size() == 0) return 0;
  if (!all_finite(X)) return std::numeric_limits<double>::quiet_NaN();
  Matrix<double> Y = X;
  const int exponent = scale_to_one(Y);
  if (Y.size() == 1) return std::abs(X(0, 0));
  const bool tall = Y.rows() > Y.cols();
  Matrix<double> gram =
      tall ? Matrix<double>(Y.transpose().lazyProduct(Y)) : Matrix<double>(Y.lazyProduct(Y.transpose()));
  return std::ldexp(std::sqrt(std::max(0.0, Spectrum(std::move(gram)).values.maxCoeff())), exponent);
}

}  // namespace kfstab::reference
