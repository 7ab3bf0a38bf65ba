#include <kfstab/properties/check.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <utility>

namespace kfstab::properties {

namespace {

using Clock = std::chrono::steady_clock;

/// So many runs are kept for a diagnosis, and of so many steps at most.
constexpr std::size_t runs_kept = 40;

class Check {
 public:
  Check(Subject& subject, const CheckOptions& options, CheckReport& report)
      : options_(options), report_(report), bench_(subject, truths_), at_once_(subject.at_once()),
        generator_(systems(within(subject.traits(), options.systems))), begin_(Clock::now()) {
    report_ = {};
    report_.subject = subject.traits();
    report_.seed = options.seed;
    report_.asked = options.cases;
    for (const Law& law : options.laws) report_.laws.push_back({law, 0, 0, std::nullopt});
  }

  void run() {
    for (std::size_t i = 0; i < options_.replay.size() && go_on(); ++i)
      examine(options_.replay[i], -1 - static_cast<int>(i));
    for (int number = 0; number < options_.cases && go_on(); ++number) {
      const auto place = static_cast<std::size_t>(number) % at_once_;
      if (place == 0) draw(number);
      examine(drawn_[place], number);
      ++report_.cases;
      if (options_.progress) options_.progress(report_.cases);
    }
    shrink();
    count();
  }

  /// What is known so far.
  void count() {
    report_.steps = bench_.steps();
    report_.seconds = std::chrono::duration<double>(Clock::now() - begin_).count();
  }

 private:
  bool go_on() {
    if (options_.interrupted && options_.interrupted()) report_.interrupted = true;
    if (options_.budget > 0 && std::chrono::duration<double>(Clock::now() - begin_).count() > options_.budget)
      report_.out_of_time = true;
    return !report_.interrupted && !report_.out_of_time;
  }

  /// The cases from this one on that are run at once.
  void draw(int number) {
    drawn_.clear();
    for (; drawn_.size() < at_once_ && number < options_.cases; ++number)
      drawn_.push_back(drawn_system(generator_, options_.seed, number, options_.cases));
    if (at_once_ > 1) bench_.run_ahead(drawn_);
  }

  void forget() {
    bench_.forget();
    truths_.forget();
  }

  std::optional<Finding> finding(const Law& law, const System& system) {
    std::optional<Finding> found;
    try {
      found = law.examine(bench_, system);
    } catch (const SubjectFault& fault) {
      if (!law.hostile) throw;
      found = Finding{std::numeric_limits<double>::infinity(), -1, fault.what()};
    }
    if (found && std::isnan(found->ratio)) found->ratio = std::numeric_limits<double>::infinity();
    return found;
  }

  void examine(const System& system, int number) {
    forget();
    if (refusal(bench_.traits(), system)) {
      ++report_.not_sent;
      return;
    }
    std::vector<std::size_t> broken;
    for (std::size_t i = 0; i < report_.laws.size(); ++i) {
      LawOutcome& outcome = report_.laws[i];
      const auto found = finding(outcome.law, system);
      if (!found) continue;
      if (found->ratio > largest_ratio) broken.push_back(i);
      ++outcome.cases;
      outcome.max_ratio = std::max(outcome.max_ratio, found->ratio);
      if (found->ratio > largest_ratio && !outcome.failure)
        outcome.failure = Failure{system, *found, system, number, 0, {}};
    }
    const Run& run = bench_.run(system);
    if (run.ending.kind == Ending::Kind::refused) {
      ++report_.refused;
      ++report_.reasons[run.ending.reason];
    }
    if (number >= 0) {
      for (const std::string& name : classes(system)) ++report_.classes[name];
      if (report_.runs.size() < runs_kept || number % std::max(1, options_.cases / static_cast<int>(runs_kept)) == 0) {
        if (report_.runs.size() == runs_kept) {
          report_.runs.erase(report_.runs.begin());
          report_.broken.erase(report_.broken.begin());
        }
        report_.runs.push_back(run);
        report_.broken.push_back(std::move(broken));
      }
    }
  }

  void shrink() {
    for (LawOutcome& outcome : report_.laws) {
      if (!outcome.failure) continue;
      Failure& failure = *outcome.failure;
      int left = options_.shrinking;
      const auto fails = [&](const System& system) {
        if (left-- <= 0 || !go_on()) return false;
        forget();
        if (refusal(bench_.traits(), system)) return false;
        const auto found = finding(outcome.law, system);
        return found && found->ratio > largest_ratio;
      };
      auto [smallest, shrinks] = smallest_of(failure.drawn, within(bench_.traits(), options_.systems), fails);
      forget();
      if (auto found = finding(outcome.law, smallest); found && found->ratio > largest_ratio) {
        failure.system = std::move(smallest);
        failure.finding = *std::move(found);
        failure.shrinks = shrinks;
        failure.irrelevant = irrelevant(failure.drawn, failure.system);
      }
    }
  }

  const CheckOptions& options_;
  CheckReport& report_;
  Truths truths_;
  Bench bench_;
  std::size_t at_once_;
  std::vector<System> drawn_;
  rc::Gen<System> generator_;
  Clock::time_point begin_;
};

}  // namespace

bool CheckReport::passed() const {
  return std::ranges::all_of(laws, [](const LawOutcome& outcome) { return outcome.holds(); });
}

Options within(const Traits& traits, Options options) {
  const Needs& needs = traits.needs;
  if (needs.invertible_A || needs.positive_definite_Q || needs.positive_definite_P0) options.singular = false;
  if (needs.time_invariant) options.time_varying = false;
  if (traits.measurement_every_step) options.missing = false;
  // What is formed of P^{-1} has to be solved with: it breaks down where others have half of their digits left.
  if (traits.holds == Held::information) options.worst_condition = std::min(options.worst_condition, 1e6);
  return options;
}

void check(Subject& subject, const CheckOptions& options, CheckReport& report) {
  Check check(subject, options, report);
  try {
    check.run();
  } catch (const SubjectFault&) {
    check.count();
    throw;
  }
}

CheckReport check(Subject& subject, const CheckOptions& options) {
  CheckReport report;
  check(subject, options, report);
  return report;
}

}  // namespace kfstab::properties
