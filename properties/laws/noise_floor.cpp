#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <kfstab/filters/symmetric_eigen.hpp>

namespace kfstab::properties::laws {

namespace {

/// How far below 0 the smallest eigenvalue of a symmetric matrix lies. X was formed in 100 digits; rounding it to double costs
/// u |X|, at most a unit or two of the ratio.
double below_zero(const Precise& X) {
  Matrix<double> rounded = X.rounded(), vectors(X.rows(), X.rows());
  if (rounded.rows() == 0) return 0;
  if (!symmetric_eigen(rounded, vectors)) return std::numeric_limits<double>::infinity();
  return std::max(0.0, -rounded.diagonal().minCoeff());
}

std::optional<double> ratio(const ObservedStep& s) {
  if (s.size.n == 0 || !s.answers_predicted()) return std::nullopt;
  // (iii) and others turn an asymmetry of P into an error of the symmetric part: not this law's matter.
  const double P = s.before.norm();
  if ((s.before - s.before.transposed()).norm() > s.rounding() * P) return std::nullopt;
  const Precise floor = s.B * s.Q * s.B.transposed();
  // Twice the symmetric part, so that no half is needed.
  double error = below_zero(s.P + s.P.transposed() - floor - floor) / 2;
  if (s.subject.holds == Held::covariance && s.gain) {
    // P+ = F P F' + K R K' + B Q B': what was negative in P before the step is not this step's error.
    const Precise KC = *s.gain * s.C;
    const Precise F = s.subject.gain == GainKind::predictor ? s.A - KC : s.A - s.A * KC;
    const double inherited = below_zero(s.before + s.before.transposed()) / 2;
    error = std::max(0.0, error - F.norm() * F.norm() * inherited);
  }
  return s.ratio(error, 1, s.amplification());
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, ratio); }

}  // namespace

Law noise_floor() {
  return {
      .id = "noise-floor",
      .statement =
          "P+ >= B Q B': no measurement tells of noise that has yet to come. Where P itself has a negative eigenvalue: "
          "P+ >= B Q B' + "
          "|F|^2 lambda_min(P), F = A - K C. Of an information filter: Q^{-1} >= B' P_{k|k-1}^{-1} B",
      .assumptions =
          "steps that start with |P - P'| <= u (n+m+p) |P|; not the first step of an information filter, which has no "
          "time update",
      .source = "theory 2: P+ - B Q B' = A P_{k|k} A', a covariance",
      .tolerance =
          "30 u (n+m+p) kappa (|A|^2 |P| + |B|^2 |Q| + |K| |C P A'|), kappa = (|R| + |C|^2 |P|) |Re^{-1}|; for a "
          "filter that "
          "holds a root of P without the last term and with 1 + kappa^{1/2} for kappa; for one that holds T or Y = "
          "T'T: 30 u (n+m+p) kappa (|Q^{-1}| + "
          "|B|^2 (|T|^2 |A^{-1}|^2 + |R^{-1/2} C|^2)), kappa = 1 + (|Q^{-1/2}| + |T| |A^{-1}B|) |Qe|^{1/2}, squared "
          "where Y is held, "
          "Qe^{-1} = Q^{-1} + (T A^{-1}B)'(T A^{-1}B)",
      .failure =
          "P_{k|k} is not positive semidefinite, or the process noise was added with a wrong sign, weight or root.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws
