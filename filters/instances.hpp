#pragma once

#include <stdexcept>
#include <string>

#include <kfstab/filters/kernels.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/filters/registry_headers.inc>

/// Makes every filter of the registry for a scalar of one's own. In one source file per scalar:
///
///     #include <kfstab/filters/instances.hpp>
///     template std::unique_ptr<kfstab::AnyFilter<float>> kfstab::make_filter<float>(std::string_view);
///
/// It compiles all of them: some seconds a scalar, more for high precision. Double stands in the library.
namespace kfstab {

/// Drives one filter class by the loop of AnyFilter.
template <class Filter>
class FilterOf final : public AnyFilter<typename Filter::Scalar> {
  using Scalar = typename Filter::Scalar;
  using Model = typename Filter::Model;

 public:
  explicit FilterOf(const Metadata& metadata) : metadata_(metadata), filter_(Dimensions{}) {}

  const Metadata& metadata() const override { return metadata_; }

  void start(const AnyProblem<Scalar>& problem) override {
    problem_ = std::get_if<Problem<Model>>(&problem);
    if (!problem_)
      throw std::invalid_argument(std::string(metadata_.id) + ": the problem is in another parametrisation");
    filter_ = Filter(problem_->dimensions());
    filter_.start(problem_->initial, problem_->x0);
    if constexpr (Model::parametrisation == Parametrisation::information) {
      previous_u_ = current_u_ = Vector<Scalar>::Zero(problem_->models.front().D.cols());
      current_step_ = -1;
    }
  }

  Step<Scalar> step(std::int64_t k, const Vector<Scalar>* y, const Vector<Scalar>* u) override {
    Step<Scalar> step;
    if constexpr (Model::parametrisation == Parametrisation::information) {
      // Its step k takes u_{k-1}; a step that is called again after it failed takes the same one again.
      if (k != current_step_) previous_u_.swap(current_u_);
      current_step_ = k;
      if (u) current_u_ = *u;
      if (u && !all_finite(*u))
        step.report = {Status::non_finite_input, Scalar(0)};
      else if (k == 0)
        step.report = filter_.measurement_update(problem_->model(0), y);
      else
        step.report = filter_.step(problem_->model(k - 1), problem_->model(k), y, u ? &previous_u_ : nullptr);
    } else {
      step.report = filter_.step(problem_->model(k), y, u);
    }
    step.held = held();
    if (metadata_.gain == GainKind::predictor) {
      if constexpr (requires { filter_.predictor_gain(); }) step.gain = &filter_.predictor_gain();
    } else {
      if constexpr (requires { filter_.filter_gain(); }) step.gain = &filter_.filter_gain();
    }
    if (y) step.state = &filter_.state();
    return step;
  }

 private:
  /// What a class holds is what it has a name for. A condensed form makes it of what it has, O(n^3), when somebody looks.
  Shown<Scalar> held() {
    if constexpr (requires { filter_.condensed_factor(); })
      return {[](void* filter) -> const Matrix<Scalar>& {
                if constexpr (requires(Filter& f) { f.factor(); }) return static_cast<Filter*>(filter)->factor();
                else return static_cast<Filter*>(filter)->information_factor();
              },
              &filter_};
    else if constexpr (requires { filter_.covariance(); }) return &filter_.covariance();
    else if constexpr (requires { filter_.factor(); }) return &filter_.factor();
    else if constexpr (requires { filter_.covariance_root(); }) return &filter_.covariance_root();
    else if constexpr (requires { filter_.ud_factors(); }) return &filter_.ud_factors();
    else if constexpr (requires { filter_.information_factor(); }) return &filter_.information_factor();
    else if constexpr (requires { filter_.information(); }) return &filter_.information();
    else return nullptr;
  }

  const Metadata& metadata_;
  const Problem<Model>* problem_ = nullptr;
  Filter filter_;
  Vector<Scalar> previous_u_, current_u_;
  std::int64_t current_step_ = -1;
};

template <class Scalar>
std::unique_ptr<AnyFilter<Scalar>> make_filter(std::string_view id) {
  kernels::check_environment();
  const Metadata* metadata = find_filter(id);
  auto next = filters().begin();
#define KFSTAB_FILTER(header, Filter, ...)                                \
  if (metadata == &*next++) return std::make_unique<FilterOf<Filter<Scalar>>>(*metadata);
#include <kfstab/filters/registry.inc>
#undef KFSTAB_FILTER
  throw std::invalid_argument("no filter is called '" + std::string(id) + "'");
}

}  // namespace kfstab
