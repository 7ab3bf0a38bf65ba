#pragma once

#include <cstdint>
#include <memory>
#include <random>
#include <utility>
#include <vector>



#include <kfstab/filters/problem.hpp>
#include <kfstab/reference/rational.hpp>

/// What the tests of the reference share: systems with few bits, data from a list, and an independent Riccati step in
/// rational numbers, by other formulas and without a rounding anywhere.
namespace kfstab::reference::testing {

using Rationals = std::vector<std::vector<Rational>>;
/// More digits than the reference needs for anything compared with it here.
using Wide = Real<200>;

inline Matrix<double> matrix(Index rows, Index cols, std::initializer_list<double> by_rows) {
  Matrix<double> X(rows, cols);
  auto entry = by_rows.begin();
  for (Index i = 0; i < rows; ++i)
    for (Index j = 0; j < cols; ++j) X(i, j) = *entry++;
  return X;
}

/// Entries are multiples of 1/16 within [-1, 1]: products of a few are exact in double.
inline Matrix<double> few_bits(std::mt19937_64& random, Index rows, Index cols) {
  Matrix<double> X(rows, cols);
  for (Index j = 0; j < cols; ++j)
    for (Index i = 0; i < rows; ++i) X(i, j) = static_cast<double>(static_cast<int>(random() % 33) - 16) / 16;
  return X;
}

/// Lower, with a diagonal within [1/2, 3/2].
inline Matrix<double> few_bits_root(std::mt19937_64& random, Index n) {
  Matrix<double> S = few_bits(random, n, n).triangularView<Eigen::StrictlyLower>();
  for (Index i = 0; i < n; ++i) S(i, i) = static_cast<double>(8 + random() % 17) / 16;
  return S;
}

/// S S', exact for few_bits_root.
inline Matrix<double> product_of(const Matrix<double>& S) { return S.lazyProduct(S.transpose()); }

inline RootModel<double> random_root_model(std::mt19937_64& random, Dimensions d) {
  RootModel<double> model;
  model.A = few_bits(random, d.n, d.n);
  model.B = few_bits(random, d.n, d.m);
  model.C = few_bits(random, d.p, d.n);
  model.D = few_bits(random, d.n, 1);
  model.Q_root = few_bits_root(random, d.m);
  model.R_root = few_bits_root(random, d.p);
  return model;
}

inline Problem<CovarianceModel<double>> as_covariance(const Problem<RootModel<double>>& root) {
  Problem<CovarianceModel<double>> problem;
  for (const auto& from : root.models) {
    CovarianceModel<double> to;
    to.A = from.A;
    to.B = from.B;
    to.C = from.C;
    to.D = from.D;
    to.Q = product_of(from.Q_root);
    to.R = product_of(from.R_root);
    problem.models.push_back(to);
  }
  problem.initial = product_of(root.initial);
  problem.x0 = root.x0;
  return problem;
}

class ListedData final : public Data {
 public:
  explicit ListedData(std::vector<StepData> steps) : steps_(std::move(steps)) {}
  std::unique_ptr<DataStream> open() const override {
    ++opened_;
    return std::make_unique<Stream>(steps_);
  }
  int opened() const { return opened_; }

 private:
  class Stream final : public DataStream {
   public:
    explicit Stream(const std::vector<StepData>& steps) : steps_(&steps) {}
    const StepData& next() override { return steps_->at(at_++); }

   private:
    const std::vector<StepData>* steps_;
    std::size_t at_ = 0;
  };

