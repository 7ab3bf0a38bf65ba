#include <kfstab/experiments/run.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <type_traits>
#include <variant>

#include <fmt/core.h>

#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/data.hpp>
#include <kfstab/reference/bounds.hpp>
#include <kfstab/reference/error_analysis.hpp>
#include <kfstab/reference/rounded.hpp>
#include <kfstab/reference/same_numbers.hpp>
#include <kfstab/reference/trajectory.hpp>

namespace kfstab::experiments {
namespace {

using reference::Errors;
using reference::FirstOrderBound;
using reference::Trajectory;

/// The numbers of one parametrisation, and the truth about them: shared by all filters that take it.
struct Course {
  std::variant<AnyProblem<double>, properties::Refusal> problem;
  Trajectory* truth = nullptr;

  Course(const properties::System& system, Parametrisation form, int bits)
      : problem(properties::problem(system, form)) {
    if (auto* found = std::get_if<AnyProblem<double>>(&problem)) *found = reference::rounded(*found, bits);
  }
  const AnyProblem<double>* numbers() const { return std::get_if<AnyProblem<double>>(&problem); }
};

struct Runner {
  FilterRun result;
  Course* course = nullptr;
  Foreign* foreign = nullptr;  ///< if it is not of the registry
  /// One of the two: of doubles, or of another number of bits.
  std::unique_ptr<AnyFilter<double>> filter;
  std::unique_ptr<reference::RoundedFilter> rounded;
  std::optional<FirstOrderBound> bound;  ///< there if the filter is

  void start(int bits, Dimensions dimensions) {
    const Metadata& metadata = *result.metadata;
    if (bits == bits_of_double) {
      filter = foreign ? foreign->make() : make_filter<double>(metadata.id);
      filter->start(*course->numbers());
    } else {
      rounded = std::make_unique<reference::RoundedFilter>(metadata, bits);
      rounded->start(*course->numbers());
    }
    bound.emplace(metadata, dimensions, foreign ? foreign->roundoff() : std::ldexp(1, -bits));
  }
  void stop(std::int64_t k, const std::string& why) {
    result.first_failure = k;
    result.stopped = why;
  }
  void stop(std::int64_t k, const properties::SubjectFault& fault) {
    stop(k, std::string(fault.what()));
    foreign->give_up(fault);
  }
  bool running() const { return bound && !result.first_failure; }
};

/// The data of a run, one step at a time: what every filter is given.
class Feed {
 public:
  explicit Feed(const std::shared_ptr<const Data>& data) : stream_(data ? data->open() : nullptr) {}
  void next() {
    if (stream_) current_ = &stream_->next();
  }
  const Vector<double>* y() const { return current_ ? &current_->y : nullptr; }
  const Vector<double>* u() const { return current_ && current_->u.size() > 0 ? &current_->u : nullptr; }

