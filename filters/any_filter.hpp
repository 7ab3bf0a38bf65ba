#pragma once

#include <cstdint>
#include <memory>
#include <string_view>

#include <kfstab/filters/metadata.hpp>
#include <kfstab/filters/problem.hpp>
#include <kfstab/filters/step_report.hpp>

namespace kfstab {

/// A matrix that a filter shows. It looks like a pointer to it, null where there is none; but a filter that holds the matrix in
/// other coordinates makes it when it is looked at for the first time, and a step that nobody looks at does not pay for it.
template <class Scalar>
class Shown {
 public:
  using Make = const Matrix<Scalar>& (*)(void* filter);

  Shown(const Matrix<Scalar>* matrix = nullptr) : matrix_(matrix) {}
  Shown(Make make, void* filter) : make_(make), filter_(filter) {}

  explicit operator bool() const { return matrix_ || make_; }
  const Matrix<Scalar>& operator*() const { return matrix_ ? *matrix_ : make_(filter_); }
  const Matrix<Scalar>* operator->() const { return &**this; }

 private:
  const Matrix<Scalar>* matrix_ = nullptr;
  Make make_ = nullptr;
  void* filter_ = nullptr;
};

/// What a filter has after step k, seen without a copy; valid until its next step.
///
/// After step k a filter that predicts holds P_{k+1|k} and x_{k+1|k}, one that filters P_{k|k} and x_{k|k}
/// (metadata.instant); its gain is that of step k either way.
template <class Scalar>
struct Step {
  StepReport<Scalar> report;
  Shown<Scalar> held = {};                ///< metadata.holds; of a triangle only that counts. Null for Held::gain.
  const Matrix<Scalar>* gain = nullptr;   ///< n x p: metadata.gain
  const Vector<Scalar>* state = nullptr;  ///< null in a run without data
};

/// Any filter of the registry, sizes known at run time: what commands, claims and laws use.
///
/// It fetches from the Problem what its form needs (A_k; or C_{k+1}), so that every filter is driven by the same loop:
///
///     filter->start(problem);
///     for (k = 0; k < steps; ++k) { auto step = filter->step(k, &y, &u); ... }
///
/// Step k processes y_k whatever the form: the filters that predict go from k|k-1 to k+1|k; an information filter, whose
/// recursion goes from k|k to k+1|k+1, does its start (the measurement update of y_0) in step 0 and ends step k with k|k.
template <class Scalar>
class AnyFilter {
 public:
  virtual ~AnyFilter() = default;

  virtual const Metadata& metadata() const = 0;
  /// Allocates for the problem's sizes and takes its initial condition. The problem must outlive the run.
  /// Throws std::invalid_argument if the problem is in another parametrisation.
  virtual void start(const AnyProblem<Scalar>& problem) = 0;
  /// Step k, to be called for k = 0, 1, 2 ... No allocation for scalars that do not allocate. y and u may be null: the
  /// run has no data. After a failed step the previous state stands, and calling step again is allowed.
  virtual Step<Scalar> step(std::int64_t k, const Vector<Scalar>* y, const Vector<Scalar>* u) = 0;
};

}  // namespace kfstab
