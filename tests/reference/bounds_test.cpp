#include <kfstab/reference/bounds.hpp>

#include <cmath>

#include <gtest/gtest.h>

#include <kfstab/filters/registry.hpp>
#include <kfstab/reference/steady_state.hpp>

#include "support.hpp"
#include "tolerance.hpp"

namespace kfstab::reference::testing {
namespace {

using test::u;

// ---- three filters in double, as short as they come ----

/// [L 0] = X U, U orthogonal, by rotations of pairs of columns.
Matrix<double> triangularise(Matrix<double> X) {
  for (Index i = 0; i < std::min(X.rows(), X.cols()); ++i)
    for (Index j = i + 1; j < X.cols(); ++j) {
      if (X(i, j) == 0) continue;
      const double r = std::hypot(X(i, i), X(i, j)), c = X(i, i) / r, s = X(i, j) / r;
      for (Index k = i; k < X.rows(); ++k) {
        const double a = X(k, i), b = X(k, j);
        X(k, i) = c * a + s * b;
        X(k, j) = c * b - s * a;
      }
      X(i, j) = 0;
    }
  return X;
}

Matrix<double> lower_solve(const Matrix<double>& L, Matrix<double> X) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) {
      for (Index l = 0; l < i; ++l) X(i, j) -= L(i, l) * X(l, j);
      X(i, j) /= L(i, i);
    }
  return X;
}

Matrix<double> multiply(const Matrix<double>& X, const Matrix<double>& Y) {
  // Eigen steps through the null pointer of an empty matrix
  if (X.cols() == 0) return Matrix<double>::Zero(X.rows(), Y.cols());
  return X.lazyProduct(Y);
}

Matrix<double> symmetrise(const Matrix<double>& X) { return (X + X.transpose()) / 2; }

/// P+ = A (P - P C' Re^{-1} C P) A' + B Q B', symmetrised
Matrix<double> covariance_step(const CovarianceModel<double>& m, const Matrix<double>& P) {
  const Matrix<double> PC = multiply(P, m.C.transpose());
  Matrix<double> L = multiply(m.C, PC) + m.R;
  for (Index j = 0; j < L.cols(); ++j) {
    for (Index l = 0; l < j; ++l) L(j, j) -= L(j, l) * L(j, l);
    L(j, j) = std::sqrt(L(j, j));
    for (Index i = j + 1; i < L.rows(); ++i) {
      for (Index l = 0; l < j; ++l) L(i, j) -= L(i, l) * L(j, l);
      L(i, j) /= L(j, j);
    }
  }
  const Matrix<double> W = lower_solve(L, PC.transpose());
  const Matrix<double> Pf = P - multiply(W.transpose(), W);
  return symmetrise(multiply(multiply(m.A, Pf), m.A.transpose()) + multiply(multiply(m.B, m.Q), m.B.transpose()));
}

Matrix<double> root_step(const RootModel<double>& m, const Matrix<double>& S) {
  const auto d = m.dimensions();
  Matrix<double> pre = Matrix<double>::Zero(d.p + d.n, d.p + d.n + d.m);
  pre.topLeftCorner(d.p, d.p) = m.R_root;
  pre.block(0, d.p, d.p, d.n) = multiply(m.C, S);
  pre.block(d.p, d.p, d.n, d.n) = multiply(m.A, S);
  pre.block(d.p, d.p + d.n, d.n, d.m) = multiply(m.B, m.Q_root);
  return triangularise(pre).block(d.p, d.p, d.n, d.n);
}

