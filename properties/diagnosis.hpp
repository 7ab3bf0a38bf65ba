#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include <kfstab/properties/check.hpp>
#include <kfstab/properties/mistakes.hpp>

/// Which mistake a filter makes: by re-enactment. A plain filter makes it on the same data; the mistake whose answers agree
/// with the subject's to rounding is it.
namespace kfstab::properties {

/// How well a mistake explains a subject's answers.
struct Diagnosis {
  std::vector<const Mistake*> mistakes;  ///< one, or two that are made together
  /// Decimal digits to which P, K and x agree: the median over the systems of the fewest in each.
  double digits = 0;
  double right_digits = 0;  ///< the same, of the filter without a mistake
  int systems = 0;          ///< on which the mistake shows: the mistaken and the right filter differ
  int agree = 0;            ///< on so many of them the subject answers as the mistaken filter does
  /// agree / systems, 0 to 1: 1 is sure.
  double confidence() const { return systems > 0 ? static_cast<double>(agree) / systems : 0; }

  /// "answers as a filter that takes R for R^{1/2}: R R' stands where R belongs (13 digits agree over 40 systems; of the
  /// right filter 0)"
  std::string sentence() const;
};

/// The mistakes that explain what the subject answered in these runs, the best first; none if none does. Pairs are tried
/// where no single mistake does. What explains counts as explained where nearly all systems on which a mistake shows agree.
/// Mistakes that no system of the runs tells apart come together, the simplest first.
std::vector<Diagnosis> diagnose(const Traits& traits, std::span<const Run> runs);

/// A guess: a mistake that does not explain the subject's answers, but comes near to what is wrong with them.
struct Candidate {
  const Mistake* mistake = nullptr;
  int alike = 0;    ///< laws that both break, on the systems on which the two were compared
  int either = 0;   ///< laws that one of them breaks there
  int systems = 0;  ///< how many these were
  /// Of the pairs of a law and a system on which it fails for one of them, the share on which it fails for both: 0 to 1.
  double likeness = 0;
  /// As of a Diagnosis: digits to which the subject answers as such a filter does, and as the right filter does.
  double digits = 0, right_digits = 0;

  /// "forgets the process noise: 12 of 13 laws fail alike; 6 digits of its answers agree, with the right filter's 0"
  std::string sentence() const;
};

/// Up to three mistakes for a subject whose answers no mistake explains, the likeliest first; none if none comes near. First by
/// the answers: the twelve whose re-enactment gains the most digits over the right filter. These are checked on some of the
/// subject's systems by the laws of the report, and ranked by likeness and digits gained (as a share of those that would explain
/// them), which count the same. One that neither gains a digit nor breaks half of what is broken is none.
/// @param stop  asked before each mistake is tried; may be empty
std::vector<Candidate> candidates(const CheckReport& report, const std::function<bool()>& stop = {});

}  // namespace kfstab::properties
