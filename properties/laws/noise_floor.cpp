#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>

namespace kfstab::properties::laws {

namespace {

/// How far below 0 the smallest eigenvalue of a symmetric matrix lies. X was formed in 100 digits; rounding it to double costs
/// u |X|, at most a unit or two of the ratio.
double below_zero(const Precise& X) {
  const Matrix<double> rounded = X.rounded();
  if (rounded.rows() == 0) return 0;
  const Eigen::SelfAdjointEigenSolver<Matrix<double>> solver(rounded, Eigen::EigenvaluesOnly);
  return std::max(0.0, -solver.eigenvalues()(0));
}

std::optional<double> of_covariance(const ObservedStep& step, const CovarianceStep& s) {
  const double A = s.A.norm(), P = s.P.norm(), B = s.B.norm();
  // (iii) and others turn an asymmetry of P into an error of the symmetric part: not this law's matter.
  if ((s.P - s.P.transposed()).norm() > step.rounding() * P) return std::nullopt;
  const double k = s.Re.condition();
  const bool factor = step.filter.holds == Held::covariance_factor;
  const double kappa = factor ? 1 + std::sqrt(k) : k;
  const Precise floor = s.B * s.Q * s.B.transposed();
  // Twice the symmetric part, so that no half is needed.
  const double error = below_zero(s.P_plus + s.P_plus.transposed() - floor - floor) / 2;
  const double gain = factor ? 0 : s.gain.norm() * (s.C * s.P * s.A.transposed()).norm();
  const double scale = A * A * P + B * B * s.Q.norm() + gain;
  return error == 0 ? 0 : error / (step.rounding() * kappa * scale);
}

/// P_{k|k-1} >= B Q B' says of inverses, with Q and P definite, that Q^{-1} >= B' P_{k|k-1}^{-1} B.
std::optional<double> of_information(const ObservedStep& step, const InformationStep& s) {
  if (step.k == 0) return std::nullopt;
  const auto A = s.A_inverse.inverse();
  if (!A) return std::nullopt;
  const Precise B = *A * s.A_inverse_B;
  const Precise R_C = s.R_inverse_root * s.C;
  const Precise predicted = s.T.transposed() * s.T - R_C.transposed() * R_C;
  const Precise Q_inverse = s.Q_inverse_root.transposed() * s.Q_inverse_root;
  const double error = below_zero(Q_inverse - B.transposed() * predicted * B);

  const Precise T_B = s.T_before * s.A_inverse_B;
  const double k_Qe = std::sqrt((Q_inverse + T_B.transposed() * T_B).condition());
  const double k_A = s.A_inverse.condition();
  const double kappa = k_A + s.R_inverse_root.condition() + k_Qe * (s.Q_inverse_root.condition() + k_A);
  const double T = s.T.norm(), b = B.norm();
  const double scale = Q_inverse.norm() + b * b * T * T;
  return error == 0 ? 0 : error / (step.rounding() * kappa * scale);
}

std::optional<double> ratio(const ObservedStep& step) {
  if (step.size.n == 0) return std::nullopt;
  return step.covariance ? of_covariance(step, *step.covariance) : of_information(step, *step.information);
}

}  // namespace

Law noise_floor() {
  return {
      .id = "noise-floor",
      .statement = "P+ >= B Q B': no measurement tells of noise that has yet to come. Of an information filter: Q^{-1} >= B' P_{k|k-1}^{-1} B",
      .assumptions = "steps that start with |P - P'| <= u (n+m+p) |P|; not the first step of an information filter, which has no "
                     "time update",
      .source = "theory 2: P+ - B Q B' = A P_{k|k} A', a covariance",
      .tolerance = "30 u (n+m+p) kappa (|A|^2 |P| + |B|^2 |Q| + |K| |C P A'|), kappa = k(Re); without its last term and with kappa = 1 + k(Re)^{1/2} "
                   "for a filter that holds S; 30 u (n+m+p) kappa (|Q^{-1}| + |B|^2 |T|^2), kappa that of the bound of theory 4, for one "
                   "that holds T",
      .failure = "P_{k|k} is not positive semidefinite, or the process noise was added with a wrong sign, weight or root.",
      .ratio = ratio};
}

}  // namespace kfstab::properties::laws
