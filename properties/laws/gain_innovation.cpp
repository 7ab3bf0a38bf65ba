#include <kfstab/properties/law.hpp>

#include <cmath>

namespace kfstab::properties::laws {

namespace {

std::optional<double> of_covariance(const ObservedStep& s) {
  // Where P is not quite symmetric, P C' and (C P)' are two things: (ii) and (iv) take the gain from the second, and
  // (ii) its Re as well.
  const auto coding = s.subject.asymmetry;
  const bool transposed_gain = coding == Asymmetry::mixed || coding == Asymmetry::cp;
  const Precise P = transposed_gain ? s.prior.transposed() : s.prior;
  const Precise Re = coding == Asymmetry::mixed ? s.Re.transposed() : s.Re;
  const bool predictor = s.subject.gain == GainKind::predictor;
  const Precise PC = P * s.C.transposed();
  const double error = (*s.gain * Re - (predictor ? s.A * PC : PC)).norm();

  const double A = s.A.norm(), B = s.B.norm(), C = s.C.norm(), p = s.prior.norm();
  const double innovation = s.R.norm() + C * C * p;
  const double state = predictor ? A * A * p + B * B * s.Q.norm() : p;
  double gain = s.gain->norm();
  if (coding == Asymmetry::downdate) {
    // (v) comes to K by A Kf, which may cancel.
    const auto inverse = Re.inverse();
    if (!inverse) return std::nullopt;
    gain = A * (PC * *inverse).norm();
  }
  const double scale = gain * innovation + std::sqrt(state * innovation);
  return s.ratio(error, 1, scale);
}

std::optional<double> of_information(const ObservedStep& s) {
  const auto R_inverse = s.R.inverse();
  if (!R_inverse) return std::nullopt;
  const double error = (*s.information * *s.gain - s.C.transposed() * *R_inverse).norm();
  const double scale = std::sqrt(static_cast<double>(s.size.n)) * s.information->norm() * s.gain->norm() +
                       s.C.norm() * R_inverse->norm();
  return s.ratio(error, 1, scale);
}

std::optional<double> ratio(const ObservedStep& s) {
  if (s.size.p == 0 || s.size.n == 0 || !s.gain) return std::nullopt;
  return s.information ? of_information(s) : of_covariance(s);
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, ratio); }

}  // namespace

Law gain_innovation() {
  return {
      .id = "gain-innovation",
      .statement =
          "K Re = A P C', Re = R + C P C' (Kf Re = P C' for a filter gain); of an information filter, which holds "
          "P_{k|k}, the "
          "same law as P_{k|k}^{-1} Kf = C' R^{-1}",
      .assumptions = "none; a residual, so no condition number enters: even a gain that is wrong by k(Re) u fulfils it",
      .source = "theory 2; the definition of the gain",
      .tolerance =
          "30 u (n+m+p) (|K| r + sqrt(a r)), r = |R| + |C|^2 |P|, a = |A|^2 |P| + |B|^2 |Q| (a = |P| for a filter "
          "gain; |A| |Kf| for |K| in "
          "coding (v)); "
          "30 u (n+m+p) (n^{1/2} |Y| |Kf| + |C| |R^{-1/2}|^2) for an information filter",
      .failure =
          "The gain does not belong to P: taken after the update instead of before, R used where its root is meant, a "
          "factor "
          "of A too many or too few, or the inverse of Re formed and multiplied.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws
