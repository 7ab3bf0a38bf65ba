#include <kfstab/experiments/explain.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <variant>

#include <fmt/core.h>

#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/filters/counting.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/data.hpp>
#include <kfstab/reports/number.hpp>

namespace kfstab::experiments {
namespace {

using reports::short_number;

constexpr int half_word = 26;
constexpr std::size_t most_losses = 3;

/// Of those that a double has.
double digits_lost(double error) {
  const double all = -std::log10(u);
  return std::isnan(error) ? all : std::clamp(std::log10(error / u), 0.0, all);
}

/// A curve, asked by step: its value there, or at the last step before that it keeps.
class Lookup {
 public:
  explicit Lookup(const Series& series) : points_(series.points()) {}
  double operator()(double step) const {
    const auto after = std::ranges::upper_bound(points_.step, step);
    if (after == points_.step.begin()) return NaN;
    return points_.value[static_cast<std::size_t>(after - points_.step.begin() - 1)];
  }

 private:
  Series::Points points_;
};

Explanation losses(const FilterRun& f, const AnalysisRun& analysis) {
  Explanation e;
  e.filter = f.metadata;
  e.refused = f.refused;
  e.first_indefinite = f.first_indefinite;
  e.first_failure = f.first_failure;
  e.failure = f.failure;
  e.stopped = f.stopped;
  if (e.refused) return e;
  const bool holds_P = f.metadata->holds != Held::gain;
  e.of = holds_P ? 'P' : 'K';
  const auto errors = (holds_P ? f.covariance_error : f.gain_error).points();
  const Lookup root_condition(analysis.innovation_condition), cosine(analysis.cosine), gamma(analysis.gamma);
  const auto& of = analysis.information;
  const Lookup A(of.A), Q_root(of.Q_root), R_root(of.R_root), spread(of.spread), inverse_cosine(of.inverse_cosine),
      T(of.T);
  for (std::size_t i = 0; i < errors.step.size(); ++i) {
    const double lost = digits_lost(errors.value[i]), k = errors.step[i];
    if (!(lost > e.lost)) continue;
    const double root = root_condition(k), growth = gamma(k);
    e.losses.push_back({static_cast<std::int64_t>(k), lost - e.lost, root * root, cosine(k), growth * growth,
                        {A(k), Q_root(k), R_root(k), spread(k), inverse_cosine(k), T(k)}});
    e.lost = lost;
    e.worst = static_cast<std::int64_t>(k);
  }
  std::ranges::stable_sort(e.losses, std::greater(), &Loss::digits);
  if (e.losses.size() > most_losses) e.losses.resize(most_losses);
  const auto k = static_cast<double>(e.worst);
  const double error = Lookup(f.covariance_error)(k), asymmetry = Lookup(f.asymmetry)(k);
  e.asymmetry = error > 0 && std::isfinite(asymmetry) && std::isfinite(error) ? std::min(1.0, asymmetry / error) : 0;
  return e;
}

std::string cause_of_growth(const Loss& loss) {
  return fmt::format(", where ||F||^2 = {}: what was wrong before may grow by {:.1f} digits there", short_number(loss.growth),
                     std::log10(loss.growth));
}

/// What of a step costs most, and how much: as theory (4) has it for what the filter holds.
std::string cause(const Loss& loss, const Metadata& filter) {
  const bool root = holds_root(filter.holds);
  const double by_condition = std::log10(loss.innovation_condition) / (root ? 2 : 1);
  const double by_angle = -2 * std::log10(loss.cosine) / (root ? 2 : 1);
  const double by_growth = std::log10(loss.growth);
  if (std::isnan(by_condition)) return "";
  std::string most;
  if (by_growth >= std::max({by_condition, by_angle, 0.5})) return cause_of_growth(loss);
  if (by_condition >= std::max(by_angle, 0.5))
    most = fmt::format("k(Re) = {}: worth {:.1f} digits to a form that holds {}",
                       short_number(loss.innovation_condition), by_condition, root ? "a root" : "P");
  else if (by_angle >= 0.5)
    most =
        fmt::format("the downdate leaves {} of the predicted covariance: worth {:.1f} digits to a form that holds {}",
                    short_number(loss.cosine * loss.cosine), by_angle, root ? "a root" : "P");
  else
    most = fmt::format("k(Re) = {} and ||F||^2 = {}: nothing that would cost a digit",
                       short_number(loss.innovation_condition), short_number(loss.growth));
  return ", where " + most;
}

/// The same of an information form: which factor of (4.3) is the largest. What is a root there is squared where P^{-1} is
/// held.
std::string cause_of_information(const Loss& loss, const Metadata& filter) {
  const reference::InformationLoss& of = loss.information;
  if (std::isnan(of.T)) return "";
  struct Factor {
    double value;
    const char *name, *why;
  };
  const Factor factors[] = {
      {of.A, "k(A)", "A is inverted"},
      {of.R_root, "k(R^{1/2})", "R^{1/2} is inverted"},
      {of.spread * of.Q_root, "(t1/tm) k(Q^{1/2})",
       "Q^{1/2} is inverted, and w is known much better in one direction than in another"},
      {of.spread * of.A, "(t1/tm) k(A)", "A is inverted, and w is known much better in one direction than in another"},
      {of.inverse_cosine, "1/cos3", "little is left of the information that the step began with"},
      {of.T, "k(T)", "P is made from what is held, by inverting it"}};
  const Factor& most = *std::ranges::max_element(factors, {}, &Factor::value);
  if (loss.growth > most.value && std::log10(loss.growth) >= 0.5) return cause_of_growth(loss);
  const double powers = filter.holds == Held::information ? 2 : 1, digits = powers * std::log10(most.value);
  if (digits < 0.5) return fmt::format(", where no factor of (4.3) is above {}", short_number(most.value));
  return fmt::format(", where {} = {}, worth {:.1f} digits to a form that holds {}: {}", most.name,
                     short_number(most.value), digits, powers == 2 ? "P^{-1}" : "a root of P^{-1}", most.why);
}

void tell(Explanation& e, const SystemRun& run) {
  const std::string id(e.filter->id);
  const auto say = [&](std::string sentence) { e.sentences.push_back(std::move(sentence)); };
  if (e.refused) return say("It was not run: " + *e.refused + ".");
  if (e.first_failure) say(fmt::format("{} breaks down in step {}: {}.", id, *e.first_failure, failure_name(e.failure, e.stopped)));
  if (e.lost < 1) {
    if (!e.first_failure) say(fmt::format("{} loses less than a digit of {}.", id, e.of));
    return;
  }
  const Loss& most = e.losses.front();
  if (most.digits >= e.lost / 3 || e.losses.size() == 1) {
    const std::string where =
        is_information(*e.filter) ? cause_of_information(most, *e.filter) : cause(most, *e.filter);
    say(e.losses.size() == 1
            ? fmt::format("{} loses {:.1f} digits of {}, all of them at step {}{}.", id, e.lost, e.of, most.step, where)
            : fmt::format("{} loses {:.1f} of its {:.1f} lost digits of {} at step {}{}.", id, most.digits, e.lost,
                          e.of, most.step, where));
  } else {
    const double steps = static_cast<double>(std::max<std::int64_t>(e.worst, 1));
    say(fmt::format(
        "{} loses {:.1f} digits of {} by and by, {:.2g} a step up to step {}; no step takes more than {:.1f}.", id,
        e.lost, e.of, e.lost / steps, e.worst, most.digits));
  }
  if (e.asymmetry > 0.5)
    say(fmt::format(
        "Its error is an asymmetry, {:.0f} % of it, which grows by a law of the coding whatever the filter forgets: "
        "theory (3.6). One triangle of P, or its mean with P', would cure that.",
        100 * e.asymmetry));
  else if (!run.analysis.log10_amplification.points().step.empty()) {
    const double amplification = Lookup(run.analysis.log10_amplification)(static_cast<double>(e.worst));
    if (amplification > 1)
      say(fmt::format("Up to step {} the closed loop multiplies an error by up to 1e{:.0f}: no form escapes that.",
                      e.worst, amplification));
  }
  if (e.first_indefinite) say(fmt::format("After step {} its P is not positive semidefinite.", *e.first_indefinite));
  if (e.entries.size() > 0) {
    Index row = 0, col = 0;
    const double largest = e.entries.maxCoeff(&row, &col);
    say(fmt::format(
        "At step {} the entry of P that is most wrong is p[{},{}], by {} in units of the deviations of its states; "
        "the one least wrong is off by {}.",
        e.worst, std::max(row, col), std::min(row, col), short_number(largest), short_number(e.entries.minCoeff())));
  }
  if (e.cancellations) {
    const Cancellations& c = *e.cancellations;
    say(c.half_word == 0 ? fmt::format("In none of its {} additions does half of the word cancel.", c.additions)
                         : fmt::format("In {} of its {} additions half of the word or more cancels, in step {} {} times.",
                                       c.half_word, c.additions, c.step, c.at_step));
  }
}

/// The same run in numbers that count.
std::optional<Cancellations> count(const properties::System& asked, const Metadata& filter, std::int64_t steps) {
  const properties::System system = properties::with_every_measurement(asked);
  using Number = Counting<double>;
  const auto to_number = [](double x) { return Number(x); };
  const auto made = properties::problem(system, filter.takes);
  const auto* problem = std::get_if<AnyProblem<double>>(&made);
  if (!problem) return {};
  const AnyProblem<Number> counted = convert(*problem, to_number);
  const auto instance = make_filter<Number>(filter.id);
  instance->start(counted);
  const auto stream = system.data ? system.data->open() : nullptr;
  Cancellations result;
  Vector<Number> y, u_k;
  for (std::int64_t k = 0; k < steps && !interrupted(); ++k) {
    if (stream) {
      const StepData& data = stream->next();
      y = convert(data.y, to_number);
      u_k = convert(data.u, to_number);
    }
    kfstab::operations() = {};
    if (!instance->step(k, stream ? &y : nullptr, stream && u_k.size() > 0 ? &u_k : nullptr).report) break;
    result.additions += kfstab::operations().additions;
    result.any += kfstab::operations().cancellations(1);
    const auto here = kfstab::operations().cancellations(half_word);
    result.half_word += here;
    if (here > result.at_step) {
      result.step = k;
      result.at_step = here;
    }
  }
  return result;
}

}  // namespace

Explained explain(SystemRun run) {
  Explained result;
  for (const FilterRun& f : run.filters) {
    result.filters.push_back(losses(f, run.analysis));
    tell(result.filters.back(), run);
  }
  result.run = std::move(run);
  return result;
}

Explained explain(const properties::System& system, const std::vector<const Metadata*>& filters,
                  const ExplainOptions& options) {
  struct Worst {
    double error = -1;
    Matrix<double> entries;
  };
  std::map<std::string_view, Worst> worst;
  Explained result;
  result.run =
      run(system, filters, {.progress = options.progress, .timed = false, .observe = [&](const Observation& now) {
                              Worst& own = worst[now.metadata.id];
                              if (!now.step.held || !(now.errors.covariance > own.error)) return;
                              own.error = now.errors.covariance;
                              own.entries = now.truth.entry_errors(now.metadata, now.step);
                            }});
  for (const FilterRun& f : result.run.filters) {
    Explanation e = losses(f, result.run.analysis);
    if (!e.refused) {
      e.entries = std::move(worst[f.metadata->id].entries);
      e.cancellations = count(system, *f.metadata, result.run.steps_done);
    }
    tell(e, result.run);
    result.filters.push_back(std::move(e));
  }
  return result;
}

}  // namespace kfstab::experiments
