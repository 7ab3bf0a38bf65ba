#pragma once

#include <kfstab/filters/metadata.hpp>
#include <kfstab/reference/trajectory.hpp>

/// What theory excuses: first-order bounds of the rounding errors, and how each coding of the filter carries an
/// asymmetry on.
namespace kfstab::reference {

/// The first-order bound of the relative error of P, step by step: the envelope under which an error curve belongs.
///
/// One step commits a local error of at most delta, and carries the errors before it by the closed loop,
///
///     W_{k+1} = F W_k F' + delta_k I,   -W <= dP <= W (as quadratic forms),   so ||dP||_F / ||P||_F <= ||W||_F /
///     ||P||_F.
///
/// Local errors, theory (4.1)-(4.3), added up by (4.4), with u (n + m + p) for their constant:
///     held P   delta = u (n+m+p) k(Re) / cos^2 ||P+||_2
///     held S   delta = 2 u (n+m+p) (1 + k(Re)^{1/2}) / cos ||P+||_2      (of S, hence twice of P)
///     held T   -d(P^{-1}) within 2 u (n+m+p) {bracket} / cos3 ||P^{-1}||_2 I, mapped to P:  delta I becomes delta P P,
///              and F becomes (I - Kf C) A.
/// It bounds symmetric errors. The asymmetry of a filter that does not symmetrise has its own laws: asymmetry_map.
class FirstOrderBound {
 public:
  /// @param roundoff  u of the numbers that the filter computes with
  FirstOrderBound(const Metadata& metadata, Dimensions dimensions, double roundoff = unit_roundoff<double>());

  /// The bound of ||dP||_F / ||P||_F after the step that the truth is of; steps must be given in order from the first.
  double advance(const Truth& truth);

  /// The bound of ||dK||_F / ||K||_F of the same step, K the gain that the form computes, predictor or filter, theory
  /// (4.6): what was wrong with P before the step, by
  ///
  ///     (tr F W F'  tr Re^{-1} C W C' Re^{-1})^{1/2},      F or, of Kf, I - Kf C,
  ///
  /// with ||Re^{-1}|| in the place of the two Re^{-1}; and what the step adds, with u (n+m+p) for the constant,
  ///     held P   k(Re) ||K||                                          (4.1)
  ///     held S   ((s1/sp) ||S+|| + s1 ||G|| + ||S+|| / cos) / sp      (4.2); of Kf, S_{k|k} in the place of S+
  /// NaN for the forms that hold T or Y, of whose gain section 4 says nothing.
  /// @param C  of the step's model, p x n
  double gain(const Truth& truth, const Matrix<double>& C) const;

 private:
  Held held_;
  Instant instant_;
  GainKind gain_;
  double constant_;
  Matrix<double> W_, W_before_;
};

/// What a coding of the covariance filter makes of an asymmetry D = P - P' in one step, to first order, theory
/// (3.i)-(3.v) and (3.8):
///
///                Re as computed (LU)           one triangle of Re (Cholesky)
///     textbook   F D F'                        F D F' - KC D (KC)'
///     mixed      2 A D A' - F D F'             2 A D A' - F D F' + KC D (KC)'
///     gain       A D A' - KC D (KC)'           A D A'
///     cp         A D A' + KC D (KC)'           A D A'
///     downdate   A D A' + KC D (KC)'           A D A'
///     none       0                             0
///
/// All n x n; KC is the product K C, F = A - KC, D antisymmetric, and so is the result, exactly.
Matrix<double> asymmetry_map(Asymmetry form, bool one_triangle_of_Re, const Matrix<double>& A, const Matrix<double>& KC,
                             const Matrix<double>& F, const Matrix<double>& D);

/// The growth of an asymmetry per step once the gain is constant: the spectral radius of asymmetry_map on the
/// antisymmetric matrices. 0 for n <= 1, where there are none. Costs O(n^6).
double asymmetry_growth(Asymmetry form, bool one_triangle_of_Re, const Matrix<double>& A, const Matrix<double>& KC,
                        const Matrix<double>& F);

}  // namespace kfstab::reference
