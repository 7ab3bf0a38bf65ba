#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include <kfstab/filters/any_filter.hpp>
#include <kfstab/properties/precise.hpp>
#include <kfstab/properties/system.hpp>

/// Laws: what holds of every step of every correct filter, whatever the system, up to rounding. A law needs no reference
/// trajectory: it looks at one step, at what the filter held before it and after it, in 100 digits.
namespace kfstab::properties {

/// A step of a filter that holds P or S and predicts: P is P_{k|k-1} before it, P_plus P_{k+1|k} after it, of a root the
/// product SS' without rounding. P may be unsymmetric where the filter lets it be.
struct CovarianceStep {
  Precise A, B, C, Q, R;
  Precise P, P_plus;
  Precise gain;  ///< A P C' Re^{-1} or P C' Re^{-1}: filter.gain
  Precise Re;    ///< R + C P C'

  /// (|R| + |C|^2 |P|) |Re^{-1}|, Frobenius norms: by how much an inverse of Re enlarges the error with which Re is formed.
  /// Not less than k(Re), and far more where C hardly sees what is large in P. Infinite if Re is singular.
  double innovation_condition() const;
};

/// A step of a filter that holds Y = P_{k|k}^{-1}, or T, Y = T'T without rounding, and has the gain P_{k|k} C' R^{-1}. C and R are those of step k; A^{-1}
/// B and Q, and Y_before, are of step k - 1, and of no meaning at k = 0, where there is no time update.
struct InformationStep {
  Precise A_inverse, A_inverse_B, C, Q_inverse_root, R_inverse_root;
  Precise Y_before, Y;
  Precise gain;
};

/// One step as a law sees it.
struct ObservedStep {
  const Metadata& filter;
  Dimensions size;
  std::int64_t k;
  std::optional<CovarianceStep> covariance;
  std::optional<InformationStep> information;

  /// u (n + m + p), the size of a rounding error to be expected where nothing is ill-conditioned.
  double rounding() const {
    return unit_roundoff<double>() * static_cast<double>(size.n + size.m + size.p);
  }
  /// error / (u (n + m + p) kappa scale), what a law gives; nothing where numbers are so small that underflow decides.
  std::optional<double> ratio(double error, double kappa, double scale) const;
};

/// A law, one a file in properties/laws. CMake lists the files: laws/NAME.cpp defines Law NAME() in namespace laws.
struct Law {
  std::string_view id;           ///< as the command line knows it: "gain-innovation"
  std::string_view statement;    ///< in the notation of docs/theory.md
  std::string_view assumptions;  ///< where it applies
  std::string_view source;
  std::string_view tolerance;    ///< what the error is divided by, as a formula
  std::string_view failure;      ///< what a failure means, and where to look
  /// error / (u (n + m + p) kappa scale) of the step; nothing where the law does not apply. The law holds up to 30.
  std::optional<double> (*ratio)(const ObservedStep& step);
};

/// One threshold for all laws, LAPACK's: constants of proportion are well below it, bugs far above.
inline constexpr double largest_ratio = 30;

/// Every law there is.
std::vector<Law> all_laws();

/// How a law fared in a run.
struct LawResult {
  Law law;
  std::int64_t steps = 0;   ///< to how many steps it applied
  double worst = 0;         ///< the largest ratio; infinite where it was not a number
  std::int64_t worst_step = -1;

  bool holds() const { return worst <= largest_ratio; }
};

struct LawReport {
  std::vector<LawResult> results;  ///< in the order of all_laws()
  std::int64_t steps = 0;          ///< that were done
  Status status = Status::ok;      ///< if not ok: how the step after them failed, which ended the run

  bool all_hold() const;
};

/// Runs a filter over the steps of a problem, without data, and asks every law of every step. Breaking down is no
/// violation of a law: the report says that it happened.
LawReport check_laws(AnyFilter<double>& filter, const AnyProblem<double>& problem, std::int64_t steps);

/// The same for a filter of the registry; a report of no step if the filter does not apply to the system (refusal() says why).
/// Throws std::invalid_argument for an unknown id.
LawReport check_laws(std::string_view filter_id, const System& system);

}  // namespace kfstab::properties
