#include <kfstab/properties/law.hpp>

namespace kfstab::properties::laws::noise_floor {

namespace {

std::optional<Finding> look(const ObservedStep& s) {
  if (s.size.n == 0 || !s.answers_predicted()) return std::nullopt;
  // (iii) and others turn an asymmetry of P into an error of the symmetric part: not this law's matter.
  const double P = s.before.norm();
  if ((s.before - s.before.transposed()).norm() > s.rounding() * P) return std::nullopt;
  if (!s.update) return std::nullopt;
  double inherited = 0;
  if (s.subject.holds == Held::covariance) {
    // P+ = F P F' + K R K' + B Q B': what was negative in P before the step is not this step's error.
    const Precise F = s.A - s.A * s.update->Kf * s.C;
    inherited = F.norm() * F.norm() * below_zero(s.before);
  }
  return s.semidefinite("P+ - B Q B'", s.P - s.B * s.Q * s.B.transposed(), s.amplification(), inherited);
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, look); }

}  // namespace

Law law() {
  return {
      .id = "noise-floor",
      .statement =
          "P+ >= B Q B': no measurement tells of noise that has yet to come. Where P itself has a negative eigenvalue: "
          "P+ >= B Q B' + |F|^2 lambda_min(P), F = A - K C",
      .assumptions = "filters that answer P_{k+1|k}; steps that start with |P - P'| <= u (n+m+p) |P|",
      .source = "theory 2: P+ - B Q B' = A P_{k|k} A', a covariance",
      .tolerance =
          "30 u (n+m+p) kappa (|A|^2 |P| + |B|^2 |Q| + |K| |C P A'|), kappa = (|R| + |C|^2 |P|) |Re^{-1}|; for a "
          "filter "
          "that holds a root of P without the last term and with 1 + kappa^{1/2} for kappa",
      .failure =
          "P_{k|k} is not positive semidefinite, or the process noise was added with a wrong sign, weight or root.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::noise_floor
