#include <kfstab/filters/kernels.hpp>

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include <kfstab/filters/hessenberg_square_root_covariance.hpp>
#include <kfstab/filters/hessenberg_square_root_information.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/filters/square_root_covariance.hpp>
#include <kfstab/filters/square_root_information.hpp>

#include "filters/fixed_kernels.hpp"
#include "filters/in_batch.hpp"
#include "filters/random_problem.hpp"
#include "filters/with_kernels.hpp"
#include "tolerance.hpp"

namespace kfstab::test {
namespace {

using Wide = Matrix<long double>;  // truth beside double: 11 bits more, and a range that no square leaves
using Srcf = SquareRootCovarianceFilter<double>;

const double infinity = std::numeric_limits<double>::infinity(), nan = std::nan("");

/// What there is to know of a step.
struct KernelResult {
  StepReport<double> report;
  Matrix<double> factor, gain, innovation_root;
};

/// One step from S0.
template <class Filter>
KernelResult one_step(const RootModel<double>& model, const Matrix<double>& S0, Wanted wanted = Wanted::all) {
  Filter filter(model.dimensions());
  filter.start(S0, Vector<double>::Zero(S0.rows()).eval());
  typename Filter::Model as_filter;
  as_filter.A = model.A;
  as_filter.B = model.B;
  as_filter.C = model.C;
  as_filter.D = model.D;
  as_filter.Q_root = model.Q_root;
  as_filter.R_root = model.R_root;
  KernelResult is;
  is.report = filter.step(as_filter, nullptr, nullptr, wanted);
  is.factor = filter.factor();
  is.gain = filter.predictor_gain();
  is.innovation_root = filter.innovation_root();
  return is;
}

RootModel<double> random_model(Dice& dice, const Dimensions& d) {
  RootModel<double> model;
  model.A = dice.matrix(d.n, d.n, 16);
  model.B = dice.matrix(d.n, d.m, 16);
  model.C = dice.matrix(d.p, d.n, 16);
  model.D.resize(d.n, 0);
  model.Q_root = dice.lower_root(d.m);
  model.R_root = dice.lower_root(d.p);
  for (Matrix<double>* root : {&model.Q_root, &model.R_root})
    for (Index j = 0; j < root->cols(); ++j)
      for (Index i = 0; i < j; ++i) (*root)(i, j) = nan;
  return model;
}

Wide lower(const Matrix<double>& X) {
  Wide L = Wide::Zero(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = j; i < X.rows(); ++i) L(i, j) = X(i, j);
  return L;
}

long double row_product(const Wide& X, Index i, Index j) {
  long double sum = 0;
  for (Index k = 0; k < X.cols(); ++k) sum += X(i, k) * X(j, k);
  return sum;
}

/// What the rows of the array are to each other after the step against what they were before: largest error of an inner
/// product over u (n + m + p) |row i| |row j|, the norms those of sums of absolute values, as the array itself is computed.
double backward_error(const RootModel<double>& model, const Matrix<double>& S0, const KernelResult& is) {
  const auto [n, m, p] = model.dimensions();
  const Wide S = lower(S0), Q = lower(model.Q_root), R = lower(model.R_root);
  const auto array = [&, n = n, m = m, p = p](auto f) {
    Wide X = Wide::Zero(p + n, p + n + m);
    for (Index i = 0; i < p + n; ++i)
      for (Index j = 0; j < p + n + m; ++j) {
        if (i < p && j < p) X(i, j) = f(R(i, j));
        if (j >= p && j < p + n)
          for (Index k = j - p; k < n; ++k) X(i, j) += f((i < p ? model.C(i, k) : model.A(i - p, k)) * S(k, j - p));
        if (i >= p && j >= p + n)
          for (Index k = j - p - n; k < m; ++k) X(i, j) += f(model.B(i - p, k) * Q(k, j - p - n));
      }
    return X;
  };
  const Wide before = array([](long double x) { return x; });
  const Wide scale = array([](long double x) { return std::abs(x); });
  // [Re 0; K Re, S+]
  Wide after = Wide::Zero(p + n, p + n);
  for (Index j = 0; j < p; ++j)
    for (Index i = 0; i < p; ++i) after(i, j) = is.innovation_root(i, j);
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < p; ++j)
      for (Index k = j; k < p; ++k)
        after(p + i, j) += static_cast<long double>(is.gain(i, k)) * is.innovation_root(k, j);
    for (Index j = 0; j < n; ++j) after(p + i, p + j) = is.factor(i, j);
  }
  double worst = 0;
  for (Index i = 0; i < p + n; ++i)
    for (Index j = 0; j <= i; ++j) {
      const long double error = std::abs(row_product(before, i, j) - row_product(after, i, j));
      const long double norms = std::sqrt(row_product(scale, i, i) * row_product(scale, j, j));
      if (error == 0) continue;
      const auto ratio = static_cast<double>(error / (0x1p-53L * (n + m + p) * norms));
      if (!(ratio <= worst)) worst = ratio;
    }
  return worst;
}

