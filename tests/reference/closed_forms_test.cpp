#include <kfstab/reference/closed_forms.hpp>

#include <gtest/gtest.h>

#include <kfstab/reference/exact_filter.hpp>
#include <kfstab/reference/steady_state.hpp>

#include "support.hpp"

namespace kfstab::reference::testing {
namespace {

TEST(ClosedForms, DyerMcReynoldsIsWhatTheExactFilterComputes) {
  for (const char* d : {"1", "-1/2", "1/1024", "1/1000000000000000000000000000000"}) {
    SCOPED_TRACE(d);
    const DyerMcReynolds form{Rational(d)};
    ExactFilter filter(form.problem());
    filter.advance();
    EXPECT_EQ(filter.step().P_next, form.P());
    EXPECT_EQ(filter.step().P_filtered, form.P(1));
    EXPECT_EQ(filter.step().filter_gain, form.gain());
    EXPECT_EQ(filter.step().predictor_gain, form.gain());
    EXPECT_EQ(filter.step().innovation_determinant, form.innovation_determinant());
    for (int k = 2; k < 6; ++k) {
      filter.advance();
      EXPECT_EQ(filter.step().P_filtered, form.P(k));
    }
    EXPECT_EQ(form.P(0), form.problem().initial);
  }
}

TEST(ClosedForms, OneStateIsWhatTheExactFilterComputes) {
  for (const OneState& form : {OneState{1, 1, 1, 1},
                               {Rational("9/10"), Rational("1/3"), 2, Rational("1/7")},
                               {-3, 0, 1, 1},
                               {0, 1, 1, 1},
                               {1, 1, 0, 1}}) {
    ExactFilter filter(form.problem(Rational("5/3")));
    for (int k = 0; k < 9; ++k) {
      filter.advance();
      EXPECT_EQ(filter.step().P_predicted(0, 0), form.P(Rational("5/3"), k)) << k;
    }
  }
}

TEST(ClosedForms, OneStateInSteadyState) {
  // a = q = c = r = 1: the golden ratio
  EXPECT_LE(abs(Wide((OneState{1, 1, 1, 1}.steady_state<Wide>()) - (1 + sqrt(Wide(5))) / 2)), to_digits(195));
  for (const OneState& form : {OneState{Rational("1/2"), Rational("1/4"), 2, Rational("1/8")},
                               {2, 1, 1, 1},
                               {1, Rational("1/1048576"), 1, 1},
                               {Rational("3/2"), 3, Rational("-1/4"), 4}}) {
    const Wide P = form.steady_state<Wide>();
    // where Moebius goes: an error shrinks by (a r / (c^2 P + r))^2 a step, so in this many to 50 digits
    const Wide Re = wide(Rational(form.c * form.c)) * P + wide(form.r);
    const double rate = std::abs(round_to_double(Wide(wide(Rational(form.a * form.r)) / Re)));
    ASSERT_LT(rate, 1);
    const auto steps = static_cast<std::int64_t>(std::ceil(-26 / std::log10(rate)));
    EXPECT_LE(abs(Wide(wide(form.P(1, steps)) / P - 1)), to_digits(49));
    // and the doubling's, which starts from the same numbers: all are doubles
    CovarianceModel<double> model;
    const auto one = [](const Rational& x) { return matrix(1, 1, {static_cast<double>(x)}); };
    model.A = one(form.a);
    model.C = one(form.c);
    model.B = one(1);
    model.Q = one(form.q);
    model.R = one(form.r);
    const AnyProblem<double> problem = Problem<CovarianceModel<double>>{{model}, one(1), Vector<double>::Zero(1)};
    EXPECT_EQ(steady_state(problem).P(0, 0), round_to_double(P));
  }
}

TEST(ClosedForms, WithoutNoiseIsWhatTheExactFilterComputes) {
  std::mt19937_64 random(43);
  for (const Dimensions d : {Dimensions{1, 0, 1}, {3, 0, 2}, {4, 0, 1}, {2, 0, 0}}) {
    Problem<RootModel<double>> root;
    root.models = {random_root_model(random, d)};
    if (d.n == 3) root.models[0].A.row(2) = root.models[0].A.row(0);  // singular
    root.initial = few_bits_root(random, d.n);
    if (d.n == 4) root.initial.row(1).setZero();  // singular too
    root.x0 = Vector<double>::Zero(d.n);
    const ExactProblem problem = exact_problem(root);
    ExactFilter filter(problem);
    for (int k = 0; k < 5; ++k) {
      filter.advance();
      EXPECT_EQ(filter.step().P_predicted, noise_free_covariance(problem, k)) << "n = " << d.n << ", k = " << k;
    }
  }
  ExactProblem singular = DyerMcReynolds(1).problem();
  singular.models[0].R(0, 0) = 0;
  EXPECT_THROW(noise_free_covariance(singular, 1), ReferenceError);
}

}  // namespace
}  // namespace kfstab::reference::testing
