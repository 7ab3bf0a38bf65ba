#include <kfstab/filters/batch.hpp>

#include <gtest/gtest.h>

#include <Eigen/LU>

#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include "filters/fixed_kernels.hpp"
#include "filters/random_problem.hpp"
#include "filters/with_kernels.hpp"
#include "tolerance.hpp"

namespace kfstab::test {
namespace {

/// What one filter of a batch is given.
template <class Filter>
struct Given {
  typename Filter::Model model, next;  ///< next: of an information filter, C and R of step k+1
  Matrix<double> initial;
  Vector<double> x0, Du;
  typename Filter::Output y;
};

/// To the last bit; a NaN is the same as another.
bool all_the_same(const Matrix<double>& X, const Matrix<double>& Y) {
  return ((X.array() == Y.array()) || (X.array() != X.array() && Y.array() != Y.array())).all();
}

Matrix<double> gram(const Matrix<double>& L) { return L.lazyProduct(L.transpose()); }

template <class Filter>
Given<Filter> random_filter(const Dimensions& d, std::uint64_t seed) {
  Dice dice(seed);
  Given<Filter> is;
  const auto model = [&](auto& to) {
    using B = Batch<Filter>;
    if constexpr (B::information) {
      to.A_inverse = dice.matrix(d.n, d.n, 16);
      to.A_inverse_B = dice.matrix(d.n, d.m, 16);
      to.Q_inverse_root = dice.lower_root(d.m).transpose();
      to.R_inverse_root = dice.lower_root(d.p).transpose();
      if (seed % 2) to.w_mean = dice.vector(d.m, 16);
    } else {
      to.A = dice.matrix(d.n, d.n, 16);
      to.B = dice.matrix(d.n, d.m, 16);
      if constexpr (B::conventional) {
        to.Q = gram(dice.lower_root(d.m));
        to.R = gram(dice.lower_root(d.p));
      } else {
        to.Q_root = dice.lower_root(d.m);
        to.R_root = dice.lower_root(d.p);
      }
    }
    to.C = dice.matrix(d.p, d.n, 16);
    to.D.setIdentity(d.n, d.n);
  };
  model(is.model);
  model(is.next);
  is.initial = dice.lower_root(d.n);
  if (Batch<Filter>::conventional) is.initial = gram(is.initial);
  if (Batch<Filter>::information) is.initial.transposeInPlace();
  is.x0 = dice.vector(d.n, 16);
  is.y = dice.vector(d.p, 48);
  is.Du = dice.vector(d.n, 16);
  return is;
}

template <class Filter>
std::vector<Given<Filter>> random_filters(const Dimensions& d, std::uint64_t count) {
  std::vector<Given<Filter>> all;
  for (std::uint64_t i = 0; i < count; ++i) all.push_back(random_filter<Filter>(d, 100 + i));
  return all;
}

/// The models and data of all.
template <class Filter>
void give_to(Batch<Filter>& batch, const std::vector<Given<Filter>>& all) {
  for (Index i = 0; i < batch.count(); ++i) {
    const Given<Filter>& is = all[static_cast<std::size_t>(i)];
    if constexpr (Batch<Filter>::information)
      batch.set_model(i, is.model, is.next);
    else
      batch.set_model(i, is.model);
    const Vector<double, Batch<Filter>::N> Du = is.Du;
    batch.set_data(i, is.y, &Du);
  }
}

template <class Filter>
Batch<Filter> batch_of(const std::vector<Given<Filter>>& all) {
  Batch<Filter> batch(static_cast<Index>(all.size()), all.front().model.dimensions());
  for (Index i = 0; i < batch.count(); ++i)
    batch.start(i, all[static_cast<std::size_t>(i)].initial, all[static_cast<std::size_t>(i)].x0);
  give_to(batch, all);
  return batch;
}

/// A filter by itself, by the plain text.
template <class Filter>
StepReport<double> step_alone(Filter& filter, const Given<Filter>& is, bool with_data, Wanted wanted) {
  const WithKernels with("plain");
  const auto* y = with_data ? &is.y : nullptr;
  const auto* u = with_data ? &is.Du : nullptr;
  filter.start(is.initial, is.x0);
  if constexpr (Batch<Filter>::information)
    return filter.step(is.model, is.next, y, u, wanted);
  else if constexpr (Batch<Filter>::covariance_root)
    return filter.step(is.model, y, u, wanted);
  else
    return filter.step(is.model, y, u);
}

template <class Filter>
Matrix<double> held_alone(const Filter& filter) {
  if constexpr (Batch<Filter>::information)
    return filter.information_factor();
  else if constexpr (Batch<Filter>::covariance_root)
    return filter.factor();
  else
    return filter.covariance();
}

template <class Filter>
Matrix<double> gain_alone(const Filter& filter) {
  if constexpr (Batch<Filter>::covariance_root)
    return filter.predictor_gain();
  else
    return filter.filter_gain();
}

/// P, S S' or T'T.
template <class Filter>
Matrix<double> square_of_held(const Matrix<double>& held) {
  if (Batch<Filter>::conventional) return held;
  return gram(Batch<Filter>::information ? Matrix<double>(held.transpose()) : held);
}

/// How far two computations of one step may be apart. What is inverted, Re or T+, has the condition number kappa.
struct AllowedErrors {
  double held, gain, state;
};

/// The backward error of a step, relative to the numbers that it is made from, times what becomes of it: [R, C S; 0, A S, B Q] is
/// rotated, and P+ = [A S, B Q] [A S, B Q]' - K Re K' is as much smaller as it may be: the error is that of the minuend. The
/// gain and the state are quotients by Re.
template <class Filter>
AllowedErrors allowed_errors(const Given<Filter>& is, const Filter& filter, double rcond) {
  const auto [n, m, p] = is.model.dimensions();
  if (n == 0) return {};
  const double unit = threshold * u * static_cast<double>(n + m + p);
  const double x = is.x0.norm(), y = is.y.norm(), Du = is.Du.norm(), K = gain_alone(filter).norm();
  if constexpr (Batch<Filter>::information) {
    // T+ is what is left of [Q, 0; T A^{-1}B, T A^{-1}; 0, R C], and an error of it that of all; (xi) of the right-hand side.
    const Matrix<double> T = is.initial, RC = is.next.R_inverse_root * is.next.C;
    const double A = is.model.A_inverse.norm(), Q = is.model.Q_inverse_root.norm(),
                 array = T.norm() * (A + is.model.A_inverse_B.norm()) + Q + RC.norm(), kappa = 1 / rcond,
                 growth = array / filter.information_factor().norm(),
                 right = T.norm() * (x + A * Du) + Q * is.model.w_mean.norm() + is.next.R_inverse_root.norm() * y;
    return {unit * array * array, unit * kappa * kappa * growth * growth * K,
            unit * kappa * growth * (right / array + filter.state().norm())};
  } else {
    Matrix<double> P, Q, R;
    if constexpr (Batch<Filter>::conventional) {
      P = is.initial;
      Q = is.model.Q;
      R = is.model.R;
    } else {
      P = gram(is.initial);
      Q = gram(is.model.Q_root);
      R = gram(is.model.R_root);
    }
    const double A = is.model.A.norm(), B = is.model.B.norm(), C = is.model.C.norm(),
                 kappa = Batch<Filter>::conventional ? 1 / rcond : 1 / (rcond * rcond),
                 minuend = A * A * P.norm() + B * B * Q.norm(),
                 Re = (is.model.C * P * is.model.C.transpose() + R).norm();
    const double gain = p == 0 ? 0 : unit * kappa * std::max(1.0, A) * P.norm() * C * kappa / Re;
    const double innovation = y + C * x, of_K = Batch<Filter>::conventional ? std::max(1.0, A) : 1;
    return {unit * kappa * minuend, gain, of_K * gain * innovation + unit * (A * x + of_K * K * innovation + Du)};
  }
}

/// Filter i of the batch beside the same filter by itself, after one step of each.
template <class Filter>
void expect_alike(const Batch<Filter>& batch, Index i, const Given<Filter>& is, bool with_data, Wanted wanted) {
  using B = Batch<Filter>;
  Filter filter(is.model.dimensions()), asked(is.model.dimensions());
  const auto report = step_alone(filter, is, with_data, wanted);
  ASSERT_EQ(batch.report(i).status, report.status);
  if (!report) {
    EXPECT_EQ(square_of_held<Filter>(batch.held(i)), square_of_held<Filter>(held_alone(filter)));
    EXPECT_EQ(batch.state(i), Vector<double>(is.x0));
    return;
  }
  const double rcond = step_alone(asked, is, false, Wanted::all).rcond;
  const AllowedErrors error = allowed_errors(is, filter, rcond);
  EXPECT_LE((square_of_held<Filter>(batch.held(i)) - square_of_held<Filter>(held_alone(filter))).stableNorm(),
            error.held);
  EXPECT_LE((batch.gain(i) - gain_alone(filter)).norm(), error.gain);
  if (with_data)
    EXPECT_LE((batch.state(i) - filter.state()).norm(), error.state);
  else
    EXPECT_TRUE(all_the_same(batch.state(i), is.x0));
  if constexpr (B::covariance_root) {
    const Matrix<double> Re = gram(filter.innovation_root());
    const auto [n, m, p] = is.model.dimensions();
    EXPECT_LE((gram(batch.innovation_root(i)) - Re).norm(), threshold * u * static_cast<double>(n + m + p) * Re.norm());
  }
  if (B::conventional || wants_rcond(wanted)) {
    // An estimate, which signs of columns lead astray, and seldom by more than a factor 3.
    EXPECT_LE(batch.report(i).rcond, 3 * report.rcond);
    EXPECT_GE(3 * batch.report(i).rcond, report.rcond);
  } else {
    EXPECT_TRUE(std::isnan(batch.report(i).rcond));
  }
}

std::string case_text(const std::string& isa, const Dimensions& d) {
  return isa + " n=" + std::to_string(d.n) + " m=" + std::to_string(d.m) + " p=" + std::to_string(d.p);
}

template <class Filter>
void expect_so_many_filters(const std::string& isa, const Dimensions& d) {
  for (const bool with_data : {true, false})
    for (const Wanted wanted : {Wanted::all, Wanted::state, Wanted::gain, Wanted::factor}) {
      SCOPED_TRACE(case_text(isa, d) + (with_data ? " with data " : " ") + std::to_string(static_cast<int>(wanted)));
      const WithKernels with(isa);
      const auto all = random_filters<Filter>(d, 11);  // one group of eight, and one that is not full
      Batch<Filter> batch = batch_of(all);
      batch.step(with_data, wanted);
      for (Index i = 0; i < batch.count(); ++i)
        expect_alike(batch, i, all[static_cast<std::size_t>(i)], with_data, wanted);
    }
}

template <class Filter>
class BatchOf : public testing::Test {};

using Forms =
    testing::Types<ConventionalFilter<double>, SquareRootCovarianceFilter<double>, SquareRootInformationFilter<double>>;
TYPED_TEST_SUITE(BatchOf, Forms);

TYPED_TEST(BatchOf, IsSoManyFilters) {
  for (const std::string& isa : all_kernels())
    for (const Dimensions& d : {Dimensions{4, 2, 2}, Dimensions{1, 1, 1}, Dimensions{5, 3, 7}, Dimensions{3, 0, 2},
                                Dimensions{6, 2, 0}, Dimensions{0, 0, 1}, Dimensions{9, 4, 3}, Dimensions{12, 3, 5}})
      expect_so_many_filters<TypeParam>(isa, d);
}

TYPED_TEST(BatchOf, IsDoneByTheKernelsItIsTold) {
  const Dimensions d{4, 2, 2};
  const auto all = random_filters<TypeParam>(d, 3);
  const auto held = [&](std::string_view isa, const kernels::Kernels* told) {
    const WithKernels with(isa);
    auto batch = batch_of(all);
    batch.use(told);
    batch.step(true);
    return batch.held(2);
  };
  for (const kernels::Kernels& told : kernels::available())
    for (const std::string& in_use : all_kernels()) EXPECT_EQ(held(in_use, &told), held(told.isa, nullptr)) << in_use;
  TypeParam alone(d);  // by the plain text, which differs from kernels in the last bits
  step_alone(alone, all[2], true, Wanted::all);
  EXPECT_EQ(held("plain", nullptr), held_alone(alone));
  EXPECT_NE(held("plain", kernels::everywhere()), held_alone(alone));
}

TEST(Batch, TakesFiltersOfKnownSizes) {
  for (const std::string& isa : all_kernels()) {
    expect_so_many_filters<ConventionalFilter<double, 3, 1, 2>>(isa, {3, 1, 2});
    expect_so_many_filters<SquareRootCovarianceFilter<double, 3, 1, 2>>(isa, {3, 1, 2});
    expect_so_many_filters<SquareRootInformationFilter<double, 3, 1, 2>>(isa, {3, 1, 2});
  }
}

TYPED_TEST(BatchOf, TakesAnotherModelForEveryStep) {
  for (const std::string& isa : all_kernels()) {
    SCOPED_TRACE(isa);
    const WithKernels with(isa);
    auto all = random_filters<TypeParam>({4, 2, 2}, 9);
    Batch<TypeParam> batch = batch_of(all);
    for (std::uint64_t k = 0; k < 3; ++k) {
      for (Index i = 0; i < batch.count(); ++i) {
        auto& is = all[static_cast<std::size_t>(i)];
        is = random_filter<TypeParam>({4, 2, 2}, 1000 * k + static_cast<std::uint64_t>(i));
        is.initial = batch.held(i);
        is.x0 = batch.state(i);
      }
      give_to(batch, all);
      batch.step(true);
      for (Index i = 0; i < batch.count(); ++i)
        expect_alike(batch, i, all[static_cast<std::size_t>(i)], true, Wanted::all);
    }
  }
}

// Not an estimate: 1 / (|X|_1 |X^{-1}|_1) of what is inverted. X^{-1} is rounded by p u k(X), rcond by p u; Re, which is formed
// anew here, by (n + p) u.
TYPED_TEST(BatchOf, ComputesTheConditionNumber) {
  using B = Batch<TypeParam>;
  for (const std::string& isa : all_kernels()) {
    if (isa == "plain") continue;  // does every filter alone, and that estimates
    const WithKernels with(isa);
    for (const Dimensions& d : {Dimensions{4, 2, 2}, Dimensions{1, 1, 1}, Dimensions{5, 3, 7}, Dimensions{9, 4, 3}}) {
      SCOPED_TRACE(case_text(isa, d));
      const auto all = random_filters<TypeParam>(d, 11);
      B batch = batch_of(all);
      batch.step();
      for (Index i = 0; i < batch.count(); ++i) {
        const auto& is = all[static_cast<std::size_t>(i)];
        Matrix<double> X;
        if constexpr (B::information)
          X = batch.held(i);
        else if constexpr (B::covariance_root)
          X = batch.innovation_root(i);
        else
          X = is.model.C * is.initial * is.model.C.transpose() + is.model.R;
        const Matrix<double> inverse = X.fullPivLu().inverse();
        const auto norm = [](const Matrix<double>& Y) { return Y.cwiseAbs().colwise().sum().maxCoeff(); };
        const double rcond = 1 / (norm(X) * norm(inverse));
        EXPECT_NEAR(batch.report(i).rcond, rcond, threshold * u * static_cast<double>(d.n + d.p)) << i;
      }
    }
  }
}

/// Scales what the step's result is made from: A and B, or T A^{-1} and C.
template <class Filter>
void scale_result(Given<Filter>& is, double factor) {
  if constexpr (Batch<Filter>::information) {
    is.model.A_inverse *= factor;
    is.next.C *= factor;
  } else {
    is.model.A *= factor;
    is.model.B *= factor;
  }
}

// Among sound filters one with a NaN in each place, singular ones, and some whose squares leave the range. Those are done alone,
// by the plain text, and so to the last bit as that does it; ckf squares nothing that P does not hold, and may overflow.
TYPED_TEST(BatchOf, LetsEveryFilterFailForItself) {
  using B = Batch<TypeParam>;
  for (const std::string& isa : all_kernels()) {
    SCOPED_TRACE(isa);
    const WithKernels with(isa);
    for (const bool with_data : {true, false}) {
      auto all = random_filters<TypeParam>({4, 2, 2}, 18);
      B batch = batch_of(all);
      batch.step(true);
      std::vector<Matrix<double>> gains;
      for (Index i = 0; i < batch.count(); ++i) {
        ASSERT_EQ(batch.report(i).status, Status::ok);
        all[static_cast<std::size_t>(i)].initial = batch.held(i);
        all[static_cast<std::size_t>(i)].x0 = batch.state(i);
        gains.push_back(batch.gain(i));
      }
      if constexpr (B::information) {
        all[1].model.A_inverse(2, 1) = std::nan("");
        all[2].model.A_inverse.col(1).setZero();
        all[2].next.C.col(1).setZero();
      } else {
        all[1].model.A(2, 1) = std::nan("");
        all[2].model.C.row(1).setZero();
        if constexpr (B::conventional) {
          all[2].model.R.row(1).setZero();
          all[2].model.R.col(1).setZero();
        } else {
          all[2].model.R_root.row(1).setZero();
        }
      }
      all[3].model.C(1, 0) = all[3].next.C(1, 0) = std::nan("");
      scale_result(all[4], 1e-100);
      scale_result(all[5], 0);
      scale_result(all[6], 1e100);
      scale_result(all[7], 1e-300);
      scale_result(all[8], 1e300);
      all[9].y(1) = std::nan("");
      all[10].x0(3) = std::nan("");
      all[11].Du(0) = INFINITY;
      all[12].initial(1, 1) = std::nan("");
      if constexpr (B::conventional) {
        all[13].model.R *= -100;
        all[14].model.R(0, 0) = INFINITY;  // P+ and the gain are finite all the same
      }
      all[16].initial *= 0;
      for (const Index i : {10, 12, 16})
        batch.start(i, all[static_cast<std::size_t>(i)].initial, all[static_cast<std::size_t>(i)].x0);
      for (const Index i : {10, 12, 16}) gains[static_cast<std::size_t>(i)].setZero();
      give_to(batch, all);
      batch.step(with_data);
      for (Index i = 0; i < batch.count(); ++i) {
        SCOPED_TRACE(i);
        const auto at = static_cast<std::size_t>(i);
        TypeParam filter({4, 2, 2});
        const auto report = step_alone(filter, all[at], with_data, Wanted::all);
        EXPECT_EQ(batch.report(i).status, report.status);
        const bool sound = i == 0 || i > (B::conventional ? 14 : 12) || (!with_data && i >= 9 && i <= 11);
        if (sound && i != 16) {
          EXPECT_EQ(report.status, Status::ok);
        } else if (i == 1 || i == 3 || i == 14) {
          EXPECT_EQ(report.status, Status::non_finite_input);
        } else if (i == 2) {
          EXPECT_NE(report.status, Status::ok);
        }
        if (!report) {
          EXPECT_TRUE(all_the_same(batch.held(i), all[at].initial));
          EXPECT_TRUE(all_the_same(batch.state(i), all[at].x0));
          EXPECT_TRUE(all_the_same(batch.gain(i), gains[at]));
        } else if ((i == 7 || i == 8) && !B::conventional) {
          EXPECT_EQ(Matrix<double>(batch.held(i)), held_alone(filter));
          EXPECT_EQ(Matrix<double>(batch.gain(i)), gain_alone(filter));
          EXPECT_EQ(Vector<double>(batch.state(i)), filter.state());
        } else if (sound || (!B::information && i <= 6)) {
          expect_alike(batch, i, all[at], with_data, Wanted::all);
        }
      }
    }
  }
}

// Nothing is divided by where there are neither outputs nor data, and T+ may be singular all the same.
TEST(Batch, FindsSingularInformationWithoutOutputs) {
  for (const std::string& isa : all_kernels()) {
    const WithKernels with(isa);
    using Filter = SquareRootInformationFilter<double>;
    auto all = random_filters<Filter>({3, 1, 0}, 3);
    all[1].model.A_inverse.col(2).setZero();
    for (const Wanted wanted : {Wanted::all, Wanted::state, Wanted::gain, Wanted::factor}) {
      Batch<Filter> batch = batch_of(all);
      batch.step(false, wanted);
      for (Index i = 0; i < 3; ++i)
        EXPECT_EQ(batch.report(i).status,
                  i == 1 && wanted != Wanted::factor ? Status::singular_information : Status::ok);
    }
  }
}

// Nor is there anything that a zero pivot of Re would make infinite where there are no states.
TEST(Batch, FindsASingularReWithoutStates) {
  for (const std::string& isa : all_kernels()) {
    const WithKernels with(isa);
    auto all = random_filters<ConventionalFilter<double>>({0, 0, 2}, 3);
    all[1].model.R.setOnes();
    auto batch = batch_of(all);
    batch.step();
    for (Index i = 0; i < 3; ++i)
      EXPECT_EQ(batch.report(i).status, i == 1 ? Status::not_positive_definite : Status::ok);
  }
}

TEST(Batch, TakesARootOfTheNoiseThatIsInBAlready) {
  for (const std::string& isa : all_kernels()) {
    const WithKernels with(isa);
    using Filter = SquareRootCovarianceFilter<double>;
    auto all = random_filters<Filter>({4, 2, 2}, 3);
    for (auto& is : all) is.model.Q_root.setIdentity();
    Batch<Filter> batch = batch_of(all), other = batch_of(all);
    for (Index i = 0; i < 3; ++i) {
      RootModel<double> model = all[static_cast<std::size_t>(i)].model;
      model.Q_root.resize(0, 0);
      other.set_model(i, model);
    }
    batch.step();
    other.step();
    for (Index i = 0; i < 3; ++i) EXPECT_EQ(batch.held(i), other.held(i));
  }
}

// ---- kernels for known sizes ----

using Eights = std::vector<kernels::Eight>;

/// So many matrices of eight filters each: random, and those of `order` near the identity, symmetric if that is wanted.
Eights random_eights(Dice& dice, Index groups, Index rows, Index cols, bool near_identity) {
  Eights all(static_cast<std::size_t>(groups * rows * cols));
  for (Index g = 0; g < groups; ++g)
    for (Index l = 0; l < 8; ++l) {
      Matrix<double> X = dice.matrix(rows, cols, 16);
      if (near_identity)
        X = Matrix<double>::Identity(rows, cols) + (X + X.transpose()) / (4 * static_cast<double>(rows));
      for (Index j = 0; j < cols; ++j)
        for (Index i = 0; i < rows; ++i) all[static_cast<std::size_t>((g * cols + j) * rows + i)].lane[l] = X(i, j);
    }
  return all;
}

// The same text as for sizes known at run time, whose sums are added in another order: so both are the sum of n + m + p terms, and
// of what is inverted the numbers near the identity have a condition number below 9 (eigenvalues within 1/2 of 1, and so 3; its
// square for gains).
TEST(Batch, KernelsForKnownSizesAreThoseForAny) {
  for (const FixedKernels* fixed : all_fixed_kernels)
    for (const kernels::Kernels& run_time : kernels::available()) {
      if (run_time.isa != fixed->isa) continue;
      for (const Dimensions& d : {Dimensions{2, 1, 1}, fixed->width == 8 ? Dimensions{5, 3, 2} : Dimensions{3, 1, 2}})
        for (const int form : {0, 1, 2})
          for (const int less : {0, 1, 2, 3, 4}) {
            SCOPED_TRACE(case_text(fixed->isa, d) + " form " + std::to_string(form) + " less " + std::to_string(less));
            const bool information = form == 1;
            const auto [n, m, p] = d;  // of the array
            constexpr Index groups = 2;
            Dice dice(7);
            Eights A = random_eights(dice, groups, n, n, true), B = random_eights(dice, groups, n, m, false),
                   C = random_eights(dice, groups, p, n, false);
            const Eights S = random_eights(dice, groups, n, n, true), Q = random_eights(dice, groups, m, m, true),
                         R = random_eights(dice, groups, p, p, true), x = random_eights(dice, groups, n, 1, false),
                         Du = random_eights(dice, groups, n, 1, false), w = random_eights(dice, groups, p, 1, false),
                         y = random_eights(dice, groups, information ? m : p, 1, false);
            const Index outputs = information ? m : p;
            struct Results {
              Eights S, Re, K, rcond, x, work;
              unsigned char gave_up[2] = {255, 255};
            };
            const auto results = [&, n = n, m = m, p = p] {
              const auto sized = [](Index size) { return Eights(static_cast<std::size_t>(size)); };
              return Results{sized(groups * n * n),
                             sized(groups * p * p),
                             sized(groups * n * outputs),
                             sized(groups),
                             sized(groups * n),
                             sized(kernels::batch_array_work(n, m, p) + kernels::batch_covariance_work(n, m, p))};
            };
            Results first = results(), second = results();
            const auto step = [&, n = n, m = m, p = p](Results& to, auto array, auto covariance) {
              const kernels::Eight* const of_x = less == 1 ? nullptr : x.data();
              if (form == 2)
                covariance(kernels::BatchCovarianceStep{groups, n, m, p, A.data(), B.data(), C.data(), S.data(),
                                                        Q.data(), R.data(), of_x, y.data(),
                                                        less == 2 ? nullptr : Du.data(), to.S.data(), to.K.data(),
                                                        to.rcond.data(), to.x.data(), to.gave_up, to.work.data()});
              else
                array(kernels::BatchArrayStep{groups,
                                              n,
                                              m,
                                              p,
                                              information,
                                              A.data(),
                                              B.data(),
                                              C.data(),
                                              S.data(),
                                              Q.data(),
                                              R.data(),
                                              of_x,
                                              y.data(),
                                              less == 2 ? nullptr : Du.data(),
                                              less == 2 ? nullptr : w.data(),
                                              to.S.data(),
                                              information ? nullptr : to.Re.data(),
                                              less == 3 ? nullptr : to.K.data(),
                                              less == 4 ? nullptr : to.rcond.data(),
                                              to.x.data(),
                                              to.gave_up,
                                              to.work.data()});
            };
            if (form == 0 && less == 3) continue;  // its state is made of the gain
            const auto gave_up = [](const Results& of) { return of.gave_up[0] | of.gave_up[1] << 8; };
            step(first, run_time.batch_array_step, run_time.batch_covariance_step);
            step(second, fixed->batch_array, fixed->batch_covariance);
            const auto expect_near = [&, n = n, m = m, p = p](const Eights& X, const Eights& Y) {
              double size = 1;
              for (const auto& eight : X)
                for (const double number : eight.lane) size = std::max(size, std::abs(number));
              for (std::size_t i = 0; i < X.size(); ++i)
                for (int l = 0; l < 8; ++l)
                  EXPECT_NEAR(X[i].lane[l], Y[i].lane[l], threshold * u * static_cast<double>(n + m + p) * 9 * size);
            };
            EXPECT_EQ(gave_up(first), 0);
            EXPECT_EQ(gave_up(second), 0);
            // Factors are unique but for signs, and both texts take the same.
            expect_near(first.S, second.S);
            expect_near(first.Re, second.Re);
            expect_near(first.K, second.K);
            expect_near(first.rcond, second.rcond);
            expect_near(first.x, second.x);
            // One of either group whose squares are not safe, and one with a NaN.
            if (form == 2) continue;
            for (auto* eights : {&A, &B, &C})
              for (std::size_t i = 0; i < eights->size(); ++i) {
                (*eights)[i].lane[2] *= i < eights->size() / groups ? 1e-100 : 1;
                (*eights)[i].lane[5] *= i < eights->size() / groups ? 1 : 1e100;
              }
            A.front().lane[7] = std::nan("");
            step(second, fixed->batch_array, fixed->batch_covariance);
            EXPECT_EQ(gave_up(second), 1 << 2 | 1 << 7 | 1 << 5 << 8);
          }
    }
}

}  // namespace
}  // namespace kfstab::test
