#include <kfstab/properties/law.hpp>

namespace kfstab::properties::laws::definiteness {

namespace {

std::optional<Finding> look(const ObservedStep& s) {
  if (s.size.n == 0 || !s.update || !s.first_order()) return std::nullopt;
  // P_{k|k} = M P M' + Kf R Kf' with M = I - Kf C: what was negative in P before the step is not this step's error.
  const double m = (Precise::identity(s.size.n) - s.update->Kf * s.C).norm();
  const double a = s.answers_predicted() ? s.A.norm() : 1;
  return s.semidefinite("P", s.P, s.amplification(), a * a * m * m * below_zero(s.prior) + s.asymmetric());
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, look); }

}  // namespace

Law law() {
  return {
      .id = "definiteness",
      .statement =
          "P >= 0; where the P before has a negative eigenvalue, P >= |M|^2 lambda_min(P before), M = A (I - Kf C), or "
          "I - Kf C of P_{k|k}",
      .assumptions =
          "steps whose Re is positive definite and within the reach of first-order bounds: 30 u (n+m+p) kappa <= 1/2",
      .source = "theory 2: P_{k|k} = M P M' + Kf R Kf', a sum of semidefinite terms",
      .tolerance =
          "30 u (n+m+p) kappa (|A|^2 |P| + |B|^2 |Q| + |K| |C P A'|), kappa = (|R| + |C|^2 |P|) |Re^{-1}|; of forms "
          "that hold a root, 1 + kappa^{1/2} for kappa; of those that hold P^{-1}, theory (4.3)",
      .failure =
          "P is no covariance: some combination of the states has a negative variance. Look for a wrong sign in the "
          "update or in the process noise, and at what is done to P after it.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::definiteness
