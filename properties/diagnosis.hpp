#pragma once

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

}  // namespace kfstab::properties
