#include <kfstab/experiments/perturbation.hpp>

#include <algorithm>

#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/registry.hpp>

namespace kfstab::experiments {
namespace {

/// X X'.
Matrix<double> square(const Matrix<double>& X) { return X.lazyProduct(X.transpose()); }

/// (T'T)^{-1}, T upper.
Matrix<double> inverse_of_information(const Matrix<double>& T) {
  Matrix<double> X = Matrix<double>::Identity(T.rows(), T.cols());
  solve_triangular_right<Triangle::upper, false>(T, X);
  return square(X);
}

}  // namespace

Matrix<double> covariance_of(const Metadata& filter, const Matrix<double>& held) {
  switch (filter.holds) {
    case Held::covariance:
    case Held::gain: break;
    case Held::covariance_factor:
    case Held::covariance_root: return square(held);
    case Held::ud_factors: {
      Matrix<double> U = held;
      const Vector<double> D = held.diagonal();
      for (Index j = 0; j < U.cols(); ++j) {
        for (Index i = j + 1; i < U.rows(); ++i) U(i, j) = 0;
        U(j, j) = 1;
      }
      const Matrix<double> UD = U * D.asDiagonal();
      return UD.lazyProduct(U.transpose());
    }
    case Held::information_factor: return inverse_of_information(held);
    case Held::information: {
      Matrix<double> V = held;
      cholesky_upper(V);
      return inverse_of_information(V);
    }
  }
  return held;
}

std::vector<Deviation> deviations(const Metadata& filter, const properties::System& system, const Matrix<double>& dP,
                                  const Vector<double>& dx, const Matrix<double>& y) {
  properties::System disturbed = system;
  if (dP.size() > 0) disturbed.P0.value.matrices.front() += dP;
  if (dx.size() > 0) disturbed.x0 += dx;
  const auto problem = problem_of(system, filter.takes), other_problem = problem_of(disturbed, filter.takes);
  const auto one = make_filter<double>(filter.id), other = make_filter<double>(filter.id);
  one->start(problem);
  other->start(other_problem);

  std::vector<Deviation> result;
  for (std::int64_t k = 0; k < system.steps; ++k) {
    Vector<double> y_k;
    if (y.size() > 0) y_k = y.col(k);
    const auto a = one->step(k, y.size() > 0 ? &y_k : nullptr, nullptr);
    const auto b = other->step(k, y.size() > 0 ? &y_k : nullptr, nullptr);
    if (!a.report || !b.report) break;
    Deviation& deviation = result.emplace_back();
    if (a.held) deviation.P = covariance_of(filter, *b.held) - covariance_of(filter, *a.held);
    deviation.gain = *b.gain - *a.gain;
    if (a.state) deviation.x = *b.state - *a.state;
  }
  return result;
}

std::vector<double> sizes_of_P(const std::vector<Deviation>& deviations) {
  std::vector<double> sizes;
  for (const Deviation& deviation : deviations) sizes.push_back(deviation.P.norm());
  return sizes;
}

double noise(const std::vector<double>& sizes) {
  double largest = 0;
  for (std::size_t k = sizes.size() - std::min<std::size_t>(sizes.size(), 20); k < sizes.size(); ++k)
    keep_worst(largest, sizes[k]);
  return largest;
}

Transitions transitions(const properties::System& system, Parametrisation form) {
  const auto problem = problem_of(system, form);
  reference::Trajectory truth(problem, nullptr, {.digits = 15});
  const Index n = system.A.rows();
  Matrix<double> predicted = Matrix<double>::Identity(n, n), filtered = predicted;
  Transitions result;
  for (std::int64_t k = 0; k < system.steps; ++k) {
    truth.advance();
    predicted = truth.truth().closed_loop.lazyProduct(predicted).eval();
    filtered = truth.truth().filtered_closed_loop.lazyProduct(filtered).eval();
    result.predicted.push_back(predicted);
    result.filtered.push_back(filtered);
    result.truths.push_back(truth.truth());
  }
  return result;
}

Matrix<double> carried(const Matrix<double>& X, const Matrix<double>& Y, const Matrix<double>& Z) {
  const Matrix<double> XY = X.lazyProduct(Y);
  return XY.lazyProduct(Z.transpose());
}

std::vector<const Metadata*> forgetful_filters() {
  std::vector<const Metadata*> selected;
  for (const Metadata& metadata : filters())
    if (metadata.holds != Held::gain && metadata.holds != Held::information &&
        (metadata.asymmetry == Asymmetry::none || metadata.asymmetry == Asymmetry::textbook))
      selected.push_back(&metadata);
  return selected;
}

}  // namespace kfstab::experiments
