#include <kfstab/filters/chandrasekhar.hpp>

#include <gtest/gtest.h>

#include <cmath>

#include <kfstab/filters/square_root_covariance.hpp>

#include "filters/beside_reference.hpp"
#include "filters/high_precision.hpp"

namespace kfstab::test::chandrasekhar {
namespace {

using Filter = ChandrasekharFilter<double>;
using Model = RootModel<double>;

/// A time-invariant model and S0; A is scaled by 2^-shift, so that some are stable.
Problem<Model> drawn(const Dimensions& d, std::uint64_t seed, int shift) {
  auto problem = std::get<Problem<Model>>(random_problem(Parametrisation::root, {.d = d, .inputs = 1}, seed));
  problem.models[0].A *= std::ldexp(1., -shift);
  return problem;
}

template <class Scalar>
struct System {
  RootModel<Scalar> model;
  Matrix<Scalar> S0;
};

template <class Scalar>
System<Scalar> in(const Problem<Model>& problem) {
  const AnyProblem<Scalar> any = cast<Scalar>(AnyProblem<double>(problem));
  const auto& p = std::get<Problem<RootModel<Scalar>>>(any);
  return {p.models[0], p.initial};
}

/// P_0 ... P_last and the gain of each step, by the recursion of the covariance, in high precision.
struct Riccati {
  std::vector<Matrix<HighPrecision>> P, Re, K;
};

Riccati riccati(const System<HighPrecision>& s, int steps) {
  using H = HighPrecision;
  SquareRootCovarianceFilter<H> filter(s.model.dimensions());
  filter.start(s.S0, Vector<H>(Vector<H>::Zero(s.S0.rows())));
  Riccati r;
  for (int k = 0; k <= steps; ++k) {
    const Matrix<H> S = filter.factor();
    r.P.push_back(S.lazyProduct(S.transpose()));
    EXPECT_TRUE(filter.step(s.model));
    r.Re.push_back(filter.innovation_root().lazyProduct(filter.innovation_root().transpose()));
    r.K.push_back(filter.predictor_gain());
  }
  return r;
}

template <class Scalar>
double norm(const Matrix<Scalar>& X) {
  Scalar sum(0);
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) sum += X(i, j) * X(i, j);
  return std::sqrt(static_cast<double>(sum));
}

const Dimensions sizes[] = {{4, 2, 2}, {3, 5, 1}, {2, 1, 4}, {1, 1, 1}, {5, 2, 3}, {3, 0, 2}};

}  // namespace

// In high precision what the recursion says of P is true to its digits: P_{k+1} - P_k = L Sig L', for any P0.
TEST(Chandrasekhar, IncrementsAreThoseOfP) {
  using H = HighPrecision;
  for (const Dimensions& d : sizes)
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
      SCOPED_TRACE("n=" + std::to_string(d.n) + " m=" + std::to_string(d.m) + " p=" + std::to_string(d.p) + " seed=" +
                   std::to_string(seed));
      const auto s = in<H>(drawn(d, seed, 2));
      const Riccati truth = riccati(s, 7);
      ChandrasekharFilter<H> filter(d);
      filter.start(s.S0, Vector<H>(Vector<H>::Zero(d.n)));
      for (int k = 0; k < 6; ++k) {
        ASSERT_TRUE(filter.step(s.model));
        const Matrix<H> L = filter.increment();
        Matrix<H> signed_L = L;
        signed_L.rightCols(filter.decreasing()) *= H(-1);
        const std::size_t next = static_cast<std::size_t>(k) + 1;
        const Matrix<H> step = truth.P[next + 1] - truth.P[next];
        const Matrix<H> G = filter.normalised_gain(), Re_root = filter.innovation_root();
        const Matrix<H> Re = Re_root.lazyProduct(Re_root.transpose());
        const Matrix<H> GRe = G.lazyProduct(Re_root.transpose());
        const Matrix<H> APC = s.model.A.lazyProduct(truth.P[next].lazyProduct(s.model.C.transpose()));
        // Errors are u k(Theta) of the largest P there was; 1e10 covers k(Theta) of these systems, and u is 1e-50.
        const double tolerance = 1e-40 * (norm(truth.P[0]) + norm(truth.P[next]));
        EXPECT_LE(norm<H>(L.lazyProduct(signed_L.transpose()) - step), tolerance) << "step " << k;
        EXPECT_LE(norm<H>(Re - truth.Re[next]), tolerance * (1 + norm(s.model.C) * norm(s.model.C)));
        EXPECT_LE(norm<H>(GRe - APC), tolerance * (1 + norm(s.model.A) * norm(s.model.C)));
        EXPECT_LE(norm<H>(filter.predictor_gain() - truth.K[static_cast<std::size_t>(k)]),
                  1e-40 * norm(truth.K[static_cast<std::size_t>(k)]));
      }
    }
}