// Sizes on both sides of every border that a kernel has: a vector, several, more columns than the small ones take.
const std::vector<Dimensions> kernel_sizes = {{1, 1, 1}, {1, 0, 0}, {2, 1, 3}, {3, 2, 0}, {4, 2, 2}, {4, 0, 4},
                                              {5, 3, 3}, {7, 9, 1}, {8, 4, 4}, {6, 60, 2}, {9, 3, 8}, {1, 1, 12},
                                              {12, 4, 4}, {16, 8, 8}, {23, 5, 9}, {24, 24, 24}, {40, 0, 1},
                                              {33, 17, 18}};

std::string text(const Dimensions& d) {
  return "n=" + std::to_string(d.n) + " m=" + std::to_string(d.m) + " p=" + std::to_string(d.p);
}

// The same step, by each of them, of one filter and in a batch.
TEST(Kernels, AreBackwardStableAsThePlainTextIs) {
  constexpr int steps = 40;
  for (const Dimensions& d : kernel_sizes) {
    std::vector<double> means;
    for (const std::string& isa : all_kernels())
      for (const bool batch : {false, true}) {
        SCOPED_TRACE(isa + (batch ? " in a batch " : " ") + text(d));
        const WithKernels with(isa);
        double& mean = means.emplace_back(0.0);
        for (std::uint64_t seed = 1; seed <= steps; ++seed) {
          Dice dice(seed);
          const RootModel<double> model = random_model(dice, d);
          const Matrix<double> S0 = dice.lower_root(d.n);
          const KernelResult is = batch ? one_step<InBatch<Srcf>>(model, S0) : one_step<Srcf>(model, S0);
          ASSERT_EQ(is.report.status, Status::ok);
          const double error = backward_error(model, S0, is);
          EXPECT_LE(error, threshold);
          mean += error / steps;
          for (Index j = 0; j < d.n; ++j)
            for (Index i = 0; i < j; ++i) ASSERT_EQ(is.factor(i, j), 0);
          for (Index j = 0; j < d.p; ++j)
            for (Index i = 0; i < j; ++i) ASSERT_EQ(is.innovation_root(i, j), 0);
        }
        // Of the mean, since the worst of a few is a matter of chance; where the plain text has no errors, of order 1, a
        // reflector of another sign may make some: a rounding of one product is 1/(n + m + p).
        EXPECT_LE(mean, 2 * means.front() + 1.0 / static_cast<double>(d.n + d.m + d.p));
      }
  }
}

/// log10 of S's determinant squared.
long double log_determinant(const Matrix<double>& S) {
  long double sum = 0;
  for (Index i = 0; i < S.rows(); ++i) sum += 2 * std::log10(std::abs(static_cast<long double>(S(i, i))));
  return sum;
}

// Standard deviations from 1 down to 1e-18: without process noise, det A = 1, det P+ is det P / Re, and right as long as every
// column of the root is right for itself. Reflectors see to that if the large columns come first: errors of a column, some
// (n + m + p) u of it, are seen in the determinant of what is left when columns are scaled, well conditioned here.
TEST(Kernels, KeepWhatIsSmallRight) {
  for (const Index n : {3, 12, 20, 40}) {
    const Dimensions d{n, 2, 1};
    Dice dice(9);
    Problem<RootModel<double>> problem;
    RootModel<double>& model = problem.models.emplace_back();
    model.A.setIdentity(n, n);
    for (Index j = 1; j < n; ++j) model.A(j - 1, j) = .5;
    model.B.setZero(n, d.m);
    model.C.setZero(d.p, n);
    model.C(0, 0) = 1;
    model.D.resize(n, 0);
    model.Q_root.setIdentity(d.m, d.m);
    model.R_root.setIdentity(d.p, d.p);
    problem.x0.setZero(n);
    problem.initial.setZero(n, n);
    const Matrix<double> mixed = dice.matrix(n, n, 16);
    for (Index j = 0; j < n; ++j)
      for (Index i = j; i < n; ++i)
        problem.initial(i, j) = std::pow(10, -18.0 * static_cast<double>(j) / static_cast<double>(n - 1)) *
                                (i == j ? 1 : mixed(i, j) / static_cast<double>(n));
    const long double exact = log_determinant(problem.initial) - std::log10(2.0L);  // Re = 1 + 1
    const AnyProblem<double> any = problem;
    for (const std::string& isa : all_kernels())
      for (const bool batch : {false, true}) {
        const WithKernels with(isa);
        const auto filter = batch ? in_batch("srcf") : make_filter<double>("srcf");
        filter->start(any);
        const auto step = filter->step(0, nullptr, nullptr);
        ASSERT_EQ(step.report.status, Status::ok);
        EXPECT_NEAR(static_cast<double>(log_determinant(*step.held) - exact), 0,
                    threshold * 0x1p-53 * static_cast<double>(n * (n + d.m + d.p)))
            << isa << (batch ? " batch" : "") << " n=" << n;
      }
  }
}