/// T of k|k to T of k+1|k+1; first: of k|k-1 to k|k.
Matrix<double> information_step(const InformationModel<double>& m, const Matrix<double>& T, bool first) {
  const auto d = m.dimensions();
  const Index w = first ? 0 : d.m;
  Matrix<double> pre = Matrix<double>::Zero(w + d.n + d.p, w + d.n);
  if (first) {
    pre.block(0, 0, d.n, d.n) = T;
  } else {
    pre.topLeftCorner(w, w) = m.Q_inverse_root;
    pre.block(w, 0, d.n, w) = multiply(T, m.A_inverse_B);
    pre.block(w, w, d.n, d.n) = multiply(T, m.A_inverse);
  }
  pre.block(w + d.n, w, d.p, d.n) = multiply(m.R_inverse_root, m.C);
  const Matrix<double> L = triangularise(pre.transpose());
  return L.block(w, w, d.n, d.n).transpose();
}

Metadata form(Held held) {
  Metadata metadata;
  metadata.holds = held;
  metadata.instant = held == Held::information_factor ? Instant::filtered : Instant::predicted;
  return metadata;
}

struct Measured {
  double worst_ratio = 0;  ///< max error / bound
  double last_bound = 0;
  double worst_condition = 1;  ///< max k(P_{k|k}), of an information problem
  double tightest = 0;         ///< max over steps of error, over max of the bound
};

/// Steps a filter of one form beside the reference and its bound.
template <class ProblemType, class StepFunction>
Measured run(const ProblemType& from, Held held, StepFunction step, int steps) {
  const AnyProblem<double> problem = from;
  Trajectory trajectory(problem, nullptr);
  FirstOrderBound bound(form(held), from.dimensions());
  Matrix<double> X = from.initial;
  Measured result;
  double largest_error = 0, largest_bound = 0;
  for (int k = 0; k < steps; ++k) {
    trajectory.advance();
    X = step(X, k);
    const Errors errors = trajectory.measure(form(held), {{}, &X, nullptr, nullptr});
    result.last_bound = bound.advance(trajectory.truth());
    result.worst_ratio = std::max(result.worst_ratio, errors.covariance / result.last_bound);
    if (held == Held::information_factor)
      result.worst_condition = std::max(result.worst_condition,
                                        trajectory.truth().information.norm() * trajectory.truth().P_filtered.norm());
    largest_error = std::max(largest_error, errors.covariance);
    largest_bound = std::max(largest_bound, result.last_bound);
  }
  result.tightest = largest_error / largest_bound;
  return result;
}

Problem<RootModel<double>> random_root_problem(std::mt19937_64& random, Dimensions d) {
  Problem<RootModel<double>> root;
  root.models = {random_root_model(random, d)};
  root.models[0].A *= 0.75;
  root.initial = few_bits_root(random, d.n);
  root.x0 = Vector<double>::Zero(d.n);
  return root;
}

/// The bounds are first order with a constant of n + m + p, which the errors must not pass; how far below they stay
/// is a matter of luck of rounding (the square root of the number of roundings) and of how the worst case of one step
/// meets that of the next.
constexpr double loosest = 1e4;

TEST(FirstOrderBound, CoversTheCovarianceFilterAndTheSquareRootFilter) {
  std::mt19937_64 random(77);
  for (int trial = 0; trial < 30; ++trial) {
    SCOPED_TRACE(trial);
    const Dimensions d{2 + trial % 4, 1 + trial % 3, 1 + trial % 2};
    const auto root = random_root_problem(random, d);
    const auto covariance = as_covariance(root);
    const Measured P = run(
        covariance, Held::covariance,
        [&](const Matrix<double>& X, int) { return covariance_step(covariance.models[0], X); }, 40);
    const Measured S = run(
        root, Held::covariance_factor, [&](const Matrix<double>& X, int) { return root_step(root.models[0], X); }, 40);
    EXPECT_LE(P.worst_ratio, 1);
    EXPECT_LE(S.worst_ratio, 1);
    EXPECT_GE(P.tightest, 1 / loosest);
    EXPECT_GE(S.tightest, 1 / loosest);
  }
}

