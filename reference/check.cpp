#include <kfstab/reference/detail/check.hpp>

#include <string>

#include <kfstab/reference/definiteness.hpp>
#include <kfstab/reference/error.hpp>

namespace kfstab::reference::detail {
namespace {

std::string shape(Index rows, Index cols) { return std::to_string(rows) + " x " + std::to_string(cols); }

template <class Derived>
void finite(const Eigen::MatrixBase<Derived>& X, const std::string& name) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      if (!is_finite(typename Derived::Scalar(X(i, j))))
        throw ReferenceError(name + "(" + std::to_string(i) + "," + std::to_string(j) + ") is not finite");
}

template <class Derived>
void shaped(const Eigen::MatrixBase<Derived>& X, Index rows, Index cols, const std::string& name) {
  if (X.rows() != rows || X.cols() != cols)
    throw ReferenceError(name + " is " + shape(X.rows(), X.cols()) + ", expected " + shape(rows, cols));
}

void full(const Matrix<double>& X, Index rows, Index cols, const std::string& name) {
  shaped(X, rows, cols, name);
  finite(X, name);
}

/// A rational is finite.
void full(const Matrix<Rational>& X, Index rows, Index cols, const std::string& name) { shaped(X, rows, cols, name); }

void finite(const Vector<Rational>&, const std::string&) {}

template <class S>
void symmetric(const Matrix<S>& X, Index n, const std::string& name) {
  full(X, n, n, name);
  for (Index j = 0; j < n; ++j)
    for (Index i = j + 1; i < n; ++i)
      if (X(i, j) != X(j, i))
        throw ReferenceError(name + " is not symmetric: entries (" + std::to_string(i) + "," + std::to_string(j) +
                             ") and (" + std::to_string(j) + "," + std::to_string(i) + ") differ");
}

/// The other triangle may hold anything.
void lower(const Matrix<double>& X, Index n, const std::string& name) {
  shaped(X, n, n, name);
  finite(Matrix<double>(X.triangularView<Eigen::Lower>()), name);
}

void nonsingular_upper(const Matrix<double>& X, Index n, const std::string& name) {
  shaped(X, n, n, name);
  finite(Matrix<double>(X.triangularView<Eigen::Upper>()), name);
  for (Index i = 0; i < n; ++i)
    if (X(i, i) == 0)
      throw ReferenceError(name + " is singular: entry (" + std::to_string(i) + "," + std::to_string(i) + ") is 0");
}

template <class S>
void noise(const CovarianceModel<S>& model, Dimensions d, const std::string& at) {
  full(model.A, d.n, d.n, "A" + at);
  full(model.B, d.n, d.m, "B" + at);
  symmetric(model.Q, d.m, "Q" + at);
  symmetric(model.R, d.p, "R" + at);
}

void noise(const RootModel<double>& model, Dimensions d, const std::string& at) {
  full(model.A, d.n, d.n, "A" + at);
  full(model.B, d.n, d.m, "B" + at);
  lower(model.Q_root, d.m, "Q^{1/2}" + at);
  lower(model.R_root, d.p, "R^{1/2}" + at);
}

void noise(const InformationModel<double>& model, Dimensions d, const std::string& at) {
  full(model.A_inverse, d.n, d.n, "A^{-1}" + at);
  full(model.A_inverse_B, d.n, d.m, "A^{-1} B" + at);
  nonsingular_upper(model.Q_inverse_root, d.m, "Q^{-1/2}" + at);
  nonsingular_upper(model.R_inverse_root, d.p, "R^{-1/2}" + at);
  if (model.w_mean.size() != 0) {
    shaped(model.w_mean, d.m, 1, "the mean of w" + at);
    finite(model.w_mean, "the mean of w" + at);
  }
  if (is_singular(model.A_inverse)) throw ReferenceError("A^{-1}" + at + " is singular");
}

template <class S>
void start(const Problem<CovarianceModel<S>>& problem, Index n) { symmetric(problem.initial, n, "P0"); }
void start(const Problem<RootModel<double>>& problem, Index n) { lower(problem.initial, n, "S0"); }
void start(const Problem<InformationModel<double>>& problem, Index n) { nonsingular_upper(problem.initial, n, "T0"); }

}  // namespace

void check(const Source& source, bool with_data) {
  visit_source(
      source, [&](const auto& problem) {
        if (problem.models.empty()) throw ReferenceError("the problem has no model");
        const Dimensions d = problem.dimensions();
        for (std::size_t k = 0; k < problem.models.size(); ++k) {
          const auto& model = problem.models[k];
          const std::string at = problem.models.size() == 1 ? "" : " of model " + std::to_string(k);
          noise(model, d, at);
          full(model.C, d.p, d.n, "C" + at);
          if (model.D.cols() > 0) full(model.D, d.n, model.D.cols(), "D" + at);
        }
        start(problem, d.n);
        if (with_data || problem.x0.size() > 0) {
          shaped(problem.x0, d.n, 1, "x0");
          finite(problem.x0, "x0");
        }
      });
}

void check(const SourceData& data, const Source& source, std::int64_t k) {
  const auto [outputs, inputs] = visit_source(source, [k](const auto& problem) {
    const auto& model = problem.model(k);
    return std::pair(model.C.rows(), model.D.cols());
  });
  const std::string at = " of step " + std::to_string(k);
  std::visit(
      [&, outputs = outputs, inputs = inputs](const auto* step) {
        shaped(step->y, outputs, 1, "y" + at);
        finite(step->y, "y" + at);
        shaped(step->u, inputs, 1, "u" + at);
        finite(step->u, "u" + at);
      },
      data);
}

}  // namespace kfstab::reference::detail
