#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <kfstab/experiments/fit.hpp>
#include <kfstab/reports/document.hpp>

/// A claim of the literature as an experiment. Each is one file in claims/, which defines one function that returns its
/// Claim; CMake makes the table.
namespace kfstab::experiments {

/// A number that a claim can be run with, by `--set name=value`.
struct Parameter {
  std::string name;
  double value;  ///< what it is unless set
  std::string meaning;
  double least, most;  ///< what it may be set to, both included
  std::optional<double> quick = {};  ///< what it is unless set under --quick; else `value`
};

/// The values that a run of a claim uses. A claim's prediction follows them.
class Settings {
 public:
  Settings() = default;
  explicit Settings(std::map<std::string, double> values) : values_(std::move(values)) {}
  /// The value of a parameter that the claim has declared.
  double operator()(const std::string& name) const { return values_.at(name); }
  const std::map<std::string, double>& values() const { return values_; }

 private:
  std::map<std::string, double> values_;
};

/// What a claim measured: numbers beside their predictions, and the figures that show them.
struct Findings {
  std::vector<reports::Check> checks;
  std::vector<reports::Figure> figures;
};

struct Claim {
  std::string id;         ///< "asymmetry-growth"
  int number;             ///< in the ledger of docs/theory.md: 3 for C3
  std::string title;
  std::string statement;  ///< what is claimed, in a sentence or two
  std::string source;
  std::string setup;      ///< systems, filters, what is varied
  std::string prediction; ///< what should be seen, and from which equation
  std::string meaning;    ///< for somebody who chooses a filter
  std::vector<Parameter> parameters;
  std::function<Findings(const Settings&)> measure;
  std::string mathematics = {};  ///< the equations behind the prediction, one a line, as reports/mathml.hpp reads them
};

/// A claim that was run.
struct ClaimResult {
  Claim claim;
  Settings settings;
  Findings findings;
  double seconds = 0;

  /// Computed from the checks: refuted if one fails; inconclusive if one could not be measured, or there is none;
  /// else confirmed.
  reports::Verdict verdict() const;
};

/// All claims, in the order of the ledger.
std::vector<Claim> all_claims();

/// At what size a claim is measured: as it is, or in a fraction of the time, with fewer frames and steps.
enum class Effort { full, quick };

/// A claim's own parameters out of `set`, and the defaults for the others. Throws properties::InputError for a value out of
/// range.
Settings settings_of(const Claim& claim, const std::map<std::string, double>& set, Effort effort = Effort::full);

/// Runs a claim with settings_of(claim, set, effort). Throws Interrupted: a claim that was cut short is not judged.
ClaimResult run_claim(const Claim& claim, const std::map<std::string, double>& set, Effort effort = Effort::full);

/// Runs claims, `jobs` at once (0: one a core), and gives the results in their order. done is called after each, from
/// any thread. Those that were not finished when interrupted() became true are left out.
std::vector<ClaimResult> run_claims(const std::vector<Claim>& claims, const std::map<std::string, double>& set,
                                    Effort effort, int jobs, const std::function<void()>& done);

/// How a claim fared with the seeds 1, 2 ... : how often each check held.
struct Stability {
  struct Held {
    std::string check;
    int times = 0;  ///< of `runs`, or fewer where it is not part of every run
  };
  Claim claim;
  int runs = 0;       ///< 1 for a claim that draws nothing
  int confirmed = 0;  ///< verdicts
  std::vector<Held> checks;
};

/// Runs each claim that has a parameter "seed" with the seeds 1 ... seeds, the others once. Otherwise as run_claims;
/// what was not finished is left out of the counts.
std::vector<Stability> run_seeds(const std::vector<Claim>& claims, const std::map<std::string, double>& set,
                                 Effort effort, int jobs, int seeds, const std::function<void()>& done);

/// A check that a measured value lies within a relative tolerance of the predicted one. Not finite: does not hold.
reports::Check check_close(std::string name, double predicted, double measured, double relative);
/// A check that a measured value lies within an absolute distance of the predicted one.
reports::Check check_within(std::string name, double predicted, double measured, double distance);
/// A check that a slope lies within a distance of the predicted one. Where its 95 % confidence interval reaches further
/// than that distance to either side, the points do not determine it, and it was not measured (NaN).
reports::Check check_slope(std::string name, double predicted, const Line& line, double distance);
/// The same of a growth factor, within a relative distance.
reports::Check check_growth(std::string name, double predicted, const Growth& growth, double relative);
/// A check that a measured value is at most, or at least, a limit.
reports::Check check_at_most(std::string name, double limit, double measured, std::string reason);
reports::Check check_at_least(std::string name, double limit, double measured, std::string reason);

}  // namespace kfstab::experiments
