#include <kfstab/experiments/claim.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>

#include <fmt/core.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/properties/input_error.hpp>

namespace kfstab::experiments {

std::vector<Claim> unordered_claims();  // the generated table

std::vector<Claim> all_claims() {
  std::vector<Claim> all = unordered_claims();
  std::ranges::sort(all, {}, &Claim::number);
  return all;
}

reports::Verdict ClaimResult::verdict() const {
  bool measured = !findings.checks.empty();
  for (const reports::Check& check : findings.checks) {
    if (std::isnan(check.measured))
      measured = false;
    else if (!check.holds)
      return reports::Verdict::refuted;
  }
  return measured ? reports::Verdict::confirmed : reports::Verdict::inconclusive;
}

Settings settings_of(const Claim& claim, const std::map<std::string, double>& set, Effort effort) {
  std::map<std::string, double> values;
  for (const Parameter& parameter : claim.parameters) {
    const auto given = set.find(parameter.name);
    const double own = effort == Effort::quick ? parameter.quick.value_or(parameter.value) : parameter.value;
    const double value = given == set.end() ? own : given->second;
    if (!(value >= parameter.least && value <= parameter.most)) {
      properties::Place place;
      place.origin = "--set";
      place.field = parameter.name;
      throw properties::InputError(place, fmt::format("{}", value),
                                   fmt::format("{} of claim {} from {} to {}", parameter.meaning, claim.id,
                                               parameter.least, parameter.most));
    }
    values[parameter.name] = value;
  }
  return Settings(values);
}

ClaimResult run_claim(const Claim& claim, const std::map<std::string, double>& set, Effort effort) {
  ClaimResult result{claim, settings_of(claim, set, effort), {}, 0};
  const auto begin = std::chrono::steady_clock::now();
  result.findings = claim.measure(result.settings);
  going_on();  // runs keep what is done
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return result;
}

std::vector<ClaimResult> run_claims(const std::vector<Claim>& claims, const std::map<std::string, double>& set,
                                    Effort effort, int jobs, const std::function<void()>& done) {
  std::vector<std::optional<ClaimResult>> finished(claims.size());
  oneapi::tbb::task_arena arena(jobs == 0 ? oneapi::tbb::task_arena::automatic : jobs);
  arena.execute([&] {
    oneapi::tbb::parallel_for(
        oneapi::tbb::blocked_range<std::size_t>(0, claims.size(), 1),
        [&](const oneapi::tbb::blocked_range<std::size_t>& range) {
          for (std::size_t i = range.begin(); i < range.end() && !interrupted(); ++i) {
            try {
              finished[i] = run_claim(claims[i], set, effort);
            } catch (const Interrupted&) {
              return;
            }
            done();
          }
        },
        oneapi::tbb::simple_partitioner());
  });
  std::vector<ClaimResult> results;
  for (auto& result : finished)
    if (result) results.push_back(std::move(*result));
  return results;
}

std::vector<Stability> run_seeds(const std::vector<Claim>& claims, const std::map<std::string, double>& set,
                                 Effort effort, int jobs, int seeds, const std::function<void()>& done) {
  std::vector<Claim> drawn, fixed;
  for (const Claim& claim : claims)
    (std::ranges::count(claim.parameters, "seed", &Parameter::name) > 0 ? drawn : fixed).push_back(claim);

  std::map<int, Stability> found;
  const auto take = [&](const std::vector<ClaimResult>& results) {
    for (const ClaimResult& result : results) {
      Stability& stability = found.try_emplace(result.claim.number, Stability{result.claim, 0, 0, {}}).first->second;
      ++stability.runs;
      stability.confirmed += result.verdict() == reports::Verdict::confirmed;
      for (const reports::Check& check : result.findings.checks) {
        auto held = std::ranges::find(stability.checks, check.name, &Stability::Held::check);
        if (held == stability.checks.end()) held = stability.checks.insert(held, {check.name, 0});
        held->times += check.holds;
      }
    }
  };
  take(run_claims(fixed, set, effort, jobs, done));
  for (int seed = 1; seed <= seeds && !interrupted(); ++seed) {
    auto with_seed = set;
    with_seed["seed"] = seed;
    take(run_claims(drawn, with_seed, effort, jobs, done));
  }
  std::vector<Stability> all;
  for (auto& [number, stability] : found) all.push_back(std::move(stability));
  return all;
}

reports::Check check_close(std::string name, double predicted, double measured, double relative) {
  const bool holds = std::isfinite(predicted) && std::abs(measured - predicted) <= relative * std::abs(predicted);
  return {std::move(name), predicted, measured, fmt::format("within {:g} % of the prediction", 100 * relative), holds};
}

reports::Check check_within(std::string name, double predicted, double measured, double distance) {
  const bool holds = std::abs(measured - predicted) <= distance;
  return {std::move(name), predicted, measured, fmt::format("within {:g} of the prediction", distance), holds};
}

reports::Check check_slope(std::string name, double predicted, const Line& line, double distance) {
  const double measured = line.half_width <= distance ? line.slope : NaN;
  reports::Check check = check_within(std::move(name), predicted, measured, distance);
  check.criterion += fmt::format("; 95 % interval +- {:.2g}, {} points", line.half_width, line.points);
  return check;
}

reports::Check check_growth(std::string name, double predicted, const Growth& growth, double relative) {
  const double measured = growth.half_width <= relative * predicted ? growth.factor : NaN;
  reports::Check check = check_close(std::move(name), predicted, measured, relative);
  check.criterion += fmt::format("; 95 % interval +- {:.2g}, {} points", growth.half_width, growth.last - growth.first);
  return check;
}

reports::Check check_at_most(std::string name, double limit, double measured, std::string reason) {
  return {std::move(name), limit, measured, fmt::format("at most {:g}: {}", limit, reason), measured <= limit};
}

reports::Check check_at_least(std::string name, double limit, double measured, std::string reason) {
  return {std::move(name), limit, measured, fmt::format("at least {:g}: {}", limit, reason), measured >= limit};
}

}  // namespace kfstab::experiments
