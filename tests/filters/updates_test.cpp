// The two halves of a step, fixed sizes, and what filters show beside P, gain and state.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>

#include <kfstab/filters/carlson.hpp>
#include <kfstab/filters/chandrasekhar.hpp>
#include <kfstab/filters/conventional.hpp>
#include <kfstab/filters/hessenberg_square_root_covariance.hpp>
#include <kfstab/filters/information.hpp>
#include <kfstab/filters/joseph.hpp>
#include <kfstab/filters/potter.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/filters/square_root_covariance.hpp>
#include <kfstab/filters/square_root_information.hpp>
#include <kfstab/filters/svd.hpp>
#include <kfstab/filters/ud.hpp>

#include "filters/plain_recursion.hpp"
#include "filters/random_problem.hpp"
#include "filters/split_filter.hpp"
#include "tolerance.hpp"

namespace kfstab::test {
namespace {

template <class Filter>
const auto& held_by(const Filter& filter) {
  if constexpr (requires { filter.covariance(); })
    return filter.covariance();
  else if constexpr (requires { filter.factor(); })
    return filter.factor();
  else if constexpr (requires { filter.covariance_root(); })
    return filter.covariance_root();
  else if constexpr (requires { filter.ud_factors(); })
    return filter.ud_factors();
  else if constexpr (requires { filter.information(); })
    return filter.information();
  else
    return filter.information_factor();
}

template <class Filter>
class SplitOf final : public SplitFilter {
  using Model = typename Filter::Model;

 public:
  void start(const AnyProblem<double>& problem) override {
    problem_ = &std::get<Problem<Model>>(problem);
    filter_ = Filter(problem_->dimensions());
    filter_.start(problem_->initial, problem_->x0);
  }
  StepReport<double> measurement_update(std::int64_t k, const Vector<double>* y) override {
    return filter_.measurement_update(problem_->model(k), y);
  }
  StepReport<double> time_update(std::int64_t k, const Vector<double>* input) override {
    return filter_.time_update(problem_->model(k), input);
  }
  StepReport<double> step(std::int64_t k, const Vector<double>* y, const Vector<double>* input) override {
    if constexpr (Model::parametrisation == Parametrisation::information)
      return filter_.step(problem_->model(k), problem_->model(k + 1), y, input);
    else
      return filter_.step(problem_->model(k), y, input);
  }
  const Matrix<double>& held() const override { return held_by(filter_); }
  const Matrix<double>& filter_gain() const override { return filter_.filter_gain(); }
  const Vector<double>& state() const override { return filter_.state(); }

