#include <kfstab/properties/law.hpp>

namespace kfstab::properties::laws::one_step {

namespace {

std::optional<Finding> look(const ObservedStep& s) {
  if (s.size.n == 0 || !s.update || !s.first_order()) return std::nullopt;
  return s.compare("P", s.P, s.after(s.update->P), s.amplification(), s.asymmetric());
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, look); }

}  // namespace

Law law() {
  return {
      .id = "one-step",
      .statement =
          "P+ = A (P - P C' Re^{-1} C P) A' + B Q B', computed without rounding from the filter's own answer before",
      .assumptions =
          "steps whose Re is positive definite and within the reach of first-order bounds: 30 u (n+m+p) kappa <= 1/2",
      .source = "theory (1.2), (4.1) to (4.3)",
      .tolerance =
          "30 u (n+m+p) kappa (|A|^2 |P| + |B|^2 |Q| + |K| |C P A'|), kappa = (|R| + |C|^2 |P|) |Re^{-1}|; of forms "
          "that hold a root, 1 + kappa^{1/2} for kappa and no last term; of those that hold P^{-1}, theory (4.3); and "
          "4 |A|^2 (1 + |Kf C|)^2 |P - P'| of an unsymmetric P",
      .failure =
          "This one step does not do what a Kalman filter does. The numbers are of the smallest step that shows it: do "
          "it by hand. If the first step is right and a later one wrong, something is kept from step to step that "
          "should not be.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::one_step
