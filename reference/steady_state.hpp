#pragma once

#include <kfstab/filters/problem.hpp>
#include <kfstab/reference/error.hpp>

namespace kfstab::reference {

/// Where a time-invariant filter goes: the stabilising solution of the discrete algebraic Riccati equation
///
///     P = A P A' - A P C' (R + C P C')^{-1} C P A' + B Q B',
///
/// each entry computed in high precision and rounded once.
struct SteadyState {
  Matrix<double> P;               ///< P_{k+1|k} as k grows
  Matrix<double> predictor_gain;  ///< K = A P C' Re^{-1}
  Matrix<double> closed_loop;     ///< F = A - K C
  double spectral_radius = 0;     ///< rho(F) < 1: symmetric errors are forgotten by rho(F)^2 a step
  double residual = 0;            ///< of the equation, relative to ||P||_F, before rounding
  int certified_digits = 0;       ///< of P: agreement of two precisions
};

/// By structure-preserving doubling: 2^j steps of the recursion at the cost of one, so the steps needed are as the
/// logarithm of 1/(1 - rho(F)). The problem's initial condition is not used.
/// Throws ReferenceError if the problem is not time-invariant, R is singular, the doubling does not converge, or the
/// solution it finds is not stabilising (an unstable or marginal mode that the noise does not excite).
SteadyState steady_state(const AnyProblem<double>& problem);

/// What the state is like after a long time without measurements: the solution of the Lyapunov equation
///
///     P = A P A' + B Q B',
///
/// each entry computed in high precision and rounded once. A Chandrasekhar filter starts from its root
/// (InitialCovariance::stationary).
struct StationaryCovariance {
  Matrix<double> P;
  double spectral_radius = 0;  ///< rho(A) < 1
  double residual = 0;         ///< of the equation, relative to ||P||_F, before rounding
  int certified_digits = 0;    ///< agreement of two precisions
};

/// By squaring, 2^j terms of the sum of A^i B Q B' (A^i)' at the cost of one. The problem's initial condition, C and R
/// are not used. Throws ReferenceError if the problem is not time-invariant, or rho(A) >= 1: then there is
/// none, or more than one.
StationaryCovariance stationary_covariance(const AnyProblem<double>& problem);

/// The largest modulus of an eigenvalue; 0 for 0 x 0, NaN if X is not finite. By Gelfand's formula, ||X^N||^{1/N} for
/// N = 2^60, in high precision up to n = 32: the spectral radius of the very doubles of X. In double beyond.
double spectral_radius(const Matrix<double>& X);

}  // namespace kfstab::reference
