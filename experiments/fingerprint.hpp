#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <kfstab/experiments/fit.hpp>
#include <kfstab/filters/metadata.hpp>
#include <kfstab/properties/subject.hpp>

/// The stability fingerprint of a filter: how it loses digits where theory says that digits are lost, and which filter of the
/// registry does the same. Not whether it is right (properties/check.hpp), but of what kind it is.
namespace kfstab::experiments {

/// A filter on systems of growing difficulty, all of them exact in double whatever a filter takes: P0, Q and R have exact
/// roots.
struct Climb {
  std::string_view id{};          ///< kebab-case: "innovation"
  std::string_view difficulty{};  ///< what grows from rung to rung, in words
  std::string_view symbol{};      ///< the same in the notation of docs/theory.md: "k(Re^1/2)"
  std::string_view theory{};      ///< the equation that says what is lost
  std::vector<double> at{};       ///< the difficulty of each rung
  /// Of each rung the median over its systems of the worst relative error over the steps; infinite where it broke down, NaN
  /// where it answers none. Of the ladder "graded", P is |ln det P^ - ln det P|.
  std::vector<double> P{}, K{};
  /// Digits lost per decade of difficulty, where the errors are well above rounding and well below 1; of fewer than three
  /// such errors there is no slope (NaN): nothing to speak of is lost, or all at once.
  Line P_slope{}, K_slope{};
  /// The least difficulty at which, in half of the systems, P was not positive semidefinite after some step, and at which
  /// the filter broke down.
  std::optional<double> indefinite{}, broken{};
  /// Why it was not climbed to the end: what the filter said.
  std::optional<std::string> refused{};
};

/// What becomes of the asymmetry that rounding makes, in a long run.
struct AsymmetryRun {
  std::string_view id{};        ///< "one-output", "two-outputs"
  double product = 0;           ///< |l1 l2| of A
  std::vector<double> curve{};  ///< ||P^ - P^'|| / (2 ||P||) after each step; empty for a filter that shows no P
  /// Per step; 1 of an asymmetry that does not grow, 0 where there is none: P is symmetric to the last bit. NaN without P,
  /// and where it is not rounding that makes P asymmetric.
  double growth = 0;
};

/// A filter of the registry, and how far from it the subject is: in decades of error, the mean over all that both have.
struct Neighbour {
  const Metadata* filter;
  double distance;
};

struct Fingerprint {
  properties::Traits subject;
  /// The largest relative error of P, K and x on ordinary systems, the median over them.
  double ordinary_error = 0;
  /// u of its arithmetic: 2^-53 times how much larger that error is than what is typical of the registry's filters. Not
  /// below 2^-53: its answers are doubles.
  double roundoff = 0;
  /// Whether every number that it answered is one of single precision.
  bool answers_floats = false;
  std::vector<Climb> climbs;
  std::vector<AsymmetryRun> asymmetries;
  /// The filters of the registry that show as much as the subject, the nearest first; empty where its answers are wrong.
  std::vector<Neighbour> neighbours;
  std::int64_t steps = 0;  ///< the subject's
  double seconds = 0;

  /// "double", "single" or "half" by u, to within six bits (four of half); "wrong" where not even two digits are right on
  /// ordinary systems; else "other".
  std::string_view precision() const;
  /// The nearest, and those that are as near to within half as much again. None if even the nearest is half a decade away.
  std::vector<const Metadata*> alike() const;

  /// By their ids.
  const Climb& climb(std::string_view ladder) const;
  const AsymmetryRun& asymmetry(std::string_view run) const;
};

/// Runs the subject over the ladders, about a thousand steps, and places it among the filters of the registry, which are
/// measured by the same code at the first call (some tenths of a second). Nothing if `stop` said so between two systems. Throws
/// properties::SubjectFault; but where a filter dies on a ladder, there it has broken down.
std::optional<Fingerprint> fingerprint(properties::Subject& subject, const std::function<bool()>& stop = {});

/// The fingerprint of each filter of the registry, in its order, without neighbours.
const std::vector<Fingerprint>& registry_fingerprints();
/// That of the filter with this id.
const Fingerprint& registry_fingerprint(std::string_view id);

/// In a sentence: "behaves like ckf-gain: loses two digits per decade of k(Re^1/2) (srcf would lose one), its asymmetry grows
/// by |l1 l2| = 1.10 a step, definiteness is lost at d = 3.8e-06".
std::string sentence(const Fingerprint& fingerprint);

}  // namespace kfstab::experiments
