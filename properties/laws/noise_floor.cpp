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

std::optional<double> of_covariance(const ObservedStep& step, const CovarianceStep& s) {
  const double A = s.A.norm(), P = s.P.norm(), B = s.B.norm();
  // (iii) and others turn an asymmetry of P into an error of the symmetric part: not this law's matter.
  if ((s.P - s.P.transposed()).norm() > step.rounding() * P) return std::nullopt;
  const double k = s.innovation_condition();
  const bool factor = holds_root(step.filter.holds);
  const double kappa = factor ? 1 + std::sqrt(k) : k;
  const Precise floor = s.B * s.Q * s.B.transposed();
  // Twice the symmetric part, so that no half is needed.
  double error = below_zero(s.P_plus + s.P_plus.transposed() - floor - floor) / 2;
  if (!factor) {
    // P+ = F P F' + K R K' + B Q B': what was negative in P before the step is not this step's error.
    const Precise KC = s.gain * s.C;
    const Precise F = step.filter.gain == GainKind::predictor ? s.A - KC : s.A - s.A * KC;
    const double inherited = below_zero(s.P + s.P.transposed()) / 2;
    error = std::max(0.0, error - F.norm() * F.norm() * inherited);
  }
  const double gain = factor ? 0 : s.gain.norm() * (s.C * s.P * s.A.transposed()).norm();
  const double scale = A * A * P + B * B * s.Q.norm() + gain;
  return step.ratio(error, kappa, scale);
}

/// P_{k|k-1} >= B Q B' says of inverses, with Q and P definite, that Q^{-1} >= B' P_{k|k-1}^{-1} B.
std::optional<double> of_information(const ObservedStep& step, const InformationStep& s) {
  if (step.k == 0) return std::nullopt;
  const auto A = s.A_inverse.inverse();
  if (!A) return std::nullopt;
  const Precise B = *A * s.A_inverse_B;
  const Precise R_C = s.R_inverse_root * s.C;
  const Precise predicted = s.Y - R_C.transposed() * R_C;
  const Precise Q_inverse = s.Q_inverse_root.transposed() * s.Q_inverse_root;
  const double error = below_zero(Q_inverse - B.transposed() * predicted * B);

  // The pre-array's columns are [Q^{-1/2}; T A^{-1}B; 0] and [0; T A^{-1}; R^{-1/2} C]: the first are eliminated from the second.
  const auto Qe = (Q_inverse + s.A_inverse_B.transposed() * s.Y_before * s.A_inverse_B).inverse();
  if (!Qe) return std::nullopt;
  const double T = std::sqrt(std::sqrt(static_cast<double>(step.size.n)) * s.Y_before.norm());  // not less than |T|
  const double first = s.Q_inverse_root.norm() + T * s.A_inverse_B.norm();
  const double second = std::hypot(T * s.A_inverse.norm(), R_C.norm());
  const double root_kappa = 1 + first * std::sqrt(Qe->norm());
  const double kappa = step.filter.holds == Held::information ? root_kappa * root_kappa : root_kappa;
  const double b = B.norm();
  return step.ratio(error, kappa, Q_inverse.norm() + b * b * second * second);
}

std::optional<double> ratio(const ObservedStep& step) {
  if (step.size.n == 0) return std::nullopt;
  return step.covariance ? of_covariance(step, *step.covariance) : of_information(step, *step.information);
}

}  // namespace

Law noise_floor() {
  return {
      .id = "noise-floor",
      .statement = "P+ >= B Q B': no measurement tells of noise that has yet to come. Where P itself has a negative eigenvalue: P+ >= B Q B' + "
                   "|F|^2 lambda_min(P), F = A - K C. Of an information filter: Q^{-1} >= B' P_{k|k-1}^{-1} B",
      .assumptions = "steps that start with |P - P'| <= u (n+m+p) |P|; not the first step of an information filter, which has no "
                     "time update",
      .source = "theory 2: P+ - B Q B' = A P_{k|k} A', a covariance",
      .tolerance = "30 u (n+m+p) kappa (|A|^2 |P| + |B|^2 |Q| + |K| |C P A'|), kappa = (|R| + |C|^2 |P|) |Re^{-1}|; for a filter that "
                   "holds a root of P without the last term and with 1 + kappa^{1/2} for kappa; for one that holds T or Y = T'T: 30 u (n+m+p) kappa (|Q^{-1}| + "
                   "|B|^2 (|T|^2 |A^{-1}|^2 + |R^{-1/2} C|^2)), kappa = 1 + (|Q^{-1/2}| + |T| |A^{-1}B|) |Qe|^{1/2}, squared where Y is held, "
                   "Qe^{-1} = Q^{-1} + (T A^{-1}B)'(T A^{-1}B)",
      .failure = "P_{k|k} is not positive semidefinite, or the process noise was added with a wrong sign, weight or root.",
      .ratio = ratio};
}

}  // namespace kfstab::properties::laws
