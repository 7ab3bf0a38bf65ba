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
  /// Whether it sends what is no system: a filter that dies of it breaks this law, and the check goes on.
  bool hostile = false;
  /// Nothing where the law does not apply to the system or to what the subject answers.
  std::optional<Finding> (*examine)(Bench& bench, const System& system);
};

/// One threshold for all laws, LAPACK's: constants of proportion are well below it, bugs far above.
inline constexpr double largest_ratio = 30;

/// Every law there is, in the order of their ids.
std::vector<Law> all_laws();

/// A matrix's entry in which `found` is furthest from `expected`: "P[1,0] = 2.5, expected -2.5 (off by 5)".
std::string largest_difference(std::string_view name, const Precise& found, const Precise& expected);

/// Below it the subject's arithmetic underflows, or nearly so: no rounding error is relative there.
double underflow(const Traits& subject);

/// How far below 0 the smallest eigenvalue of X's symmetric part lies. X is rounded to double: that costs u |X|, at most a
/// unit or two of a ratio.
double below_zero(const Precise& X);

/// The numbers that a subject is given, without rounding.
struct ExactModel {
  Precise A, B, C, Q, R, D;
};
struct ExactSystem {
  std::vector<ExactModel> models;  ///< of one period, as a Problem has them
  Precise P0, x0;
  const ExactModel& at(std::int64_t k) const { return models[static_cast<std::size_t>(k) % models.size()]; }
};

/// @param complete  with every measurement there
/// Nothing where the parametrisation does not apply.
std::optional<ExactSystem> exact_system(const System& complete, Parametrisation takes);

/// One step of a subject, as laws see it that are about one step: what it was given and what it answered, without rounding.
struct ObservedStep {
  const Traits& subject;
  Dimensions size;
  std::int64_t k;

  /// The model of the measurement that is part of the step, and of the time update that is: A, B and Q are those of step k,
  /// but of step k - 1 for a filter that starts predicted and answers P_{k|k} (it has none at k = 0).
  Precise A, B, C, Q, R;
  bool predicts;   ///< whether the step has a time update: not the first of such a filter
  Index measured;  ///< how many entries of y there are; a missing one has a row of 0 in C, a variance of its own, and is 0
  double missing_log_variance;  ///< the sum of the logarithms of these variances

  Precise before;                      ///< P as the step found it: P0, or the answer before
  Precise prior;                       ///< P_{k|k-1}: that, or A P A' + B Q B' of a filter that answers P_{k|k}
  Precise P;                           ///< the answer: P_{k+1|k} or P_{k|k}
  Precise Re;                          ///< R + C prior C'
  std::optional<Precise> information;  ///< P^{-1} as the filter holds it, Y or T'T
  std::optional<Precise> gain;         ///< as answered

  /// Of a run with data: x as the step found it, x_{k|k-1}, the answer, y_k; n x 1 and p x 1. Du: D u, of the time update.
  std::optional<Precise> x_before, x_prior, x, y, Du;
  double Du_terms = 0;  ///< |D| |u|: how large the terms of D u are, which may cancel
  std::optional<double> log_likelihood;  ///< as answered

  /// What the measurement makes of the prior; nothing if Re is not positive definite.
  struct Update {
    Precise Re_inverse;
    Precise Kf;  ///< P C' Re^{-1}
    Precise P;   ///< P_{k|k} = P - Kf C P
  };
  std::optional<Update> update;

  /// What the step's answer would be if P_{k|k} were X: A X A' + B Q B', or X itself.
  Precise after(const Precise& X) const;
  /// What the step's answer would be if x_{k|k} were z: A z + D u, or z itself.
  Precise state_after(const Precise& z) const;
  /// The gain that a filter of this kind has by the prior: A P C' Re^{-1} or P C' Re^{-1}. There must be an update.
  Precise exact_gain() const;
  /// What Joseph's form makes of the prior by a gain K of the kind that the filter answers, whether it is the best or not.
  Precise joseph(const Precise& K) const;
  bool answers_predicted() const { return subject.instant == Instant::predicted; }
  bool predictor_gain() const { return subject.gain.value_or(GainKind::predictor) == GainKind::predictor; }
  bool holds_information() const {
    return subject.holds == Held::information || subject.holds == Held::information_factor;
  }