// What is above the diagonal of a root is not read, whatever it is: numbers, of which a kernel that reads them makes others.
TEST(Kernels, ReadTheLowerTrianglesAlone) {
  for (const Dimensions& d : {Dimensions{6, 2, 41}, Dimensions{6, 41, 2}, Dimensions{41, 2, 3}, Dimensions{3, 2, 4}})
    for (const std::string& isa : all_kernels()) {
      const WithKernels with(isa);
      Dice dice(5);
      RootModel<double> model = random_model(dice, d);
      Matrix<double> S0 = dice.lower_root(d.n);
      KernelResult results[2];
      for (const double above : {0., 7.}) {
        for (Matrix<double>* root : {&model.Q_root, &model.R_root, &S0})
          for (Index j = 0; j < root->cols(); ++j)
            for (Index i = 0; i < j; ++i) (*root)(i, j) = above;
        results[above != 0] = one_step<Srcf>(model, S0);
      }
      EXPECT_EQ(results[0].factor, results[1].factor) << isa << ' ' << text(d);
      EXPECT_EQ(results[0].innovation_root, results[1].innovation_root) << isa << ' ' << text(d);
      EXPECT_EQ(results[0].gain, results[1].gain) << isa << ' ' << text(d);
    }
}

template <int N, int M, int P>
void fixed_is_dynamic() {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Dice dice(seed);
    const RootModel<double> model = random_model(dice, {N, M, P});
    const Matrix<double> S0 = dice.lower_root(N);
    const KernelResult is = one_step<SquareRootCovarianceFilter<double, N, M, P>>(model, S0);
    ASSERT_EQ(is.report.status, Status::ok);
    EXPECT_LE(backward_error(model, S0, is), threshold) << text({N, M, P});
  }
}

TEST(Kernels, OfFixedSizesAreBackwardStable) {
  fixed_is_dynamic<1, 1, 1>();
  fixed_is_dynamic<3, 2, 1>();
  fixed_is_dynamic<2, 0, 3>();
  fixed_is_dynamic<5, 1, 0>();
}

// Beside the kernels for any size, which the tests above hold against the plain text: all results, the right-hand side too.
TEST(Kernels, OfFixedSizesAreThoseOfAnySize) {
  for (const kernels::Kernels& kernel : kernels::available()) {
    const FixedKernels* const fixed = fixed_kernels(kernel.isa);
    ASSERT_NE(fixed, nullptr) << kernel.isa;
    for (const Dimensions& d : {Dimensions{3, 1, 2}, Dimensions{4, 2, 2}, Dimensions{9, 1, 9}})
      for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        if (d.n == 9 && fixed->width < 8) continue;  // the kernel of AVX-512 for that size has loops
        const Index n = d.n, m = d.m, p = d.p;
        const bool transposed = n == 3;
        SCOPED_TRACE(std::string(kernel.isa) + ' ' + text(d) + (transposed ? " transposed" : ""));
        Dice dice(seed);
        const auto given = [&](Index rows, Index cols) {
          return transposed ? Matrix<double>(dice.matrix(cols, rows, 16)) : Matrix<double>(dice.matrix(rows, cols, 16));
        };
        const auto root = [&](Index size) {
          return transposed ? Matrix<double>(dice.lower_root(size).transpose()) : dice.lower_root(size);
        };
        const Matrix<double> A = given(n, n), B = given(n, m), C = given(p, n), S = root(n), Q = root(m), R = root(p);
        const Vector<double> x = dice.vector(n, 16), y = dice.vector(m, 16), z = dice.vector(p, 16);
        const auto run = [&](bool (*array_step)(const kernels::ArrayStep&)) {
          Matrix<double> S_next = Matrix<double>::Zero(n, n), Re = Matrix<double>::Zero(p, p), K(n, p);
          Vector<double> right = Vector<double>::Zero(n + m), work(kernels::array_step_work(n, m, p));
          double rcond = 0;
          kernels::ArrayStep step{.n = n,
                                  .m = m,
                                  .p = p,
                                  .A_band = n,
                                  .C_band = n,
                                  .transposed = transposed,
                                  .A = kernels::source(A),
                                  .B = kernels::source(B),
                                  .C = kernels::source(C),
                                  .S = kernels::source(S),
                                  .Q = kernels::source(Q),
                                  .R = kernels::source(R),
                                  .S_next = kernels::target(S_next),
                                  .Re = kernels::target(Re),
                                  .rcond_of_Re = &rcond,
                                  .work = work.data()};
          if (transposed) {
            step.x = x.data();
            step.y = y.data();
            step.z = z.data();
            step.xi = right.data();
            step.e = right.data() + n;
          } else {
            step.K = kernels::target(K);
          }
          EXPECT_TRUE(array_step(step));
          const Matrix<double> L = transposed ? Matrix<double>(S_next.transpose()) : S_next;
          // Signs of columns are free: what does not depend on them is compared.
          Matrix<double> rest = transposed ? Matrix<double>(L.lazyProduct(right.head(n))) : K;
          return std::tuple{Matrix<double>(L.lazyProduct(L.transpose())), rest, right.tail(m).cwiseAbs().eval(), rcond};
        };
        const auto [P, rest, e, rcond] = run(kernel.array_step);
        const auto [P_, rest_, e_, rcond_] = run(fixed->array);
        // The gain is divided by Re^{1/2}, whose backward error is multiplied by its condition number.
        const double unit = threshold * 0x1p-53 * static_cast<double>(n + m + p);
        EXPECT_LE((P - P_).norm(), unit * P.norm());
        EXPECT_LE((rest - rest_).norm(), unit / rcond * rest.norm());
        EXPECT_NEAR(rcond_, rcond, unit);
        if (transposed) {
          EXPECT_LE((e - e_).norm(), unit * x.norm() * P.norm());
        }
      }
  }
}

