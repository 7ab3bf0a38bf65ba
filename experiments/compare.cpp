#include <kfstab/experiments/compare.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <ranges>

#include <fmt/core.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/cost.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/reports/number.hpp>

namespace kfstab::experiments {
namespace {

/// What luck with single roundings is worth, in digits.
constexpr double luck = 1;

double digits(double error, int bits) {
  const double most = bits * std::log10(2.0);
  if (std::isnan(error)) return 0;
  return error > 0 ? std::clamp(-std::log10(error), 0.0, most) : most;
}

Digits digits(const Series& error, int bits) {
  if (error.count() == 0) return {};
  return {digits(error.last(), bits), digits(error.largest(), bits)};
}

/// ||F_k ... F_0||^{1/(k+1)}
double forgetting(const SystemRun& run) {
  const Series& squared = run.analysis.log10_amplification;
  return squared.count() == 0 ? NaN : std::pow(10, squared.last() / 2 / static_cast<double>(squared.count()));
}

/// Filters of one parametrisation each: where a system is rounded to few bits, each parametrisation is a system of its
/// own, and one may be no system any more without the others.
std::vector<std::vector<const Metadata*>> by_parametrisation(const std::vector<const Metadata*>& filters) {
  std::vector<std::vector<const Metadata*>> groups;
  for (const auto form : {Parametrisation::covariance, Parametrisation::root, Parametrisation::information}) {
    std::vector<const Metadata*> group;
    std::ranges::copy_if(filters, std::back_inserter(group), [&](const Metadata* f) { return f->takes == form; });
    if (!group.empty()) groups.push_back(std::move(group));
  }
  return groups;
}

/// Adds what a run came to; its filters are some of the comparison's.
void add(Point& point, const SystemRun& run, const std::vector<const Metadata*>& filters) {
  for (const FilterRun& f : run.filters) {
    Fare& own = point.filters[static_cast<std::size_t>(std::ranges::find(filters, f.metadata) - filters.begin())];
    own = fare(f, point.bits);
    if (run.reference_error && !own.refused) own.refused = "the reference has no answer: " + *run.reference_error;
  }
  if (std::isnan(point.forgetting)) point.forgetting = forgetting(run);
}

void measure(Point& point, const properties::System& system, const CompareOptions& options) {
  point.filters.resize(options.filters.size());
  std::vector<std::string> errors;
  std::vector<std::vector<const Metadata*>> groups(1, options.filters);
  if (point.bits < bits_of_double) groups = by_parametrisation(options.filters);
  for (const auto& group : groups) {
    const SystemRun result = run(system, group, {.bits = point.bits, .timed = false, .foreign = options.foreign});
    if (result.interrupted) return;
    add(point, result, options.filters);
    if (result.reference_error) errors.push_back(*result.reference_error);
  }
  if (errors.size() == groups.size()) point.error = errors.front();
  point.done = true;
}

/// All combinations of the scans' values, the last scan's fastest.
std::vector<std::vector<double>> grid(const std::vector<Scan>& scans) {
  std::vector<std::vector<double>> points(1);
  for (const Scan& scan : scans) {
    std::vector<std::vector<double>> wider;
    for (const auto& point : points)
      for (const double value : scan.values) {
        wider.push_back(point);
        wider.back().push_back(value);
      }
    points = std::move(wider);
  }
  return points;
}

/// What the recommendation is made from: the points of double, or of the longest words scanned; without scans the
/// system as it is written.
std::vector<const Point*> considered(const Comparison& comparison) {
  if (comparison.scans.empty()) return {&comparison.base};
  std::vector<const Point*> points;
  int bits = 0;
  for (const Point& point : comparison.points)
    if (point.done && !point.error) {
      points.push_back(&point);
      if (bits != bits_of_double && (point.bits == bits_of_double || point.bits > bits)) bits = point.bits;
    }
  std::erase_if(points, [&](const Point* point) { return point->bits != bits; });
  return points;
}

/// " at d = 1e-7", or nothing where there is one point alone.
std::string at(const Comparison& comparison, const Point& point) {
  return point.at.empty() ? "" : " at " + place(comparison, point);
}

/// A filter over the points that are considered.
struct Candidate {
  std::size_t index = 0;
  const Metadata* filter = nullptr;
  double operations = 0;
  std::optional<std::string> refused = {};
  std::size_t sound = 0;  ///< points
  const Point* first_unsound = nullptr;
  double least = infinity;  ///< digits kept
  const Point* least_at = nullptr;
  double loss = 0;  ///< digits fewer than the best of the sound ones, at the worst point
  const Point* loss_at = nullptr;
};

std::vector<Candidate> candidates(const Comparison& comparison, const std::vector<const Point*>& points) {
  std::vector<Candidate> all;
  for (std::size_t i = 0; i < comparison.filters.size(); ++i) {
    Candidate c{.index = i, .filter = comparison.filters[i]};
    c.operations = operations(*c.filter, comparison.as_written.dimensions);
    for (const Point* point : points) {
      const Fare& own = point->filters[i];
      if (own.refused && !c.refused) c.refused = own.refused;
      if (own.sound())
        ++c.sound;
      else if (!c.first_unsound)
        c.first_unsound = point;
      if (own.kept() < c.least) {
        c.least = own.kept();
        c.least_at = point;
      }
    }
    all.push_back(std::move(c));
  }
  for (const Point* point : points) {
    double best = 0;
    for (const Candidate& c : all)
      if (!c.first_unsound && c.filter->holds != Held::gain) best = std::max(best, point->filters[c.index].kept());
    for (Candidate& c : all) {
      const double loss = best - point->filters[c.index].kept();
      if (loss > c.loss) {
        c.loss = loss;
        c.loss_at = point;
      }
    }
  }
  return all;
}

/// "its P is not positive semidefinite from step 3 on at d = 1e-8"
std::string what_fails(const Comparison& comparison, const Candidate& c) {
  const Fare& own = c.first_unsound->filters[c.index];
  const std::string where = at(comparison, *c.first_unsound);
  if (own.refused) return fmt::format("does not apply{}: {}", where, *own.refused);
  if (own.first_failure)
    return fmt::format("breaks down{} in step {} ({})", where, *own.first_failure,
                       failure_name(own.failure, own.stopped));
  return fmt::format("has a P that is not positive semidefinite{} after step {}", where, *own.first_indefinite);
}

std::string cost(double operations) { return fmt::format("{:.0f} multiply-adds a step", operations); }

/// The cheaper filter that comes nearest, or else the next cheapest: what is not taken, and why.
std::string runner_up(const Comparison& comparison, const std::vector<Candidate>& all, const Candidate& chosen) {
  const Candidate* next = nullptr;
  const auto better = [&](const Candidate& a, const Candidate& b) {
    if (a.first_unsound && b.first_unsound) return a.sound > b.sound;
    return !a.first_unsound == !b.first_unsound ? a.loss < b.loss : !a.first_unsound;
  };
  for (const Candidate& c : all)
    if (&c != &chosen && !c.refused && c.operations < chosen.operations && c.filter->holds != Held::gain &&
        (!next || better(c, *next)))
      next = &c;
  if (next) {
    const std::string id(next->filter->id);
    const std::string cheaper =
        fmt::format("{} would take {:.0f} % of that, but ", id, 100 * next->operations / chosen.operations);
    if (next->first_unsound) return cheaper + what_fails(comparison, *next) + ".";
    return cheaper + fmt::format("loses {:.1f} digits more{}.", next->loss, at(comparison, *next->loss_at));
  }
  for (const Candidate& c : all)
    if (&c != &chosen && !c.refused && c.filter->holds != Held::gain && !std::isnan(c.operations) &&
        (!next || c.operations < next->operations))
      next = &c;
  if (!next) return "";
  const std::string dearer = fmt::format("The next, {}, takes {:.1f} times as much and ", next->filter->id,
                                         next->operations / chosen.operations);
  if (next->first_unsound) return dearer + what_fails(comparison, *next) + ".";
  if (next->loss_at && next->loss > luck)
    return dearer + fmt::format("loses {:.1f} digits more{}.", next->loss, at(comparison, *next->loss_at));
  return dearer + "keeps no more that counts.";
}

/// "textbook-Python keeps at least 12.1 digits of P and K, at most 0.2 fewer than the best."
std::string foreign_sentence(const Comparison& comparison, const Candidate& c, std::size_t points) {
  const std::string id(c.filter->id);
  if (c.first_unsound) return fmt::format("{} {}.", id, what_fails(comparison, c));
  return fmt::format("{} keeps at least {:.1f} digits of P and K{}, {}.", id, c.least,
                     points > 1 ? ", fewest" + at(comparison, *c.least_at) : "",
                     c.loss > luck ? fmt::format("{:.1f} fewer than the best{}", c.loss, at(comparison, *c.loss_at))
                                   : "as many as the best, as far as that counts");
}

std::string ladder(const Comparison& comparison) {
  std::string long_enough, never;
  for (std::size_t i = 0; i < comparison.filters.size(); ++i) {
    const std::string id(comparison.filters[i]->id);
    if (std::ranges::all_of(comparison.points, [&](const Point& p) { return !p.done || p.filters[i].refused; }))
      continue;
    if (const auto bits = fewest_bits(comparison, i))
      long_enough += fmt::format("{}{} from {}", long_enough.empty() ? "" : ", ", id, *bits);
    else
      never += (never.empty() ? "" : ", ") + id;
  }
  std::string text = fmt::format("Words: sound and right to {} digits of P and K at every point ",
                                 reports::short_number(comparison.accurate));
  text += long_enough.empty() ? "is no filter at any of these lengths" : "are " + long_enough + " bits on";
  if (!long_enough.empty() && !never.empty()) text += "; at none of these lengths " + never;
  return text + ".";
}

}  // namespace

double Fare::kept() const {
  if (!sound()) return 0;
  const double fewest = std::fmin(P.worst, K.worst);
  return std::isnan(fewest) ? 0 : fewest;
}

Fare fare(const FilterRun& run, int bits) {
  Fare own;
  own.filter = run.metadata;
  own.refused = run.refused;
  if (own.refused) return own;
  own.P = digits(run.covariance_error, bits);
  own.K = digits(run.gain_error, bits);
  own.x = digits(run.state_error, bits);
  own.bound = digits(run.bound, bits).worst;
  own.asymmetry = run.asymmetry.largest();
  own.first_indefinite = run.first_indefinite;
  own.first_failure = run.first_failure;
  own.failure = run.failure;
  own.stopped = run.stopped;
  return own;
}

std::optional<int> fewest_bits(const Comparison& comparison, std::size_t filter) {
  std::map<int, bool, std::greater<>> long_enough;  // by bits, the most first
  for (const Point& point : comparison.points) {
    if (!point.done) continue;
    const bool here =
        !point.error && point.filters[filter].sound() && point.filters[filter].kept() >= comparison.accurate;
    const auto [entry, first] = long_enough.try_emplace(point.bits, here);
    if (!first) entry->second = entry->second && here;
  }
  std::optional<int> fewest;
  for (const auto& [bits, is] : long_enough) {
    if (!is) break;
    fewest = bits;
  }
  return fewest;
}

std::string place(const Comparison& comparison, const Point& point) {
  std::string text;
  for (std::size_t i = 0; i < comparison.scans.size(); ++i)
    text +=
        fmt::format("{}{} = {}", i == 0 ? "" : ", ", comparison.scans[i].name, reports::short_number(point.at[i], 3));
  return text;
}
Recommendation recommend(const Comparison& comparison) {
  Recommendation result;
  const auto points = considered(comparison);
  if (points.empty() || points.front()->filters.empty()) {
    result.sentences.push_back("No point was measured: there is nothing to recommend.");
    return result;
  }
  const bool scans_bits =
      std::ranges::any_of(comparison.scans, [](const Scan& scan) { return scan.of == Scan::Of::bits; });
  const std::string everywhere = (points.size() > 1 ? fmt::format(" at all {} points", points.size()) : "") +
                                 (scans_bits ? fmt::format(" of {} bits", points.front()->bits) : "");
  const auto all = candidates(comparison, points);
  // Nobody counted what a foreign filter costs: it is told of, and not taken.
  const auto counted = [](const Candidate& c) { return !std::isnan(c.operations); };
  const auto eligible = [&](const Candidate& c) { return !c.refused && c.filter->holds != Held::gain && counted(c); };

  double least_loss = infinity;
  for (const Candidate& c : all)
    if (eligible(c) && !c.first_unsound) least_loss = std::min(least_loss, c.loss);
  const Candidate* chosen = nullptr;
  for (const Candidate& c : all)
    if (eligible(c) && !c.first_unsound && c.loss <= std::max(luck, least_loss) &&
        (!chosen || c.operations < chosen->operations))
      chosen = &c;

  if (chosen) {
    result.filter = chosen->filter;
    result.sentences.push_back(fmt::format("Take {}: the cheapest of the filters that keep the digits{}, {}.",
                                           chosen->filter->id, everywhere, cost(chosen->operations)));
    result.sentences.push_back(fmt::format(
        "It keeps at least {:.1f} digits of P and K in every step{}, and never is more than {:.1f} behind the best{}.",
        chosen->least, points.size() == 1 ? "" : ", fewest" + at(comparison, *chosen->least_at), chosen->loss,
        chosen->least < comparison.accurate ? ": at its worst no filter is right to more, in words of this length"
                                            : ""));
    const std::string other = runner_up(comparison, all, *chosen);
    if (!other.empty()) result.sentences.push_back(other);
  } else {
    for (const Candidate& c : all)
      if (eligible(c) && c.sound > 0 &&
          (!chosen || c.sound > chosen->sound || (c.sound == chosen->sound && c.operations < chosen->operations)))
        chosen = &c;
    if (!chosen) {
      result.sentences.push_back(
          fmt::format("None of these filters can be recommended: none does every step{} with a P that stays positive "
                      "semidefinite.",
                      comparison.scans.empty() ? "" : " at any point"));
    } else {
      result.filter = chosen->filter;
      result.sentences.push_back(fmt::format("No filter is sound{}. {} lasts longest, at {} of them; it {}.",
                                             everywhere, chosen->filter->id, chosen->sound,
                                             what_fails(comparison, *chosen)));
    }
  }
  for (const Candidate& c : all)
    if (!counted(c) && !c.refused) result.sentences.push_back(foreign_sentence(comparison, c, points.size()));
  if (scans_bits) result.sentences.push_back(ladder(comparison));
  std::string refused;
  for (const Candidate& c : all)
    if (c.refused && points.size() == 1) refused += (refused.empty() ? "" : "; ") + *c.refused;
  if (!refused.empty()) result.sentences.push_back("Not run: " + refused + ".");
  return result;
}

void check_scans(const CompareOptions& options) {
  std::vector<Scan> ends = options.scans;
  for (Scan& scan : ends) scan.values = {scan.values.front(), scan.values.back()};
  for (const auto& at : grid(ends)) scanned_system(options.system, options.overrides, options.scans, at);
}

Comparison compare(const CompareOptions& options) {
  Comparison result;
  result.filters = options.filters;
  result.scans = options.scans;
  result.accurate = options.accurate;
  const properties::System system = find_system(options.system, options.overrides);
  result.as_written = run(system, options.filters, {.foreign = options.foreign});
  result.base.filters.resize(options.filters.size());
  add(result.base, result.as_written, options.filters);
  result.base.error = result.as_written.reference_error;
  result.base.done = !result.as_written.interrupted;
  if (options.progress) options.progress(1);

  if (!options.scans.empty())
    for (auto& values : grid(options.scans)) {
      Point& point = result.points.emplace_back();
      point.bits = scanned_bits(options.scans, values);
      point.at = std::move(values);
    }
  oneapi::tbb::task_arena arena(options.jobs == 0 ? oneapi::tbb::task_arena::automatic : options.jobs);
  arena.execute([&] {
    oneapi::tbb::parallel_for(std::size_t{0}, result.points.size(), [&](std::size_t i) {
      if (interrupted()) return;
      Point& point = result.points[i];
      measure(point, scanned_system(options.system, options.overrides, options.scans, point.at), options);
      if (options.progress && point.done) options.progress(1);
    });
  });
  result.interrupted = interrupted();
  result.recommendation = recommend(result);
  return result;
}

}  // namespace kfstab::experiments
