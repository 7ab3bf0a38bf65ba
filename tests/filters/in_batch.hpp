#pragma once

#include <limits>
#include <memory>
#include <string>
#include <string_view>

#include <kfstab/filters/batch.hpp>
#include <kfstab/filters/instances.hpp>

/// Batch as a filter of the registry, so that whatever is said of a filter can be said of one in a batch: laws, claims.
namespace kfstab::test {

/// One filter of a batch. Its neighbours start from other scales; one is given data that are not finite, and one has a singular
/// Re, or starts without information, so that these fail in all steps, or in some.
template <class Filter>
class InBatch {
 public:
  using Scalar = double;
  using Model = typename Filter::Model;
  static constexpr bool information = Batch<Filter>::information;

  explicit InBatch(Dimensions d)
      : batch_(count, d), alone_(d), held_(Matrix<double>::Zero(d.n, d.n)), gain_(Matrix<double>::Zero(d.n, d.p)),
        x_(Vector<double>::Zero(d.n)), Du_(Vector<double>::Zero(d.n)) {}

  void start(const Matrix<double>& initial, const Vector<double>& x0) {
    alone_.start(initial, x0);
    start_all(initial, x0);
  }

  StepReport<double> step(const Model& model, const Vector<double>* y, const Vector<double>* input, Wanted wanted = Wanted::all)
    requires(!information)
  {
    for (Index i = 0; i < count; ++i) batch_.set_model(i, i == singular ? without_R(model) : model);
    return step_all(model.D, y, input, wanted);
  }
  StepReport<double> step(const Model& model, const Model& next, const Vector<double>* y, const Vector<double>* input)
    requires(information)
  {
    for (Index i = 0; i < count; ++i) batch_.set_model(i, model, next);
    return step_all(model.D, y, input, Wanted::all);
  }
  /// A batch begins with step, and so this is done by one filter alone.
  StepReport<double> measurement_update(const Model& model, const Vector<double>* y) requires(information) {
    const auto report = alone_.measurement_update(model, y);
    start_all(alone_.information_factor(), alone_.state());
    gain_ = alone_.filter_gain();
    return report;
  }

  const Matrix<double>& covariance() const requires(Batch<Filter>::conventional) { return held_; }
  const Matrix<double>& factor() const requires(Batch<Filter>::covariance_root) { return held_; }
  const Matrix<double>& information_factor() const requires(information) { return held_; }
  const Matrix<double>& predictor_gain() const requires(Batch<Filter>::covariance_root) { return gain_; }
  const Matrix<double>& filter_gain() const requires(!Batch<Filter>::covariance_root) { return gain_; }
  const Vector<double>& state() const { return x_; }
  Matrix<double> innovation_root() const requires(Batch<Filter>::covariance_root) { return batch_.innovation_root(mine); }

 private:
  static constexpr Index count = 19, mine = 10, singular = 8, not_finite = 13;  // mine: in no first lane or group

  static Model without_R(Model model) {
    model.C.setZero();
    if constexpr (Batch<Filter>::conventional) model.R.setZero();
    else if constexpr (!information) model.R_root.setZero();
    return model;
  }

  void start_all(const Matrix<double>& initial, const Vector<double>& x0) {
    for (Index i = 0; i < count; ++i) {
      const double scale = i == mine ? 1 : information && i == singular ? 0 : 1 + static_cast<double>(i);
      batch_.start(i, Matrix<double>(scale * initial), x0);
    }
    look();
  }

  StepReport<double> step_all(const Matrix<double>& D, const Vector<double>* y, const Vector<double>* input, Wanted wanted) {
    if (y) {
      if (input) Du_ = D * *input;
      const Vector<double> rubbish = Vector<double>::Constant(y->size(), std::numeric_limits<double>::quiet_NaN());
      for (Index i = 0; i < count; ++i) batch_.set_data(i, i == not_finite ? rubbish : *y, input ? &Du_ : nullptr);
    }
    batch_.step(y != nullptr, wanted);
    look();
    return batch_.report(mine);
  }

  void look() {
    held_ = batch_.held(mine);
    gain_ = batch_.gain(mine);
    x_ = batch_.state(mine);
  }

  Batch<Filter> batch_;
  Filter alone_;
  Matrix<double> held_, gain_;
  Vector<double> x_, Du_;
};

/// ckf, srcf or srif, in a batch; null for the others, of which there are none.
inline std::unique_ptr<AnyFilter<double>> in_batch(std::string_view id) {
  const Metadata& metadata = *find_filter(id);
  if (id == "ckf") return std::make_unique<FilterOf<InBatch<ConventionalFilter<double>>>>(metadata);
  if (id == "srcf") return std::make_unique<FilterOf<InBatch<SquareRootCovarianceFilter<double>>>>(metadata);
  if (id == "srif") return std::make_unique<FilterOf<InBatch<SquareRootInformationFilter<double>>>>(metadata);
  return nullptr;
}

}  // namespace kfstab::test