// Rows of the array as large or small as doubles allow: all of them, or every other.
TEST(Kernels, AreGuardedAgainstOverAndUnderflow) {
  for (const Dimensions& d : {Dimensions{4, 2, 2}, Dimensions{20, 10, 10}, Dimensions{33, 5, 9}})
    for (const double scale : {1e-300, 1e300})
      for (const bool all_rows : {true, false}) {
        Dice dice(7);
        RootModel<double> model = random_model(dice, d);
        for (Index i = 0; i < d.n; ++i)
          if (all_rows || i % 2) {
            model.A.row(i) *= scale;
            model.B.row(i) *= scale;
          }
        for (Index i = 0; i < d.p; ++i)
          if (all_rows || i % 2 == 0) {
            model.C.row(i) *= scale;
            for (Index j = 0; j <= i; ++j) model.R_root(i, j) *= scale;
          }
        const Matrix<double> S0 = dice.lower_root(d.n);
        for (const std::string& isa : all_kernels()) {
          SCOPED_TRACE(isa + ' ' + text(d) + " scale " + std::to_string(std::log10(scale)));
          const WithKernels with(isa);
          const KernelResult is = one_step<Srcf>(model, S0);
          const WithKernels without("plain");
          const KernelResult plain = one_step<Srcf>(model, S0);
          ASSERT_EQ(is.report.status, plain.report.status);
          if (!plain.report) continue;
          EXPECT_LE(backward_error(model, S0, is), threshold);
        }
      }
}

TEST(Kernels, LeaveStatusesAsTheyAre) {
  const auto status = [](const RootModel<double>& model, const Matrix<double>& S0) {
    return one_step<Srcf>(model, S0).report.status;
  };
  for (const Dimensions& d : {Dimensions{4, 2, 2}, Dimensions{20, 10, 10}, Dimensions{40, 5, 3}})
    for (const std::string& isa : all_kernels()) {
      SCOPED_TRACE(isa + ' ' + text(d));
      const WithKernels with(isa);
      Dice dice(3);
      const RootModel<double> sound = random_model(dice, d);
      const Matrix<double> S0 = dice.lower_root(d.n);
      EXPECT_EQ(status(sound, S0), Status::ok);
      for (const double bad : {nan, infinity}) {
        RootModel<double> model = sound;
        model.A(d.n - 1, 0) = bad;
        EXPECT_EQ(status(model, S0), Status::non_finite_input);
        model = sound;
        model.B(0, d.m - 1) = bad;
        EXPECT_EQ(status(model, S0), Status::non_finite_input);
        model = sound;
        model.R_root(d.p - 1, 0) = bad;
        EXPECT_EQ(status(model, S0), Status::non_finite_input);
      }
      RootModel<double> model = sound;
      model.A *= 1e308;
      model.B *= 1e308;
      EXPECT_EQ(status(model, S0), Status::overflow);
      model = sound;
      model.C.row(1).setZero();
      model.R_root.row(1).setZero();
      EXPECT_EQ(status(model, S0), Status::singular_innovation);
      model = sound;
      model.C.setZero();
      model.R_root.setZero();
      EXPECT_EQ(status(model, S0), Status::singular_innovation);
      // Nothing at all is left: P+ = 0 is a covariance.
      model = sound;
      model.A.setZero();
      model.B.setZero();
      const KernelResult none = one_step<Srcf>(model, S0);
      EXPECT_EQ(none.report.status, Status::ok);
      EXPECT_TRUE(none.factor.isZero(0));
      EXPECT_TRUE(none.gain.isZero(0));
    }
}

