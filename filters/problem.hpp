#pragma once

#include <cstdint>
#include <memory>
#include <type_traits>
#include <variant>
#include <vector>

#include <kfstab/filters/state_space.hpp>

/// The very numbers that one parametrisation takes. The reference starts from a Problem too, and reads it exactly, so
/// that a filter is measured by its own rounding alone, never by that of its input.
namespace kfstab {

/// A problem in one parametrisation, for models of any size.
template <class ModelType>
struct Problem {
  using Model = ModelType;
  using Scalar = typename Model::Scalar;

  /// Model k is models[k mod size]: one for a time-invariant system, a period's worth, or one a step.
  std::vector<Model> models;
  /// P0, S0 (lower) or T0 (upper), as the parametrisation says: that of x_{0|-1}.
  Matrix<Scalar> initial;
  /// x_{0|-1}.
  Vector<Scalar> x0;

  const Model& model(std::int64_t k) const { return models[static_cast<std::size_t>(k) % models.size()]; }
  Dimensions dimensions() const { return models.front().dimensions(); }
  bool time_invariant() const { return models.size() == 1; }
};

template <class Scalar>
using AnyProblem =
    std::variant<Problem<CovarianceModel<Scalar>>, Problem<RootModel<Scalar>>, Problem<InformationModel<Scalar>>>;

template <class Scalar>
Parametrisation parametrisation(const AnyProblem<Scalar>& problem) {
  return static_cast<Parametrisation>(problem.index());
}

/// Entry by entry.
template <class F, int Cols>
auto convert(const Matrix<double, Dynamic, Cols>& X, F f) {
  Matrix<decltype(f(0.0)), Dynamic, Cols> Y(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(i, j) = f(X(i, j));
  return Y;
}

template <class F>
auto convert(const CovarianceModel<double>& from, F f) {
  CovarianceModel<decltype(f(0.0))> to;
  to.A = convert(from.A, f);
  to.B = convert(from.B, f);
  to.C = convert(from.C, f);
  to.D = convert(from.D, f);
  to.Q = convert(from.Q, f);
  to.R = convert(from.R, f);
  return to;
}

template <class F>
auto convert(const RootModel<double>& from, F f) {
  RootModel<decltype(f(0.0))> to;
  to.A = convert(from.A, f);
  to.B = convert(from.B, f);
  to.C = convert(from.C, f);
  to.D = convert(from.D, f);
  to.Q_root = convert(from.Q_root, f);
  to.R_root = convert(from.R_root, f);
  return to;
}

template <class F>
auto convert(const InformationModel<double>& from, F f) {
  InformationModel<decltype(f(0.0))> to;
  to.A_inverse = convert(from.A_inverse, f);
  to.A_inverse_B = convert(from.A_inverse_B, f);
  to.C = convert(from.C, f);
  to.D = convert(from.D, f);
  to.Q_inverse_root = convert(from.Q_inverse_root, f);
  to.R_inverse_root = convert(from.R_inverse_root, f);
  to.w_mean = convert(from.w_mean, f);
  return to;
}

/// The problem in the scalar that f makes of a double: f(x) in the place of every number x.
template <class F>
AnyProblem<std::invoke_result_t<F, double>> convert(const AnyProblem<double>& from, F f) {
  return std::visit(
      [f](const auto& problem) -> AnyProblem<std::invoke_result_t<F, double>> {
        Problem<decltype(convert(problem.models.front(), f))> to;
        for (const auto& model : problem.models) to.models.push_back(convert(model, f));
        to.initial = convert(problem.initial, f);
        to.x0 = convert(problem.x0, f);
        return to;
      },
      from);
}

/// What one step brings: the measurement y_k (p) and the known input u_k (as many as D has columns).
template <class Scalar>
struct StepDataOf {
  Vector<Scalar> y;
  Vector<Scalar> u;
};

/// The data of a run in the order of time. Streams hold one step at a time, so a run of any length fits.
template <class Scalar>
class DataStreamOf {
 public:
  virtual ~DataStreamOf() = default;
  /// y_k and u_k of the next k, from k = 0 on; valid until the next call.
  virtual const StepDataOf<Scalar>& next() = 0;
};

/// Where data come from; a run without data computes covariances and gains alone. Every stream that it opens brings the
/// same numbers: from step 0.
template <class Scalar>
class DataOf {
 public:
  virtual ~DataOf() = default;
  virtual std::unique_ptr<DataStreamOf<Scalar>> open() const = 0;
};

using StepData = StepDataOf<double>;
using DataStream = DataStreamOf<double>;
using Data = DataOf<double>;

}  // namespace kfstab
