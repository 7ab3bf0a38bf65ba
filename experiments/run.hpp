#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/foreign.hpp>
#include <kfstab/experiments/series.hpp>
#include <kfstab/filters/any_filter.hpp>
#include <kfstab/filters/metadata.hpp>
#include <kfstab/filters/step_report.hpp>
#include <kfstab/properties/system.hpp>
#include <kfstab/reference/trajectory.hpp>

/// Filters and the reference stepping side by side through a system, measured at once: no run is held whole.
namespace kfstab::experiments {

/// How one filter fared.
struct FilterRun {
  const Metadata* metadata = nullptr;
  /// Why the filter was not run, in a sentence; then there is nothing else.
  std::optional<std::string> refused;

  // Over the steps k = 0, 1 ... (reference::Errors says what each is); those of P are empty where none is held.
  Series covariance_error;
  Series gain_error;
  Series state_error;  ///< empty in a run without data
  Series asymmetry;
  Series smallest_eigenvalue;
  Series bound;       ///< of covariance_error, to first order
  Series gain_bound;  ///< of gain_error

  /// Of P at the last step.
  double correct_digits = NaN;
  std::optional<std::int64_t> first_indefinite;  ///< first step at which P was not positive semidefinite
  std::optional<std::int64_t> first_failure;     ///< step that the filter could not do; it was not stepped on
  Status failure = Status::ok;
  std::string stopped;         ///< instead of a status, what a foreign filter said or did then, in words
  /// Of a step alone, in a loop without reference or measurements of error; NaN if it fails at once, and of a foreign filter.
  double seconds_per_step = 0;
};

/// What the system does to an error, over the steps: reference::ErrorAnalysis says what each is.
struct AnalysisRun {
  Series gamma, log10_amplification, innovation_condition, cosine;
  /// reference::InformationLoss, member by member; empty unless an information form was among those asked for.
  struct Information {
    Series A, Q_root, R_root, spread, inverse_cosine, T;
  } information;
};

struct SystemRun {
  std::string name, description, source;
  Dimensions dimensions;
  std::map<std::string, double> parameters;
  std::optional<std::uint64_t> seed;  ///< of simulated data
  std::int64_t steps_asked = 0;
  std::int64_t steps_done = 0;
  bool interrupted = false;
  /// The reference has no answer from some step on, and why.
  std::optional<std::string> reference_error;
  int trajectories = 0;      ///< of the reference: one for all filters whose problems are the same in exact numbers
  int certified_digits = 0;  ///< least over steps, quantities and trajectories
  int working_digits = 0;
  AnalysisRun analysis;
  std::vector<FilterRun> filters;
};

/// A filter of doubles that has done step k, and the truth about it: valid during the call.
struct Observation {
  std::int64_t k;
  const Metadata& metadata;
  const Step<double>& step;
  const reference::Errors& errors;
  const reference::Trajectory& truth;
};

/// How a step failed, as tables say it: the status, or "no_answer" of a foreign filter.
inline std::string_view failure_name(Status status, const std::string& stopped) {
  return stopped.empty() ? name(status) : "no_answer";
}

struct RunOptions {
  int digits = 30;  ///< to be certified; more where the filters have more bits
  /// Called after so many more steps.
  std::function<void(std::int64_t)> progress = {};
  /// Mantissa of the filters. With fewer than 53 bits the problem and the data are rounded first, and the reference starts
  /// from what the filter is given.
  int bits = 53;
  bool timed = true;  ///< measure seconds_per_step, of 53 bits
  /// Called after each step of each filter of 53 bits.
  std::function<void(const Observation&)> observe = {};
  /// Those of the filters that are not of the registry.
  std::vector<Foreign*> foreign = {};
};

/// Runs the filters (metadata of the registry, or of options.foreign) on the system; missing measurements as
/// properties::with_every_measurement has them, foreign filters not excepted. Stops early when interrupted() or when the reference has
/// no answer, and keeps what is done.
SystemRun run(const properties::System& system, const std::vector<const Metadata*>& filters, const RunOptions& options);

}  // namespace kfstab::experiments
