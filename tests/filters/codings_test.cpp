// How an asymmetry D = P - P' goes through one step of each unsymmetrised coding, to first order: in high precision, so
// that nothing but the map and its second-order rest is seen.
#include <gtest/gtest.h>

#include "filters/high_precision.hpp"

#include <kfstab/filters/registry.hpp>

#include "filters/random_problem.hpp"

namespace kfstab::test::codings {
namespace {

using Real = HighPrecision;

/// Plain loops; Eigen's products of this scalar would take longer to compile than all the rest.
struct Dense {
  Matrix<Real> X;
  Index rows() const { return X.rows(); }
  Index cols() const { return X.cols(); }
};

Dense operator*(const Dense& a, const Dense& b) {
  Dense c{Matrix<Real>(a.rows(), b.cols())};
  for (Index i = 0; i < a.rows(); ++i)
    for (Index j = 0; j < b.cols(); ++j) {
      Real s = 0;
      for (Index k = 0; k < a.cols(); ++k) s += a.X(i, k) * b.X(k, j);
      c.X(i, j) = s;
    }
  return c;
}

Dense combined(const Dense& a, const Dense& b, int sign) {
  Dense c = a;
  for (Index j = 0; j < a.cols(); ++j)
    for (Index i = 0; i < a.rows(); ++i) c.X(i, j) += sign * b.X(i, j);
  return c;
}
Dense operator+(const Dense& a, const Dense& b) { return combined(a, b, 1); }
Dense operator-(const Dense& a, const Dense& b) { return combined(a, b, -1); }

Dense transposed(const Dense& a) {
  Dense c{Matrix<Real>(a.cols(), a.rows())};
  for (Index j = 0; j < a.cols(); ++j)
    for (Index i = 0; i < a.rows(); ++i) c.X(j, i) = a.X(i, j);
  return c;
}

/// Of order 2: all that p = 2 needs.
Dense inverse(const Dense& a) {
  const Real d = a.X(0, 0) * a.X(1, 1) - a.X(0, 1) * a.X(1, 0);
  Dense c{Matrix<Real>(2, 2)};
  c.X(0, 0) = a.X(1, 1) / d;
  c.X(1, 1) = a.X(0, 0) / d;
  c.X(0, 1) = -a.X(0, 1) / d;
  c.X(1, 0) = -a.X(1, 0) / d;
  return c;
}

double norm(const Dense& a) {
  Real s = 0;
  for (Index j = 0; j < a.cols(); ++j)
    for (Index i = 0; i < a.rows(); ++i) s += a.X(i, j) * a.X(i, j);
  return static_cast<double>(Real(sqrt(s)));
}

Dense widened(const Matrix<double>& X) { return {cast<Real>(X)}; }

/// X D X'.
Dense through(const Dense& X, const Dense& D) { return X * D * transposed(X); }

/// D+ of the map, and of the map that would hold if Re were used as if it were symmetric (one triangle of it factored).
struct Maps {
  Dense as_computed, one_triangle;
};

Maps maps(Asymmetry coding, const Dense& A, const Dense& K, const Dense& C, const Dense& D) {
  const Dense F = A - K * C, ADA = through(A, D), FDF = through(F, D), M = through(K * C, D);
  switch (coding) {
    case Asymmetry::textbook: return {FDF, FDF - M};
    case Asymmetry::mixed: return {ADA + ADA - FDF, ADA + ADA - FDF + M};
    case Asymmetry::gain: return {ADA - M, ADA};
    default: return {ADA + M, ADA};  // cp and downdate
  }
}

/// |D+ - map(D)| / |D| of one step from P0 + D/2.
struct Residuals {
  double as_computed, one_triangle;
};

Residuals one_step(const Metadata& metadata, const AnyProblem<double>& symmetric, double size, std::uint64_t seed) {
  AnyProblem<Real> any = cast<Real>(symmetric);
  auto& problem = std::get<Problem<CovarianceModel<Real>>>(any);
  const auto& given = std::get<Problem<CovarianceModel<double>>>(symmetric);
  const auto& model = given.models[0];
  const Index n = given.initial.rows();
  Dice dice(seed);
  Dense D{Matrix<Real>::Zero(n, n)};
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i < j; ++i) {
      D.X(i, j) = Real(dice.roll(-16, 16)) * size;
      D.X(j, i) = -D.X(i, j);
    }
  for (Index j = 0; j < n; ++j)
    for (Index i = 0; i < n; ++i) problem.initial(i, j) += D.X(i, j) / 2;

  const auto filter = make_filter<Real>(metadata.id);
  filter->start(any);
  const auto step = filter->step(0, nullptr, nullptr);
  EXPECT_EQ(step.report.status, Status::ok);
  const Dense next{*step.held}, asymmetry = next - transposed(next);

  const Dense A = widened(model.A), C = widened(model.C), P = widened(given.initial);
  const Dense Re = widened(model.R) + through(C, P), K = A * P * transposed(C) * inverse(Re);
  const Maps expected = maps(metadata.asymmetry, A, K, C, D);
  return {norm(asymmetry - expected.as_computed) / norm(D), norm(asymmetry - expected.one_triangle) / norm(D)};
}

}  // namespace

// To first order exactly: what is left shrinks with |D| itself. So a seed of 1e-12 leaves 1e-4 of what 1e-8 leaves (a
// factor 10 for the third order and for cases whose second-order term happens to be small), and 1e-8 leaves at most
// 1e-8 times the second derivative of the map, whose norms are of order 1 to 1e3 here.
TEST(Codings, FollowTheirMapsToFirstOrder) {
  int codings = 0;
  for (const Metadata& metadata : filters()) {
    if (metadata.asymmetry == Asymmetry::none) continue;
    ++codings;
    for (const Index n : {3, 4, 5})
      for (std::uint64_t seed = 1; seed <= 10; ++seed) {
        SCOPED_TRACE(std::string(metadata.id) + " n=" + std::to_string(n) + " seed=" + std::to_string(seed));
        const auto problem = random_problem(Parametrisation::covariance, {.d = {n, 2, 2}}, seed);
        const Residuals large = one_step(metadata, problem, 1e-8, seed),
                        small = one_step(metadata, problem, 1e-12, seed);
        EXPECT_LE(large.as_computed, 1e-5);
        EXPECT_LE(small.as_computed, 10 * 1e-4 * large.as_computed);
      }
  }
  EXPECT_EQ(codings, 5);
}

// The codings use Re as computed, by LU. Had one triangle of it been factored, the asymmetry of Re would not have
// counted and another map would hold, which differs by K C D C'K'; where C D C' is not small the two cannot be
// confused.
TEST(Codings, UseReAsComputed) {
  for (const Metadata& metadata : filters()) {
    if (metadata.asymmetry == Asymmetry::none) continue;
    double largest = 0;
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      const auto problem = random_problem(Parametrisation::covariance, {.d = {4, 2, 2}}, seed);
      const Residuals residuals = one_step(metadata, problem, 1e-8, seed);
      EXPECT_GE(residuals.one_triangle, residuals.as_computed) << metadata.id << " seed=" << seed;
      largest = std::max(largest, residuals.one_triangle);
    }
    EXPECT_GE(largest, .01) << metadata.id;
  }
}

}  // namespace kfstab::test::codings