 private:
  const Problem<Model>* problem_ = nullptr;
  Filter filter_{Dimensions{}};
};

constexpr auto split =
    std::to_array<std::string_view>({"ckf", "joseph", "srcf", "srif", "ud", "potter", "carlson", "information", "svd"});

const Case split_cases[] = {{.d = {4, 2, 2}, .period = 3, .inputs = 1},
                            {.d = {2, 3, 4}, .period = 2, .inputs = 2},
                            {.d = {3, 0, 1}, .period = 2, .inputs = 1},
                            {.d = {1, 1, 1}, .period = 1, .inputs = 1}};

template <class Model>
void set_no_dynamics(Model& model) {
  const Index n = model.dimensions().n;
  if constexpr (Model::parametrisation == Parametrisation::information) {
    model.A_inverse.setIdentity();
    model.A_inverse_B.setZero();
    model.w_mean.resize(0);
  } else {
    model.A.setIdentity();
    model.B.setZero();
  }
  model.D.setZero(n, model.D.cols());
}

template <class Model>
void set_no_measurement(Model& model) {
  model.C.setZero();
}

void expect_followed(const PlainRecursion& recursion, const Matrix<double>& held, const Matrix<double>* gain,
                     const Vector<double>& state, const char* what) {
  const Judgement is = recursion.judge(exact(held), gain ? exact(*gain) : exact(recursion.gain()), exact(state));
  EXPECT_LE(is.held.ratio(), threshold) << what << ": held is off by " << is.held.error;
  if (gain) {
    EXPECT_LE(is.gain.ratio(), threshold) << what << ": the gain is off by " << is.gain.error;
  }
  EXPECT_LE(is.state.ratio(), threshold) << what << ": the state is off by " << is.state.error;
}

/// A model of sizes known at compile time.
template <class To, class From>
To fixed(const From& from) {
  To to;
  to.C = from.C;
  to.D = from.D;
  if constexpr (To::parametrisation == Parametrisation::information) {
    to.A_inverse = from.A_inverse;
    to.A_inverse_B = from.A_inverse_B;
    to.Q_inverse_root = from.Q_inverse_root;
    to.R_inverse_root = from.R_inverse_root;
    to.w_mean = from.w_mean;
  } else {
    to.A = from.A;
    to.B = from.B;
    if constexpr (To::parametrisation == Parametrisation::root) {
      to.Q_root = from.Q_root;
      to.R_root = from.R_root;
    } else {
      to.Q = from.Q;
      to.R = from.R;
    }
  }
  return to;
}

template <class Filter, class DynamicModel>
void fixed_follows(const char* id) {
  using Model = typename Filter::Model;
  const Case c{.d = {Model::states, Model::noises, Model::outputs}, .period = 3, .inputs = 1};
  SCOPED_TRACE(std::string(id) + ": " + c.text());
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const Metadata& metadata = *find_filter(id);
    const AnyProblem<double> any = random_problem(metadata.takes, c, seed);
    const auto& problem = std::get<Problem<DynamicModel>>(any);
    PlainRecursion recursion(any, metadata, u);
    Filter filter;
    filter.start(problem.initial, problem.x0);
    Dice dice(41);
    Vector<double> input_before = Vector<double>::Zero(1);
    for (int k = 0; k < 4; ++k) {
      const Vector<double> y = dice.vector(c.d.p, 32), input = dice.vector(1, 32);
      const typename Filter::Output y_fixed = y;
      recursion.step(k, &y, &input);
      StepReport<double> report;
      if constexpr (Model::parametrisation == Parametrisation::information) {
        report = k == 0 ? filter.measurement_update(fixed<Model>(problem.model(0)), &y_fixed)
                        : filter.step(fixed<Model>(problem.model(k - 1)), fixed<Model>(problem.model(k)), &y_fixed,
                                      &input_before);
      } else {
        report = filter.step(fixed<Model>(problem.model(k)), &y_fixed, &input);
      }
      ASSERT_EQ(report.status, Status::ok);
      input_before = input;
      const Matrix<double> held = held_by(filter);
      const Vector<double> state = filter.state();
      expect_followed(recursion, held, nullptr, state, "fixed sizes");
    }
  }
}

}  // namespace

std::span<const std::string_view> split_filters() { return split; }

std::unique_ptr<SplitFilter> make_split_filter(std::string_view id) {
  if (id == "ckf") return std::make_unique<SplitOf<ConventionalFilter<double>>>();
  if (id == "joseph") return std::make_unique<SplitOf<JosephFilter<double>>>();
  if (id == "srcf") return std::make_unique<SplitOf<SquareRootCovarianceFilter<double>>>();
  if (id == "srif") return std::make_unique<SplitOf<SquareRootInformationFilter<double>>>();
  if (id == "ud") return std::make_unique<SplitOf<UdFilter<double>>>();
  if (id == "potter") return std::make_unique<SplitOf<PotterFilter<double>>>();
  if (id == "carlson") return std::make_unique<SplitOf<CarlsonFilter<double>>>();
  if (id == "information") return std::make_unique<SplitOf<InformationFilter<double>>>();
  if (id == "svd") return std::make_unique<SplitOf<SvdFilter<double>>>();
  return nullptr;
}