  /// u (n + m + p), the size of a rounding error to be expected where nothing is ill-conditioned.
  double rounding() const { return subject.roundoff * static_cast<double>(size.n + size.m + size.p); }
  /// error / (u (n + m + p) kappa scale), what a law gives; nothing where numbers are so small that underflow decides.
  std::optional<double> ratio(double error, double kappa, double scale) const;
  /// The same of a difference, |found - expected| less what is allowed, with the words that tell it.
  std::optional<Finding> compare(std::string_view name, const Precise& found, const Precise& expected, double scale,
                                 double allowed = 0) const;
  /// X is to be positive semidefinite. scale counts as no less than |X|: X is rounded before its eigenvalues are looked for.
  std::optional<Finding> semidefinite(std::string_view name, const Precise& X, double scale, double allowed = 0) const;

  /// (|R| + |C|^2 |P|) |Re^{-1}|, Frobenius norms, P the prior: by how much an inverse of Re enlarges the error with which Re is
  /// formed. Not less than k(Re), and far more where C hardly sees what is large in P. Infinite if Re is singular.
  double innovation_condition() const { return amplified.innovation; }
  /// k(R^{1/2}) of a form that whitens the measurements, R^{-1/2} C and R^{-1/2} y, else 1.
  double whitening() const { return amplified.whitening; }
  /// How large the rounding error of the answered P may be for a filter of the subject's kind, theory 4, absolute, divided by
  /// u (n + m + p): of the forms that hold P, kappa (|A|^2 |P| + |B|^2 |Q| + |K| |C P A'|) with the condition above for kappa;
  /// of those that hold a root, 1 + kappa^{1/2} and no last term; of those that hold P^{-1}, what they lose of that, |P|^2 fold.
  double amplification() const { return amplified.P; }
  /// The same of the gain, of the kind that it answers: (|A| |Kf| r + (r a)^{1/2}) |Re^{-1}|, r = |R| + |C|^2 |P|, a =
  /// |A|^2 |P| + |B|^2 |Q| (|Kf| and |P| for a filter gain): residual over Re, theory 2; and |P| (n^{1/2} |Y| |Kf| + |C|
  /// |R^{-1}|) of an information filter, to which the error of its P_{k|k} adds. Whitening adds k(R^{1/2}) (|Kf| + |C| (|P_{k|k}|
  /// |Re^{-1}| + |Kf|^2)).
  double gain_amplification() const { return amplified.gain; }
  /// The same of the state: |A x| + |K| (|y| + |C| |x|) + |D| |u|, what rounding does to the terms, times the condition of its
  /// solution for x of a form that has P^{-1}, and the gain's error times the innovation.
  double state_amplification() const { return amplified.state; }
  /// By how much an asymmetry D of P changes the step, whatever the coding, to first order: theory (3.6), all terms of which
  /// are within 4 |A|^2 (1 + |Kf C|)^2 |D|.
  double asymmetric() const { return amplified.asymmetric; }
  /// Whether a bound of first order says anything: 30 u (n + m + p) kappa <= 1/2, so that Re as computed cannot be half of
  /// what it is, and an asymmetry of P that is not yet of second order.
  bool first_order() const { return amplified.first_order; }

  /// Fills in what follows from the rest.
  void complete();

  /// What complete() makes of the rest: the numbers above, state_gain that of the gain of x.
  struct Amplification {
    double innovation = 1, whitening = 1, P = 0, gain = 0, state_gain = 0, state = 0, asymmetric = 0;
    bool first_order = true;
  } amplified = {};
};

/// Looks at every step of the subject's run that it answered with a P; the worst ratio counts. Nothing if it applies to none.
std::optional<Finding> worst_step(Bench& bench, const System& system,
                                  const std::function<std::optional<Finding>(const ObservedStep&)>& examine);

/// The steps themselves; computed once. Valid until Bench::forget().
const std::vector<ObservedStep>& observed_steps(Bench& bench, const System& system);

/// What an asymmetry of P may have made of P up to each answer, absolute, of a filter that lets P lose its symmetry: theory
/// (3.6), as ObservedStep::asymmetric, carried on by F; with the asymmetry itself. As many as there are truths.
std::vector<double> asymmetric_errors(Bench& bench, const System& system);

/// A long run with data drawn from the system itself.
struct Simulation {
  System system;
  Matrix<double> x;  ///< the states, n x steps
};

/// For laws of the long run: 60 steps, of the systems for which they are cheap: time-invariant, n, m, p <= 2, p > 0.
/// Nothing for others.
std::optional<Simulation> long_run(const Traits& subject, const System& system);

/// The standardised innovations Re^{-1/2} (y - C x_{k|k-1}) of the subject's long run, by its own P and x. Nothing where there
/// is no such run, where it ends early, or where rounding might be seen in them.
std::optional<std::vector<Vector<double>>> long_run_innovations(Bench& bench, const System& system);

/// P of an answer, from a factor without rounding; nothing where it holds none, or an information matrix that is singular.
std::optional<Precise> covariance(const Answer& answer);

}  // namespace kfstab::properties
