#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include <kfstab/filters/step_report.hpp>
#include <kfstab/properties/system.hpp>
#include <kfstab/reference/trajectory.hpp>

/// The errors of filters over the steps of a system: run() without its bounds, series and timing, for claims that draw
/// systems by the hundred.
namespace kfstab::experiments {

/// How one filter fared, step by step.
struct Trace {
  std::vector<reference::Errors> errors;  ///< after each step that it did
  Status end = Status::ok;                ///< of the step that it could not do; there is none after it

  /// The largest over the steps from `first` on; infinite if it was NaN at one of them, or the filter broke down.
  double worst(double reference::Errors::*error, std::size_t first = 0) const;
  /// Whether some P was not positive semidefinite, or the filter broke down.
  bool lost_definiteness() const;
};

/// Steps the filters of those ids and the reference through the system. Throws std::logic_error for a filter that does
/// not apply: a claim's own system; ReferenceError where there is no truth.
std::map<std::string, Trace> traces(const properties::System& system, const std::vector<std::string>& ids);

/// The ids of the filters that are selected, in the registry's order.
std::vector<std::string> filter_ids(const std::function<bool(const Metadata&)>& selects);

}  // namespace kfstab::experiments