TEST(FirstOrderBound, CoversTheInformationFilter) {
  std::mt19937_64 random(78);
  for (int trial = 0; trial < 20; ++trial) {
    SCOPED_TRACE(trial);
    const Dimensions d{2 + trial % 3, 1 + trial % 2, 1 + trial % 2};
    Problem<InformationModel<double>> problem;
    InformationModel<double> model;
    model.A_inverse = Matrix<double>::Identity(d.n, d.n) + 0.5 * few_bits(random, d.n, d.n);
    model.A_inverse_B = few_bits(random, d.n, d.m);
    model.C = few_bits(random, d.p, d.n);
    model.Q_inverse_root = few_bits_root(random, d.m).transpose();
    model.R_inverse_root = few_bits_root(random, d.p).transpose();
    problem.models = {model};
    problem.initial = few_bits_root(random, d.n).transpose();
    problem.x0 = Vector<double>::Zero(d.n);
    const Measured T = run(
        problem, Held::information_factor,
        [&](const Matrix<double>& X, int k) { return information_step(model, X, k == 0); }, 30);
    EXPECT_LE(T.worst_ratio, 1);
    // A bound of P^{-1} by its norm, mapped to P, costs k(P) where the error does not.
    EXPECT_GE(T.tightest, 1 / (loosest * T.worst_condition));
  }
}

/// Nearly parallel measurements: k(Re) = 4.5 / d^2. The covariance filter pays k(Re), the root filter its square root.
TEST(FirstOrderBound, GrowsWithTheConditionAsTheoryHasIt) {
  double previous_P = 0, previous_S = 0;
  for (int j = 4; j <= 16; j += 4) {
    const double d = std::ldexp(1.0, -j);
    Problem<RootModel<double>> root;
    RootModel<double> model;
    model.A = Matrix<double>::Identity(3, 3);
    model.B = Matrix<double>(3, 0);
    model.Q_root = Matrix<double>(0, 0);
    model.C = matrix(2, 3, {1, 1, 1, 1, 1, 1 + d});
    model.R_root = d * Matrix<double>::Identity(2, 2);
    root.models = {model};
    root.initial = Matrix<double>::Identity(3, 3);
    root.x0 = Vector<double>::Zero(3);
    const auto covariance = as_covariance(root);
    const Measured P = run(
        covariance, Held::covariance,
        [&](const Matrix<double>& X, int) { return covariance_step(covariance.models[0], X); }, 1);
    const Measured S = run(
        root, Held::covariance_factor, [&](const Matrix<double>& X, int) { return root_step(model, X); }, 1);
    EXPECT_LE(P.worst_ratio, 1);
    EXPECT_LE(S.worst_ratio, 1);
    if (j > 4) {
      // four binary digits of d; next to nothing else changes
      EXPECT_NEAR(std::log2(P.last_bound / previous_P), 8, 0.5);
      EXPECT_NEAR(std::log2(S.last_bound / previous_S), 4, 0.5);
    }
    previous_P = P.last_bound;
    previous_S = S.last_bound;
  }
}

TEST(FirstOrderBound, AccumulatesByTheClosedLoop) {
  // Scalar, no measurement: P+ = P + 1 with A = 1, so W_{k+1} = W_k + delta_k, delta_k = 3 u P_{k+1}: by hand
  Truth truth;
  truth.closed_loop = Matrix<double>::Identity(1, 1);
  FirstOrderBound bound(form(Held::covariance), {1, 1, 1});
  double W = 0;
  for (int k = 1; k < 10; ++k) {
    truth.P_next = Matrix<double>::Constant(1, 1, k + 1.0);
    W += 3 * u * (k + 1.0);
    EXPECT_NEAR(bound.advance(truth) / (W / (k + 1.0)), 1, 1e-14);
  }
}