  std::vector<StepData> steps_;
  mutable int opened_ = 0;
};

inline std::shared_ptr<ListedData> random_data(std::mt19937_64& random, Index p, Index inputs, int steps) {
  std::vector<StepData> list;
  for (int k = 0; k < steps; ++k) list.push_back({few_bits(random, p, 1), few_bits(random, inputs, 1)});
  return std::make_shared<ListedData>(std::move(list));
}

// ---- rational numbers ----

inline Rationals rationals(const Matrix<double>& X) {
  Rationals Y(static_cast<std::size_t>(X.rows()), std::vector<Rational>(static_cast<std::size_t>(X.cols())));
  for (std::size_t i = 0; i < Y.size(); ++i)
    for (std::size_t j = 0; j < Y[i].size(); ++j) Y[i][j] = Rational(X(static_cast<Index>(i), static_cast<Index>(j)));
  return Y;
}

inline std::size_t columns(const Rationals& X) { return X.empty() ? 0 : X.front().size(); }

inline Rationals times(const Rationals& X, const Rationals& Y, std::size_t cols) {
  Rationals Z(X.size(), std::vector<Rational>(cols));
  for (std::size_t i = 0; i < X.size(); ++i)
    for (std::size_t j = 0; j < cols; ++j)
      for (std::size_t l = 0; l < Y.size(); ++l) Z[i][j] += X[i][l] * Y[l][j];
  return Z;
}
inline Rationals times(const Rationals& X, const Rationals& Y) { return times(X, Y, columns(Y)); }

inline Rationals plus(Rationals X, const Rationals& Y, const Rational& factor = 1) {
  for (std::size_t i = 0; i < X.size(); ++i)
    for (std::size_t j = 0; j < X[i].size(); ++j) X[i][j] += factor * Y[i][j];
  return X;
}

inline Rationals transposed(const Rationals& X, std::size_t cols) {
  Rationals Y(cols, std::vector<Rational>(X.size()));
  for (std::size_t i = 0; i < X.size(); ++i)
    for (std::size_t j = 0; j < cols; ++j) Y[j][i] = X[i][j];
  return Y;
}

inline Rationals inverse(Rationals X) {
  const std::size_t n = X.size();
  Rationals Y(n, std::vector<Rational>(n));
  for (std::size_t i = 0; i < n; ++i) Y[i][i] = 1;
  for (std::size_t k = 0; k < n; ++k) {
    std::size_t pivot = k;
    while (X.at(pivot)[k] == 0) ++pivot;
    std::swap(X[k], X[pivot]);
    std::swap(Y[k], Y[pivot]);
    const Rational d = X[k][k];
    for (std::size_t j = 0; j < n; ++j) {
      X[k][j] /= d;
      Y[k][j] /= d;
    }
    for (std::size_t i = 0; i < n; ++i) {
      if (i == k) continue;
      const Rational f = X[i][k];
      for (std::size_t j = 0; j < n; ++j) {
        X[i][j] -= f * X[k][j];
        Y[i][j] -= f * Y[k][j];
      }
    }
  }
  return Y;
}

/// The textbook recursion, P_{k|k} = P - P C' Re^{-1} C P, exact.
struct RationalFilter {
  Rationals P, x;  // predicted
  Rationals P_filtered, Re, K, Kf, x_filtered;

  void step(const CovarianceModel<double>& model, const Vector<double>& y, const Vector<double>& input) {
    const auto n = static_cast<std::size_t>(model.A.rows()), p = static_cast<std::size_t>(model.C.rows()),
               m = static_cast<std::size_t>(model.B.cols());
    const Rationals A = rationals(model.A), B = rationals(model.B), C = rationals(model.C);
    const Rationals PC = times(P, transposed(C, n), p);
    Re = plus(times(C, PC, p), rationals(model.R));
    Kf = times(PC, inverse(Re), p);
    K = times(A, Kf, p);
    P_filtered = plus(P, times(Kf, transposed(PC, p), n), -1);
    P = plus(times(times(A, P_filtered, n), transposed(A, n), n),
             times(times(B, rationals(model.Q), m), transposed(B, m), n));
    const Rationals innovation = plus(rationals(y), times(C, x, 1), -1);
    x_filtered = plus(x, times(Kf, innovation, 1));
    x = plus(times(A, x_filtered, 1), times(rationals(model.D), rationals(input), 1));
  }
};

/// A rational in 200 digits.
inline Wide wide(const Rational& q) { return Wide(numerator(q)) / Wide(denominator(q)); }

/// The nearest double.
inline double nearest(const Rational& q) { return round_to_double(wide(q)); }

/// ||sum - truth||_F / ||truth||_F of an expansion in doubles, in 200 digits.
inline Wide relative_distance(const std::vector<Matrix<double>>& sum, const Rationals& truth) {
  Wide distance = 0, size = 0;
  for (std::size_t i = 0; i < truth.size(); ++i)
    for (std::size_t j = 0; j < truth[i].size(); ++j) {
      const Wide t = wide(truth[i][j]);
      Wide d = -t;
      for (const auto& term : sum) d += term(static_cast<Index>(i), static_cast<Index>(j));
      distance += d * d;
      size += t * t;
    }
  if (distance == 0) return 0;
  return sqrt(Wide(distance / size));
}

/// 10^-digits
inline Wide to_digits(int digits) { return pow(Wide(10), -digits); }

}  // namespace kfstab::reference::testing