TEST(Kernels, ComputeWhatIsWanted) {
  for (const std::string& isa : all_kernels())
    for (const Dimensions& d : {Dimensions{4, 2, 2}, Dimensions{20, 10, 10}, Dimensions{3, 2, 0}}) {
      SCOPED_TRACE(isa + ' ' + text(d));
      const WithKernels with(isa);
      Dice dice(5);
      RootModel<double> model = random_model(dice, d);
      const Matrix<double> S0 = dice.lower_root(d.n);
      const KernelResult all = one_step<Srcf>(model, S0), gain = one_step<Srcf>(model, S0, Wanted::gain),
                   factor = one_step<Srcf>(model, S0, Wanted::factor);
      EXPECT_EQ(all.factor, gain.factor);
      EXPECT_EQ(all.factor, factor.factor);
      EXPECT_EQ(all.gain, gain.gain);
      EXPECT_TRUE(factor.gain.isZero(0));
      EXPECT_EQ(all.innovation_root, factor.innovation_root);
      EXPECT_TRUE(all.report && gain.report && factor.report);
      EXPECT_TRUE(std::isnan(gain.report.rcond) && std::isnan(factor.report.rcond));
      if (d.p == 0) continue;
      model.C.row(0).setZero();
      model.R_root.row(0).setZero();
      EXPECT_EQ(one_step<Srcf>(model, S0, Wanted::gain).report.status, Status::singular_innovation);
      EXPECT_EQ(one_step<Srcf>(model, S0, Wanted::factor).report.status, Status::ok);
    }
}

/// Largest difference of two matrices over u size times the larger norm.
double difference(const Matrix<double>& X, const Matrix<double>& Y, Index size) {
  const double scale = std::max(X.norm(), Y.norm()), error = (X - Y).norm();
  return error == 0 ? 0 : error / (0x1p-53 * static_cast<double>(size) * scale);
}

// The forms that the same kernel serves, through the registry, beside their own plain text. One step from the same numbers:
// S S' and T'T differ by the backward errors of two orthogonal factorisations; gain and state by that times the condition
// number of what is inverted, 1 / rcond of the root, of which the gain takes two solves.
TEST(Kernels, OfTheArrayFormsAgreeWithTheirPlainText) {
  std::vector<Dimensions> all = kernel_sizes;
  // On both sides of where L^{-1} itself gives way to an estimate of its norm, of Re^{1/2} and of T; and where T is packed.
  all.insert(all.end(), {{16, 3, 17}, {17, 4, 5}, {25, 6, 24}, {24, 5, 26}, {64, 8, 8}, {66, 5, 9}, {9, 4, 70},
                         {72, 40, 41}, {130, 2, 1}});
  for (const char* id : {"srcf", "srcf-hessenberg", "srif", "srif-hessenberg"})
    for (const Dimensions& d : all)
      for (const bool data : {true, false}) {
        const Metadata& metadata = *find_filter(id);
        const Case c{.d = d, .inputs = 1, .data = data};
        if (!applies(metadata, c)) continue;
        const AnyProblem<double> problem = random_problem(metadata.takes, c, 11);
        Dice dice(12);
        const Vector<double> y = dice.vector(d.p, 48), u = dice.vector(1, 16);
        const auto run = [&](const std::string& isa) {
          const WithKernels with(isa);
          const auto filter = make_filter<double>(id);
          filter->start(problem);
          Step<double> step;
          for (int k = 0; k < 2; ++k) step = filter->step(k, data ? &y : nullptr, data ? &u : nullptr);
          EXPECT_EQ(step.report.status, Status::ok);
          const Matrix<double> root = metadata.holds == Held::information_factor ? step.held->transpose() : *step.held;
          return std::tuple{Matrix<double>(root.lazyProduct(root.transpose())), *step.gain,
                            step.state ? *step.state : Vector<double>(), step.report.rcond};
        };
        const auto [P, K, x, rcond] = run("plain");
        for (const kernels::Kernels& kernel : kernels::available()) {
          SCOPED_TRACE(std::string(id) + ' ' + std::string(kernel.isa) + ' ' + text(d));
          const auto [P_, K_, x_, rcond_] = run(std::string(kernel.isa));
          const Index size = d.n + d.m + d.p;
          const double kappa = 1 / (rcond * rcond);
          EXPECT_LE(difference(P, P_, size), threshold * kappa);
          EXPECT_LE(difference(K, K_, size), threshold * kappa);
          EXPECT_LE(difference(x, x_, size), threshold * kappa);
          // An estimate, which signs of columns lead astray, and seldom by more than a factor 3. Where the kernel computes the
          // norm of the inverse, up to three vectors of rows, an estimate of it is no larger.
          EXPECT_LE(std::max(rcond, rcond_), 3 * std::min(rcond, rcond_));
          const Index order = metadata.takes == Parametrisation::information ? d.n : d.p;
          if (order <= 3 * fixed_kernels(kernel.isa)->width) {
            EXPECT_LE(rcond_, rcond * (1 + threshold * 0x1p-53 * static_cast<double>(size) * kappa));
          }
        }
      }
}