/// The gain of the filters of the registry, one of each kind of gain and of each form that theory speaks of.
TEST(FirstOrderBound, CoversTheGain) {
  std::mt19937_64 random(79);
  for (const char* id : {"ckf", "ckf-textbook", "joseph", "srcf", "potter", "svd"}) {
    double tightest = 0;
    for (int trial = 0; trial < 20; ++trial) {
      SCOPED_TRACE(::testing::Message() << id << ", trial " << trial);
      const Dimensions d{2 + trial % 3, 1 + trial % 3, 1 + trial % 2};
      const auto root = random_root_problem(random, d);
      const auto filter = make_filter<double>(id);
      const Metadata& metadata = filter->metadata();
      AnyProblem<double> problem = root;
      if (metadata.takes == Parametrisation::covariance) problem = as_covariance(root);
      Trajectory trajectory(problem, nullptr);
      FirstOrderBound bound(metadata, d);
      filter->start(problem);
      for (int k = 0; k < 40; ++k) {
        trajectory.advance();
        const Errors errors = trajectory.measure(metadata, filter->step(k, nullptr, nullptr));
        bound.advance(trajectory.truth());
        const double gain = bound.gain(trajectory.truth(), root.models[0].C);
        ASSERT_LE(errors.gain, gain) << k;
        tightest = std::max(tightest, errors.gain / gain);
      }
    }
    EXPECT_GE(tightest, 1 / loosest) << id;
  }
  Truth none;
  none.predictor_gain = Matrix<double>(2, 0);
  EXPECT_EQ(FirstOrderBound(form(Held::covariance), {2, 1, 0}).gain(none, Matrix<double>(0, 2)), 0);
  EXPECT_TRUE(std::isnan(FirstOrderBound(form(Held::information_factor), {2, 1, 1}).gain(none, {})));
}

/// An error of P that is there already: the carried term alone, (3.2), by hand for one state.
TEST(FirstOrderBound, CarriesAnErrorOfPIntoTheGain) {
  Truth truth;
  const auto one = [](double x) { return Matrix<double>::Constant(1, 1, x); };
  truth.closed_loop = one(0.5);
  truth.predictor_gain = one(0.25);
  truth.innovation = one(8);
  truth.P_next = one(4);
  FirstOrderBound bound(form(Held::covariance), {1, 1, 1});
  bound.advance(truth);
  const double first = 3 * u;
  EXPECT_NEAR(bound.gain(truth, one(2)) / first, 1, 1e-14);  // nothing before it: k(Re) = 1
  bound.advance(truth);
  // W = 3 u 4 after the first step; F W C / Re = 12 u / 8, relative to .25
  EXPECT_NEAR(bound.gain(truth, one(2)) / (first + 12 * u * 0.5 * 2 / 8 / 0.25), 1, 1e-14);
}

// ---- asymmetry ----

using Mat = Matrix<Wide>;

Mat mul(const Mat& X, const Mat& Y) {
  Mat Z(X.rows(), Y.cols());
  for (Index j = 0; j < Z.cols(); ++j)
    for (Index i = 0; i < Z.rows(); ++i) {
      Z(i, j) = 0;
      for (Index l = 0; l < X.cols(); ++l) Z(i, j) += X(i, l) * Y(l, j);
    }
  return Z;
}
Mat flip(const Mat& X) {
  Mat Y(X.cols(), X.rows());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(j, i) = X(i, j);
  return Y;
}
Mat combine(const Mat& X, const Mat& Y, int sign) {
  Mat Z(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Z(i, j) = sign > 0 ? Wide(X(i, j) + Y(i, j)) : Wide(X(i, j) - Y(i, j));
  return Z;
}
Mat add(const Mat& X, const Mat& Y) { return combine(X, Y, 1); }
Mat sub(const Mat& X, const Mat& Y) { return combine(X, Y, -1); }
Mat inverse_of_two_by_two(const Mat& X) {
  const Wide det = X(0, 0) * X(1, 1) - X(0, 1) * X(1, 0);
  Mat Y(2, 2);
  Y(0, 0) = X(1, 1) / det;
  Y(1, 1) = X(0, 0) / det;
  Y(0, 1) = -X(0, 1) / det;
  Y(1, 0) = -X(1, 0) / det;
  return Y;
}
Wide size_of(const Mat& X) {
  Wide s = 0;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) s += X(i, j) * X(i, j);
  return sqrt(s);
}

