#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include <Eigen/LU>

#include <kfstab/filters/joseph.hpp>
#include <kfstab/reference/detail/lockstep.hpp>

/// The reference with a fault. It stands before the right one, and passes on whatever the fault leaves alone.
namespace kfstab::damage {

using reference::Errors;
using reference::Quantity;
using reference::Truth;

class Reference : public reference::detail::Lockstep {
 public:
  explicit Reference(std::unique_ptr<Lockstep> right) : right_(std::move(right)) {}

  bool advance(const reference::detail::SourceData& data, const reference::Request& request) override {
    return right_->advance(data, request);
  }
  const std::string& why() const override { return right_->why(); }
  void round_into(Truth& truth) const override { right_->round_into(truth); }
  Errors measure(const Metadata& metadata, const Step<double>& step) const override {
    return right_->measure(metadata, step);
  }
  Errors measure(const Metadata& metadata, const Step<reference::Rounded>& step) const override {
    return right_->measure(metadata, step);
  }
  Matrix<double> entry_errors(const Metadata& metadata, const Step<double>& step) const override {
    return right_->entry_errors(metadata, step);
  }
  std::vector<Matrix<double>> expansion(Quantity quantity, int terms) const override {
    return right_->expansion(quantity, terms);
  }
  std::vector<std::vector<std::string>> decimals(Quantity quantity, int most_digits) const override {
    return right_->decimals(quantity, most_digits);
  }
  int certified_digits() const override { return right_->certified_digits(); }
  int certified_digits(Quantity quantity) const override { return right_->certified_digits(quantity); }
  int lower_digits() const override { return right_->lower_digits(); }
  int higher_digits() const override { return right_->higher_digits(); }

 private:
  std::unique_ptr<Lockstep> right_;
};

/// It forgets the angle between pre- and post-array.
class WithoutCosine final : public Reference {
 public:
  using Reference::Reference;
  void round_into(Truth& truth) const override {
    Reference::round_into(truth);
    truth.cosine = 1;
  }
};

/// P, the gains and the errors are those of Joseph's form in double; only the state, and what it is conditioned like,
/// remain right.
class InDouble final : public Reference {
 public:
  InDouble(std::unique_ptr<Lockstep> right, const reference::detail::Source& source)
      : Reference(std::move(right)), problem_(covariance_problem(source)), filter_(problem_.dimensions()) {
    filter_.start(problem_.initial, problem_.x0);
  }

  bool advance(const reference::detail::SourceData& data, const reference::Request& request) override {
    if (!Reference::advance(data, request)) return false;
    const auto& model = problem_.model(++k_);
    P_predicted_ = filter_.covariance();
    filter_.measurement_update(model);
    P_filtered_ = filter_.covariance();
    filter_.time_update(model);
    P_next_ = filter_.covariance();
    return true;
  }

  void round_into(Truth& truth) const override {
    Reference::round_into(truth);
    truth.P_predicted = P_predicted_;
    truth.P_filtered = P_filtered_;
    truth.P_next = P_next_;
    truth.filter_gain = filter_.filter_gain();
    truth.predictor_gain = problem_.model(k_).A * filter_.filter_gain();
  }

  Errors measure(const Metadata& metadata, const Step<double>& step) const override {
    Errors errors = Reference::measure(metadata, step);
    const auto& P = metadata.instant == Instant::filtered ? P_filtered_ : P_next_;
    if (step.held && metadata.holds != Held::gain && std::isfinite(errors.covariance)) {
      errors.covariance = (covariance(metadata.holds, *step.held) - P).norm() / P.norm();
      errors.correct_digits = std::clamp(-std::log10(errors.covariance), 0.0, 15.95);
    }
    if (step.gain && std::isfinite(errors.gain)) {
      const Matrix<double> Kf = filter_.filter_gain();
      const Matrix<double> K = metadata.gain == GainKind::predictor ? Matrix<double>(problem_.model(k_).A * Kf) : Kf;
      errors.gain = (*step.gain - K).norm() / K.norm();
    }
    return errors;
  }
  using Reference::measure;

 private:
  static Matrix<double> inverse_of_square(const Matrix<double>& upper_root) {
    const Matrix<double> T = upper_root.triangularView<Eigen::Upper>();
    return (T.transpose() * T).inverse();
  }
  static Matrix<double> square(const Matrix<double>& lower_root) {
    const Matrix<double> S = lower_root.triangularView<Eigen::Lower>();
    return S * S.transpose();
  }

  static CovarianceModel<double> covariance_model(const CovarianceModel<double>& model) { return model; }
  static CovarianceModel<double> covariance_model(const RootModel<double>& model) {
    return {{model.A, model.B, model.C, model.D}, square(model.Q_root), square(model.R_root)};
  }
  static CovarianceModel<double> covariance_model(const InformationModel<double>& model) {
    const Matrix<double> A = model.A_inverse.inverse();
    return {{A, A * model.A_inverse_B, model.C, model.D},
            inverse_of_square(model.Q_inverse_root),
            inverse_of_square(model.R_inverse_root)};
  }

  static Problem<CovarianceModel<double>> covariance_problem(const reference::detail::Source& source) {
    return std::visit(
        [](const auto& problem) {
          Problem<CovarianceModel<double>> to;
          for (const auto& model : problem.models) to.models.push_back(covariance_model(model));
          switch (std::decay_t<decltype(problem)>::Model::parametrisation) {
            case Parametrisation::covariance: to.initial = problem.initial; break;
            case Parametrisation::root: to.initial = square(problem.initial); break;
            case Parametrisation::information: to.initial = inverse_of_square(problem.initial); break;
          }
          to.x0 = problem.x0;
          return to;
        },
        *std::get<const AnyProblem<double>*>(source));
  }

  /// The P that is meant, in double.
  static Matrix<double> covariance(Held holds, const Matrix<double>& held) {
    switch (holds) {
      case Held::covariance_factor: return square(held);
      case Held::covariance_root: return held * held.transpose();
      case Held::ud_factors: {
        const Matrix<double> U = held.triangularView<Eigen::UnitUpper>();
        return U * held.diagonal().asDiagonal() * U.transpose();
      }
      case Held::information_factor: return inverse_of_square(held);
      case Held::information: return held.inverse();
      default: return held;
    }
  }

  Problem<CovarianceModel<double>> problem_;
  JosephFilter<double> filter_;
  std::int64_t k_ = -1;
  Matrix<double> P_predicted_, P_filtered_, P_next_;
};

}  // namespace kfstab::damage
