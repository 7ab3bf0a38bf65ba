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

/// A mistake explains if it does so on nearly all systems: on some, ill conditioned, even right codings agree to few digits.
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
    // Where the mistake changes nothing it explains nothing, but must not explain worse than the right filter does.
    if (agreement(*mistaken, one.right) >= enough) {
      refuted += as_mistaken < enough;
    } else {
      ++diagnosis.systems;
      diagnosis.agree += as_mistaken >= enough;
      refuted += as_mistaken < enough;
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

}  // namespace

std::string Diagnosis::sentence() const {
  std::string what;
  for (const Mistake* mistake : mistakes) what += fmt::format("{}{}", what.empty() ? "" : ", and ", mistake->sentence);
  return fmt::format(
      "answers as a filter that {} ({:.0f} digits agree on {} of {} systems where it shows; of the right filter "
      "{:.0f})",
      what, std::floor(digits), agree, systems, std::floor(right_digits));
}

std::vector<Diagnosis> diagnose(const Traits& traits, std::span<const Run> runs) {
  std::vector<Case> cases;
  for (const Run& run : runs) {
    if (run.ending.kind != Ending::Kind::done || run.answers.empty()) continue;
    auto numbers = covariance_numbers(run.system);
    if (!numbers) continue;
    auto right = reenact(run.system, *numbers, traits, {});
    if (right) cases.push_back({&run.system, *std::move(numbers), as_covariances(run.answers), *std::move(right)});
  }
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
