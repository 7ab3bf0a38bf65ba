#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <kfstab/filters/metadata.hpp>
#include <kfstab/filters/problem.hpp>

/// Random problems made of few-bit numbers: multiples of 1/16 and, for covariances, of 1/256. So the same problem is
/// exactly the same for float, double, long double and high precision, and Q = Q^{1/2} Q^{T/2} holds to the last bit.
namespace kfstab::test {

/// Small random integers from a stated seed, the same on every machine (the standard's distributions are not).
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : engine_(seed) {}

  /// An integer of [low, high].
  int roll(int low, int high);
  /// Entries k/16, |k| <= size.
  Matrix<double> matrix(Index rows, Index cols, int size);
  Vector<double> vector(Index rows, int size);
  /// Lower triangular, well conditioned, diagonal of either sign; zeros above it.
  Matrix<double> lower_root(Index n);

 private:
  std::mt19937_64 engine_;
};

struct Case {
  Dimensions d;
  int period = 1;         ///< models; 1 is time-invariant
  Index inputs = 0;       ///< columns of D
  bool data = true;       ///< y and u are given, states computed
  bool singular = false;  ///< Q and P0 of deficient rank, and A singular

  std::string text() const;
};

/// Whether a filter may be asked to run that case at all.
bool applies(const Metadata& filter, const Case& c);

/// A problem of one parametrisation. What the parametrisation takes is random itself (of an information problem A^{-1}
/// is, not A), so that no conversion rounds.
AnyProblem<double> random_problem(Parametrisation takes, const Case& c, std::uint64_t seed);

/// The same matrix or problem in another scalar; exact where its numbers are.
template <class To, class From>
auto cast(const From& from) {
  return convert(from, [](double x) { return To(x); });
}

}  // namespace kfstab::test
