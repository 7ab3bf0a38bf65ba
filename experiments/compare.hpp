#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/run.hpp>
#include <kfstab/experiments/scan.hpp>

/// Filters side by side on somebody's own system, as it is and with something in it made to vary; and which to take.
/// docs/compare.md states the rules.
namespace kfstab::experiments {

/// Correct decimal digits of one quantity over a run: at its last step, and the fewest of all steps. Within 0 and what
/// the word holds; NaN where there is no such quantity.
struct Digits {
  double end = NaN;
  double worst = NaN;
};

/// How a filter fared in one run.
struct Fare {
  const Metadata* filter = nullptr;
  std::optional<std::string> refused;  ///< why it was not run; then there is nothing else
  Digits P, K, x;
  double bound = NaN;  ///< fewest digits of P that the first-order bound leaves
  double asymmetry = NaN;
  std::optional<std::int64_t> first_indefinite, first_failure;
  Status failure = Status::ok;
  std::string stopped;  ///< FilterRun::stopped

  /// Every step was done, and P was positive semidefinite after each.
  bool sound() const { return !refused && !first_failure && !first_indefinite; }
  /// The fewest digits of P and K, at any step; 0 where the filter is not sound. (x is left out: an estimate may pass
  /// through 0, and its relative error then says nothing.)
  double kept() const;
};

/// One point of the scans.
struct Point {
  std::vector<double> at;  ///< a value for each scan
  int bits = 53;
  bool done = false;
  std::optional<std::string> error;  ///< why the reference had no answer
  /// By how much an error is multiplied a step, on average over the run: ||F_k ... F_0||^{1/(k+1)}. Below 1 it is
  /// forgotten; it tends to rho(F) in steady state.
  double forgetting = NaN;
  std::vector<Fare> filters;  ///< in the order of Comparison::filters
};

struct Recommendation {
  const Metadata* filter = nullptr;    ///< null where none can be recommended
  std::vector<std::string> sentences;  ///< the recommendation, then its reasons
};

struct Comparison {
  SystemRun as_written;  ///< the system without scans, in double: all curves, and the time of a step
  Point base;            ///< the same, as a point
  std::vector<const Metadata*> filters;
  std::vector<Scan> scans;
  std::vector<Point> points;  ///< the last scan's values fastest
  double accurate = 3;        ///< digits of P and K from which a word counts as long enough
  bool interrupted = false;
  Recommendation recommendation;
};

struct CompareOptions {
  std::string system;  ///< as find_system takes it
  properties::Overrides overrides;
  std::vector<const Metadata*> filters;
  std::vector<Foreign*> foreign = {};  ///< those of the filters that are not of the registry
  std::vector<Scan> scans;             ///< two at most
  double accurate = 3;
  int jobs = 0;
  std::function<void(std::int64_t)> progress;  ///< called after so many more points
};

/// Throws InputError for scans that the system does not take: what is wrong with one is wrong at its ends.
void check_scans(const CompareOptions& options);

/// Runs every filter at every point, points in parallel. Stops early when interrupted(), and keeps the points done.
/// Throws InputError as check_scans, from the point where it shows.
Comparison compare(const CompareOptions& options);

/// What a run of so many bits comes to.
Fare fare(const FilterRun& run, int bits);

/// "d = 1e-7, R[0,0] = 0.5"; empty without scans.
std::string place(const Comparison& comparison, const Point& point);

/// Which filter to take, by the rules of docs/compare.md, from the numbers of the comparison alone.
Recommendation recommend(const Comparison& comparison);

/// The fewest bits of a scan of bits from which on a filter (its place in Comparison::filters) is sound and has
/// `accurate` digits at every point; nothing if it is not even with the most.
std::optional<int> fewest_bits(const Comparison& comparison, std::size_t filter);

}  // namespace kfstab::experiments