// The 1-norm is that of T+, and not of its transpose: of T = I + 1000 e_1 (0, 1, ..., 1) the one has the condition number 1001^2,
// the other one nearly 69^2 times as much. Below and above the order from which on it is estimated.
TEST(Kernels, KnowTheConditionOfTFromThatOfItsTranspose) {
  for (const Index n : {Index(6), Index(70)}) {
    const Dimensions d{n, 1, 1};
    InformationModel<double> model;
    model.A_inverse.setIdentity(n, n);
    model.A_inverse_B.setZero(n, 1);
    model.C.setZero(1, n);
    model.D.resize(n, 0);
    model.Q_inverse_root.setIdentity(1, 1);
    model.R_inverse_root.setIdentity(1, 1);
    Matrix<double> T0 = Matrix<double>::Identity(n, n);
    T0.row(0).tail(n - 1).setConstant(1000);
    for (const std::string& isa : all_kernels()) {
      const WithKernels with(isa);
      SquareRootInformationFilter<double> filter(d);
      filter.start(T0, Vector<double>::Zero(n));
      const auto report = filter.step(model, model);
      EXPECT_EQ(report.status, Status::ok);
      EXPECT_GE(report.rcond, 1 / (1001.0 * 1001.0) * (1 - 1e-6)) << isa << ' ' << n;  // rounding: 1001^2 n u
      EXPECT_LE(report.rcond, 3 / (1001.0 * 1001.0)) << isa << ' ' << n;               // an estimate
    }
  }
}

// One row at a time, whose numbers are in the lanes. A solve with a triangle is backward stable row by row (Higham 2002, 8.1). By
// inverses W of blocks M on the diagonal it adds what x M W M makes of rounding in W and in the product with it (Higham 2002,
// 14.2). The estimates of linear_solve.hpp and of the kernels take the same course.
TEST(Kernels, DivideARow) {
  for (const kernels::Kernels& kernel : kernels::available()) {
    const FixedKernels& fixed = *fixed_kernels(kernel.isa);
    for (Index K = 1; K <= most_divided; ++K)
      for (const bool transposed : {false, true}) {
        SCOPED_TRACE(std::string(kernel.isa) + " K=" + std::to_string(K) + (transposed ? " transposed" : ""));
        Dice dice(static_cast<std::uint64_t>(K));
        const Matrix<double> L = dice.lower_root(K), M = transposed ? Matrix<double>(L.transpose()) : L;
        const Vector<double> b = dice.vector(K, 16);
        const double bound = threshold * 0x1p-53 * static_cast<double>(K);
        for (const bool by_blocks : {false, true}) {
          if (transposed && !by_blocks) continue;
          Vector<double> x = b;
          EXPECT_TRUE(fixed.divide_row(x.data(), L.data(), K, transposed, by_blocks));
          const Vector<double> terms = M.cwiseAbs().transpose() * x.cwiseAbs();
          Vector<double> allowed = terms;
          for (Index j = 0; by_blocks && j < K; j += fixed.width) {
            const Index size = std::min(fixed.width, K - j);
            const Matrix<double> block = M.block(j, j, size, size), I = Matrix<double>::Identity(size, size),
                                 W = transposed ? Matrix<double>(block.triangularView<Eigen::Upper>().solve(I))
                                                : Matrix<double>(block.triangularView<Eigen::Lower>().solve(I));
            allowed.segment(j, size) +=
                block.cwiseAbs().transpose() * (W.cwiseAbs().transpose() * terms.segment(j, size));
          }
          for (Index j = 0; j < K; ++j)
            EXPECT_LE(std::abs(M.col(j).dot(x) - b(j)), bound * allowed(j)) << j << (by_blocks ? " by blocks" : "");
        }
        // Of the second L the inverse is I + 1000 (e_4 - e_5)(e_1 - e_2)', whose rows and columns have the sums 1: only the
        // vector of alternating signs finds what is large.
        Matrix<double> hidden = Matrix<double>::Identity(K, K);
        if (K > 5) hidden.block(4, 1, 2, 2) << -1000, 1000, 1000, -1000;
        for (const Matrix<double>& triangle : {L, hidden}) {
          if (K == 1) continue;
          const Matrix<double> N = transposed ? Matrix<double>(triangle.transpose()) : triangle;
          Vector<double> work(K), sign(K);
          const double rcond = transposed ? reciprocal_condition_triangular<Triangle::upper>(N, work, sign)
                                          : reciprocal_condition_triangular<Triangle::lower>(N, work, sign);
          const double expected = 1 / (rcond * N.cwiseAbs().colwise().sum().maxCoeff());
          EXPECT_NEAR(fixed.estimate_of_inverse(triangle.data(), K, transposed), expected, bound / rcond * expected);
        }
      }
  }
}

/// What a step says, and what stands after it.
struct Outcome {
  Status status;
  double rcond;
  Matrix<double> held, gain;
  Vector<double> state;
};