// Both halves, and the step, against the same recursion: so they agree with each other within twice its bound.
TEST(Updates, MeasurementThenTimeIsAStep) {
  for (const std::string_view id : split_filters())
    for (const Case& c : split_cases) {
      SCOPED_TRACE(std::string(id) + ": " + c.text());
      Metadata metadata = *find_filter(id);
      metadata.gain = GainKind::filter;
      const bool information = metadata.takes == Parametrisation::information;
      const AnyProblem<double> problem = random_problem(metadata.takes, c, 42);
      PlainRecursion recursion(problem, metadata, u);
      const auto halves = make_split_filter(id), whole = make_split_filter(id);
      halves->start(problem);
      whole->start(problem);
      Dice dice(43);
      Vector<double> input_before;
      for (int k = 0; k < 4; ++k) {
        const Vector<double> y = dice.vector(c.d.p, 32), input = dice.vector(c.inputs, 32);
        recursion.step(k, &y, &input);
        if (information) {
          if (k > 0) {
            ASSERT_TRUE(halves->time_update(k - 1, &input_before));
            ASSERT_TRUE(whole->step(k - 1, &y, &input_before));
          } else {
            ASSERT_TRUE(whole->measurement_update(0, &y));
          }
          ASSERT_TRUE(halves->measurement_update(k, &y));
        } else {
          ASSERT_TRUE(halves->measurement_update(k, &y));
          ASSERT_TRUE(halves->time_update(k, &input));
          ASSERT_TRUE(whole->step(k, &y, &input));
        }
        input_before = input;
        const bool has_gain = information || id != "srcf";  // srcf's step has the predictor gain
        expect_followed(recursion, halves->held(), &halves->filter_gain(), halves->state(), "halves");
        expect_followed(recursion, whole->held(), has_gain ? &whole->filter_gain() : nullptr, whole->state(), "whole");
      }
    }
}

// A measurement update is a step of a model that stands still, a time update one of a model that measures nothing.
TEST(Updates, EachHalfAloneIsAStepOfASimplerModel) {
  for (const std::string_view id : split_filters())
    for (const Case& c : split_cases) {
      SCOPED_TRACE(std::string(id) + ": " + c.text());
      Metadata metadata = *find_filter(id);
      metadata.gain = GainKind::filter;
      const AnyProblem<double> problem = random_problem(metadata.takes, c, 44);
      Dice dice(45);
      const Vector<double> y = dice.vector(c.d.p, 32), input = dice.vector(c.inputs, 32);

      AnyProblem<double> still = problem, blind = problem;
      std::visit(
          [](auto& given) {
            for (auto& model : given.models) set_no_dynamics(model);
          },
          still);
      std::visit(
          [](auto& given) {
            for (auto& model : given.models) set_no_measurement(model);
          },
          blind);
      PlainRecursion measured(still, metadata, u), moved(blind, metadata, u);
      const auto filter = make_split_filter(id);

      filter->start(problem);
      ASSERT_TRUE(filter->measurement_update(0, &y));
      measured.step(0, &y, nullptr);
      expect_followed(measured, filter->held(), &filter->filter_gain(), filter->state(), "measurement update");

      filter->start(problem);
      ASSERT_TRUE(filter->time_update(0, &input));
      moved.step(0, &y, &input);
      if (metadata.instant == Instant::filtered) moved.step(1, &y, &input);  // it moves at the start of the next
      expect_followed(moved, filter->held(), nullptr, filter->state(), "time update");
    }
}

TEST(Updates, WithoutDataLeaveTheStateAndTheSameCovariance) {
  for (const std::string_view id : split_filters()) {
    const Case c{.d = {3, 2, 2}, .period = 2, .inputs = 1};
    const auto problem = random_problem(find_filter(id)->takes, c, 46);
    const auto with = make_split_filter(id), without = make_split_filter(id);
    with->start(problem);
    without->start(problem);
    const Vector<double> x0 = without->state(), y = Dice(47).vector(2, 32), input = Dice(48).vector(1, 32);
    ASSERT_TRUE(with->measurement_update(0, &y));
    ASSERT_TRUE(without->measurement_update(0, nullptr));
    ASSERT_TRUE(with->step(0, &y, &input));
    ASSERT_TRUE(without->step(0, nullptr, nullptr));
    EXPECT_EQ(with->held(), without->held()) << id;
    EXPECT_EQ(without->state(), x0) << id;
  }
}

// Halves read the promised triangle of the start alone, as whole steps do: NaN in the other changes no bit.
TEST(Updates, ReadOneTriangleOfTheStart) {
  for (const std::string_view id : split_filters()) {
    const Metadata& metadata = *find_filter(id);
    const AnyProblem<double> clean = random_problem(metadata.takes, {.d = {3, 2, 2}}, 52);
    AnyProblem<double> planted = clean;
    std::visit(
        [&](auto& given) {
          for (Index j = 0; j < 3; ++j)
            for (Index i = j + 1; i < 3; ++i)
              (metadata.takes == Parametrisation::root ? given.initial(j, i) : given.initial(i, j)) = std::nan("");
        },
        planted);
    for (const bool measured : {true, false}) {
      const auto one = make_split_filter(id), other = make_split_filter(id);
      one->start(clean);
      other->start(planted);
      EXPECT_EQ(one->held(), other->held()) << id;
      ASSERT_TRUE(measured ? one->measurement_update(0, nullptr) : one->time_update(0, nullptr));
      ASSERT_TRUE(measured ? other->measurement_update(0, nullptr) : other->time_update(0, nullptr)) << id;
      EXPECT_EQ(one->held(), other->held()) << id;
    }
  }
}

