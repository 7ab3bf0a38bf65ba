// The kernels of filters that hold P beside the plain text: the same step in long double is the truth.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <Eigen/LU>

#include <kfstab/filters/joseph.hpp>

#include "filters/fixed_kernels.hpp"
#include "filters/random_problem.hpp"
#include "filters/with_kernels.hpp"
#include "tolerance.hpp"

namespace kfstab::test::covariance_kernel {
namespace {

using Wide = Matrix<long double>;

template <class Filter>
struct Result {
  StepReport<typename Filter::Scalar> report;
  Matrix<typename Filter::Scalar> P, gain;
};

template <class Filter>
Result<Filter> one_step(const CovarianceModel<double>& model, const Matrix<double>& P0) {
  using Scalar = typename Filter::Scalar;
  const auto exactly = [](double x) { return Scalar(x); };
  const auto from = convert(model, exactly);
  typename Filter::Model to;
  to.A = from.A;
  to.B = from.B;
  to.C = from.C;
  to.D = from.D;
  to.Q = from.Q;
  to.R = from.R;
  Filter filter(model.dimensions());
  filter.start(convert(P0, exactly), Vector<Scalar>::Zero(P0.rows()).eval());
  const auto report = filter.step(to);
  return {report, filter.covariance(), filter.filter_gain()};
}

struct Step {
  CovarianceModel<double> model;
  Matrix<double> P0;
};

Matrix<double> squared(const Matrix<double>& root) { return root * root.transpose(); }

Step random_step(std::uint64_t seed, const Dimensions& d) {
  Dice dice(seed);
  Step step;
  step.model.A = dice.matrix(d.n, d.n, 16);
  step.model.B = dice.matrix(d.n, d.m, 16);
  step.model.C = dice.matrix(d.p, d.n, 16);
  step.model.D.resize(d.n, 0);
  step.model.Q = squared(dice.lower_root(d.m));
  step.model.R = squared(dice.lower_root(d.p));
  step.P0 = squared(dice.lower_root(d.n));
  return step;
}

/// The errors of P+ and of the gain over what rounding excuses: u (n+m+p) k(Re) times the sizes of the products that are summed.
template <class Filter, class Truth>
double error_ratio(const Step& step, const Result<Filter>& is, const Truth& truth) {
  const auto [n, m, p] = step.model.dimensions();
  const auto wide = [](const Matrix<double>& X) {
    return convert(X, [](double x) { return static_cast<long double>(x); });
  };
  const Wide A = wide(step.model.A), B = wide(step.model.B), C = wide(step.model.C), P = wide(step.P0),
             Q = wide(step.model.Q), R = wide(step.model.R);
  long double kappa = 1, inverse_norm = 1;
  if (p > 0) {
    const Wide Re = R + C * P * C.transpose(), inverse = Re.inverse();
    inverse_norm = inverse.norm();
    kappa = std::max(1.0L, Re.norm() * inverse_norm);
  }
  const Wide A_abs = A.cwiseAbs(), B_abs = B.cwiseAbs(), C_abs = C.cwiseAbs(), P_abs = P.cwiseAbs();
  // |P_{k|k}| <= |P| in the norm, and Joseph's products are not larger than I + |Kf C| squared times it, part of kappa.
  const long double size_of_P =
      (A_abs * P_abs * A_abs.transpose()).norm() + (B_abs * Q.cwiseAbs() * B_abs.transpose()).norm();
  const long double size_of_gain = p > 0 ? (P_abs * C_abs.transpose()).norm() * inverse_norm : 1;
  const long double tolerance = 0x1p-53L * static_cast<long double>(n + m + p) * kappa;
  const auto error = [&](const Matrix<double>& X, const Wide& exact) { return (wide(X) - exact).norm(); };
  return static_cast<double>(std::max(error(is.P, truth.P) / (tolerance * size_of_P),
                                      error(is.gain, truth.gain) / (tolerance * size_of_gain)));
}

/// 1 / (|Re|_1 |Re^{-1}|_1).
double condition_of_Re(const Step& step) {
  if (step.model.R.rows() == 0) return 1;
  const auto wide = [](const Matrix<double>& X) {
    return convert(X, [](double x) { return static_cast<long double>(x); });
  };
  const Wide Re = wide(step.model.R) + wide(step.model.C) * wide(step.P0) * wide(step.model.C).transpose();
  const auto norm = [](const Wide& X) { return X.cwiseAbs().colwise().sum().maxCoeff(); };
  return static_cast<double>(1 / (norm(Re) * norm(Re.inverse())));
}

std::string text(const Dimensions& d) {
  return "n=" + std::to_string(d.n) + " m=" + std::to_string(d.m) + " p=" + std::to_string(d.p);
}

// On both sides of what a strip, a group of strips, a block of columns holds.
const std::vector<Dimensions> sizes = {{1, 1, 1},   {4, 2, 2},   {5, 0, 0},  {5, 3, 7},  {8, 4, 4},
                                       {8, 8, 8},   {9, 1, 3},   {9, 17, 1}, {16, 8, 8}, {17, 5, 19},
                                       {31, 2, 15}, {64, 3, 33}, {67, 66, 1}};

template <template <class, int, int, int> class Filter>
void is_as_accurate_as_the_plain_text() {
  using Double = Filter<double, Dynamic, Dynamic, Dynamic>;
  using Truth = Filter<long double, Dynamic, Dynamic, Dynamic>;
  for (const Dimensions& d : sizes) {
    std::vector<double> worst(all_kernels().size());
    for (std::uint64_t seed = 1; seed <= 6; ++seed) {
      const Step step = random_step(seed, d);
      const auto truth = one_step<Truth>(step.model, step.P0);
      for (std::size_t i = 0; i < worst.size(); ++i) {
        const WithKernels with(all_kernels()[i]);
        const auto is = one_step<Double>(step.model, step.P0);
        ASSERT_EQ(is.report.status, Status::ok) << all_kernels()[i] << ' ' << text(d);
        EXPECT_EQ(is.P, is.P.transpose()) << all_kernels()[i] << ' ' << text(d);
        // As good as rounding leaves it: by the error of Re, k(Re) times u, relative to rcond = 1/k(Re). An estimate, which takes the
        // same course in all texts; but no estimate up to three vectors of rows.
        const FixedKernels* fixed = fixed_kernels(all_kernels()[i]);
        const double expected =
            fixed && d.p <= 3 * fixed->width ? condition_of_Re(step) : static_cast<double>(truth.report.rcond);
        EXPECT_NEAR(is.report.rcond, expected, threshold * 0x1p-53 * static_cast<double>(d.n + d.m + d.p)) << text(d);
        worst[i] = std::max(worst[i], error_ratio(step, is, truth));
      }
    }
    for (std::size_t i = 0; i < worst.size(); ++i) {
      EXPECT_LE(worst[i], threshold) << all_kernels()[i] << ' ' << text(d);
      // The worst of some steps, so that chance counts for little; 1/(n + m + p) is one rounding of one product.
      EXPECT_LE(worst[i], 2 * worst[0] + 1.0 / static_cast<double>(d.n + d.m + d.p))
          << all_kernels()[i] << ' ' << text(d);
    }
  }
}

TEST(CovarianceKernels, AreAsAccurateAsThePlainText) { is_as_accurate_as_the_plain_text<ConventionalFilter>(); }

TEST(CovarianceKernels, OfJosephsFormAreAsAccurateAsThePlainText) { is_as_accurate_as_the_plain_text<JosephFilter>(); }

template <class Filter, class Truth>
void fixed_is_accurate(const Dimensions& d) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const Step step = random_step(seed, d);
    const auto is = one_step<Filter>(step.model, step.P0);
    ASSERT_EQ(is.report.status, Status::ok);
    EXPECT_LE(error_ratio(step, is, one_step<Truth>(step.model, step.P0)), threshold) << text(d);
    EXPECT_NEAR(is.report.rcond, condition_of_Re(step), threshold * 0x1p-53 * static_cast<double>(d.n + d.m + d.p));
  }
}

