#include <kfstab/experiments/run.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <ranges>
#include <variant>

#include <fmt/core.h>

#include <kfstab/experiments/interruption.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/data.hpp>
#include <kfstab/reference/bounds.hpp>
#include <kfstab/reference/error_analysis.hpp>
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

  const AnyProblem<double>* numbers() const { return std::get_if<AnyProblem<double>>(&problem); }
};

struct Runner {
  FilterRun result;
  Course* course = nullptr;
  std::unique_ptr<AnyFilter<double>> filter;
  std::optional<FirstOrderBound> bound;

  bool running() const { return filter && !result.first_failure; }
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
}

void measure(Runner& runner, std::int64_t k, const Vector<double>* y, const Vector<double>* u) {
  FilterRun& r = runner.result;
  const reference::Truth& truth = runner.course->truth->truth();
  const double bound = runner.bound->advance(truth);
  if (!runner.running()) return;
  const Step<double> step = runner.filter->step(k, y, u);
  if (!step.report) {
    r.first_failure = k;
    r.failure = step.report.status;
    return;
  }
  const Errors e = runner.course->truth->measure(*r.metadata, step);
  r.gain_error.add(k, e.gain);
  const double gain_bound = runner.bound->gain(truth, output_map(*runner.course->numbers(), k));
  if (!std::isnan(gain_bound)) r.gain_bound.add(k, gain_bound);
  if (y) r.state_error.add(k, e.state);
  if (!step.held) return;
  r.covariance_error.add(k, e.covariance);
  r.asymmetry.add(k, e.asymmetry);
  r.smallest_eigenvalue.add(k, e.smallest_eigenvalue);
  if (!std::isnan(bound)) r.bound.add(k, bound);
  r.correct_digits = e.correct_digits;
  if (!e.positive_semidefinite && !r.first_indefinite) r.first_indefinite = k;
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
  double best = std::numeric_limits<double>::quiet_NaN();
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

/// The truth about each course: one trajectory for all whose numbers are the same.
std::vector<std::unique_ptr<Trajectory>> trajectories(std::map<Parametrisation, Course>& courses,
                                                      const std::shared_ptr<const Data>& data, int digits) {
  std::vector<std::unique_ptr<Trajectory>> made;
  std::vector<const Course*> with_own;
  // That of an information problem first: it alone knows P^{-1}, and everything else as well.
  for (auto& [parametrisation, course] : courses | std::views::reverse) {
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

SystemRun run(const properties::System& system, const std::vector<const Metadata*>& filters,
              const RunOptions& options) {
  SystemRun result;
  result.name = system.name;
  result.description = system.description;
  result.source = system.source;
  result.dimensions = system.dimensions();
  result.parameters = system.parameters;
  result.steps_asked = system.steps;
  if (const auto* simulated = dynamic_cast<const properties::Simulated*>(system.data.get())) result.seed = simulated->seed();

  std::map<Parametrisation, Course> courses;
  std::vector<Runner> runners;
  for (const Metadata* metadata : filters) {
    Runner& runner = runners.emplace_back();
    runner.result.metadata = metadata;
    if (const auto refusal = properties::refusal(*metadata, system)) {
      runner.result.refused = refusal->reason;
      continue;
    }
    auto found = courses.find(metadata->takes);
    if (found == courses.end())
      found = courses.emplace(metadata->takes, Course{properties::problem(system, metadata->takes), {}}).first;
    runner.course = &found->second;
    if (!runner.course->numbers()) {
      runner.result.refused = std::get<properties::Refusal>(runner.course->problem).reason;
      continue;
    }
    runner.filter = make_filter<double>(metadata->id);
    runner.filter->start(*runner.course->numbers());
    runner.bound.emplace(*metadata, result.dimensions);
  }

  std::vector<std::unique_ptr<Trajectory>> truths;
  try {
    truths = trajectories(courses, system.data, options.digits);
    result.trajectories = static_cast<int>(truths.size());

    Feed feed(system.data);
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
        if (runner.filter) measure(runner, k, feed.y(), feed.u());
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
    if (runner.filter && !result.interrupted)
      runner.result.seconds_per_step =
          time_step(*runner.result.metadata, *runner.course->numbers(), system, result.steps_done);
    else
      runner.result.seconds_per_step = std::numeric_limits<double>::quiet_NaN();
    result.filters.push_back(std::move(runner.result));
  }
  return result;
}

}  // namespace kfstab::experiments
