#pragma once

#include <cstdint>
#include <memory>

#include <kfstab/reference/error.hpp>
#include <kfstab/reference/rational.hpp>

/// An oracle: the Kalman filter without rounding.
namespace kfstab::reference {

/// The same numbers as covariances, exactly: covariances as they stand; from roots S0 S0', Q^{1/2} Q^{T/2}, R^{1/2}
/// R^{T/2} of the lower triangles; from an information problem A = (A^{-1})^{-1}, B = A (A^{-1} B), (U'U)^{-1} of the
/// upper triangles U. Where the noise has a mean, D has one more column, B E w, which exact_data() feeds with 1.
/// Throws ReferenceError as the trajectory does of the same problem.
ExactProblem exact_problem(const AnyProblem<double>& problem);

/// The data of that problem, exactly. Null for null.
std::shared_ptr<const ExactData> exact_data(const AnyProblem<double>& problem, std::shared_ptr<const Data> data);

/// What is true at step k, exactly. Shapes as in Truth; the states and weighted_innovation are empty and 0 in a run
/// without data.
struct ExactStep {
  Matrix<Rational> P_predicted, P_filtered, P_next;  ///< P_{k|k-1}, P_{k|k}, P_{k+1|k}
  Matrix<Rational> innovation;                       ///< Re
  Matrix<Rational> predictor_gain, filter_gain;      ///< K = A P C' Re^{-1}, Kf = P C' Re^{-1}
  Vector<Rational> x_predicted, x_filtered, x_next;  ///< x_{k|k-1}, x_{k|k}, x_{k+1|k}
  /// What step k adds to the log-likelihood is -(p log 2 pi + log det Re + e' Re^{-1} e) / 2, e = y - C x_{k|k-1}.
  Rational innovation_determinant, weighted_innovation;
};

/// The textbook recursion in rational numbers, theory (1.2):
///
///     Re = R + C P C',  Kf = P C' Re^{-1},  P_{k|k} = P - Kf C P,  P+ = A P_{k|k} A' + B Q B',
///     x_{k|k} = x + Kf (y - C x),  x+ = A x_{k|k} + D u.
///
/// The numerators grow by as many bits a step as the model has: for some tens of steps of small systems.
class ExactFilter {
 public:
  /// Throws ReferenceError on shapes that do not agree and matrices that are not symmetric.
  explicit ExactFilter(ExactProblem problem, std::shared_ptr<const ExactData> data = nullptr);

  /// Step k = 0, 1, 2 ... Throws ReferenceError, naming the step, unless Re is positive definite: decided exactly, by
  /// the pivots of its LDL' factorisation.
  void advance();

  std::int64_t k() const { return k_; }
  const ExactStep& step() const { return step_; }

 private:
  ExactProblem problem_;
  std::shared_ptr<const ExactData> data_;
  std::unique_ptr<DataStreamOf<Rational>> stream_;
  std::int64_t k_ = -1;
  ExactStep step_;
};

}  // namespace kfstab::reference