// Compiled for vectors of two: Re has one vector of rows, two, and so many that its condition number is found as for any size. With
// fewer than four states no kernel runs.
TEST(CovarianceKernels, OfFixedSizesAreAccurate) {
  fixed_is_accurate<ConventionalFilter<double, 4, 3, 2>, ConventionalFilter<long double>>({4, 3, 2});
  fixed_is_accurate<JosephFilter<double, 9, 1, 4>, JosephFilter<long double>>({9, 1, 4});
  fixed_is_accurate<ConventionalFilter<double, 5, 1, 5>, ConventionalFilter<long double>>({5, 1, 5});
}

// A kernel gives up where something is wrong; what is scaled by a power of two is the same system but for the range.
TEST(CovarianceKernels, LeaveStatusesAsTheyAre) {
  const double infinity = std::numeric_limits<double>::infinity(), nan = std::nan("");
  using Filter = ConventionalFilter<double>;
  for (const Dimensions& d : {Dimensions{4, 2, 2}, Dimensions{9, 3, 8}, Dimensions{20, 4, 11}}) {
    const Step sound = random_step(1, d);
    std::vector<std::pair<Status, Step>> steps;
    const auto add = [&](Status status, auto change) {
      steps.emplace_back(status, sound);
      change(steps.back().second);
    };
    add(Status::ok, [](Step&) {});
    for (const double bad : {nan, infinity}) {
      add(Status::non_finite_input, [&](Step& s) { s.model.A(d.n - 1, 0) = bad; });
      add(Status::non_finite_input, [&](Step& s) { s.model.B(0, d.m - 1) = bad; });
      add(Status::non_finite_input, [&](Step& s) { s.model.C(d.p - 1, d.n - 1) = bad; });
      add(Status::non_finite_input, [&](Step& s) { s.model.Q(0, 0) = bad; });
      add(Status::non_finite_input, [&](Step& s) { s.model.R(d.p - 1, d.p - 1) = bad; });
    }
    add(Status::overflow, [](Step& s) { s.model.A *= 1e300; });
    add(Status::overflow, [](Step& s) { s.model.C *= 1e300; });
    add(Status::not_positive_definite, [](Step& s) { s.model.R(1, 1) = -1e6; });
    add(Status::not_positive_definite, [](Step& s) {
      s.model.R.setZero();
      s.model.C.setZero();
    });
    // Two outputs that are nearly the same: the last pivot is u times the first, or so.
    add(Status::singular_innovation, [](Step& s) {
      s.model.C.setZero();
      s.model.R.setIdentity();
      s.model.R(1, 1) = 0x1p-60;
    });
    for (const double scale : {0x1p-600, 0x1p400}) {
      add(Status::ok, [&](Step& s) {
        s.P0 *= scale;
        s.model.Q *= scale;
        s.model.R *= scale;
      });
    }
    for (const std::string& isa : all_kernels()) {
      const WithKernels with(isa);
      for (std::size_t i = 0; i < steps.size(); ++i) {
        const auto& [status, step] = steps[i];
        const auto is = one_step<Filter>(step.model, step.P0);
        EXPECT_EQ(is.report.status, status) << isa << ' ' << text(d) << " case " << i << ": " << name(is.report.status);
        if (status != Status::ok) {
          EXPECT_EQ(is.P, step.P0.selfadjointView<Eigen::Upper>().toDenseMatrix());
        } else {
          EXPECT_LE(error_ratio(step, is, one_step<ConventionalFilter<long double>>(step.model, step.P0)), threshold);
        }
      }
    }
  }
}

}  // namespace
}  // namespace kfstab::test::covariance_kernel
