#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace kfstab::properties::laws::answers {

namespace {

/// Whether rounding excuses nothing up to answer k: half of the digits of P (of K where P is not held) are certain, and Re is
/// far from singular.
bool ordinary(const Course& course, const Traits& subject, std::int64_t k) {
  if (k >= course.steps()) return false;
  const double half = std::sqrt(subject.roundoff);
  const double P = course.P(k).norm(), K = course.K(k).norm();
  const bool of_gain = subject.holds == Held::gain;
  const double bound = of_gain ? course.K_bound(k) : course.P_bound(k), size = of_gain ? K : P;
  return largest_ratio * bound <= half * size && course.truth(k).innovation_condition * half <= 1;
}

std::optional<Finding> examine(Bench& bench, const System& system) {
  const Ending& ending = bench.run(system).ending;
  if (ending.kind == Ending::Kind::done) return Finding{};
  const Course& course = bench.course(system);
  for (std::int64_t k = 0; k <= std::max<std::int64_t>(ending.step, 0); ++k)
    if (!ordinary(course, bench.traits(), k)) return std::nullopt;
  const char* said = ending.kind == Ending::Kind::refused ? "it refuses" : "no answer";
  const std::string where = ending.step < 0 ? "start" : fmt::format("step {}", ending.step);
  return Finding{std::numeric_limits<double>::infinity(), ending.step,
                 fmt::format("{}: {}: {}", where, said, ending.reason)};
}

}  // namespace

Law law() {
  return {.id = "answers",
          .statement =
              "every step of an ordinary system is answered: with matrices of the right shape, all entries finite, and "
              "no error",
          .assumptions =
              "systems within what the filter says that it needs, on which first-order bounds leave half of the digits "
              "of P (of K, where P is not held) certain and k(Re) <= u^{-1/2} in every step up to the one that was not "
              "answered",
          .source = "docs/protocol.md; theory (4.4)",
          .tolerance = "none: an answer or not",
          .failure =
              "The filter gives up, or answers a NaN or a wrong shape, where nothing is difficult. If it is not made "
              "for such systems (no noise, p = 0, more measurements than states, a singular P0), let it say so in its "
              "needs; if a matrix is not invertible for it, look at what it inverts.",
          .reference = true,
          .examine = examine};
}

}  // namespace kfstab::properties::laws::answers
