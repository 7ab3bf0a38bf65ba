#pragma once

#include <string>

#include <kfstab/experiments/stored.hpp>
#include <kfstab/reports/document.hpp>

/// What changed between two stored results: of two runs, machines or versions.
namespace kfstab::experiments {

struct Difference {
  /// A section each for verdicts, checks or filters, what is new or gone, and the contexts.
  reports::Document document;
  /// A claim's verdict is worse than it was (confirmed, inconclusive, refuted, in this order), or a filter is refused,
  /// breaks down or loses definiteness where it did not, or earlier. How many digits are too many no criterion says:
  /// they are told and not judged.
  bool worse = false;
};

/// Numbers differ if they are not the same double. Times do not count.
/// Throws properties::InputError if one is a run and the other of claims.
Difference difference(const Stored& before, const Stored& after, const std::string& before_name,
                      const std::string& after_name);

}  // namespace kfstab::experiments
