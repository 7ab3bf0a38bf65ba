#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include <kfstab/filters/metadata.hpp>
#include <kfstab/filters/problem.hpp>

namespace kfstab::test {

/// A matrix of any scalar as a sum of matrices of double: exact, and the way for numbers of every precision through an
/// interface that knows none.
using Exact = std::vector<Matrix<double>>;

template <class Derived>
Exact exact(const Eigen::MatrixBase<Derived>& X) {
  using Scalar = typename Derived::Scalar;
  Exact parts;
  Matrix<Scalar> rest = X;
  do {
    Matrix<double> part(X.rows(), X.cols());
    bool more = false;
    for (Index j = 0; j < X.cols(); ++j)
      for (Index i = 0; i < X.rows(); ++i) {
        part(i, j) = static_cast<double>(rest(i, j));
        rest(i, j) -= Scalar(part(i, j));
        more = more || (is_finite(part(i, j)) && rest(i, j) != Scalar(0));
      }
    parts.push_back(part);
    if (!more) break;
  } while (parts.size() < 8);
  return parts;
}

/// How far what a filter holds is from the truth, and how far its own rounding may have brought it.
struct Deviation {
  double error = 0;  ///< Frobenius norm of the difference
  double bound = 0;  ///< u (n+m+p) kappa scale, summed over the steps with what each did to the errors before it
  double ratio() const { return error == 0 ? 0 : error / bound; }
};

struct Judgement {
  Deviation held;  ///< of P; of S S' for a factor S; of T'T for an information root T
  Deviation gain;
  Deviation state;
};

/// The Kalman recursion as textbooks print it, in 120 decimal digits, beside one filter of the registry, from the very
/// numbers that the filter was given. It is written without any code of the room under test.
///
/// The bounds are first-order rounding analyses of one step of each form, with kappa and norms (Frobenius) taken from
/// the exact run: plain_recursion_test.cpp has them with their reasons.
class PlainRecursion {
 public:
  /// @param filter  says what is compared: P_{k+1|k} or P_{k|k}, which gain, and which form's bound holds
  /// @param unit  unit roundoff of the filter's scalar
  PlainRecursion(const AnyProblem<double>& problem, const Metadata& filter, double unit);
  ~PlainRecursion();

  /// Step k, as AnyFilter::step.
  void step(std::int64_t k, const Vector<double>* y, const Vector<double>* u);
  /// @param state  empty in a run without data
  Judgement judge(const Exact& held, const Exact& gain, const Exact& state) const;

  /// Of e'e, the sum of squares that the last step of an information filter left over, which is the innovation's,
  /// (y - C x)' Re^{-1} (y - C x). The bound is that of one step: what came in is taken for exact.
  Deviation judge_residual(double e_squared) const;

  /// Rounded to double.
  Matrix<double> covariance() const;
  Matrix<double> gain() const;
  Matrix<double> state() const;

 private:
  struct Run;
  std::unique_ptr<Run> run_;
};

}  // namespace kfstab::test
