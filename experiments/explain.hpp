#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <kfstab/experiments/run.hpp>

/// Where the digits went: the steps at which a filter lost them, what those steps are like, the entries that lost most,
/// and what cancelled.
namespace kfstab::experiments {

/// Digits that were lost at one step: by how much the largest error so far grew there, in decades.
struct Loss {
  std::int64_t step = 0;
  double digits = 0;
  // What the step may cost by theory (4.1)-(4.3) and (3.1); NaN where the run does not say.
  double innovation_condition = 0;  ///< k(Re)
  double cosine = 0;                ///< how much the downdate leaves, theory (4.1); below 1 it costs
  double growth = 0;                ///< ||F||^2: what the step makes of an error from before
  reference::InformationLoss information;  ///< what it costs an information form, (4.3)
};

/// Whether (4.3) says what a filter loses in a step, and not (4.1) or (4.2).
constexpr bool is_information(const Metadata& filter) {
  return filter.holds == Held::information_factor || filter.holds == Held::information;
}

/// Additions whose operands agreed in leading bits, counted in a run of Counting<double>.
struct Cancellations {
  std::int64_t additions = 0, any = 0;
  std::int64_t half_word = 0;          ///< of 26 bits or more
  std::int64_t step = 0, at_step = 0;  ///< where most of the latter were, and how many
};

/// One filter's story.
struct Explanation {
  const Metadata* filter = nullptr;
  std::optional<std::string> refused;
  char of = 'P';             ///< 'P', or 'K' of a filter that holds no P
  double lost = 0;           ///< digits of it, of those that a double has, at the worst step
  std::int64_t worst = 0;    ///< that step
  std::vector<Loss> losses;  ///< the three steps that cost most, most first
  double asymmetry = 0;      ///< the asymmetry of P at the worst step as a part of its error, within [0, 1]
  std::optional<std::int64_t> first_indefinite, first_failure;
  Status failure = Status::ok;
  std::string stopped;  ///< FilterRun::stopped
  /// |p^_ij - p_ij| / sqrt(p_ii p_jj) at the worst step; empty where it is not known.
  Matrix<double> entries;
  std::optional<Cancellations> cancellations;
  std::vector<std::string> sentences;
};

struct Explained {
  SystemRun run;
  std::vector<Explanation> filters;
};

struct ExplainOptions {
  std::function<void(std::int64_t)> progress;  ///< called after so many more steps
};

/// Runs the filters and explains them.
Explained explain(const properties::System& system, const std::vector<const Metadata*>& filters,
                  const ExplainOptions& options);

/// Explains a run that was stored: what its curves say, without entries and cancellations.
Explained explain(SystemRun run);

}  // namespace kfstab::experiments