/// One step of each coding in 200 digits, literally: U = P C', V = C P, Re as it comes or its lower triangle mirrored.
Mat coded_step(Asymmetry coding, bool one_triangle, const Mat& A, const Mat& C, const Mat& BQB, const Mat& R,
               const Mat& P) {
  const Mat U = mul(P, flip(C)), V = mul(C, P), Ct = flip(C), At = flip(A);
  Mat Re;
  switch (coding) {
    case Asymmetry::mixed: Re = add(R, mul(C, flip(V))); break;
    case Asymmetry::cp: Re = add(R, mul(V, Ct)); break;
    default: Re = add(R, mul(C, U)); break;
  }
  if (one_triangle) Re(0, 1) = Re(1, 0);
  const Mat Re_inverse = inverse_of_two_by_two(Re);
  const bool transposed_gain = coding == Asymmetry::mixed || coding == Asymmetry::cp;
  const Mat Kf = mul(transposed_gain ? flip(V) : U, Re_inverse), K = mul(A, Kf);
  switch (coding) {
    case Asymmetry::textbook: return add(mul(mul(sub(A, mul(K, C)), P), At), BQB);
    case Asymmetry::mixed: return add(sub(mul(mul(A, P), At), mul(mul(K, flip(U)), At)), BQB);
    case Asymmetry::gain: return add(sub(mul(mul(A, P), At), mul(mul(K, Re), flip(K))), BQB);
    case Asymmetry::cp: return add(sub(mul(mul(A, P), At), mul(mul(K, V), At)), BQB);
    case Asymmetry::downdate: return add(mul(mul(A, sub(P, mul(Kf, flip(U)))), At), BQB);
    case Asymmetry::none: break;
  }
  return P;
}

TEST(AsymmetryMap, IsFirstOrderOfEachCoding) {
  std::mt19937_64 random(5);
  for (int trial = 0; trial < 3; ++trial) {
    const auto root = random_root_problem(random, {3, 2, 2});
    const auto covariance = as_covariance(root);
    const auto& m = covariance.models[0];
    const AnyProblem<double> problem = covariance;
    Trajectory trajectory(problem, nullptr);
    trajectory.advance();
    const Truth& t = trajectory.truth();
    const Matrix<double> KC = multiply(t.predictor_gain, m.C);
    Matrix<double> D = few_bits(random, 3, 3);
    D = Matrix<double>(D - D.transpose());
    for (const Asymmetry coding :
         {Asymmetry::textbook, Asymmetry::mixed, Asymmetry::gain, Asymmetry::cp, Asymmetry::downdate})
      for (const bool one_triangle : {false, true}) {
        SCOPED_TRACE(::testing::Message()
                     << "trial " << trial << " coding " << static_cast<int>(coding) << " LLT " << one_triangle);
        const Mat predicted = exact<Wide>(asymmetry_map(coding, one_triangle, m.A, KC, t.closed_loop, D));
        double residual[2];
        const double seeds[] = {0x1p-20, 0x1p-40};
        for (int s = 0; s < 2; ++s) {
          Mat P = exact<Wide>(covariance.initial);
          for (Index j = 0; j < 3; ++j)
            for (Index i = 0; i < 3; ++i) P(i, j) += Wide(seeds[s] * D(i, j)) / 2;  // P - P' = seed D
          const Mat next = coded_step(coding, one_triangle, exact<Wide>(m.A), exact<Wide>(m.C),
                                      exact<Wide>(multiply(multiply(m.B, m.Q), m.B.transpose())), exact<Wide>(m.R), P);
          Mat skew = sub(next, flip(next));
          for (Index j = 0; j < 3; ++j)
            for (Index i = 0; i < 3; ++i) skew(i, j) /= seeds[s];
          residual[s] = round_to_double(Wide(size_of(sub(skew, predicted)) / size_of(exact<Wide>(D))));
        }
        // What is left is of second order: in proportion to the seed, but for what rounding K and F to double leaves.
        const double scale = (1 + m.A.squaredNorm()) * (1 + KC.squaredNorm());
        EXPECT_LE(residual[0], seeds[0] * 100 * scale);
        EXPECT_LE(residual[1], residual[0] * seeds[1] / seeds[0] * 4 + 64 * u * scale);
      }
  }
}

