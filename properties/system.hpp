#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <kfstab/filters/metadata.hpp>
#include <kfstab/filters/problem.hpp>

namespace kfstab::properties {

/// An entry that was written exactly and is no double ("1/3", "1e-30"): its text, and where it stands. It holds as long
/// as the double in its place is the nearest one; a double that code puts there instead counts as itself.
/// exact.hpp makes numbers of it.
struct ExactEntry {
  std::size_t matrix = 0;  ///< of a Sequence
  Index row = 0;
  Index col = 0;
  std::string text;

  friend bool operator==(const ExactEntry&, const ExactEntry&) = default;
};

/// A matrix over time.
struct Sequence {
  enum class Kind {
    constant,  ///< one matrix
    list,      ///< one for each step
    periodic,  ///< matrix k mod size at step k
  };

  Kind kind = Kind::constant;
  /// At least one, all of one shape; of a list, one for each step of the system.
  std::vector<Matrix<double>> matrices;
  /// Ordered by matrix.
  std::vector<ExactEntry> exact;

  Sequence() : matrices(1) {}
  Sequence(Matrix<double> constant) : matrices(1, std::move(constant)) {}
  Sequence(Kind k, std::vector<Matrix<double>> over_time) : kind(k), matrices(std::move(over_time)) {}

  const Matrix<double>& at(std::int64_t k) const { return matrices[static_cast<std::size_t>(k) % matrices.size()]; }
  Index rows() const { return matrices.front().rows(); }
  Index cols() const { return matrices.front().cols(); }
  /// The same as a list, one matrix a step, with what was written exactly.
  Sequence unrolled(std::int64_t steps) const;
};

/// A covariance as it was written: itself, symmetric and positive semidefinite, or a lower root of it, L with LL' the
/// covariance. The one is not turned into the other before a Problem asks for it.
struct Covariance {
  enum class Written { covariance, root };

  Written written = Written::covariance;
  Sequence value;
};

/// A Kalman filtering problem as somebody wrote it:
///
///     x_{k+1} = A x_k + B w_k + D u_k,    y_k = C x_k + v_k,    E w w' = Q,    E v v' = R,    x_{0|-1} = x0, P_{0|-1} = P0
///
/// A (n x n), B (n x m), C (p x n), D (n x inputs; no columns where there is no known input), Q (m x m), R (p x p), each
/// constant, periodic or one a step; P0 (n x n) and x0 (n) are constant. Read from a file (system_file.hpp), drawn
/// (generators.hpp) or made in code. Units are the writer's.
///
/// Filters take doubles. Entries that were written exactly are kept beside them, for the reference.
struct System {
  std::string name;
  std::string description;
  std::string source;
  /// What the file's [parameters] came to, overrides included; nothing here is computed from them any more.
  std::map<std::string, double> parameters;

  Sequence A, B, C, D;
  Covariance Q, R, P0;
  Vector<double> x0;
  std::vector<ExactEntry> exact_x0;
  std::int64_t steps = 1;
  /// The measurements and inputs of the steps; null where covariances and gains alone are to be run.
  std::shared_ptr<const Data> data;

  Dimensions dimensions() const { return {A.rows(), B.cols(), C.rows()}; }
  Index inputs() const { return D.cols(); }
  bool time_invariant() const;
  /// How many models tell the whole run: 1, a common period, or one a step.
  std::size_t model_count() const;
};

/// Why a filter or a parametrisation does not apply to a system, as one sentence: "srif needs an invertible A: A (step
/// 3) is singular".
struct Refusal {
  std::string reason;
};

/// The numbers that one parametrisation takes of a system, each the exact value from the doubles written, rounded once
/// to double (what was written exactly counts as the double nearest to it; see exact.hpp for more):
///
///  - what is written in the form asked for is passed on bit by bit;
///  - covariance from a root: LL', exactly symmetric;
///  - root from a covariance: the lower Cholesky root with a diagonal >= 0. A pivot of 0 gives a column of 0. A covariance
///    that is positive semidefinite only up to its own rounding (see admissible_covariance) has (1 + n eps) times its
///    diagonal under its root;
///  - information: A^{-1}, A^{-1}B, and upper roots of Q^{-1}, R^{-1}, P0^{-1} with a positive diagonal.
///
/// Models are made for one common period (the least common multiple), for each step if any matrix is listed, and never
/// for more than steps. Refuses a singular A, Q, R or P0 in the information form and values beyond the range of double.
std::variant<AnyProblem<double>, Refusal> problem(const System& system, Parametrisation form);

/// Why the filter does not apply to the system, or nothing: its metadata's needs, one by one. Singular means exactly so,
/// for the numbers written, not nearly so.
std::optional<Refusal> refusal(const Metadata& filter, const System& system);

/// Whether Q may stand for a covariance: entries finite, exactly symmetric, and positive semidefinite but for rounding,
/// that is the smallest eigenvalue of Q scaled to a unit diagonal is >= -n eps, eps = 2^-52. The tolerance is what
/// rounding each entry of a singular covariance can do; scaling makes it as strict for the smallest component as for the
/// largest. Gives what is wrong, or nothing. Q is square.
std::optional<std::string> admissible_covariance(const Matrix<double>& Q);

}  // namespace kfstab::properties
