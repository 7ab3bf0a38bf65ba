#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <kfstab/filters/any_filter.hpp>
#include <kfstab/filters/metadata.hpp>
#include <kfstab/filters/problem.hpp>
#include <kfstab/reference/error.hpp>

/// The truth: the Riccati recursion and the state, in a precision high enough to certify its digits, stepped beside the
/// filters.
///
///     Trajectory truth(problem, data);
///     filter->start(problem);
///     for (k = 0; k < steps; ++k) {
///       truth.advance();
///       auto step = filter->step(k, ...);
///       Errors errors = truth.measure(filter->metadata(), step);
///     }
namespace kfstab::reference {

struct ExactProblem;  // rational.hpp
struct ExactData;

/// What one step of a square-root information filter costs, k-1|k-1 to k|k, theory (4.3): relative to T it loses u times
/// { k(A) + k(R^{1/2}) + (t1/tm) [k(Q^{1/2}) + k(A)] } / cos3, and k(T) times that who asks for P. A and Q are those of step
/// k-1. At k = 0, where only R^{-1/2} C is annexed to T0, (1 + k(R^{1/2})) / cos3: A = 1, spread = 0. All are NaN unless the
/// problem is an information problem.
struct InformationLoss {
  double A = std::numeric_limits<double>::quiet_NaN();               ///< k(A)
  double Q_root = std::numeric_limits<double>::quiet_NaN();          ///< k(Q^{1/2})
  double R_root = std::numeric_limits<double>::quiet_NaN();          ///< k(R^{1/2})
  double spread = std::numeric_limits<double>::quiet_NaN();          ///< t1/tm, the extreme singular values of Qe^{-1/2}
  double inverse_cosine = std::numeric_limits<double>::quiet_NaN();  ///< 1/cos3
  double T = std::numeric_limits<double>::quiet_NaN();               ///< k(T) = k(P_{k|k})^{1/2}

  double amplification() const { return (A + R_root + (spread > 0 ? spread * (Q_root + A) : 0)) * inverse_cosine; }
};

/// What was true at step k, each entry rounded once to double.
struct Truth {
  Matrix<double> P_predicted;  ///< P_{k|k-1}
  Matrix<double> P_filtered;   ///< P_{k|k}
  Matrix<double> P_next;       ///< P_{k+1|k}
  Matrix<double> information;  ///< P_{k|k}^{-1}; empty unless the problem is an information problem

  Matrix<double> innovation;      ///< Re = R + C P C', p x p
  Matrix<double> predictor_gain;  ///< K = A P C' Re^{-1}, n x p
  Matrix<double> filter_gain;     ///< Kf = P C' Re^{-1}, n x p
  Matrix<double> closed_loop;     ///< F = A - K C: carries an error of P_{k|k-1} to P_{k+1|k}
  /// (I - Kf C_k) A_{k-1}: carries an error of P_{k-1|k-1} to P_{k|k}. At k = 0 there is no A_{k-1}: I - Kf C.
  Matrix<double> filtered_closed_loop;

  /// x_{k|k-1}, x_{k|k}, x_{k+1|k}; empty in a run without data.
  Vector<double> x_predicted, x_filtered, x_next;
  /// log p(y_k | y_0 ... y_{k-1}) = -1/2 (p log 2 pi + log det Re + e' Re^{-1} e), e = y - C x_{k|k-1}; NaN in a run
  /// without data.
  double log_likelihood = 0;