TEST(FixedSizes, FollowTheRecursionAsDynamicOnesDo) {
  fixed_follows<SquareRootCovarianceFilter<double, 1, 1, 1>, RootModel<double>>("srcf");
  fixed_follows<SquareRootCovarianceFilter<double, 2, 1, 3>, RootModel<double>>("srcf");
  fixed_follows<SquareRootCovarianceFilter<double, 3, 2, 1>, RootModel<double>>("srcf");
  fixed_follows<ConventionalFilter<double, 3, 1, 2>, CovarianceModel<double>>("ckf");
  fixed_follows<SquareRootInformationFilter<double, 3, 2, 1>, InformationModel<double>>("srif");
  fixed_follows<UdFilter<double, 2, 1, 3>, RootModel<double>>("ud");
  fixed_follows<PotterFilter<double, 1, 1, 1>, RootModel<double>>("potter");
  fixed_follows<CarlsonFilter<double, 3, 2, 1>, RootModel<double>>("carlson");
  fixed_follows<InformationFilter<double, 3, 2, 1>, InformationModel<double>>("information");
  fixed_follows<SvdFilter<double, 2, 1, 3>, RootModel<double>>("svd");
  fixed_follows<SvdFilter<double, 1, 1, 1>, RootModel<double>>("svd");
}

TEST(SquareRootCovarianceFilter, ShowsARootOfTheInnovationCovariance) {
  const Case c{.d = {4, 2, 3}};
  const auto any = random_problem(Parametrisation::root, c, 49);
  const auto& problem = std::get<Problem<RootModel<double>>>(any);
  const auto& model = problem.models[0];
  const Matrix<double> CS = model.C.lazyProduct(problem.initial);
  Matrix<double> Re = model.R_root.lazyProduct(model.R_root.transpose());
  Re += CS.lazyProduct(CS.transpose());
  for (const bool whole : {true, false}) {
    SquareRootCovarianceFilter<double> filter(c.d);
    filter.start(problem.initial, problem.x0);
    ASSERT_TRUE(whole ? filter.step(model) : filter.measurement_update(model));
    const Matrix<double>& root = filter.innovation_root();
    for (Index j = 0; j < 3; ++j)
      for (Index i = 0; i < j; ++i) EXPECT_EQ(root(i, j), 0);
    // An orthogonal transformation of [R^{1/2} C S]: u (n+m+p) |Re|.
    EXPECT_LE((root.lazyProduct(root.transpose()) - Re).norm(), threshold * u * 9 * Re.trace());
  }
}

// The sum of squares that is left over, e'e, is that of the whitened innovation.
TEST(SquareRootInformationFilter, ShowsTheResidual) {
  for (const Case& c : split_cases)
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      SCOPED_TRACE(c.text() + " seed=" + std::to_string(seed));
      AnyProblem<double> any = random_problem(Parametrisation::information, c, seed);
      auto& problem = std::get<Problem<InformationModel<double>>>(any);
      const Metadata& metadata = *find_filter("srif");
      Dice dice(50);
      const Vector<double> y = dice.vector(c.d.p, 32), input = dice.vector(c.inputs, 32);

      SquareRootInformationFilter<double> filter(c.d);
      filter.start(problem.initial, problem.x0);
      ASSERT_TRUE(filter.measurement_update(problem.model(0), &y));
      PlainRecursion recursion(any, metadata, u);
      recursion.step(0, &y, nullptr);
      EXPECT_LE(recursion.judge_residual(filter.residual().squaredNorm()).ratio(), threshold);

      // From a filtered state: a measurement of nothing comes before.
      problem.models.insert(problem.models.begin(), problem.models.front());
      problem.models.front().C.setZero();
      filter.start(problem.initial, problem.x0);
      ASSERT_TRUE(filter.step(problem.model(0), problem.model(1), &y, &input));
      PlainRecursion second(any, metadata, u);
      second.step(0, &y, &input);
      second.step(1, &y, &input);
      EXPECT_LE(second.judge_residual(filter.residual().squaredNorm()).ratio(), threshold);
    }
}