namespace {

/// In any scalar, from any P0: what rounding does to G and Re^{1/2} stays there, so the errors of the steps add up, each
/// that of a square-root covariance filter times k(Theta), theory (4.2):
/// |dK| <= u (n+m+p) k(Theta) / sp ((s1/sp) |S+| + s1 |G| + |S+| / cos).
template <class Scalar>
void gains_are_within_their_bound() {
  for (const Dimensions& d : sizes)
    for (std::uint64_t seed = 1; seed <= 6; ++seed) {
      SCOPED_TRACE("n=" + std::to_string(d.n) + " m=" + std::to_string(d.m) + " p=" + std::to_string(d.p) + " seed=" +
                   std::to_string(seed));
      const auto problem = drawn(d, seed, 1);
      const Riccati truth = riccati(in<HighPrecision>(problem), 10);
      const auto s = in<Scalar>(problem);
      ChandrasekharFilter<Scalar> filter(d);
      filter.start(s.S0, Vector<Scalar>(Vector<Scalar>::Zero(d.n)));
      double sum = 0, theta = 1;
      for (std::size_t k = 0; k < 10; ++k) {
        ASSERT_TRUE(filter.step(s.model));
        theta = std::max(theta, static_cast<double>(filter.rotation_condition()));
        const double re = norm(truth.Re[k]), s_next = std::sqrt(norm(truth.P[k + 1])), gain = norm(truth.K[k]);
        // |Re^{-1}| <= |R^{-1}|, R = R^{1/2} R^{T/2} of the model.
        const Matrix<double> R_root = problem.models[0].R_root.triangularView<Eigen::Lower>();
        const double re_inverse = std::pow(
            Matrix<double>(R_root.triangularView<Eigen::Lower>().solve(Matrix<double>::Identity(d.p, d.p))).norm(), 2);
        const double k_root = std::sqrt(std::max(1., re * re_inverse));
        const double both = std::sqrt(s_next * s_next + gain * gain * re);  // |[G S+]|, s_next / cos
        sum += std::sqrt(re_inverse) * (k_root * s_next + std::sqrt(re) * gain * std::sqrt(re) + both);
        const double unit = static_cast<double>(unit_roundoff<Scalar>()) * static_cast<double>(d.n + d.m + d.p);
        Matrix<HighPrecision> error = truth.K[k];
        for (Index j = 0; j < d.p; ++j)
          for (Index i = 0; i < d.n; ++i) error(i, j) -= HighPrecision(filter.predictor_gain()(i, j));
        EXPECT_LE(norm(error), threshold * unit * theta * sum) << "step " << k;
      }
    }
}

}  // namespace

TEST(Chandrasekhar, GainsInFloat) { gains_are_within_their_bound<float>(); }
TEST(Chandrasekhar, GainsInDouble) { gains_are_within_their_bound<double>(); }
TEST(Chandrasekhar, GainsInLongDouble) { gains_are_within_their_bound<long double>(); }

// P0 = 0: L_0 = B Q^{1/2}, to the last bit, and Theta is orthogonal throughout.
TEST(Chandrasekhar, FromZeroItIsOrthogonal) {
  for (const Dimensions& d : sizes) {
    const auto problem = drawn(d, 3, 0);
    const Model& model = problem.models[0];
    Filter filter(d);
    SquareRootCovarianceFilter<double> dense(d);
    const Matrix<double> zero = Matrix<double>::Zero(d.n, d.n);
    filter.start(zero, problem.x0);
    dense.start(zero, problem.x0);
    double sum = 0;
    for (int k = 0; k < 20; ++k) {
      ASSERT_TRUE(filter.step(model));
      ASSERT_TRUE(dense.step(model));
      EXPECT_EQ(filter.rotation_condition(), 1);
      EXPECT_EQ(filter.decreasing(), 0);
      EXPECT_EQ(filter.growing(), std::min(d.m, d.n));
      // One step's error, u (n+m+p) k(Re^{1/2}), added up: neither filter loses more, and neither forgets all.
      const Matrix<double> Re_root = dense.innovation_root();
      const double kappa = Re_root.norm() * Matrix<double>(Re_root.triangularView<Eigen::Lower>().solve(
                                                Matrix<double>::Identity(d.p, d.p))).norm();
      sum += kappa * kappa;
      const double unit = unit_roundoff<double>() * static_cast<double>(d.n + d.m + d.p);
      EXPECT_LE((filter.predictor_gain() - dense.predictor_gain()).norm(),
                threshold * unit * sum * (model.A.norm() + dense.predictor_gain().norm()))
          << "n=" << d.n << " step " << k;
    }
  }
}