  /// k_2(Re), right to all its digits however large; 1 if p = 0.
  double innovation_condition = 1;
  /// cos = ||S_{k+1|k}|| / ||[G S_{k+1|k}]|| = (||P_{k+1|k}|| / ||A P_{k|k-1} A' + B Q B'||)^{1/2}: how much of the
  /// predicted covariance is left after the downdate. 1 where both are 0.
  double cosine = 1;
  /// Its amplification() multiplies u in one step of a square-root information filter.
  InformationLoss information_loss;
};

/// How far a filter is from the truth after one step: measured in the reference's precision, from the exact values of
/// the doubles that it holds. A factor's P is formed exactly (S S' rounded to double would be indefinite half of the
/// time once k(S) > 1e8). Relative to a truth of exactly zero, an error is 0 or infinite. What the filter does not
/// have, or holds with a NaN or an infinity in it, has error NaN.
struct Errors {
  double covariance;   ///< ||P^ - P||_F / ||P||_F, P predicted or filtered as metadata.instant says
  double information;  ///< ||T'T - P^{-1}||_F / ||P^{-1}||_F of one that holds T, else NaN
  double gain;         ///< ||K^ - K||_F / ||K||_F, of the gain that the filter computes: metadata.gain
  double state;        ///< ||x^ - x|| / ||x||; NaN in a run without data
  /// max |p^_ij - p_ij| / sqrt(p_ii p_jj), free of the units of the state. States whose true variance is zero, or not
  /// certified (Trajectory::certified_digits is about norms), are left out.
  double entrywise;
  double asymmetry;            ///< ||P^ - P^'||_F / (2 ||P||_F); 0 for a factor
  double smallest_eigenvalue;  ///< of the symmetric part of P^, with several digits right even when far below u ||P||
  bool positive_semidefinite;  ///< of the symmetric part of P^, decided exactly; always so for finite factors
  double correct_digits;       ///< -log10(covariance), at least 0, at most what the word holds (15.95); 0 if that is NaN
};

/// What a trajectory has beyond the 16 digits of Truth, and certifies. In the notation there.
enum class Quantity {
  P_predicted, P_filtered, P_next, innovation, predictor_gain, filter_gain, x_predicted, x_filtered, x_next, log_likelihood
};
inline constexpr std::size_t quantities = 10;

/// What is asked of a trajectory.
struct Request {
  int digits = 30;       ///< to be certified, 1 to 750
  int first_digits = 0;  ///< the precision to try first, raised to the next rung; 0: what `digits` is likely to need
  /// Certify each entry by itself, not only each quantity relative to its norm. An entry that is no more than rounding of
  /// what it is made of, in both precisions, counts as 0.
  bool each_entry = false;
};

/// The reference trajectory of one problem. Holds the current step and nothing before it.
///
/// It starts from the very numbers of the Problem, read exactly: P0, Q, R as they stand; from roots S0 S0' and so on,
/// reading lower triangles alone; from an information problem A = (A^{-1})^{-1}, B = A (A^{-1} B), Q, R and P0 from
/// upper triangles, E w through w_mean. Then, theory (1.2) with (2.2):
///
///     Re = R + C P C',  Kf = P C' Re^{-1},  P_{k|k} = (I - Kf C) P (I - Kf C)' + Kf R Kf',  P+ = A P_{k|k} A' + B Q
///     B', x_{k|k} = x + Kf (y - C x),  x+ = A x_{k|k} + B E w + D u.
///
/// A second run, the witness, goes beside it at the next lower rung of a ladder of precisions (57, 76, 115, 192 ...
/// 1540 digits) and in another form: P_{k|k} = P - W W' (2.1), gains by triangular solves. Each of its intermediate
/// results is moved at random by 1 to 1024 units in its last place, so that the two cannot agree by losing the same
/// small addend: where they agree to d digits, d digits bear rounding at the lower precision in either form, and are
/// certified. The truth is read from the run of the higher precision. When fewer digits agree than were asked for, both
/// climb, as many rungs as the loss seen so far asks for, and the run is replayed from step 0 (the data opened anew),
/// unseen by the caller.
///
/// Trajectories share nothing: each may run in a thread of its own, and gives the same bits there.
class Trajectory {
 public:
  /// The problem must outlive the trajectory. data may be null: covariances and gains alone.
  /// Throws ReferenceError on shapes that do not agree, numbers that are not finite, Q, R or P0 that are not exactly
  /// symmetric, a singular A^{-1}, Q^{-1/2}, R^{-1/2} or T0.
  Trajectory(const AnyProblem<double>& problem, std::shared_ptr<const Data> data, Request request = {});
  Trajectory(AnyProblem<double>&&, std::shared_ptr<const Data>, Request = {}) = delete;
  /// The same of a problem in exact numbers. What does not fit a double is no error here until truth() asks for it.
  Trajectory(const ExactProblem& problem, std::shared_ptr<const ExactData> data, Request request = {});
  Trajectory(ExactProblem&&, std::shared_ptr<const ExactData>, Request = {}) = delete;
  ~Trajectory();
  Trajectory(Trajectory&&) noexcept;
  Trajectory& operator=(Trajectory&&) noexcept;

  /// Computes step k = 0, 1, 2 ... Throws ReferenceError if Re is not positive definite, if a result does not fit a
  /// double (of a problem in doubles), if the data do not fit the model, or if the digits cannot be certified; then the
  /// trajectory is at its end.
  void advance();

  /// The step that truth() is of; -1 before the first.
  std::int64_t k() const;
  /// Rounded when it is asked for. Throws ReferenceError where a result does not fit a double.
  const Truth& truth() const;

  /// All digits of a quantity of step k() as a sum of doubles, largest first: each term is what the terms before leave,
  /// rounded. Two terms have 32 digits. (Terms below 1e-308 lose digits, as doubles do.)
  std::vector<Matrix<double>> expansion(Quantity quantity, int terms) const;

  /// The entries of a quantity of step k() as decimal numbers, a row of strings each row: as many digits as the two runs
  /// share in that very entry, most_digits at most, each right, the last to a unit. "0" where it is 0 in both; "0e-72",
  /// where they share no digit, says that it is below 10^-72. Empty where there are no data to have a state from.
  std::vector<std::vector<std::string>> decimals(Quantity quantity, int most_digits) const;

  /// The least agreement of the two runs, in decimal digits, over all quantities and steps so far; no more than the
  /// lower precision has. P, P_{k|k}, Re and P^{-1} agree relative to their Frobenius norms. K, Kf, F and x too, unless
  /// both runs say that they are 0: all that is left is rounding of the terms that they are the difference of.
  int certified_digits() const;
  /// The same, of one quantity of step k().
  int certified_digits(Quantity quantity) const;
  /// Decimal digits of the run that the truth is read from.
  int working_digits() const;

  /// Of a filter that has just done step k() of the same problem, in double or in Rounded (rounded.hpp).
  template <class Scalar = double>
  Errors measure(const Metadata& metadata, const Step<Scalar>& step) const;
  /// |p^_ij - p_ij| / sqrt(p_ii p_jj), n x n, of which Errors::entrywise is the largest; 0 in the rows and columns that it
  /// leaves out. Empty for a filter that holds no P, or a P that is not finite.
  Matrix<double> entry_errors(const Metadata& metadata, const Step<double>& step) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace kfstab::reference
