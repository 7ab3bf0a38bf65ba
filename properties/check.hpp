#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <kfstab/properties/generators.hpp>
#include <kfstab/properties/law.hpp>

/// The check of a filter: random systems, every law on each, the smallest system on which one fails.
namespace kfstab::properties {

struct CheckOptions {
  int cases = 200;
  std::uint64_t seed = 1986;
  std::vector<Law> laws = all_laws();
  /// What is drawn; made to fit what the subject needs.
  Options systems;
  /// Tried before anything is drawn, in this order: counter-examples of earlier checks.
  std::vector<System> replay;
  /// Seconds after which no new case is begun, shrinking included; 0 for as long as it takes.
  double budget = 0;
  /// How often a failing system may be made smaller, per law, counted in systems tried.
  int shrinking = 2000;
  std::function<void(int cases_done)> progress;
  std::function<bool()> interrupted;
};

/// A law that did not hold, where, and the smallest system on which it does not.
struct Failure {
  System system;
  Finding finding;          ///< on that system
  System drawn;             ///< as it was before it was made smaller
  int number = -1;          ///< which of the cases; -1 - i for replay[i]
  std::size_t shrinks = 0;  ///< how many times it was made smaller
  std::vector<std::string> irrelevant;  ///< what of the drawn system turned out not to matter, in words
};

struct LawOutcome {
  Law law;
  int cases = 0;  ///< to how many systems it applied
  double max_ratio = 0;
  std::optional<Failure> failure;
  bool holds() const { return !failure; }
};

struct CheckReport {
  Traits subject;
  std::uint64_t seed = 0;
  int asked = 0;                       ///< cases that were asked for
  int cases = 0;                       ///< that were tried
  std::int64_t steps = 0;              ///< the subject's, all in all
  std::vector<LawOutcome> laws;        ///< in the order of CheckOptions::laws
  std::map<std::string, int> classes;  ///< how many of the cases were of each class (generators.hpp)
  int not_sent = 0;                    ///< systems outside of what the subject needs
  int refused = 0;                     ///< systems that it declined although they are within
  std::map<std::string, int> reasons;  ///< what it said then, and how often
  double seconds = 0;
  bool interrupted = false, out_of_time = false;
  /// Runs for a diagnosis: some systems with what the subject answered.
  std::vector<Run> runs;
  /// Which laws did not hold on the systems of `runs`: of each run its indices into `laws`.
  std::vector<std::vector<std::size_t>> broken;

  bool passed() const;
};

/// Tries the subject. The same seed and cases try the same systems. Throws SubjectFault; what was found until then is in
/// `report`, which is filled as the check goes on.
void check(Subject& subject, const CheckOptions& options, CheckReport& report);
CheckReport check(Subject& subject, const CheckOptions& options = {});

/// What is drawn for a subject of these traits: `options` without what it does not take.
Options within(const Traits& traits, Options options);

}  // namespace kfstab::properties