 private:
  std::unique_ptr<DataStream> stream_;
  const StepData* current_ = nullptr;
};

const Matrix<double>& output_map(const AnyProblem<double>& problem, std::int64_t k) {
  return std::visit([k](const auto& p) -> const Matrix<double>& { return p.model(k).C; }, problem);
}

void add(AnalysisRun& run, std::int64_t k, const reference::ErrorAnalysis& analysis) {
  run.gamma.add(k, analysis.gamma());
  run.log10_amplification.add(k, analysis.log10_amplification());
  run.innovation_condition.add(k, analysis.innovation_condition());
  run.cosine.add(k, analysis.cosine());
  const reference::InformationLoss& loss = analysis.information_loss();
  if (std::isnan(loss.T)) return;
  run.information.A.add(k, loss.A);
  run.information.Q_root.add(k, loss.Q_root);
  run.information.R_root.add(k, loss.R_root);
  run.information.spread.add(k, loss.spread);
  run.information.inverse_cosine.add(k, loss.inverse_cosine);
  run.information.T.add(k, loss.T);
}

template <class Scalar>
void record(Runner& runner, std::int64_t k, const Step<Scalar>& step, double bound, bool with_data,
            const RunOptions& options) {
  FilterRun& r = runner.result;
  if (!step.report) {
    r.first_failure = k;
    r.failure = step.report.status;
    return;
  }
  const Trajectory& truth = *runner.course->truth;
  const Errors e = truth.measure(*r.metadata, step);
  if (step.gain) {
    r.gain_error.add(k, e.gain);
    const double gain_bound = runner.bound->gain(truth.truth(), output_map(*runner.course->numbers(), k));
    if (!std::isnan(gain_bound)) r.gain_bound.add(k, gain_bound);
  }
  if (with_data) r.state_error.add(k, e.state);
  if constexpr (std::is_same_v<Scalar, double>)
    if (options.observe) options.observe({k, *r.metadata, step, e, truth});
  if (!step.held) return;
  r.covariance_error.add(k, e.covariance);
  r.asymmetry.add(k, e.asymmetry);
  r.smallest_eigenvalue.add(k, e.smallest_eigenvalue);
  if (!std::isnan(bound)) r.bound.add(k, bound);
  r.correct_digits = e.correct_digits;
  if (!e.positive_semidefinite && !r.first_indefinite) r.first_indefinite = k;
}

void measure(Runner& runner, std::int64_t k, const Vector<double>* y, const Vector<double>* u,
             const RunOptions& options) {
  const double bound = runner.bound->advance(runner.course->truth->truth());
  if (!runner.running()) return;
  if (runner.rounded) return record(runner, k, runner.rounded->step(k, y, u), bound, y, options);
  try {
    record(runner, k, runner.filter->step(k, y, u), bound, y, options);
  } catch (const ForeignStop& why) {
    runner.stop(k, std::string(why.what()));
  } catch (const properties::SubjectFault& why) {
    runner.stop(k, why);
  }
}

/// Times a filter alone, over at most a thousand steps, repeated until they took ten milliseconds.
double time_step(const Metadata& metadata, const AnyProblem<double>& problem, const properties::System& system,
                 std::int64_t steps) {
  const std::int64_t length = std::min<std::int64_t>(steps, 1000);
  std::vector<StepData> data;
  Feed feed(system.data);
  for (std::int64_t k = 0; k < length; ++k) {
    feed.next();
    if (feed.y()) data.push_back({*feed.y(), feed.u() ? *feed.u() : Vector<double>()});
  }
  const auto filter = make_filter<double>(metadata.id);
  using clock = std::chrono::steady_clock;
  double best = NaN;
  clock::duration spent{};
  for (int round = 0; round < 100 && spent < std::chrono::milliseconds(10); ++round) {
    filter->start(problem);
    std::int64_t done = 0;
    const auto begin = clock::now();
    for (; done < length; ++done) {
      const StepData* d = data.empty() ? nullptr : &data[static_cast<std::size_t>(done)];
      if (!filter->step(done, d ? &d->y : nullptr, d && d->u.size() > 0 ? &d->u : nullptr).report) break;
    }
    const auto took = clock::now() - begin;
    spent += took;
    if (done == 0) return best;
    const double seconds = std::chrono::duration<double>(took).count() / static_cast<double>(done);
    if (!(seconds >= best)) best = seconds;
  }
  return best;
}

/// What has to be certified to judge numbers of so many bits: all their digits, and ten more.
int digits_for(int bits) { return static_cast<int>(std::ceil(bits * std::log10(2.0))) + 10; }

/// The truth about each course: one trajectory for all whose numbers are the same.
std::vector<std::unique_ptr<Trajectory>> trajectories(std::map<Parametrisation, Course>& courses,
                                                      const std::shared_ptr<const Data>& data, int digits) {
  std::vector<std::unique_ptr<Trajectory>> made;
  std::vector<const Course*> with_own;
  // That of an information problem first: it alone knows P^{-1}, and everything else as well.
  for (auto of = courses.rbegin(); of != courses.rend(); ++of) {
    Course& course = of->second;
    if (!course.numbers()) continue;
    const auto same = std::ranges::find_if(
        with_own, [&](const Course* other) { return reference::same_numbers(*course.numbers(), *other->numbers()); });
    if (same == with_own.end()) {
      made.push_back(std::make_unique<Trajectory>(*course.numbers(), data, reference::Request{.digits = digits}));
      with_own.push_back(&course);
      course.truth = made.back().get();
    } else {
      course.truth = (*same)->truth;
    }
  }
  return made;
}

}  // namespace

SystemRun run(const properties::System& asked, const std::vector<const Metadata*>& filters, const RunOptions& options) {
  const properties::System system = properties::with_every_measurement(asked);
  SystemRun result;
  result.name = system.name;
  result.description = system.description;
  result.source = system.source;
  result.dimensions = system.dimensions();
  result.parameters = system.parameters;
  result.steps_asked = system.steps;
  if (const auto* simulated = dynamic_cast<const properties::Simulated*>(system.data.get()))
    result.seed = simulated->seed();

  const auto data = reference::rounded(system.data, options.bits);
  std::map<Parametrisation, Course> courses;
  std::vector<Runner> runners;
  for (const Metadata* metadata : filters) {
    Runner& runner = runners.emplace_back();
    runner.result.metadata = metadata;
    const auto foreign =
        std::ranges::find_if(options.foreign, [&](const Foreign* f) { return &f->metadata() == metadata; });
    if (foreign != options.foreign.end()) runner.foreign = *foreign;
    const auto refusal = runner.foreign ? runner.foreign->refusal(asked) : properties::refusal(*metadata, asked);
    if (refusal) {
      runner.result.refused = refusal->reason;
      continue;
    }
    if (runner.foreign && options.bits != bits_of_double) {
      runner.result.refused =
          fmt::format("{} computes in words of its own, not of {} bits", metadata->id, options.bits);
      continue;
    }
    auto found = courses.find(metadata->takes);
    if (found == courses.end())
      found = courses.emplace(metadata->takes, Course(system, metadata->takes, options.bits)).first;
    runner.course = &found->second;
    if (!runner.course->numbers()) {
      runner.result.refused = std::get<properties::Refusal>(runner.course->problem).reason;
      continue;
    }
    try {
      runner.start(options.bits, result.dimensions);
    } catch (const ForeignStop& why) {
      runner.result.refused = fmt::format("{} {}", metadata->id, why.what());
    } catch (const properties::SubjectFault& why) {
      runner.stop(0, why);
    }
  }

  std::vector<std::unique_ptr<Trajectory>> truths;
  try {
    truths = trajectories(courses, data, std::max(options.digits, digits_for(options.bits)));
    result.trajectories = static_cast<int>(truths.size());

    Feed feed(data);
    reference::ErrorAnalysis analysis;
    for (std::int64_t k = 0; k < system.steps; ++k) {
      if (interrupted()) {
        result.interrupted = true;
        break;
      }
      for (const auto& truth : truths) truth->advance();
      // The parametrisations differ by roundings of their numbers: one of them speaks for all.
      if (!truths.empty()) {
        analysis.advance(truths.front()->truth());
        add(result.analysis, k, analysis);
      }
      feed.next();
      for (Runner& runner : runners)
        if (runner.bound) measure(runner, k, feed.y(), feed.u(), options);
      result.steps_done = k + 1;
      if (options.progress) options.progress(1);
    }
  } catch (const reference::ReferenceError& error) {
    result.reference_error = error.what();
  }

  bool first = true;
  for (const auto& truth : truths)
    if (truth->k() >= 0) {
      const int certified = truth->certified_digits();
      result.certified_digits = first ? certified : std::min(result.certified_digits, certified);
      result.working_digits = std::max(result.working_digits, truth->working_digits());
      first = false;
    }
  for (Runner& runner : runners) {
    if (runner.filter && !runner.foreign && options.timed && !result.interrupted)
      runner.result.seconds_per_step =
          time_step(*runner.result.metadata, *runner.course->numbers(), system, result.steps_done);
    else
      runner.result.seconds_per_step = NaN;
    result.filters.push_back(std::move(runner.result));
  }
  return result;
}

}  // namespace kfstab::experiments
