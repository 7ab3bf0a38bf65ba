#include <kfstab/properties/subject.hpp>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <kfstab/filters/registry.hpp>

namespace kfstab::properties {

namespace {

/// The steps of a system's data, or steps without any.
class Feed {
 public:
  explicit Feed(const Data* data) : stream_(data ? data->open() : nullptr) {}

  void next() { step_ = stream_ ? &stream_->next() : nullptr; }
  const Vector<double>* y() const { return step_ ? &step_->y : nullptr; }
  const Vector<double>* u() const { return step_ && step_->u.size() > 0 ? &step_->u : nullptr; }

 private:
  std::unique_ptr<DataStream> stream_;
  const StepData* step_ = nullptr;
};

// --- the registry's door ------------------------------------------------------------------------------------------------

class BuiltIn final : public Subject {
 public:
  explicit BuiltIn(std::unique_ptr<AnyFilter<double>> filter)
      : filter_(std::move(filter)), traits_(filter_->metadata()) {}

  const Traits& traits() const override { return traits_; }

  Ending run(const System& system, const std::function<bool(std::int64_t, const Answer&)>& each) override {
    if (const auto why = refusal(traits_, system)) return {Ending::Kind::refused, -1, why->reason};
    if (measurements_missing(system)) return run_complete(with_every_measurement(system), each);
    return run_complete(system, each);
  }

 private:
  Ending run_complete(const System& system, const std::function<bool(std::int64_t, const Answer&)>& each) {
    const auto converted = problem(system, traits_.takes);
    if (const auto* why = std::get_if<Refusal>(&converted)) return {Ending::Kind::refused, -1, why->reason};
    filter_->start(std::get<AnyProblem<double>>(converted));
    Feed feed(system.data.get());
    Answer answer;
    answer.holds = traits_.holds;
    for (std::int64_t k = 0; k < system.steps; ++k) {
      feed.next();
      const Step<double> step = filter_->step(k, feed.y(), feed.u());
      if (!step.report) return {Ending::Kind::refused, k, kfstab::name(step.report.status)};
      if (step.held) answer.held = *step.held;
      if (step.gain) answer.gain = *step.gain;
      if (step.state) answer.state = *step.state;
      if (!each(k, answer)) break;
    }
    return {};
  }

  std::unique_ptr<AnyFilter<double>> filter_;
  Traits traits_;
};

// --- filters that are driven step by step -------------------------------------------------------------------------------

std::string shape(const char* what, Index rows, Index cols, Index expected_rows, Index expected_cols) {
  return fmt::format("{} is {} x {}, expected {} x {}", what, rows, cols, expected_rows, expected_cols);
}

/// What is wrong with an answer, or nothing.
std::optional<std::string> wrong(const Answer& answer, const Traits& traits, Index n, Index p) {
  if (answer.holds != Held::gain) {
    const char* name = holds_root(answer.holds) ? "S" : "P";
    if (answer.held.rows() != n || answer.held.cols() != n)
      return shape(name, answer.held.rows(), answer.held.cols(), n, n);
    if (!answer.held.allFinite()) return fmt::format("{} holds a NaN or an infinity", name);
  }
  if (answer.state) {
    if (answer.state->size() != n) return fmt::format("x has {} entries, expected {}", answer.state->size(), n);
    if (!answer.state->allFinite()) return "x holds a NaN or an infinity";
  }
  if (answer.gain && traits.gain) {
    if (answer.gain->rows() != n || answer.gain->cols() != p)
      return shape("K", answer.gain->rows(), answer.gain->cols(), n, p);
    if (!answer.gain->allFinite()) return "K holds a NaN or an infinity";
  }
  if (answer.log_likelihood && !std::isfinite(*answer.log_likelihood)) return "loglik is not finite";
  return std::nullopt;
}

class SteppedSubject final : public Subject {
 public:
  explicit SteppedSubject(std::unique_ptr<StepwiseFilter> filter) : filter_(std::move(filter)) {}

  const Traits& traits() const override { return filter_->traits(); }

