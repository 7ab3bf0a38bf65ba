#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <random>
#include <stdexcept>
#include <utility>
#include <vector>

#include <kfstab/filters/problem.hpp>
#include <kfstab/reference/high_precision.hpp>
#include <kfstab/reference/exact_filter.hpp>
#include <kfstab/reference/rational.hpp>
#include <kfstab/reference/trajectory.hpp>

/// What the tests of the reference share: systems with few bits, data from a list, and the exact filter's numbers
/// beside those of the trajectory.
namespace kfstab::reference::testing {

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

/// The same of exact numbers.
class ExactListedData final : public ExactData {
 public:
  explicit ExactListedData(std::vector<StepDataOf<Rational>> steps) : steps_(std::move(steps)) {}
  std::unique_ptr<DataStreamOf<Rational>> open() const override { return std::make_unique<Stream>(steps_); }

 private:
  class Stream final : public DataStreamOf<Rational> {
   public:
    explicit Stream(const std::vector<StepDataOf<Rational>>& steps) : steps_(&steps) {}
    const StepDataOf<Rational>& next() override { return steps_->at(at_++); }

   private:
    const std::vector<StepDataOf<Rational>>* steps_;
    std::size_t at_ = 0;
  };

  std::vector<StepDataOf<Rational>> steps_;
};

inline std::shared_ptr<ListedData> random_data(std::mt19937_64& random, Index p, Index inputs, int steps) {
  std::vector<StepData> list;
  for (int k = 0; k < steps; ++k) list.push_back({few_bits(random, p, 1), few_bits(random, inputs, 1)});
  return std::make_shared<ListedData>(std::move(list));
}

/// A model whose information form is exact: unit triangular matrices have exact inverses.
struct ExactInformation {
  Problem<InformationModel<double>> information;
  Problem<CovarianceModel<double>> covariance;
};

inline ExactInformation exact_information() {
  const Matrix<double> A = matrix(2, 2, {1, 0.5, 0, 1}), A_inverse = matrix(2, 2, {1, -0.5, 0, 1});
  const Matrix<double> B = matrix(2, 2, {0.25, 1, 0.5, -0.75});
  const Matrix<double> U = matrix(2, 2, {1, 3, 0, 2}), U_inverse = matrix(2, 2, {1, -1.5, 0, 0.5});
  ExactInformation both;
  InformationModel<double> information;
  information.A_inverse = A_inverse;
  information.A_inverse_B = A_inverse.lazyProduct(B);
  information.C = matrix(2, 2, {1, 0.25, 0.5, 2});
  information.D = matrix(2, 1, {0.5, 0.125});
  information.Q_inverse_root = U;
  information.R_inverse_root = matrix(2, 2, {4, 1, 0, 0.5});
  information.w_mean = Vector<double>(matrix(2, 1, {0.75, -0.5}));
  // Never read
  information.Q_inverse_root(1, 0) = information.R_inverse_root(1, 0) = std::numeric_limits<double>::quiet_NaN();
  both.information.models = {information};
  both.information.initial = U;
  both.information.x0 = Vector<double>(matrix(2, 1, {1, -2}));

  CovarianceModel<double> covariance;
  covariance.A = A;
  covariance.B = B;
  covariance.C = information.C;
  // B E w as one more known input
  covariance.D = Matrix<double>(2, 2);
  covariance.D.col(0) = information.D;
  covariance.D.col(1) = B.lazyProduct(information.w_mean);
  covariance.Q = product_of(U_inverse);
  const Matrix<double> R_root_inverse = matrix(2, 2, {0.25, -0.5, 0, 2});
  covariance.R = product_of(R_root_inverse);
  both.covariance.models = {covariance};
  both.covariance.initial = product_of(U_inverse);
  both.covariance.x0 = both.information.x0;
  return both;
}

// ---- rational numbers ----

/// A rational in 200 digits.
inline Wide wide(const Rational& q) { return Wide(numerator(q)) / Wide(denominator(q)); }

/// The nearest double.
inline double nearest(const Rational& q) { return round_to_double(wide(q)); }

/// ||sum - truth||_F / ||truth||_F of an expansion in doubles, in 200 digits.
inline Wide relative_distance(const std::vector<Matrix<double>>& sum, const Matrix<Rational>& truth) {
  Wide distance = 0, size = 0;
  for (Index j = 0; j < truth.cols(); ++j)
    for (Index i = 0; i < truth.rows(); ++i) {
      const Wide t = wide(truth(i, j));
      Wide d = -t;
      for (const auto& term : sum) d += term(i, j);
      distance += d * d;
      size += t * t;
    }
  if (distance == 0) return 0;
  return sqrt(Wide(distance / size));
}

/// What Trajectory and Enclosure call so; of rational ones, hence not the log-likelihood.
inline Matrix<Rational> exact_quantity(const ExactStep& step, Quantity quantity) {
  switch (quantity) {
    case Quantity::P_predicted: return step.P_predicted;
    case Quantity::P_filtered: return step.P_filtered;
    case Quantity::P_next: return step.P_next;
    case Quantity::innovation: return step.innovation;
    case Quantity::predictor_gain: return step.predictor_gain;
    case Quantity::filter_gain: return step.filter_gain;
    case Quantity::x_predicted: return step.x_predicted;
    case Quantity::x_filtered: return step.x_filtered;
    case Quantity::x_next: return step.x_next;
    case Quantity::log_likelihood: break;
  }
  throw std::logic_error("a log-likelihood is not rational");
}

/// What the step adds to it, in 200 digits.
inline Wide log_likelihood(const ExactStep& step) {
  const auto p = static_cast<int>(step.innovation.rows());
  return -Wide(p * log(Wide(8 * atan(Wide(1)))) + log(wide(step.innovation_determinant)) +
               wide(step.weighted_innovation)) /
         2;
}

inline constexpr Quantity rational_quantities[] = {
    Quantity::P_predicted,    Quantity::P_filtered,  Quantity::P_next,      Quantity::innovation,
    Quantity::predictor_gain, Quantity::filter_gain, Quantity::x_predicted, Quantity::x_filtered,
    Quantity::x_next};

/// 10^-digits
inline Wide to_digits(int digits) { return pow(Wide(10), -digits); }

}  // namespace kfstab::reference::testing
