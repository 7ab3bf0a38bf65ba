#include <kfstab/properties/diagnosis.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include <fmt/format.h>

#include <kfstab/properties/precise.hpp>

namespace kfstab::properties {

namespace {

/// Agreement is by rounding when no more than the root of what the arithmetic has is lost: a wrong filter that happens to be
/// near agrees to two or three digits, the same wrong filter in another coding to nearly all.
double enough_digits(const Traits& traits) { return -std::log10(traits.roundoff) / 2; }

/// On an ill-conditioned system two codings of one filter agree to fewer: then to all digits that a disturbance of its steps by a
/// few roundings leaves, but for two, since a coding may round more often. Where that is less than this, a wrong filter that
/// is near is not told from a right one: the system says nothing.
constexpr double roundings = 4, digits_by_coding = 2;
double least_digits(const Traits& traits) { return enough_digits(traits) / 2; }

/// A mistake explains if it does so on nearly all systems.
constexpr double sure = .9;
constexpr std::size_t most_named = 3;

double digits_between(const Matrix<double>& X, const Matrix<double>& Y) {
  if (X.rows() != Y.rows() || X.cols() != Y.cols()) return 0;
  // Beyond the range of double there is nothing to compare but that both are there.
  if (!X.allFinite() || !Y.allFinite()) return X.allFinite() == Y.allFinite() ? 16 : 0;
  const double size = std::max(X.stableNorm(), Y.stableNorm()), difference = (X - Y).stableNorm();
  if (difference == 0 || !std::isfinite(size)) return 16;
  return std::clamp(-std::log10(difference / size), 0.0, 16.0);
}

/// The fewest digits in which two runs agree, over the quantities that both answer.
double agreement(const std::vector<Answer>& one, const std::vector<Answer>& other) {
  if (one.size() != other.size()) return 0;
  double fewest = 16;
  for (std::size_t k = 0; k < one.size(); ++k) {
    const Answer &a = one[k], &b = other[k];
    if (a.held.size() > 0 && b.held.size() > 0) fewest = std::min(fewest, digits_between(a.held, b.held));
    if (a.gain && b.gain) fewest = std::min(fewest, digits_between(*a.gain, *b.gain));
    if (a.state && b.state)
      fewest = std::min(fewest, digits_between(Matrix<double>(*a.state), Matrix<double>(*b.state)));
  }
  return fewest;
}

/// The answers with P in the place of whatever is held.
std::vector<Answer> as_covariances(const std::vector<Answer>& answers) {
  std::vector<Answer> plain = answers;
  for (Answer& answer : plain) {
    const auto P = covariance(answer);
    answer.held = P ? P->rounded() : Matrix<double>();
    answer.holds = Held::covariance;
  }
  return plain;
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + std::ssize(values) / 2;
  std::ranges::nth_element(values, middle);
  return *middle;
}

struct Case {
  const System* system;
  Problem<CovarianceModel<double>> numbers;
  std::vector<Answer> answers;  ///< the subject's
  std::vector<Answer> right;
};

std::vector<Case> cases_of(const Traits& traits, std::span<const Run> runs) {
  std::vector<Case> cases;
  for (const Run& run : runs) {
    if (run.ending.kind != Ending::Kind::done || run.answers.empty()) continue;
    auto numbers = covariance_numbers(run.system);
    if (!numbers) continue;
    auto right = reenact(run.system, *numbers, traits, {});
    if (right) cases.push_back({&run.system, *std::move(numbers), as_covariances(run.answers), *std::move(right)});
  }
  return cases;
}

/// How many digits agree by rounding on this system, where fewer than enough do; nothing if it does not say.
std::optional<double> digits_to_expect(const Traits& traits, const Case& one, const std::vector<Answer>& mistaken,
                                       const std::vector<const Mistake*>& made) {
  const auto disturbed = reenact(*one.system, one.numbers, traits, made, roundings * traits.roundoff);
  if (!disturbed) return std::nullopt;
  const double digits = std::min(enough_digits(traits), agreement(mistaken, *disturbed) - digits_by_coding);
  return digits < least_digits(traits) ? std::nullopt : std::optional(digits);
}

/// How well these mistakes explain; nothing if they show nowhere.
std::optional<Diagnosis> tried(const Traits& traits, const std::vector<Case>& cases, std::vector<const Mistake*> made) {
  Diagnosis diagnosis{std::move(made), 0, 0, 0, 0};
  const double enough = enough_digits(traits);
  std::vector<double> digits, right;
  int refuted = 0;
  for (const Case& one : cases) {
    const auto mistaken = reenact(*one.system, one.numbers, traits, diagnosis.mistakes);
    if (!mistaken) continue;
    const double as_mistaken = agreement(one.answers, *mistaken), as_right = agreement(one.answers, one.right);
    bool agrees = as_mistaken >= enough;
    if (!agrees) {
      const auto expected = digits_to_expect(traits, one, *mistaken, diagnosis.mistakes);
      if (!expected) continue;
      agrees = as_mistaken >= *expected;
    }
    refuted += !agrees;
    // Where the mistake changes nothing it explains nothing, but must not explain worse than the right filter does.
    if (agreement(*mistaken, one.right) < enough) {
      ++diagnosis.systems;
      diagnosis.agree += agrees;
      digits.push_back(as_mistaken);
      right.push_back(as_right);
    }
    if (refuted > static_cast<int>((1 - sure) * static_cast<double>(cases.size())) + 1) return std::nullopt;
  }
  if (diagnosis.systems == 0) return std::nullopt;
  diagnosis.digits = median(std::move(digits));
  diagnosis.right_digits = median(std::move(right));
  return diagnosis;
}

// --- guesses ------------------------------------------------------------------------------------------------------------------

/// So many are checked, on so many systems: what a check of one mistake costs is the time of that many cases.
constexpr std::size_t most_checked = 12, systems_compared = 15;

/// The digits of the mistake where it shows; nothing if it shows nowhere.
std::optional<Candidate> nearness(const Traits& traits, const std::vector<Case>& cases, const Mistake& mistake) {
  const Mistake* made = &mistake;
  std::vector<double> digits, right;
  for (const Case& one : cases) {
    const auto mistaken = reenact(*one.system, one.numbers, traits, std::span(&made, 1));
    if (!mistaken || agreement(*mistaken, one.right) >= enough_digits(traits)) continue;
    digits.push_back(agreement(one.answers, *mistaken));
    right.push_back(agreement(one.answers, one.right));
  }
  if (digits.empty()) return std::nullopt;
  Candidate candidate;
  candidate.mistake = made;
  candidate.digits = median(std::move(digits));
  candidate.right_digits = median(std::move(right));
  return candidate;
}

/// What the laws say of the mistake beside what they said of the subject.
void compare_laws(const CheckReport& report, Candidate& candidate) {
  const auto subject = mistaken(report.subject, {candidate.mistake});
  Truths truths;
  Bench bench(*subject, truths);
  const std::size_t count = std::min(systems_compared, report.runs.size());
  int cells_alike = 0, cells_either = 0;
  std::vector<bool> of_subject(report.laws.size()), of_mistake(report.laws.size());
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t at = i * report.runs.size() / count;
    const System& system = report.runs[at].system;
    bench.forget();
    truths.forget();
    if (refusal(subject->traits(), system)) continue;
    ++candidate.systems;
    std::vector<bool> broken(report.laws.size());
    for (const std::size_t law : report.broken[at]) broken[law] = true;
    for (std::size_t law = 0; law < report.laws.size(); ++law) {
      const auto finding = report.laws[law].law.examine(bench, system);
      const bool breaks = finding && !(finding->ratio <= largest_ratio);
      cells_alike += breaks && broken[law];
      cells_either += breaks || broken[law];
      if (breaks) of_mistake[law] = true;
      if (broken[law]) of_subject[law] = true;
    }
  }
  for (std::size_t law = 0; law < report.laws.size(); ++law) {
    candidate.alike += of_subject[law] && of_mistake[law];
    candidate.either += of_subject[law] || of_mistake[law];
  }
  candidate.likeness = cells_either > 0 ? static_cast<double>(cells_alike) / cells_either : 0;
}

}  // namespace