TEST(Chandrasekhar, AStationaryStartNeedsAsManyColumnsAsThereAreOutputs) {
  // A = 1/2, B Q B' = 3/4: P0 = 1 is stationary. Two states of it, one of them seen.
  Model model;
  model.A = Matrix<double>::Identity(2, 2) / 2;
  model.B = Matrix<double>::Identity(2, 2);
  model.C = Matrix<double>{{1., .5}};
  model.D = Matrix<double>(2, 0);
  model.Q_root = Matrix<double>::Identity(2, 2) * std::sqrt(.75);
  model.R_root = Matrix<double>::Identity(1, 1);
  const Matrix<double> S0 = Matrix<double>::Identity(2, 2);
  const Vector<double> x0 = Vector<double>::Zero(2);
  Filter told(model.dimensions()), found(model.dimensions());
  SquareRootCovarianceFilter<double> dense(model.dimensions());
  told.start(S0, x0, InitialCovariance::stationary);
  found.start(S0, x0);
  dense.start(S0, x0);
  for (int k = 0; k < 10; ++k) {
    ASSERT_TRUE(told.step(model));
    ASSERT_TRUE(found.step(model));
    ASSERT_TRUE(dense.step(model));
    EXPECT_EQ(told.growing(), 0);
    EXPECT_EQ(told.decreasing(), 1);
    // Rounding of P_1 - P_0 is no increment: the rank is found as well.
    EXPECT_EQ(found.growing() + found.decreasing(), 1);
    const double tolerance = threshold * unit_roundoff<double>() * 5 * (k + 1) * told.rotation_condition();
    EXPECT_LE((told.predictor_gain() - dense.predictor_gain()).norm(), tolerance);
    EXPECT_LE((found.predictor_gain() - dense.predictor_gain()).norm(), tolerance);
  }
}

// "Stationary" is believed: of a P0 that is far too small Re would have to fall below R, which no rotation can do.
TEST(Chandrasekhar, AWrongStationaryStartBreaksDown) {
  Model model;
  model.A = Matrix<double>::Identity(1, 1) * 3;
  model.B = Matrix<double>::Zero(1, 1);
  model.C = Matrix<double>::Identity(1, 1);
  model.D = Matrix<double>(1, 0);
  model.Q_root = model.R_root = Matrix<double>::Identity(1, 1);
  Filter filter(model.dimensions());
  filter.start(Matrix<double>(Matrix<double>::Identity(1, 1)), Vector<double>(Vector<double>::Zero(1)),
               InitialCovariance::stationary);
  const auto report = filter.step(model);
  EXPECT_EQ(report.status, Status::hyperbolic_breakdown);
  EXPECT_EQ(filter.state(), Vector<double>(Vector<double>::Zero(1)));
}

// Taken up from its arrays, a run goes on bit by bit; the filter may have been used for another before.
TEST(Chandrasekhar, TakesUpARunFromItsArrays) {
  const auto problem = drawn({4, 2, 2}, 11, 3), other = drawn({4, 2, 2}, 12, 3);
  const auto x0 = Vector<double>::Zero(4);
  Filter whole({4, 2, 2}), second({4, 2, 2});
  whole.start(problem.initial, x0);
  second.start(other.initial, x0);
  ASSERT_TRUE(second.step(other.models[0]));
  for (int k = 0; k < 3; ++k) ASSERT_TRUE(whole.step(problem.models[0]));

  const Matrix<double> L = whole.increment();
  second.start(whole.innovation_root(), whole.normalised_gain(), L, whole.growing(), x0);
  EXPECT_EQ(second.growing(), whole.growing());
  EXPECT_EQ(second.decreasing(), whole.decreasing());
  for (int k = 3; k < 8; ++k) {
    ASSERT_TRUE(whole.step(problem.models[0]));
    ASSERT_TRUE(second.step(problem.models[0]));
    EXPECT_EQ(second.predictor_gain(), whole.predictor_gain()) << k;
    EXPECT_EQ(second.increment(), whole.increment()) << k;
  }
  // And from S0 again.
  second.start(other.initial, x0);
  whole.start(other.initial, x0);
  ASSERT_TRUE(second.step(other.models[0]));
  ASSERT_TRUE(whole.step(other.models[0]));
  EXPECT_EQ(second.normalised_gain(), whole.normalised_gain());
}

TEST(Chandrasekhar, RefusesAModelThatChangesAndGoesOnWithTheOldOne) {
  const auto problem = drawn({4, 2, 2}, 5, 1);
  const Model& model = problem.models[0];
  Filter filter(model.dimensions()), control(model.dimensions());
  filter.start(problem.initial, problem.x0);
  control.start(problem.initial, problem.x0);
  for (int k = 0; k < 6; ++k) {
    for (int which = 0; which < 5 && k > 0; ++which) {
      Model other = model;
      (which == 0   ? other.A(1, 2)
       : which == 1 ? other.B(1, 1)
       : which == 2 ? other.C(1, 0)
       : which == 3 ? other.Q_root(1, 0)
                    : other.R_root(1, 0)) += 1;
      EXPECT_EQ(filter.step(other).status, Status::time_varying_model) << which;
      other.A(0, 0) = std::nan("");
      EXPECT_EQ(filter.step(other).status, Status::non_finite_input);
    }
    Model same = model;  // what is not read may change
    same.Q_root(0, 1) = same.R_root(0, 1) = 7;
    same.D *= 2;
    ASSERT_TRUE(filter.step(same));
    ASSERT_TRUE(control.step(model));
    EXPECT_EQ(filter.predictor_gain(), control.predictor_gain());
    EXPECT_EQ(filter.normalised_gain(), control.normalised_gain());
  }
}

}  // namespace kfstab::test::chandrasekhar