/// Two steps of a filter by its class, of sizes that are known or not; the second is shown.
template <class Filter, class Model>
Outcome outcome(const Problem<Model>& problem, const Vector<double>* y, Wanted wanted = Wanted::all) {
  typename Filter::Model model;
  typename Filter::Output output;
  if (y) output = *y;
  model.C = problem.models[0].C;
  model.D = problem.models[0].D;
  Filter filter(problem.dimensions());
  filter.start(problem.initial, problem.x0);
  StepReport<double> report;
  if constexpr (Model::parametrisation == Parametrisation::information) {
    model.A_inverse = problem.models[0].A_inverse;
    model.A_inverse_B = problem.models[0].A_inverse_B;
    model.Q_inverse_root = problem.models[0].Q_inverse_root;
    model.R_inverse_root = problem.models[0].R_inverse_root;
    for (int k = 0; k < 2; ++k) report = filter.step(model, model, y ? &output : nullptr, nullptr, wanted);
    return {report.status, report.rcond, filter.information_factor(), filter.filter_gain(), filter.state()};
  } else {
    model.A = problem.models[0].A;
    model.B = problem.models[0].B;
    model.Q_root = problem.models[0].Q_root;
    model.R_root = problem.models[0].R_root;
    for (int k = 0; k < 2; ++k) report = filter.step(model, y ? &output : nullptr, nullptr, wanted);
    return {report.status, report.rcond, filter.factor(), filter.predictor_gain(), filter.state()};
  }
}

/// Both did the same, as far as two factorisations of one array do.
void expect_same(const Outcome& a, const Outcome& b, bool information, Index size) {
  ASSERT_EQ(a.status, b.status);
  if (a.status != Status::ok) return;
  const double largest = a.held.cwiseAbs().maxCoeff();
  const auto square = [&](Matrix<double> X) {
    if (largest > 0) X /= largest;
    return information ? Matrix<double>(X.transpose().lazyProduct(X)) : Matrix<double>(X.lazyProduct(X.transpose()));
  };
  const double kappa = std::isnan(a.rcond) ? 1e4 : 1 / (a.rcond * a.rcond);
  EXPECT_LE(difference(square(a.held), square(b.held), size), threshold * kappa);
  EXPECT_LE(difference(a.gain, b.gain, size), threshold * kappa);
  EXPECT_LE(difference(a.state, b.state, size), threshold * kappa);
  EXPECT_EQ(std::isnan(a.rcond), std::isnan(b.rcond));
  if (!std::isnan(a.rcond)) {
    EXPECT_LE(std::max(a.rcond, b.rcond), 3 * std::min(a.rcond, b.rcond));
  }
}

template <class Fixed, class Any>
void fixed_is_plain(const char* name) {
  using Model = typename Fixed::Model;
  using AnyModel = typename Any::Model;
  const Dimensions d{Model::states, Model::noises, Model::outputs};
  constexpr bool information = Model::parametrisation == Parametrisation::information;
  for (std::uint64_t seed = 1; seed <= 5; ++seed)
    for (const bool data : {true, false})
      for (const Wanted wanted : {Wanted::all, Wanted::state, Wanted::gain, Wanted::factor}) {
        SCOPED_TRACE(std::string(name) + ' ' + text(d) + (data ? " with data" : "") + " seed " + std::to_string(seed));
        const auto problem =
            std::get<Problem<AnyModel>>(random_problem(Model::parametrisation, {.d = d, .data = data}, seed));
        Dice dice(seed);
        const Vector<double> y = dice.vector(d.p, 48);
        const WithKernels plain("plain");
        expect_same(outcome<Any>(problem, data ? &y : nullptr, wanted),
                    outcome<Fixed>(problem, data ? &y : nullptr, wanted), information, d.n + d.m + d.p);
      }
}

template <int N, int M, int P>
void fixed_forms_are_plain() {
  fixed_is_plain<SquareRootCovarianceFilter<double, N, M, P>, SquareRootCovarianceFilter<double>>("srcf");
  fixed_is_plain<HessenbergSquareRootCovarianceFilter<double, N, M, P>, HessenbergSquareRootCovarianceFilter<double>>(
      "srcf-hessenberg");
  fixed_is_plain<SquareRootInformationFilter<double, N, M, P>, SquareRootInformationFilter<double>>("srif");
  fixed_is_plain<HessenbergSquareRootInformationFilter<double, N, M, P>, HessenbergSquareRootInformationFilter<double>>(
      "srif-hessenberg");
}

// For known sizes the kernel is compiled into this source, and runs whatever KFSTAB_ISA says.
TEST(Kernels, OfFixedSizesAgreeWithThePlainText) {
  fixed_forms_are_plain<1, 1, 1>();
  fixed_forms_are_plain<2, 1, 3>();
  fixed_forms_are_plain<3, 2, 1>();
}