TEST(AsymmetryMap, NoneIsNone) {
  const Matrix<double> X = Matrix<double>::Identity(2, 2), D = matrix(2, 2, {0, 1, -1, 0});
  EXPECT_EQ(asymmetry_map(Asymmetry::none, false, X, X, X, D), Matrix<double>::Zero(2, 2));
  EXPECT_EQ(asymmetry_growth(Asymmetry::none, false, X, X, X), 0);
  EXPECT_EQ(asymmetry_growth(Asymmetry::gain, false, matrix(1, 1, {2}), matrix(1, 1, {1}), matrix(1, 1, {1})), 0);
}

/// n = 2: X D X' = det(X) D for the one antisymmetric D there is.
TEST(AsymmetryGrowth, TwoStatesInClosedForm) {
  std::mt19937_64 random(8);
  for (int trial = 0; trial < 10; ++trial) {
    const Matrix<double> A = few_bits(random, 2, 2), KC = few_bits(random, 2, 2), F = A - KC;
    const auto det = [](const Matrix<double>& X) { return X(0, 0) * X(1, 1) - X(0, 1) * X(1, 0); };
    const double a = det(A), f = det(F), m = det(KC);
    const auto expect = [&](Asymmetry coding, bool one_triangle, double growth) {
      // a few roundings of products of numbers up to 2
      EXPECT_NEAR(asymmetry_growth(coding, one_triangle, A, KC, F), std::abs(growth), 64 * u);
    };
    expect(Asymmetry::textbook, false, f);
    expect(Asymmetry::textbook, true, f - m);
    expect(Asymmetry::mixed, false, 2 * a - f);
    expect(Asymmetry::mixed, true, 2 * a - f + m);
    expect(Asymmetry::gain, false, a - m);
    expect(Asymmetry::gain, true, a);
    expect(Asymmetry::cp, false, a + m);
    expect(Asymmetry::cp, true, a);
    expect(Asymmetry::downdate, false, a + m);
    expect(Asymmetry::downdate, true, a);
  }
}

/// A stable system of which two codings diverge, and an unstable one on which mirroring Re costs the textbook form its
/// damping.
TEST(AsymmetryGrowth, StableSystemThatDiverges) {
  const auto growth = [](double r, Asymmetry coding, bool one_triangle) {
    CovarianceModel<double> model;
    model.A = r * matrix(2, 2, {std::cos(0.7), -std::sin(0.7), std::sin(0.7), std::cos(0.7)});
    model.B = matrix(2, 2, {1, 0, 0.5, 0.25});
    model.C = model.Q = Matrix<double>::Identity(2, 2);
    model.R = 0.01 * Matrix<double>::Identity(2, 2);
    const SteadyState s = steady_state(
        Problem<CovarianceModel<double>>{{model}, Matrix<double>::Identity(2, 2), Vector<double>::Zero(2)});
    return asymmetry_growth(coding, one_triangle, model.A, multiply(s.predictor_gain, model.C), s.closed_loop);
  };
  // four decimals are what was found by iterating the codings
  EXPECT_NEAR(growth(0.9, Asymmetry::cp, false), 1.4935, 5e-5);
  EXPECT_NEAR(growth(0.9, Asymmetry::downdate, false), 1.4935, 5e-5);
  EXPECT_NEAR(growth(0.9, Asymmetry::cp, true), 0.81, 1e-12);
  EXPECT_NEAR(growth(1.1, Asymmetry::textbook, true), 1.0291, 5e-5);
  EXPECT_LT(growth(1.1, Asymmetry::textbook, false), 1);
}

}  // namespace
}  // namespace kfstab::reference::testing
