#include <kfstab/properties/precise.hpp>

#include <algorithm>
#include <cassert>
#include <limits>
#include <vector>

#include <kfstab/reference/high_precision.hpp>

namespace kfstab::properties {

using Number = reference::Real<100>;

struct Precise::Numbers {
  Index rows, cols;
  std::vector<Number> entries;

  Numbers(Index r, Index c) : rows(r), cols(c), entries(static_cast<std::size_t>(r * c)) {}
  Number& operator()(Index i, Index j) { return entries[static_cast<std::size_t>(i * cols + j)]; }
  const Number& operator()(Index i, Index j) const { return entries[static_cast<std::size_t>(i * cols + j)]; }
};

namespace {

using Numbers = Precise::Numbers;

/// 10^-70 in bits: what may be left of a difference that is 0 but for the rounding of 100 digits.
constexpr long cancelled_bits = 233;

/// The binary exponent; very small for 0.
long exponent(const Number& x) {
  return x.is_zero() ? std::numeric_limits<long>::min() / 2 : mpfr_get_exp(x.backend().data());
}

/// x, and the size of the largest term that went into it: tells a zero from a difference that cancelled to rounding.
struct Scale {
  std::vector<long> exponents;

  explicit Scale(const Numbers& X) {
    exponents.reserve(X.entries.size());
    for (const Number& x : X.entries) exponents.push_back(exponent(x));
  }
};

Number one_norm(const Numbers& X) {
  Number largest = 0;
  for (Index j = 0; j < X.cols; ++j) {
    Number sum = 0;
    for (Index i = 0; i < X.rows; ++i) sum += abs(X(i, j));
    largest = std::max(largest, sum);
  }
  return largest;
}

}  // namespace

Precise::Precise(const Matrix<double>& X) {
  auto numbers = std::make_shared<Numbers>(X.rows(), X.cols());
  for (Index i = 0; i < X.rows(); ++i)
    for (Index j = 0; j < X.cols(); ++j) (*numbers)(i, j) = X(i, j);
  numbers_ = std::move(numbers);
}

Precise Precise::identity(Index n) { return Precise(Matrix<double>(Matrix<double>::Identity(n, n))); }

Index Precise::rows() const { return numbers_->rows; }
Index Precise::cols() const { return numbers_->cols; }

Matrix<double> Precise::rounded() const {
  Matrix<double> X(rows(), cols());
  for (Index i = 0; i < rows(); ++i)
    for (Index j = 0; j < cols(); ++j) X(i, j) = reference::round_to_double((*numbers_)(i, j));
  return X;
}

Precise Precise::transposed() const {
  auto result = std::make_shared<Numbers>(cols(), rows());
  for (Index i = 0; i < rows(); ++i)
    for (Index j = 0; j < cols(); ++j) (*result)(j, i) = (*numbers_)(i, j);
  return Precise(std::move(result));
}

Precise Precise::reversed() const {
  auto result = std::make_shared<Numbers>(*numbers_);
  std::reverse(result->entries.begin(), result->entries.end());
  return Precise(std::move(result));
}

Precise operator+(const Precise& X, const Precise& Y) {
  assert(X.rows() == Y.rows() && X.cols() == Y.cols());
  auto result = std::make_shared<Numbers>(*X.numbers_);
  for (std::size_t i = 0; i < result->entries.size(); ++i) result->entries[i] += Y.numbers_->entries[i];
  return Precise(std::move(result));
}

Precise operator-(const Precise& X, const Precise& Y) {
  assert(X.rows() == Y.rows() && X.cols() == Y.cols());
  auto result = std::make_shared<Numbers>(*X.numbers_);
  for (std::size_t i = 0; i < result->entries.size(); ++i) result->entries[i] -= Y.numbers_->entries[i];
  return Precise(std::move(result));
}

Precise operator*(const Precise& X, const Precise& Y) {
  assert(X.cols() == Y.rows());
  auto result = std::make_shared<Numbers>(X.rows(), Y.cols());
  for (Index i = 0; i < X.rows(); ++i)
    for (Index k = 0; k < X.cols(); ++k) {
      const Number& x = (*X.numbers_)(i, k);
      if (x.is_zero()) continue;
      for (Index j = 0; j < Y.cols(); ++j) (*result)(i, j) += x * (*Y.numbers_)(k, j);
    }
  return Precise(std::move(result));
}

Precise operator*(double factor, const Precise& X) {
  auto result = std::make_shared<Numbers>(*X.numbers_);
  for (Number& x : result->entries) x *= factor;
  return Precise(std::move(result));
}

Precise Precise::with_diagonal_raised(double relative) const {
  auto result = std::make_shared<Numbers>(*numbers_);
  for (Index i = 0; i < std::min(rows(), cols()); ++i) (*result)(i, i) += (*result)(i, i) * relative;
  return Precise(std::move(result));
}

std::optional<Precise> Precise::lower_root() const {
  assert(rows() == cols());
  const Index n = rows();
  Numbers rest = *numbers_;  // the Schur complement that is left, lower triangle
  Scale scale(rest);
  auto at = [n](Index i, Index j) { return static_cast<std::size_t>(i * n + j); };
  auto is_zero = [&](Index i, Index j) { return exponent(rest(i, j)) < scale.exponents[at(i, j)] - cancelled_bits; };

  auto L = std::make_shared<Numbers>(n, n);
  for (Index k = 0; k < n; ++k) {
    if (rest(k, k).is_zero() || is_zero(k, k)) {
      // A zero pivot of a semidefinite matrix has nothing below it.
      for (Index i = k + 1; i < n; ++i)
        if (!rest(i, k).is_zero() && !is_zero(i, k)) return std::nullopt;
      continue;
    }
    if (rest(k, k) < 0) return std::nullopt;
    (*L)(k, k) = sqrt(rest(k, k));
    for (Index i = k + 1; i < n; ++i)
      if (!rest(i, k).is_zero()) (*L)(i, k) = rest(i, k) / (*L)(k, k);
    for (Index i = k + 1; i < n; ++i) {
      if ((*L)(i, k).is_zero()) continue;
      for (Index j = k + 1; j <= i; ++j) {
        if ((*L)(j, k).is_zero()) continue;
        const Number term = (*L)(i, k) * (*L)(j, k);
        scale.exponents[at(i, j)] = std::max(scale.exponents[at(i, j)], exponent(term));
        rest(i, j) -= term;
      }
    }
  }
  return Precise(std::shared_ptr<const Numbers>(std::move(L)));
}

std::optional<Precise> Precise::inverse() const {
  assert(rows() == cols());
  const Index n = rows();
  // Gauss and Jordan with row pivoting, on [X I].
  Numbers X = *numbers_;
  Scale scale(X);
  auto at = [n](Index i, Index j) { return static_cast<std::size_t>(i * n + j); };
  auto result = std::make_shared<Numbers>(n, n);
  Numbers& Y = *result;
  for (Index i = 0; i < n; ++i) Y(i, i) = 1;

  for (Index k = 0; k < n; ++k) {
    Index pivot = -1;
    for (Index i = k; i < n; ++i) {
      const bool zero = X(i, k).is_zero() || exponent(X(i, k)) < scale.exponents[at(i, k)] - cancelled_bits;
      if (!zero && (pivot < 0 || abs(X(i, k)) > abs(X(pivot, k)))) pivot = i;
    }
    if (pivot < 0) return std::nullopt;
    if (pivot != k)
      for (Index j = 0; j < n; ++j) {
        std::swap(X(k, j), X(pivot, j));
        std::swap(Y(k, j), Y(pivot, j));
        std::swap(scale.exponents[at(k, j)], scale.exponents[at(pivot, j)]);
      }
    const Number reciprocal = 1 / X(k, k);
    for (Index j = k + 1; j < n; ++j) X(k, j) *= reciprocal;
    for (Index j = 0; j < n; ++j)
      if (!Y(k, j).is_zero()) Y(k, j) *= reciprocal;
    for (Index i = 0; i < n; ++i) {
      if (i == k || X(i, k).is_zero()) continue;
      const Number factor = X(i, k);
      for (Index j = k + 1; j < n; ++j) {
        if (X(k, j).is_zero()) continue;
        const Number term = factor * X(k, j);
        scale.exponents[at(i, j)] = std::max(scale.exponents[at(i, j)], exponent(term));
        X(i, j) -= term;
      }
      for (Index j = 0; j < n; ++j)
        if (!Y(k, j).is_zero()) Y(i, j) -= factor * Y(k, j);
    }
  }
  return Precise(std::shared_ptr<const Numbers>(std::move(result)));
}

bool Precise::has_zero_on_diagonal() const {
  for (Index i = 0; i < std::min(rows(), cols()); ++i)
    if ((*numbers_)(i, i).is_zero()) return true;
  return false;
}

double Precise::norm() const {
  Number sum = 0;
  for (const Number& x : numbers_->entries) sum += x * x;
  return sqrt(sum).convert_to<double>();
}

double Precise::condition() const {
  if (rows() == 0) return 1;
  const auto inverted = inverse();
  if (!inverted) return std::numeric_limits<double>::infinity();
  return Number(one_norm(*numbers_) * one_norm(*inverted->numbers_)).convert_to<double>();
}

}  // namespace kfstab::properties
