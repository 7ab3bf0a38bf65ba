#include <kfstab/experiments/models.hpp>

#include <cmath>
#include <stdexcept>
#include <variant>

#include <boost/random/normal_distribution.hpp>

#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/frame.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::experiments {

Matrix<double> rotation(double r, double t) {
  Matrix<double> X(2, 2);
  X << r * std::cos(t), -r * std::sin(t), r * std::sin(t), r * std::cos(t);
  return X;
}

Matrix<double> round_to(const Matrix<double>& X, int bits) {
  return X.unaryExpr([bits](double x) { return std::ldexp(std::round(std::ldexp(x, bits)), -bits); });
}

Matrix<double> random_normal(Random& random, Index rows, Index cols) {
  boost::random::normal_distribution<double> normal;
  Matrix<double> X(rows, cols);
  for (Index i = 0; i < rows; ++i)
    for (Index j = 0; j < cols; ++j) X(i, j) = normal(random);
  return X;
}

Matrix<double> random_orthogonal(Random& random, Index n) {
  return properties::orthonormal_frame(random_normal(random, n, n));
}

properties::System system_of(std::string name, const Matrix<double>& A, const Matrix<double>& B,
                             const Matrix<double>& C, const Matrix<double>& R_root, const Matrix<double>& S0,
                             std::int64_t steps) {
  using Written = properties::Covariance::Written;
  properties::System system;
  system.name = std::move(name);
  system.A = A;
  system.B = B;
  system.C = C;
  system.D = Matrix<double>(A.rows(), 0);
  system.Q = {Written::root, Matrix<double>(Matrix<double>::Identity(B.cols(), B.cols()))};
  system.R = {Written::root, R_root};
  system.P0 = {Written::root, S0};
  system.x0 = Vector<double>::Zero(A.rows());
  system.steps = steps;
  return system;
}

properties::System random_system(Random& random, Dimensions d, double radius, std::int64_t steps) {
  Matrix<double> A = random_normal(random, d.n, d.n);
  A = round_to(A * (radius / reference::spectral_radius(A)), 18);
  const Matrix<double> B = round_to(random_normal(random, d.n, d.m), 18);
  const Matrix<double> C = round_to(random_normal(random, d.p, d.n), 18);
  return system_of("random", A, B, C, Matrix<double>::Identity(d.p, d.p), Matrix<double>::Identity(d.n, d.n), steps);
}

AnyProblem<double> problem_of(const properties::System& system, Parametrisation form) {
  auto made = properties::problem(system, form);
  if (const auto* refusal = std::get_if<properties::Refusal>(&made)) throw std::logic_error(refusal->reason);
  return std::get<AnyProblem<double>>(std::move(made));
}

int color_of(std::string_view filter) {
  const Metadata* metadata = find_filter(filter);
  return metadata ? static_cast<int>(metadata - filters().data()) : -1;
}

}  // namespace kfstab::experiments
