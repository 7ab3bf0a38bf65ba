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

/// The same matrix in another scalar; exact where its numbers are.
template <class To, int Columns>
Matrix<To, Dynamic, Columns> cast(const Matrix<double, Dynamic, Columns>& from) {
  Matrix<To, Dynamic, Columns> to(from.rows(), from.cols());
  for (Index j = 0; j < from.cols(); ++j)
    for (Index i = 0; i < from.rows(); ++i) to(i, j) = To(from(i, j));
  return to;
}

template <class To>
CovarianceModel<To> cast(const CovarianceModel<double>& from) {
  CovarianceModel<To> to;
  to.A = cast<To>(from.A);
  to.B = cast<To>(from.B);
  to.C = cast<To>(from.C);
  to.D = cast<To>(from.D);
  to.Q = cast<To>(from.Q);
  to.R = cast<To>(from.R);
  return to;
}

template <class To>
RootModel<To> cast(const RootModel<double>& from) {
  RootModel<To> to;
  to.A = cast<To>(from.A);
  to.B = cast<To>(from.B);
  to.C = cast<To>(from.C);
  to.D = cast<To>(from.D);
  to.Q_root = cast<To>(from.Q_root);
  to.R_root = cast<To>(from.R_root);
  return to;
}

template <class To>
InformationModel<To> cast(const InformationModel<double>& from) {
  InformationModel<To> to;
  to.A_inverse = cast<To>(from.A_inverse);
  to.A_inverse_B = cast<To>(from.A_inverse_B);
  to.C = cast<To>(from.C);
  to.D = cast<To>(from.D);
  to.Q_inverse_root = cast<To>(from.Q_inverse_root);
  to.R_inverse_root = cast<To>(from.R_inverse_root);
  to.w_mean = cast<To>(from.w_mean);
  return to;
}

template <class To>
AnyProblem<To> cast(const AnyProblem<double>& from) {
  return std::visit(
      [](const auto& problem) -> AnyProblem<To> {
        Problem<decltype(cast<To>(problem.models.front()))> to;
        for (const auto& model : problem.models) to.models.push_back(cast<To>(model));
        to.initial = cast<To>(problem.initial);
        to.x0 = cast<To>(problem.x0);
        return to;
      },
      from);
}

}  // namespace kfstab::test
