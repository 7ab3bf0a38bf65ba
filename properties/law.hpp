#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <kfstab/properties/bench.hpp>
#include <kfstab/properties/precise.hpp>

/// Laws: what holds of every correct filter, whatever the system, up to rounding.
namespace kfstab::properties {

/// How a law fared on a system.
struct Finding {
  /// error / (u (n + m + p) kappa scale), as the law's tolerance says: the law holds up to largest_ratio. 0 or infinite where
  /// a law is about bits. A NaN counts as infinite.
  double ratio = 0;
  std::int64_t step = -1;  ///< at which step that was; -1 where it is of none
  /// What was found and what was expected there, in numbers; may be empty where the law holds.
  std::string what;
};

/// A law, one a file in properties/laws. CMake lists the files: laws/NAME.cpp defines Law NAME() in namespace laws.
struct Law {
  std::string_view id;           ///< as the command line knows it: "gain-innovation"
  std::string_view statement;    ///< in the notation of docs/theory.md
  std::string_view assumptions;  ///< where it applies
  std::string_view source;
  std::string_view tolerance;  ///< what the error is divided by, as a formula
  std::string_view failure;    ///< what a failure means, and where to look
  /// Whether it asks what was true (the certified reference), or is content with the subject's own answers.
  bool reference = false;
  /// Nothing where the law does not apply to the system or to what the subject answers.
  std::optional<Finding> (*examine)(Bench& bench, const System& system);
};

/// One threshold for all laws, LAPACK's: constants of proportion are well below it, bugs far above.
inline constexpr double largest_ratio = 30;

/// Every law there is, in the order of their ids.
std::vector<Law> all_laws();

/// One step of a subject, as laws see it that are about one step: what it was given and what it answered, without rounding.
struct ObservedStep {
  const Traits& subject;
  Dimensions size;
  std::int64_t k;

  /// The model of the measurement that is part of the step, and of the time update that is: A, B and Q are those of step k,
  /// but of step k - 1 for a filter that starts predicted and answers P_{k|k} (it has none at k = 0).
  Precise A, B, C, Q, R;
  bool predicts;  ///< whether the step has a time update: not the first of such a filter

  Precise before;                      ///< P as the step found it: P0, or the answer before
  Precise prior;                       ///< P_{k|k-1}: that, or A P A' + B Q B' of a filter that answers P_{k|k}
  Precise P;                           ///< the answer: P_{k+1|k} or P_{k|k}
  Precise Re;                          ///< R + C prior C'
  std::optional<Precise> information;  ///< P^{-1} as the filter holds it, Y or T'T
  std::optional<Precise> gain;         ///< as answered

  /// Of a run with data: x as the step found it, x_{k|k-1}, the answer, y_k; n x 1 and p x 1. Du: D u, of the time update.
  std::optional<Precise> x_before, x_prior, x, y, Du;

  /// What the step's answer would be if P_{k|k} were X: A X A' + B Q B', or X itself.
  Precise after(const Precise& X) const;
  /// The gain as answered brought to P C' Re^{-1}; nothing where there is none, or a predictor gain and a singular A.
  bool answers_predicted() const { return subject.instant == Instant::predicted; }

  /// u (n + m + p), the size of a rounding error to be expected where nothing is ill-conditioned.
  double rounding() const { return subject.roundoff * static_cast<double>(size.n + size.m + size.p); }
  /// error / (u (n + m + p) kappa scale), what a law gives; nothing where numbers are so small that underflow decides.
  std::optional<double> ratio(double error, double kappa, double scale) const;

  /// (|R| + |C|^2 |P|) |Re^{-1}|, Frobenius norms, P the prior: by how much an inverse of Re enlarges the error with which Re is
  /// formed. Not less than k(Re), and far more where C hardly sees what is large in P. Infinite if Re is singular.
  double innovation_condition() const;
  /// How large the rounding error of the answered P may be for a filter of the subject's kind, theory 4, absolute, divided by
  /// u (n + m + p): of the forms that hold P, kappa (|A|^2 |P| + |B|^2 |Q| + |K| |C P A'|) with the condition above for kappa;
  /// of those that hold a root, 1 + kappa^{1/2} and no last term; of those that hold P^{-1}, what they lose of that, |P|^2 fold.
  double amplification() const;
};

/// Looks at every step of the subject's run that it answered with a P; the worst ratio counts. Nothing if it applies to none.
std::optional<Finding> worst_step(Bench& bench, const System& system,
                                  const std::function<std::optional<double>(const ObservedStep&)>& ratio);

/// The steps themselves.
std::vector<ObservedStep> observed_steps(Bench& bench, const System& system);

/// P of an answer, from a factor without rounding; nothing where it holds none, or an information matrix that is singular.
std::optional<Precise> covariance(const Answer& answer);

}  // namespace kfstab::properties
