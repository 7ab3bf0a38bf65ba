#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include <kfstab/properties/system.hpp>

/// The reference's trajectory of a system as text, for others to test against.
namespace kfstab::experiments {

struct ReferenceRequest {
  int digits = 30;    ///< to be certified, and no more are written
  std::string cache;  ///< folder of a StepCache; none if empty
  /// Called after so many more steps.
  std::function<void(std::int64_t)> progress;
};

struct ReferenceOutcome {
  std::int64_t steps = 0;  ///< done
  bool interrupted = false;
  /// The reference has no answer at step `steps`, and why.
  std::optional<std::string> error;
  /// The cache could not be written, and why; the steps are as good.
  std::optional<std::string> warning;
};

/// Computes the steps of the system's exact numbers and hands on each, in order, as an object of kfstab.reference/1 in one
/// line of JSON (docs/results.md). One step is held at a time. What the cache knows is not computed again; what is
/// finished without an error goes into it. Stops early when interrupted(). What take throws goes through.
/// Throws reports::FileError if the cache's folder cannot be made.
ReferenceOutcome reference_steps(const properties::System& system, const ReferenceRequest& request,
                                 const std::function<void(std::string_view)>& take);

}  // namespace kfstab::experiments
