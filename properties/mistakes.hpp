#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include <kfstab/properties/bench.hpp>

/// One plain filter, and the mistakes that people make in one: to tell by re-enactment which of them a subject makes.
///
///     Re = R + C P C',  Kf = P C' Re^{-1},  Pf = (I - Kf C) P,  xf = x + Kf (y - C x)
///     P+ = A Pf A' + B Q B',  x+ = A xf + D u
namespace kfstab::properties {

/// The plain filter at work: what its lines read and write. A mistake changes it at one of its moments.
struct PlainFilter {
  /// What the step was given; C, R and y without the rows whose measurement is missing.
  Matrix<double> A, B, C, Q, R, D;
  Vector<double> y, u;
  bool measured = true;  ///< a measurement is there

  Matrix<double> P;  ///< what is held; P0 at the start
  Vector<double> x;

  // Of the measurement update.
  Vector<double> innovation;   ///< y - C x
  Matrix<double> P_prior, Re, Kf;
  Vector<double> x_prior;
  // Of the time update.
  Matrix<double> P_filtered;
  Vector<double> x_filtered;

  Matrix<double> K;   ///< as it is answered
  GainKind gain = GainKind::predictor;

  /// The step's number, and how the steps before went: for whatever is late or frozen.
  std::int64_t k = 0;
  struct Memory {
    std::optional<Matrix<double>> A, B, C, Q, R, Kf, K;
    std::optional<Vector<double>> y, u, x;
  } first, last;  ///< of the first step, and of the step before
};

/// The moments at which a mistake can be made.
enum class Moment {
  start,      ///< x and P hold x0 and P0
  given,      ///< the step's model and data are there, nothing is computed
  innovated,  ///< Re and the innovation are there
  weighed,    ///< Kf is there
  updated,    ///< P and x are those of k|k
  predicted,  ///< P and x are those of k+1|k
  answered,   ///< K is what will be answered; P and x will be, and go on from here
};

struct Mistake {
  std::string_view id;
  std::string_view sentence;  ///< completes "answers as a filter that ...": "takes R for R^{1/2}"
  Moment moment;
  /// Makes the mistake. False where the system leaves no room for it (B left out where B is not square).
  bool (*make)(PlainFilter& filter);
};

/// All mistakes that are known by name, in one order.
std::span<const Mistake> mistakes();

/// A system in the numbers that the plain filter takes; nothing if there are none.
std::optional<Problem<CovarianceModel<double>>> covariance_numbers(const System& system);

/// What the plain filter answers with these mistakes, as a subject of such traits would: P as covariance, x where there are
/// data, K where it answers one. Nothing where one of the mistakes does not fit the system, or Re is singular.
/// @param numbers  covariance_numbers(system)
/// @param disturbance  by how much, relatively, each entry of Re and of P and x as they are predicted or updated is off, up or
///                     down by chance: what the answers lose by it another coding may lose by rounding
std::optional<std::vector<Answer>> reenact(const System& system, const Problem<CovarianceModel<double>>& numbers,
                                           const Traits& traits, std::span<const Mistake* const> made,
                                           double disturbance = 0);

/// The plain filter with these mistakes, as a subject of such traits that holds P. It declines what reenact has no answer for.
std::unique_ptr<Subject> mistaken(Traits traits, std::vector<const Mistake*> made);

}  // namespace kfstab::properties