TEST(Tolerance, OfTheConstructorReplacesTheDefault) {
  const Case c{.d = {3, 1, 2}};
  const auto covariance = random_problem(Parametrisation::covariance, c, 51);
  const auto root = random_problem(Parametrisation::root, c, 51);
  const auto information = random_problem(Parametrisation::information, c, 51);
  const auto& P = std::get<Problem<CovarianceModel<double>>>(covariance);
  const auto& S = std::get<Problem<RootModel<double>>>(root);
  const auto& T = std::get<Problem<InformationModel<double>>>(information);

  ConventionalFilter<double> ckf(c.d, .999), usual_ckf(c.d);
  ckf.start(P.initial, P.x0);
  usual_ckf.start(P.initial, P.x0);
  EXPECT_EQ(ckf.step(P.models[0]).status, Status::singular_innovation);
  EXPECT_EQ(usual_ckf.step(P.models[0]).status, Status::ok);
  EXPECT_EQ(ckf.covariance(), P.initial);

  SquareRootCovarianceFilter<double> srcf(c.d, .999), usual_srcf(c.d);
  srcf.start(S.initial, S.x0);
  usual_srcf.start(S.initial, S.x0);
  EXPECT_EQ(srcf.step(S.models[0]).status, Status::singular_innovation);
  EXPECT_EQ(usual_srcf.step(S.models[0]).status, Status::ok);
  EXPECT_EQ(srcf.factor(), S.initial);

  SquareRootInformationFilter<double> srif(c.d, .999), usual_srif(c.d);
  srif.start(T.initial, T.x0);
  usual_srif.start(T.initial, T.x0);
  EXPECT_EQ(srif.step(T.models[0], T.models[0]).status, Status::singular_information);
  EXPECT_EQ(usual_srif.step(T.models[0], T.models[0]).status, Status::ok);
  EXPECT_EQ(srif.information_factor(), T.initial);
}

namespace {

template <class Filter>
void takes_the_product_for_B(const char* id) {
  const auto problem = std::get<Problem<RootModel<double>>>(
      random_problem(Parametrisation::root, {.d = {4, 2, 3}, .inputs = 1}, 41));
  const RootModel<double>& model = problem.models.front();
  RootModel<double> product = model;
  model.process_noise_root(product.B);
  product.Q_root.resize(0, 0);
  Filter given(model.dimensions()), multiplied(model.dimensions());
  given.start(problem.initial, problem.x0);
  multiplied.start(problem.initial, problem.x0);
  Dice dice(5);
  for (int k = 0; k < 4; ++k) {
    const Vector<double> y = dice.vector(3, 16);
    ASSERT_TRUE(given.step(model, &y)) << id;
    ASSERT_TRUE(multiplied.step(product, &y)) << id;
    EXPECT_EQ(given.state(), multiplied.state()) << id << " step " << k;
    if constexpr (requires { given.predictor_gain(); }) {
      EXPECT_EQ(given.predictor_gain(), multiplied.predictor_gain()) << id;
    } else {
      EXPECT_EQ(given.filter_gain(), multiplied.filter_gain()) << id;
    }
  }
}

}  // namespace

// FB01QD's MULTBQ = 'P', g13ebc's null Q: the same numbers, so the same bits.
TEST(ProcessNoise, MayComeMultipliedIntoB) {
  takes_the_product_for_B<SquareRootCovarianceFilter<double>>("srcf");
  takes_the_product_for_B<HessenbergSquareRootCovarianceFilter<double>>("srcf-hessenberg");
  takes_the_product_for_B<ChandrasekharFilter<double>>("csrf");
  takes_the_product_for_B<PotterFilter<double>>("potter");
  takes_the_product_for_B<CarlsonFilter<double>>("carlson");
  takes_the_product_for_B<UdFilter<double>>("ud");
  takes_the_product_for_B<SvdFilter<double>>("svd");
}

}  // namespace kfstab::test
