#pragma once

#include <kfstab/filters/matrix.hpp>

namespace kfstab {

/// How a step ended. Filters never throw: a step that cannot be done says why, and the previous state stands.
enum class Status {
  ok,
  /// Re, or its root, is singular to working precision: rcond is below the tolerance. No gain exists.
  singular_innovation,
  /// A leading minor of Re is not positive: its Cholesky factorisation could not be completed.
  not_positive_definite,
  /// The information root T is singular to working precision: no state estimate exists.
  singular_information,
  /// A hyperbolic rotation of the Chandrasekhar recursion does not exist: |t| >= 1.
  hyperbolic_breakdown,
  /// The model is not that of the step before, and the form knows time-invariant systems alone.
  time_varying_model,
  /// A root of the measurement noise is singular where the form must divide by it.
  singular_measurement_noise,
  /// The iteration of a singular value decomposition did not end within its bound.
  no_convergence,
  /// The model or the data held a NaN or an infinity.
  non_finite_input,
  /// All input was finite, the result is not.
  overflow,
};

/// The status in words, as messages and tables print it: "singular_innovation".
constexpr const char* name(Status status) {
  switch (status) {
    case Status::ok: return "ok";
    case Status::singular_innovation: return "singular_innovation";
    case Status::not_positive_definite: return "not_positive_definite";
    case Status::singular_information: return "singular_information";
    case Status::hyperbolic_breakdown: return "hyperbolic_breakdown";
    case Status::time_varying_model: return "time_varying_model";
    case Status::singular_measurement_noise: return "singular_measurement_noise";
    case Status::no_convergence: return "no_convergence";
    case Status::non_finite_input: return "non_finite_input";
    case Status::overflow: return "overflow";
  }
  return "unknown";
}

/// What a square-root filter's step is asked for. Less costs less: the gain a triangular solve, rcond a few more of them.
enum class Wanted {
  factor,  ///< what the filter holds, alone: no gain, and so no state, and y is not looked at. Nothing can be singular.
  gain,    ///< and the gain, and the state if there is y. What counts as singular is a zero pivot; rcond is NaN.
  state,   ///< of an information filter: the state if there is y, and rcond, and no gain; of others what `all` says
  all,     ///< the gain, the state if there is y, and rcond, held against the tolerance
};

constexpr bool wants_rcond(Wanted wanted) { return wanted == Wanted::state || wanted == Wanted::all; }
/// Of an information filter, which needs none for its state.
constexpr bool wants_gain(Wanted wanted) { return wanted == Wanted::gain || wanted == Wanted::all; }

/// What a step says of itself.
template <class Scalar>
struct StepReport {
  Status status = Status::ok;
  /// Reciprocal condition number in the 1-norm, estimated or, by kernels and of small order, computed, of what the form must
  /// invert: Re for the forms that hold P, Re^{1/2} for a square-root covariance filter (for the SVD filter in the 2-norm, as
  /// computed), R^{1/2} for scalar updates, T or Y for an information filter. 1 where there is nothing to invert, NaN where it
  /// was not wanted.
  Scalar rcond = Scalar(1);

  explicit operator bool() const { return status == Status::ok; }
};

/// A step that failed, with the failure's true cause: where the model or the data held a NaN or an infinity, that is it,
/// whatever tripped over it.
template <class Scalar, class Model, class... Vectors>
StepReport<Scalar> failed(Status status, const Scalar& rcond, const Model& model, const Vectors*... data) {
  const bool finite = model.finite() && (... && (!data || all_finite(*data)));
  return {finite ? status : Status::non_finite_input, rcond};
}

}  // namespace kfstab
