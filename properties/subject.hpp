#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <kfstab/filters/any_filter.hpp>
#include <kfstab/properties/data.hpp>
#include <kfstab/properties/system.hpp>

/// Filters under check: the one interface through which the check engine, run and compare see a filter, ours or foreign.
/// What is behind it is a door: the registry, a C++ type, a shared library, a program that speaks protocol 1.
namespace kfstab::properties {

/// What a filter says of itself (of a foreign one: in its `hello`).
struct Traits {
  std::string name;
  /// After which update it answers: P_{k+1|k} or P_{k|k}.
  Instant instant = Instant::predicted;
  /// Whether it starts from x_{0|-1}, P_{0|-1}, so that its first step begins with the measurement update of y_0; else from
  /// x_{0|0}, P_{0|0}: each step predicts, with A, B, Q and D u, before it updates.
  bool starts_predicted = true;
  /// Which gain it answers; none if it keeps it to itself.
  std::optional<GainKind> gain = GainKind::predictor;
  Needs needs;
  /// Systems with missing measurements, or with rows of C that come and go, are not for it.
  bool measurement_every_step = false;
  /// The numbers that it is given, of which its answers are judged: only filters of the registry take roots.
  Parametrisation takes = Parametrisation::covariance;
  /// What it holds, as far as it shows: decides what rounding is excused. A foreign filter that needs an invertible A counts
  /// as one that holds an information matrix.
  Held holds = Held::covariance;
  /// How an asymmetry of P is carried on; nothing where nobody knows the coding.
  std::optional<Asymmetry> asymmetry;
  /// u of its arithmetic: 2^-53, or 2^-24 for one that says that it computes in single precision.
  double roundoff = unit_roundoff<double>();

  /// Of a filter of the registry.
  explicit Traits(const Metadata& metadata);
  Traits() = default;

  /// "update-predict" or "predict-update", as protocol 1 has it.
  std::string_view cycle() const { return starts_predicted ? "update-predict" : "predict-update"; }
};

/// What a filter has after a step.
struct Answer {
  Held holds = Held::covariance;       ///< what `held` is: P; S, square and full or lower, P = SS' ...
  Matrix<double> held;                 ///< 0 x 0 from a filter that holds nothing of P (Held::gain)
  std::optional<Matrix<double>> gain;  ///< n x p: Traits::gain; a column of 0 for an entry of y that is missing
  std::optional<Vector<double>> state;
  std::optional<double> log_likelihood;
};

/// How a run ended.
struct Ending {
  enum class Kind {
    done,
    refused,    ///< the filter says that it cannot: a status of ours, an `error` or `unsupported` of a foreign one
    no_answer,  ///< what came is not an answer: a wrong shape, a NaN, rubbish
  };
  Kind kind = Kind::done;
  std::int64_t step = -1;  ///< at which; -1 where it was the start
  std::string reason;      ///< what it said, or what was wrong with what it said
};

/// A subject's run of a system.
struct Run {
  System system;
  std::vector<Answer> answers;  ///< of the steps that it did
  Ending ending;
};

/// The filter did what no filter may: the check is over (exit code 4).
struct SubjectFault : std::runtime_error {
  enum class Kind { died, hung, flooded, limit };
  Kind kind;
  SubjectFault(Kind k, const std::string& what) : std::runtime_error(what), kind(k) {}
};

class Subject {
 public:
  virtual ~Subject() = default;

  virtual const Traits& traits() const = 0;
  /// Runs the filter from the system's start over its steps and data (null data: covariances and gains alone; a NaN in y is
  /// a missing entry) and hands each answer on; stops where it ends early, or where `each` says false. Every run is a problem
  /// of its own: nothing is to be left of the one before. Throws SubjectFault.
  virtual Ending run(const System& system, const std::function<bool(std::int64_t k, const Answer&)>& each) = 0;

  /// How many systems are worth running at once; 1 for a subject that runs one after another.
  virtual std::size_t at_once() const { return 1; }
  /// A run of each of the systems, in their order, whatever the others are.
  virtual std::vector<Run> run_all(const std::vector<System>& systems);
};

/// What a filter is sent at a step by protocol 1. Valid during the call.
struct StepInput {
  const Matrix<double>& A;            ///< n x n
  const Matrix<double>& B;            ///< n x m
  const Matrix<double>& C;            ///< p x n; p may change from step to step
  const Matrix<double>& Q;            ///< m x m
  const Matrix<double>& R;            ///< p x p
  const Matrix<double>* D = nullptr;  ///< n x inputs, with u
  const Vector<double>* u = nullptr;
  const Vector<double>* y = nullptr;  ///< null: the measurement is missing, C and R are of no meaning
};

/// A filter that is driven step by step, as protocol 1 and its likes do. Matrices are covariances.
class StepwiseFilter {
 public:
  virtual ~StepwiseFilter() = default;
  virtual const Traits& traits() const = 0;
  /// Begins a new problem. m and p are those of the first step. Nothing, or how it failed (Ending::step is not looked at).
  virtual std::optional<Ending> start(const Dimensions& size, const Vector<double>& x, const Matrix<double>& P) = 0;
  virtual std::variant<Answer, Ending> step(const StepInput& input) = 0;
};

/// The subject that is driven so. Rows of y that are missing are left out of C, R and y; where all are, there is no y. What
/// is answered is looked at: shapes, and that all is finite.
std::unique_ptr<Subject> subject(std::unique_ptr<StepwiseFilter> filter);

/// A filter of the registry, driven as it wants to be: roots are passed on bit by bit. Throws std::invalid_argument for an
/// unknown id.
std::unique_ptr<Subject> built_in(std::string_view id);
/// One that is not in the registry, or not as the registry has it.
std::unique_ptr<Subject> built_in(std::unique_ptr<AnyFilter<double>> filter);

/// The filters of which there are batches (filters/batch.hpp), in the order of the registry.
std::vector<std::string_view> batched_filters();
/// One of them, "srcf", as it is in a batch: runs of one shape are stepped side by side. Its name is "srcf-batch". Throws
/// std::invalid_argument for another id.
std::unique_ptr<Subject> in_batches(std::string_view id);

/// Why the system is not for the subject, or nothing.
std::optional<Refusal> refusal(const Traits& traits, const System& system);

}  // namespace kfstab::properties