// Rows that no square may be taken of, what is singular or not finite, what is not wanted: the same as by the plain text.
TEST(Kernels, OfTheInformationFormsLeaveStatusesAsTheyAre) {
  using Model = InformationModel<double>;
  const auto check = [](const char* what, const Dimensions& d, auto change, bool statuses_alone = false) {
    for (const bool data : {true, false})
      for (const Wanted wanted : {Wanted::all, Wanted::state, Wanted::gain, Wanted::factor})
        for (const bool hessenberg : {false, true}) {
          auto problem = std::get<Problem<Model>>(random_problem(Parametrisation::information, {.d = d, .data = data}, 3));
          change(problem.models[0], problem.initial);
          Dice dice(4);
          const Vector<double> y = dice.vector(d.p, 48);
          const auto run = [&](const std::string& isa) {
            const WithKernels with(isa);
            return hessenberg ? outcome<HessenbergSquareRootInformationFilter<double>>(problem, data ? &y : nullptr, wanted)
                              : outcome<SquareRootInformationFilter<double>>(problem, data ? &y : nullptr, wanted);
          };
          const Outcome plain = run("plain");
          for (const kernels::Kernels& kernel : kernels::available()) {
            SCOPED_TRACE(std::string(what) + ' ' + text(d) + ' ' + std::string(kernel.isa) + (data ? " with data" : "") +
                         (hessenberg ? " hessenberg" : "") + " wanted " + std::to_string(static_cast<int>(wanted)));
            const Outcome is = run(std::string(kernel.isa));
            EXPECT_EQ(is.status, plain.status);
            if (!statuses_alone) expect_same(plain, is, true, d.n + d.m + d.p);
          }
        }
  };
  // Without outputs, rcond alone tells that T is singular.
  for (const Dimensions& d : {Dimensions{4, 2, 2}, Dimensions{20, 10, 11}, Dimensions{40, 5, 3}, Dimensions{70, 6, 9},
                              Dimensions{3, 1, 0}, Dimensions{30, 4, 0}}) {
    check("sound", d, [](Model&, Matrix<double>&) {});
    for (const double scale : {1e-300, 1e300})
      check("scaled", d, [&](Model& model, Matrix<double>& T0) {
        T0 *= scale;
        model.Q_inverse_root *= scale;
        model.R_inverse_root *= scale;
      });
    if (d.p > 0)
      check("a row of R^{-1/2}", d, [](Model& model, Matrix<double>&) { model.R_inverse_root.row(0) *= 1e-290; });
    check("singular", d, [](Model& model, Matrix<double>& T0) {
      T0.setZero();
      model.A_inverse.setZero();
      model.C.setZero();
    });
    check("a zero pivot among others", d, [](Model& model, Matrix<double>& T0) {
      T0.col(1).setZero();
      model.A_inverse.setIdentity();
      model.A_inverse_B.setZero();
      model.C.col(1).setZero();
    });
    const auto weaken = [](Model& model, Matrix<double>& T0) {
      T0 *= 1e-20;
      model.C.col(0).setZero();
    };
    check("nearly singular", d, weaken, true);
    check("overflow", d, [](Model& model, Matrix<double>&) { model.A_inverse *= 1e308; });
    for (const double bad : {nan, infinity})
      check("not finite", d, [&](Model& model, Matrix<double>&) { model.A_inverse(d.n - 1, 0) = bad; });
  }
}

// The same as of lower triangles, of upper ones, which are what information forms read.
TEST(Kernels, OfTheInformationFormReadTheUpperTrianglesAlone) {
  for (const Dimensions& d : {Dimensions{41, 2, 3}, Dimensions{6, 41, 2}, Dimensions{6, 2, 41}, Dimensions{130, 1, 1}})
    for (const std::string& isa : all_kernels()) {
      const WithKernels with(isa);
      auto problem =
          std::get<Problem<InformationModel<double>>>(random_problem(Parametrisation::information, {.d = d, .data = false}, 5));
      Matrix<double> T[2];
      for (const double below : {0., 7.}) {
        auto& model = problem.models[0];
        for (Matrix<double>* root : {&model.Q_inverse_root, &model.R_inverse_root, &problem.initial})
          root->triangularView<Eigen::StrictlyLower>().setConstant(below);
        SquareRootInformationFilter<double> filter(d);
        filter.start(problem.initial, problem.x0);
        ASSERT_TRUE(filter.step(model, model));
        T[below != 0] = filter.information_factor();
      }
      EXPECT_EQ(T[0], T[1]) << isa << ' ' << text(d);
    }
}

TEST(Kernels, AreChosenByName) {
  EXPECT_THROW(kernels::use("mmx"), std::invalid_argument);
  for (const std::string& isa : all_kernels()) {
    const WithKernels with(isa);
    EXPECT_EQ(kernels::in_use() ? kernels::in_use()->isa : "plain", isa);
    ASSERT_EQ(setenv("KFSTAB_ISA", isa.c_str(), 1), 0);
    EXPECT_NO_THROW(kernels::check_environment());
  }
  ASSERT_EQ(setenv("KFSTAB_ISA", "mmx", 1), 0);
  EXPECT_THROW(kernels::check_environment(), std::invalid_argument);
  unsetenv("KFSTAB_ISA");
  EXPECT_NO_THROW(kernels::check_environment());
}

}  // namespace
}  // namespace kfstab::test
