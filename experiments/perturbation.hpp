#pragma once

#include <vector>

#include <kfstab/filters/metadata.hpp>
#include <kfstab/properties/system.hpp>
#include <kfstab/reference/trajectory.hpp>

/// How an error travels through a filter: two runs side by side, one from P0 and x0, the other from P0 + dP and x0 +
/// dx.
namespace kfstab::experiments {

/// P of what a filter holds, n x n, in double. For deviations that are large beside rounding; what a filter's own
/// rounding did is measured by reference::Trajectory. Not for Held::gain.
Matrix<double> covariance_of(const Metadata& filter, const Matrix<double>& held);

/// The difference of the two runs after a step; its P is predicted or filtered as the filter's metadata say.
struct Deviation {
  Matrix<double> P, gain;  ///< P is empty for a filter that holds none
  Vector<double> x;        ///< empty in a run without data
};

/// The deviations after steps 0, 1 ... of system.steps.
/// @param dP  n x n, symmetric, or empty for none; system.P0 is written as a covariance. Each parametrisation takes P0 and
///            P0 + dP, rounded once.
/// @param dx  n, or empty for none
/// @param y   p x steps, or empty for a run without data
/// Ends early where one of the two runs breaks down.
std::vector<Deviation> deviations(const Metadata& filter, const properties::System& system, const Matrix<double>& dP,
                                  const Vector<double>& dx, const Matrix<double>& y);

/// The sizes of the deviations of P, step by step.
std::vector<double> sizes_of_P(const std::vector<Deviation>& deviations);

/// The largest of the last 20 sizes: of two runs that have long forgotten what disturbed one of them, what their rounding
/// makes of the deviation. The floor of a filter, which is higher where P^{-1} is held.
double noise(const std::vector<double>& sizes);

/// What carries an error of P_{0|-1} to what each filter holds after steps 0, 1 ...: the products of the closed loops,
/// theory (3.4) and (3.5), along the true P of the system, read in the parametrisation given.
struct Transitions {
  std::vector<Matrix<double>> predicted;  ///< F_k ... F_0
  std::vector<Matrix<double>> filtered;   ///< (I - Kf C_k) A_{k-1} ... A_0 (I - Kf C_0)
  std::vector<reference::Truth> truths;

  const std::vector<Matrix<double>>& of(Instant instant) const {
    return instant == Instant::predicted ? predicted : filtered;
  }
  const Matrix<double>& P(Instant instant, std::size_t k) const {
    return instant == Instant::predicted ? truths[k].P_next : truths[k].P_filtered;
  }
};
Transitions transitions(const properties::System& system, Parametrisation form = Parametrisation::covariance);

/// X Y Z'.
Matrix<double> carried(const Matrix<double>& X, const Matrix<double>& Y, const Matrix<double>& Z);

/// The filters of the registry that hold P, a root of it or of its inverse, and keep an error of it symmetric, coding
/// (i) among them. In the other codings the asymmetry of their own rounding grows meanwhile (claim
/// asymmetry-divergence); an error of a filter that holds increments does not go by the closed loop (claim
/// chandrasekhar-memory); and the rounding of one that holds P^{-1} itself, by normal equations, covers what is looked
/// for (claim normal-equations).
std::vector<const Metadata*> forgetful_filters();

}  // namespace kfstab::experiments
