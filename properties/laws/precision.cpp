#include <kfstab/properties/comparison.hpp>

#include <algorithm>
#include <cmath>

namespace kfstab::properties::laws::precision {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  const System base = with_data(system);
  const Course& course = bench.course(system);
  const Run& run = bench.run(base);
  const auto tolerance = tolerances(bench, base, system);
  Comparison comparison;
  for (std::size_t k = 0; k < std::min(run.answers.size(), tolerance.size()); ++k) {
    const auto step = static_cast<std::int64_t>(k);
    const Matrix<double> P = values(run.answers[k]).P, &truth = course.P(step);
    if (P.size() == 0) break;
    const double size = truth.norm();
    // Once it is gone for another reason, there is nothing to be told.
    if ((P - truth).norm() > std::ldexp(size, -18)) break;
    if (largest_ratio * tolerance[k].P <= std::ldexp(size, -34))
      comparison.add(step, "P", P, truth, tolerance[k].P, "too far off for the roundoff");
  }
  return comparison.worst();
}

}  // namespace

Law law() {
  return {.id = "precision",
          .statement = "Errors of P are of the size of the roundoff that the filter works with",
          .assumptions =
              "steps in which P is well-conditioned enough to tell 2^-53 from 2^-24 (30 b <= 2^-34 |P|) and the answer "
              "is right to 2^-18",
          .source = "theory 4: the first-order bounds are proportional to u",
          .tolerance = "30 b, b the tolerance of comparison.hpp; applies to errors below 2^-18 |P| alone",
          .failure =
              "The answers are right, but only to some 7 digits: somewhere a number passes through single precision, "
              "through a text with few digits, or through a difference quotient. A filter that computes in single "
              "precision is to say so.",
          .reference = true,
          .examine = examine};
}

}  // namespace kfstab::properties::laws::precision
