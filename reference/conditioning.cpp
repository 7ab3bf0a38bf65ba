#include <kfstab/reference/conditioning.hpp>

#include <algorithm>
#include <string>
#include <utility>

#include <kfstab/reference/detail/elimination.hpp>

namespace kfstab::reference {
namespace {

using detail::difference_of;
using detail::sum_of;
using detail::times;
using detail::transpose_of;

void place(const Matrix<Rational>& from, Matrix<Rational>& to, Index row, Index col) {
  for (Index j = 0; j < from.cols(); ++j)
    for (Index i = 0; i < from.rows(); ++i) to(row + i, col + j) = from(i, j);
}

}  // namespace

Conditioned condition(const ExactProblem& problem, std::int64_t k, std::int64_t count,
                      const std::vector<StepDataOf<Rational>>& data) {
  const auto [n, m, p] = problem.dimensions();
  const std::int64_t steps = std::max(k + 1, count);
  const bool with_data = !data.empty();

  // Where the independent ones stand: x_0, then w of each step, then v.
  const Index w = n, v = n + static_cast<Index>(steps) * m, sources = v + static_cast<Index>(steps) * p;
  Matrix<Rational> covariance = detail::zero<Rational>(sources, sources);
  place(problem.initial, covariance, 0, 0);

  Matrix<Rational> state = detail::zero<Rational>(n, sources), asked,
                   measured = detail::zero<Rational>(static_cast<Index>(count) * p, sources);
  place(detail::unit<Rational>(n), state, 0, 0);
  Vector<Rational> mean = problem.x0, asked_mean;
  Matrix<Rational> y_minus_mean = detail::zero<Rational>(static_cast<Index>(count) * p, 1);
  for (std::int64_t j = 0; j < steps; ++j) {
    const CovarianceModel<Rational>& model = problem.model(j);
    const auto at = static_cast<Index>(j);
    place(model.Q, covariance, w + at * m, w + at * m);
    place(model.R, covariance, v + at * p, v + at * p);
    if (j == k) {
      asked = state;
      asked_mean = mean;
    }
    if (j < count) {
      place(times(model.C, state), measured, at * p, 0);
      place(detail::unit<Rational>(p), measured, at * p, v + at * p);
      if (with_data) {
        const Vector<Rational> e = difference_of(data.at(static_cast<std::size_t>(j)).y, times(model.C, mean));
        for (Index i = 0; i < p; ++i) y_minus_mean(at * p + i, 0) = e(i);
      }
    }
    state = times(model.A, state);
    place(model.B, state, 0, w + at * m);
    if (with_data && j + 1 < steps) {
      mean = times(model.A, mean);
      const Vector<Rational>& u = data.at(static_cast<std::size_t>(j)).u;
      if (u.size() > 0) mean = sum_of(mean, times(model.D, u));
    }
  }

  const Matrix<Rational> x_sources = times(asked, covariance);
  const Matrix<Rational> xy = times(x_sources, transpose_of(measured));
  const Matrix<Rational> yy = detail::sandwich(measured, covariance);
  // (cov y)^{-1} [cov(y, x)  y - E y]
  Matrix<Rational> right(yy.rows(), n + 1);
  place(transpose_of(xy), right, 0, 0);
  place(y_minus_mean, right, 0, n);
  Conditioned result;
  if (!detail::solve(
          yy, right, result.determinant, [](const Rational& pivot) { return pivot > 0; }, true))
    throw ReferenceError("the covariance of y_0 ... y_" + std::to_string(count - 1) + " is not positive definite");
  const Matrix<Rational> change = times(xy, right);
  result.P = difference_of(times(x_sources, transpose_of(asked)), Matrix<Rational>(change.leftCols(n)));
  if (with_data) {
    result.x = sum_of(asked_mean, Vector<Rational>(change.col(n)));
    for (Index i = 0; i < yy.rows(); ++i) result.weighted += Rational(y_minus_mean(i, 0) * right(i, n));
  }
  return result;
}

}  // namespace kfstab::reference
