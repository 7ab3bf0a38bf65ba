#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <kfstab/properties/law.hpp>

/// What laws that compare two runs have in common: systems that are another one in disguise, and how close their answers must
/// come to each other.
namespace kfstab::properties {

// --- systems in disguise --------------------------------------------------------------------------------------------------

/// The system with data: its own, or, where it has none, small whole numbers made from the sizes.
System with_data(const System& system);
/// The same, in which no measurement is missing: a missing entry is 0.
System measured(const System& system);
/// The system's first steps, at most so many.
System first_steps(const System& system, std::int64_t steps);
/// Its y (p x steps) and u (inputs x steps); a system with data.
struct Columns {
  Matrix<double> y, u;
};
Columns columns(const System& system);
void set_columns(System& system, Columns data);
/// X for each step of the sequence or covariance, as it is written.
Sequence mapped(const Sequence& sequence, const std::function<Matrix<double>(const Matrix<double>&)>& map);
/// Q multiplied by factor: exactly where that is a power of 4, else to rounding.
Covariance multiplied(const Covariance& Q, double factor);
/// diag(Q, q I), order `more` larger: as Q is written, q a power of 4.
Covariance bordered(const Covariance& Q, Index more, double q);

/// P0, Q and R, each larger: 4 P0, 16 Q, 64 R.
System raised(const System& system);
/// The system's start and these steps: the matrices of each, as the system's are written, and the data.
struct Steps {
  std::vector<Matrix<double>> A = {}, B = {}, C = {}, D = {}, Q = {}, R = {};
};
System with_steps(const System& system, Steps steps, Columns data);

/// Other units, all of them powers of two, so that no number is rounded: covariances times 4^covariance, x0, y and u times
/// -2^data (for data != 0), state i times 2^state[i], measurement i times 2^measurement[i].
struct Units {
  int covariance = 0;
  int data = 0;
  std::vector<int> state = {};        ///< n exponents, or none at all
  std::vector<int> measurement = {};  ///< p
};
System in_units(const System& system, const Units& units);
/// What the answer would be in these units.
Answer in_units(const Answer& answer, const Units& units);

/// Other bases: x as T x, y as M y, w as V w, all orthogonal.
struct Bases {
  std::optional<Matrix<double>> T = {}, M = {}, V = {};
};
/// Covariances of full bases go over as roots, those of permutations as they were written, if they were not written as roots.
/// Nothing where Q, R or P0 is no covariance.
std::optional<System> in_bases(const System& system, const Bases& bases);
/// A reflection without zeros, n x n; the cyclic permutation i -> i + 1.
Matrix<double> reflection(Index n);
Matrix<double> cycle(Index n);

// --- answers that are compared --------------------------------------------------------------------------------------------

/// P, K and x of an answer; 0 x 0 what it does not have. P is formed of a factor in 100 digits and rounded once.
struct Values {
  Matrix<double> P, K;
  Vector<double> x;
};
Values values(const Answer& answer);

/// Whether a system is small enough that a course of its own is cheap: n, m, p <= 4.
bool small(const System& system);

/// How far an answer may be from the truth, absolute, in Frobenius norms, and that for a system whose numbers were rounded
/// once more on their way:
///
///     b_P = (Course::P_bound) + |W| + u (n+m+p) |P|,     W+ = F W F' + u (n+m+p) (|A|^2 (2 |Pf| + |Kf|^2 |R| + 2 |Kf| |C| |Pf|) + 2 |B|^2
///     |Q|) I
///
/// the second what a change by u (n+m+p) of A, B, C, Q, R and P0 does to P, to first order; b_K and b_x likewise. Infinite from the
/// first step on at which 30 b_P is no more small, of |P| or of |C|^-2 |Re^{-1}|^-1, or at which P of a filter that holds it has
/// lost its symmetry by more than that: what an asymmetry does is the law `symmetry`'s matter.
struct Tolerance {
  double P, K, x;
};
/// Of the steps that the run answered and the reference knows. whole: a system that the system is the first steps of, but perhaps for its
/// data; its course is the one that is asked, so that few are computed.
std::vector<Tolerance> tolerances(Bench& bench, const System& system, const System& whole);
std::vector<Tolerance> tolerances(Bench& bench, const System& system);
/// The `whole` of measured(system): the system itself, unless measurements are missing.
System counted(const System& system);

/// Whether equal bits may be asked of the subject: of those of the registry, whose code is known. What others compute with may sum in
/// an order that depends on where in memory a matrix lies.
bool bits_count(const Traits& traits);

/// The worst of many comparisons.
class Comparison {
 public:
  /// found - expected, against their tolerance; neither counts where it is 0 x 0. An infinite tolerance excuses everything.
  void add(std::int64_t step, std::string_view name, const Matrix<double>& found, const Matrix<double>& expected,
           double tolerance, std::string_view because);
  void add(std::int64_t step, const Values& found, const Values& expected, const Tolerance& tolerance,
           std::string_view because);
  /// Infinite where one bit (but that of the sign of 0) differs.
  void add_bits(std::int64_t step, std::string_view name, const Matrix<double>& found, const Matrix<double>& expected,
                std::string_view because);
  /// found >= expected, as symmetric matrices, up to the tolerance.
  void add_order(std::int64_t step, std::string_view name, const Matrix<double>& found, const Matrix<double>& least,
                 double tolerance, std::string_view because);
  void add(Finding finding);
  const std::optional<Finding>& worst() const { return worst_; }

 private:
  std::optional<Finding> worst_;
};

/// The subject's run in other units against its run of the system: bit by bit if `bits` and bits count, else within the
/// tolerances of both. Endings have to be the same where bits are.
std::optional<Finding> compare_units(Bench& bench, const System& system, const System& whole, const Units& units,
                                     bool bits);

/// The subject's run in other bases against its run of the system, within twice the tolerance.
std::optional<Finding> compare_bases(Bench& bench, const System& system, const System& whole, const Bases& bases,
                                     std::string_view because);

/// Bits of two runs of the same system; of a foreign filter within the tolerances.
std::optional<Finding> compare_again(Bench& bench, const System& system, const System& whole, const Run& found,
                                     const Run& expected, std::string_view because);

/// Two runs that differ in their data alone: P and K the same, x of the other more by `moved`, within the tolerances of both.
std::optional<Finding> compare_moved(Bench& bench, const System& system, const System& whole, const System& other,
                                     const std::vector<Vector<double>>& moved, std::string_view because);

}  // namespace kfstab::properties
