#include "filters/random_problem.hpp"

#include <gtest/gtest.h>

namespace kfstab::test {

int Dice::roll(int low, int high) {
  return low + static_cast<int>(engine_() % static_cast<std::uint64_t>(high - low + 1));
}

Matrix<double> Dice::matrix(Index rows, Index cols, int size) {
  Matrix<double> X(rows, cols);
  for (Index j = 0; j < cols; ++j)
    for (Index i = 0; i < rows; ++i) X(i, j) = roll(-size, size) / 16.;
  return X;
}

Vector<double> Dice::vector(Index rows, int size) { return matrix(rows, 1, size); }

Matrix<double> Dice::lower_root(Index n) {
  Matrix<double> L = Matrix<double>::Zero(n, n);
  for (Index j = 0; j < n; ++j) {
    const int sign = roll(0, 1) ? 1 : -1;
    L(j, j) = sign * roll(10, 20) / 16.;
    for (Index i = j + 1; i < n; ++i) L(i, j) = roll(-6, 6) / 16.;
  }
  return L;
}

std::string Case::text() const {
  return "n=" + std::to_string(d.n) + " m=" + std::to_string(d.m) + " p=" + std::to_string(d.p) +
         " period=" + std::to_string(period) + " inputs=" + std::to_string(inputs) + (data ? "" : " no data") +
         (singular ? " singular" : "");
}

bool applies(const Metadata& filter, const Case& c) {
  if (c.period > 1 && filter.needs.time_invariant) return false;
  const bool regular = filter.takes == Parametrisation::information || filter.needs.invertible_A ||
                       filter.needs.positive_definite_Q || filter.needs.positive_definite_P0;
  return !c.singular || !regular;
}

namespace {

/// X X', exact for the entries that Dice makes.
Matrix<double> square(const Matrix<double>& X) {
  Matrix<double> P = Matrix<double>::Zero(X.rows(), X.rows());
  for (Index j = 0; j < X.rows(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      for (Index k = 0; k < X.cols(); ++k) P(i, j) += X(i, k) * X(j, k);
  return P;
}

}  // namespace

AnyProblem<double> random_problem(Parametrisation takes, const Case& c, std::uint64_t seed) {
  Dice dice(seed);
  const Index n = c.d.n, m = c.d.m, p = c.d.p;
  const auto dynamics = [&](auto& model) {
    model.A = dice.matrix(n, n, 10);
    if (c.singular && n > 0) model.A.row(0).setZero();
    model.B = dice.matrix(n, m, 12);
    model.C = dice.matrix(p, n, 16);
    model.D = dice.matrix(n, c.inputs, 16);
  };
  const auto root = [&](Index order) {
    Matrix<double> L = dice.lower_root(order);
    if (c.singular && order > 0) L.col(order / 2).setZero();
    return L;
  };

  switch (takes) {
    case Parametrisation::covariance: {
      Problem<CovarianceModel<double>> problem;
      for (int k = 0; k < c.period; ++k) {
        auto& model = problem.models.emplace_back();
        dynamics(model);
        model.Q = square(root(m));
        model.R = square(dice.lower_root(p));
      }
      problem.initial = square(root(n));
      problem.x0 = dice.vector(n, 32);
      return problem;
    }
    case Parametrisation::root: {
      Problem<RootModel<double>> problem;
      for (int k = 0; k < c.period; ++k) {
        auto& model = problem.models.emplace_back();
        dynamics(model);
        model.Q_root = root(m);
        model.R_root = dice.lower_root(p);
      }
      problem.initial = root(n);
      problem.x0 = dice.vector(n, 32);
      return problem;
    }
    case Parametrisation::information: break;
  }
  Problem<InformationModel<double>> problem;
  for (int k = 0; k < c.period; ++k) {
    auto& model = problem.models.emplace_back();
    model.A_inverse = dice.matrix(n, n, 3);
    model.A_inverse.diagonal().array() += 1.;
    model.A_inverse_B = dice.matrix(n, m, 12);
    model.C = dice.matrix(p, n, 16);
    model.D = dice.matrix(n, c.inputs, 16);
    model.Q_inverse_root = dice.lower_root(m).transpose();
    model.R_inverse_root = dice.lower_root(p).transpose();
    if (k % 2 == 0) model.w_mean = dice.vector(m, 32);
  }
  problem.initial = dice.lower_root(n).transpose();
  problem.x0 = dice.vector(n, 32);
  return problem;
}

// What makes one problem serve every scalar: its numbers are numbers of float, and squaring the roots rounds nothing.
TEST(RandomProblem, IsExactInFloat) {
  for (const auto takes : {Parametrisation::covariance, Parametrisation::root, Parametrisation::information}) {
    const Case c{.d = {5, 3, 4}, .period = 2, .inputs = 1};
    std::visit(
        [](const auto& problem) {
          const Matrix<float> initial = cast<float>(problem.initial);
          EXPECT_EQ(cast<float>(problem.models[1].C).template cast<double>(), problem.models[1].C);
          EXPECT_EQ(initial.template cast<double>(), problem.initial);
        },
        random_problem(takes, c, 7));
  }
}

}  // namespace kfstab::test
