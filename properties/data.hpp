#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include <kfstab/properties/system.hpp>

/// The two kinds of data that a System can have, and what becomes of measurements that are missing. Streams of both kinds hold
/// one step; asking for more steps than there are throws std::out_of_range.
namespace kfstab::properties {

/// X Y X', each entry a plain sum in order: no blocking, so that small sizes cost little.
Matrix<double> congruence(const Matrix<double>& X, const Matrix<double>& Y);

/// Data that were recorded: y (p x steps) and u (inputs x steps), a step a column. A NaN in y is an entry that is missing.
class Recorded final : public Data {
 public:
  /// exact_y, exact_u: entries that were written exactly, ordered by column.
  Recorded(Matrix<double> y, Matrix<double> u, std::vector<ExactEntry> exact_y = {},
           std::vector<ExactEntry> exact_u = {});
  std::unique_ptr<DataStream> open() const override;

  const std::vector<ExactEntry>& exact_y() const { return exact_y_; }
  const std::vector<ExactEntry>& exact_u() const { return exact_u_; }

 private:
  std::shared_ptr<const Matrix<double>> y_, u_;
  std::vector<ExactEntry> exact_y_, exact_u_;
};

/// Data drawn from the system itself: x_0 from N(x0, P0), then y_k = C x_k + v_k and x_{k+1} = A x_k + B w_k + D u_k with
/// normal noise, in double. The same seed gives the same numbers on every machine with IEEE doubles (Boost.Random's
/// mt19937_64 and normal_distribution). Nothing is kept, so any number of steps can be drawn; those of an unstable system
/// overflow in the end.
class Simulated final : public Data {
 public:
  /// inputs: one column a step, no columns if D has none; exact_inputs as of Recorded. The system's own data are not
  /// used. Throws std::invalid_argument where Q, R or P0 is no covariance.
  Simulated(const System& system, std::uint64_t seed, Matrix<double> inputs = {},
            std::vector<ExactEntry> exact_inputs = {});
  std::unique_ptr<DataStream> open() const override;

  std::uint64_t seed() const { return seed_; }
  const Matrix<double>& inputs() const { return *u_; }
  const std::vector<ExactEntry>& exact_inputs() const { return exact_u_; }

 private:
  std::shared_ptr<const Problem<RootModel<double>>> problem_;
  std::shared_ptr<const Matrix<double>> u_;
  std::vector<ExactEntry> exact_u_;
  std::uint64_t seed_;
};

/// What is measured at a step where entries of y may be missing (NaN): those that are there, and what belongs to them of C and R.
struct Measured {
  Measured(const Matrix<double>& all_C, const Matrix<double>& all_R, const Vector<double>& all_y);

  Matrix<double> C, R;
  Vector<double> y;
  std::vector<Index> entries;  ///< which they are, of all
  Index outputs;               ///< how many there would be

  /// A gain of these entries as one of all: with a column of 0 for each that is missing.
  Matrix<double> of_all(const Matrix<double>& K) const;
};

/// Whether entries of y are missing within the system's steps.
bool measurements_missing(const System& system);

/// The same system with every measurement there: a missing y_i has a row of 0 in C, a variance v and no correlation in R, and
/// is 0, which tells as little. v is its own variance (of a root of R the square of its diagonal), or 1 where that is 0. So
/// missing measurements are run by filters that know nothing of them; P, K (with columns of 0) and x are those of the system,
/// each missing entry adds -log(2 pi v)/2 to the log-likelihood.
///
/// C and R are lists then, one a step; exact entries stay, but for those of a root of R that has to be multiplied out: one
/// in which an entry that is there is correlated with a missing one before it. Throws std::invalid_argument where that is
/// beyond the range of double.
System with_every_measurement(const System& system);

}  // namespace kfstab::properties