std::string Candidate::sentence() const {
  return fmt::format(
      "{}: {} of {} laws fail alike; {:.0f} digits of its answers agree where it shows, with the right filter's {:.0f}",
      mistake->sentence, alike, either, std::floor(digits), std::floor(right_digits));
}

std::vector<Candidate> candidates(const CheckReport& report, const std::function<bool()>& stop) {
  const Traits& traits = report.subject;
  const std::vector<Case> cases = cases_of(traits, report.runs);
  std::vector<Candidate> all;
  for (const Mistake& mistake : mistakes())
    if (auto candidate = nearness(traits, cases, mistake)) all.push_back(*std::move(candidate));
  const auto gained = [](const Candidate& one) { return one.digits - one.right_digits; };
  std::ranges::stable_sort(all, [&](const Candidate& a, const Candidate& b) { return gained(a) > gained(b); });
  if (all.size() > most_checked) all.resize(most_checked);
  std::vector<Candidate> near;
  for (Candidate& one : all) {
    if (stop && stop()) break;
    compare_laws(report, one);
    if (gained(one) >= 1 || (gained(one) >= 0 && one.likeness >= .5)) near.push_back(one);
  }
  const auto rank = [&](const Candidate& one) {
    return one.likeness + std::min(1.0, gained(one) / enough_digits(traits));
  };
  std::ranges::stable_sort(near, [&](const Candidate& a, const Candidate& b) { return rank(a) > rank(b); });
  if (near.size() > most_named) near.resize(most_named);
  return near;
}

std::string Diagnosis::sentence() const {
  std::string what;
  for (const Mistake* mistake : mistakes) what += fmt::format("{}{}", what.empty() ? "" : ", and ", mistake->sentence);
  return fmt::format(
      "answers as a filter that {} ({:.0f} digits agree on {} of {} systems where it shows; of the right filter "
      "{:.0f})",
      what, std::floor(digits), agree, systems, std::floor(right_digits));
}

std::vector<Diagnosis> diagnose(const Traits& traits, std::span<const Run> runs) {
  const std::vector<Case> cases = cases_of(traits, runs);
  std::vector<Diagnosis> found;
  const auto keep = [&](std::vector<const Mistake*> made) {
    if (auto diagnosis = tried(traits, cases, std::move(made)); diagnosis && diagnosis->confidence() >= sure)
      found.push_back(*std::move(diagnosis));
  };
  for (const Mistake& mistake : mistakes()) keep({&mistake});
  if (found.empty())
    for (const Mistake& one : mistakes())
      for (const Mistake& other : mistakes())
        if (&one < &other) keep({&one, &other});
  // That which shows most often and still agrees says most.
  std::ranges::stable_sort(found, [](const Diagnosis& a, const Diagnosis& b) { return a.agree > b.agree; });
  if (found.size() > most_named) found.resize(most_named);
  return found;
}

}  // namespace kfstab::properties