  Ending run(const System& system, const std::function<bool(std::int64_t, const Answer&)>& each) override {
    if (const auto why = refusal(traits(), system)) return {Ending::Kind::refused, -1, why->reason};
    const auto converted = problem(system, Parametrisation::covariance);
    if (const auto* why = std::get_if<Refusal>(&converted)) return {Ending::Kind::refused, -1, why->reason};
    const auto& numbers = std::get<Problem<CovarianceModel<double>>>(std::get<AnyProblem<double>>(converted));
    if (auto ended = filter_->start(numbers.dimensions(), numbers.x0, numbers.initial)) {
      ended->step = -1;
      return *std::move(ended);
    }
    // Without data each y is what a filter expects least to matter.
    const Vector<double> no_y = Vector<double>::Zero(system.C.rows());
    Feed feed(system.data.get());
    for (std::int64_t k = 0; k < system.steps; ++k) {
      feed.next();
      auto stepped = step(numbers.model(k), feed.y() ? *feed.y() : no_y, feed.u());
      if (auto* ended = std::get_if<Ending>(&stepped)) {
        ended->step = k;
        return std::move(*ended);
      }
      if (!each(k, std::get<Answer>(stepped))) break;
    }
    return {};
  }

 private:
  std::variant<Answer, Ending> step(const CovarianceModel<double>& model, const Vector<double>& y,
                                    const Vector<double>* u) {
    const Matrix<double>* D = u ? &model.D : nullptr;
    // With no entry left there is no measurement; C and R are sent all the same.
    const bool none = y.size() == 0 || y.array().isNaN().all();
    if (none || !y.hasNaN())
      return checked(filter_->step({model.A, model.B, model.C, model.Q, model.R, D, u, none ? nullptr : &y}),
                     model.A.rows(), model.C.rows(), none);
    const Measured measured(model.C, model.R, y);
    auto answer = checked(filter_->step({model.A, model.B, measured.C, model.Q, measured.R, D, u, &measured.y}),
                          model.A.rows(), measured.C.rows(), false);
    if (auto* given = std::get_if<Answer>(&answer); given && given->gain) given->gain = measured.of_all(*given->gain);
    return answer;
  }

  std::variant<Answer, Ending> checked(std::variant<Answer, Ending> stepped, Index n, Index p,
                                       bool no_measurement) const {
    auto* answer = std::get_if<Answer>(&stepped);
    if (!answer) return stepped;
    // A gain means nothing where nothing was measured, whatever its shape.
    if (no_measurement) answer->gain.reset();
    if (auto why = wrong(*answer, traits(), n, p)) return Ending{Ending::Kind::no_answer, -1, *std::move(why)};
    return stepped;
  }

  std::unique_ptr<StepwiseFilter> filter_;
};

}  // namespace

// A filter that remembers its model cannot be told that a row of C is gone.
Traits::Traits(const Metadata& metadata)
    : name(metadata.id), instant(metadata.instant), gain(metadata.gain), needs(metadata.needs),
      measurement_every_step(metadata.needs.time_invariant), takes(metadata.takes), holds(metadata.holds),
      asymmetry(metadata.asymmetry) {}

std::vector<Run> Subject::run_all(const std::vector<System>& systems) {
  std::vector<Run> runs;
  for (const System& system : systems) {
    Run& is = runs.emplace_back(Run{system, {}, {}});
    is.ending = run(system, [&](std::int64_t, const Answer& answer) {
      is.answers.push_back(answer);
      return true;
    });
  }
  return runs;
}

std::unique_ptr<Subject> subject(std::unique_ptr<StepwiseFilter> filter) {
  return std::make_unique<SteppedSubject>(std::move(filter));
}

std::unique_ptr<Subject> built_in(std::string_view id) { return built_in(make_filter<double>(id)); }

std::unique_ptr<Subject> built_in(std::unique_ptr<AnyFilter<double>> filter) {
  return std::make_unique<BuiltIn>(std::move(filter));
}

std::optional<Refusal> refusal(const Traits& traits, const System& system) {
  Metadata needs;
  needs.id = traits.name;
  needs.needs = traits.needs;
  if (auto why = refusal(needs, system)) return why;
  if (traits.measurement_every_step && measurements_missing(system))
    return Refusal{traits.name + " needs a measurement at every step: some are missing"};
  return std::nullopt;
}

}  // namespace kfstab::properties
