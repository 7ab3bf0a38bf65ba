// The Hessenberg forms of the square-root filters, beside the plain recursion, as the dense ones stand beside it in
// instances_double_test.cpp, and what they alone have: a transformation, one model for ever, a factor made when it is
// asked for.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include <kfstab/filters/hessenberg_square_root_covariance.hpp>
#include <kfstab/filters/hessenberg_square_root_information.hpp>
#include <kfstab/filters/registry.hpp>

#include "filters/plain_recursion.hpp"
#include "filters/random_problem.hpp"
#include "tolerance.hpp"

namespace kfstab::test::hessenberg {
namespace {

using Root = RootModel<double>;
using Information = InformationModel<double>;
using Covariance = HessenbergSquareRootCovarianceFilter<double>;
using InformationFilter = HessenbergSquareRootInformationFilter<double>;

// The bounds are those of the dense forms: an orthogonal change of coordinates perturbs A, B, C and S by u times their
// norms, which is what a step does to them anyway.
const Metadata& covariance_form() { return *find_filter("srcf-hessenberg"); }
const Metadata& information_form() { return *find_filter("srif-hessenberg"); }

const Dimensions sizes[] = {{6, 2, 2}, {6, 1, 3}, {6, 3, 1}, {5, 5, 5}, {2, 4, 5}, {2, 5, 3}, {1, 1, 1}, {1, 3, 2},
                            {2, 1, 1}, {4, 0, 2}, {4, 2, 0}, {3, 0, 0}, {0, 2, 1}, {0, 0, 0}, {9, 2, 3}};

std::vector<Case> all_cases() {
  std::vector<Case> all;
  for (const Dimensions& d : sizes)
    for (const bool data : {true, false}) all.push_back({.d = d, .inputs = data ? 2 : 0, .data = data});
  return all;
}

double norm_of(const Matrix<double>& X) { return X.norm(); }

template <class S>
void expect_followed(const PlainRecursion& recursion, const Matrix<S>& held, const Matrix<S>& gain,
                     const Vector<S>* state) {
  const Judgement is = recursion.judge(exact(held), exact(gain), state ? exact(*state) : Exact{});
  EXPECT_LE(is.held.ratio(), threshold) << "held is off by " << is.held.error;
  EXPECT_LE(is.gain.ratio(), threshold) << "the gain is off by " << is.gain.error;
  EXPECT_LE(is.state.ratio(), threshold) << "the state is off by " << is.state.error;
}

/// What every change of coordinates owes: U orthogonal, and U P U' what the condensed factor is a factor of.
template <class S>
void expect_coordinates(const Matrix<S>& U, const Matrix<S>& product, const Matrix<S>& condensed_product, Index size) {
  const double unit = threshold * static_cast<double>(unit_roundoff<S>()) * static_cast<double>(size);
  const Matrix<S> eye = Matrix<S>::Identity(U.rows(), U.rows());
  EXPECT_LE(static_cast<double>((U.lazyProduct(U.transpose()) - eye).norm()), unit * static_cast<double>(eye.norm()));
  const Matrix<S> brought = Matrix<S>(U.lazyProduct(product)).lazyProduct(U.transpose());
  EXPECT_LE(static_cast<double>((brought - condensed_product).norm()), unit * static_cast<double>(product.norm()));
}

template <class S>
Matrix<S> square(const Matrix<S>& X) {
  return X.lazyProduct(X.transpose());
}

template <class S>
void covariance_follows(const Case& c, std::uint64_t seed) {
  SCOPED_TRACE("srcf-hessenberg: " + c.text() + " seed=" + std::to_string(seed));
  const AnyProblem<double> any = random_problem(Parametrisation::root, c, seed);
  const AnyProblem<S> rounded = cast<S>(any);
  const auto& problem = std::get<Problem<RootModel<S>>>(rounded);
  PlainRecursion recursion(any, covariance_form(), static_cast<double>(unit_roundoff<S>()));
  HessenbergSquareRootCovarianceFilter<S> filter(c.d);
  filter.start(problem.initial, problem.x0);
  EXPECT_EQ(filter.factor(), problem.initial);
  Dice dice(71);
  for (int k = 0; k < 5; ++k) {
    const Vector<double> y = dice.vector(c.d.p, 48), input = dice.vector(c.inputs, 16);
    const Vector<S> y_rounded = cast<S>(y), input_rounded = cast<S>(input);
    recursion.step(k, c.data ? &y : nullptr, c.data ? &input : nullptr);
    const auto report =
        filter.step(problem.models[0], c.data ? &y_rounded : nullptr, c.data ? &input_rounded : nullptr);
    ASSERT_EQ(report.status, Status::ok) << name(report.status);
    const Matrix<S> factor = filter.factor();
    const Vector<S> state = filter.state();
    expect_followed<S>(recursion, factor, filter.predictor_gain(), c.data ? &state : nullptr);
    const Matrix<S>& condensed = filter.condensed_factor();
    for (Index j = 0; j < c.d.n; ++j)
      for (Index i = 0; i < j; ++i) EXPECT_TRUE(factor(i, j) == S(0) && condensed(i, j) == S(0));
    expect_coordinates<S>(filter.transformation(), square<S>(factor), square<S>(condensed), c.d.n + c.d.m + c.d.p);
  }
}

template <class S>
void information_follows(const Case& c, std::uint64_t seed) {
  SCOPED_TRACE("srif-hessenberg: " + c.text() + " seed=" + std::to_string(seed));
  const AnyProblem<double> any = random_problem(Parametrisation::information, c, seed);
  const AnyProblem<S> rounded = cast<S>(any);
  const auto& problem = std::get<Problem<InformationModel<S>>>(rounded);
  const auto& model = problem.models[0];
  PlainRecursion recursion(any, information_form(), static_cast<double>(unit_roundoff<S>()));
  HessenbergSquareRootInformationFilter<S> filter(c.d);
  filter.start(problem.initial, problem.x0);
  EXPECT_EQ(filter.information_factor(), problem.initial);
  Dice dice(72);
  Vector<S> input_before;
  for (int k = 0; k < 5; ++k) {
    const Vector<double> y = dice.vector(c.d.p, 48), input = dice.vector(c.inputs, 16);
    const Vector<S> y_rounded = cast<S>(y);
    const Vector<S>* given = c.data ? &y_rounded : nullptr;
    recursion.step(k, c.data ? &y : nullptr, c.data ? &input : nullptr);
    const auto report = k == 0 ? filter.measurement_update(model, given)
                               : filter.step(model, model, given, c.data ? &input_before : nullptr);
    input_before = cast<S>(input);
    ASSERT_EQ(report.status, Status::ok) << name(report.status);
    const Matrix<S> factor = filter.information_factor();
    const Vector<S> state = filter.state();
    expect_followed<S>(recursion, factor, filter.filter_gain(), c.data ? &state : nullptr);
    if (c.data) {
      const Matrix<double> e = exact(filter.residual()).front();
      // Its bound holds for what came in exact, as it does at first; later what came in was rounded, too.
      if (k == 0 && std::is_same_v<S, double>) {
        EXPECT_LE(recursion.judge_residual(e.squaredNorm()).ratio(), threshold);
      }
    }
    const Matrix<S>& condensed = filter.condensed_factor();
    for (Index j = 0; j < c.d.n; ++j)
      for (Index i = 0; i < j; ++i) EXPECT_TRUE(factor(j, i) == S(0) && condensed(j, i) == S(0));
    expect_coordinates<S>(filter.transformation(), square<S>(factor.transpose()), square<S>(condensed.transpose()),
                          c.d.n + c.d.m + c.d.p);
  }
}

template <class Filter, class Model>
StepReport<double> go_on(Filter& filter, const Model& model, const Vector<double>* y, const Vector<double>* input) {
  if constexpr (Model::parametrisation == Parametrisation::information)
    return filter.step(model, model, y, input);
  else
    return filter.step(model, y, input);
}

const Matrix<double>& held_by(Covariance& filter) { return filter.factor(); }
const Matrix<double>& held_by(InformationFilter& filter) { return filter.information_factor(); }
const Matrix<double>& gain_of(const Covariance& filter) { return filter.predictor_gain(); }
const Matrix<double>& gain_of(const InformationFilter& filter) { return filter.filter_gain(); }

/// Every number of a model that no step may change.
template <class Model>
std::vector<std::function<double&(Model&)>> numbers_of() {
  if constexpr (Model::parametrisation == Parametrisation::root)
    return {[](auto& m) -> double& { return m.A(2, 1); }, [](auto& m) -> double& { return m.B(1, 0); },
            [](auto& m) -> double& { return m.C(1, 2); }, [](auto& m) -> double& { return m.Q_root(1, 0); },
            [](auto& m) -> double& { return m.R_root(1, 0); }};
  else
    return {[](auto& m) -> double& { return m.A_inverse(2, 1); },
            [](auto& m) -> double& { return m.A_inverse_B(1, 0); }, [](auto& m) -> double& { return m.C(1, 2); },
            [](auto& m) -> double& { return m.Q_inverse_root(0, 1); },
            [](auto& m) -> double& { return m.R_inverse_root(0, 1); }};
}

template <class Filter>
void refuses_another_model() {
  using Model = typename Filter::Model;
  const Case c{.d = {3, 2, 2}, .inputs = 1};
  const AnyProblem<double> any = random_problem(Model::parametrisation, c, 81);
  const auto& problem = std::get<Problem<Model>>(any);
  const Vector<double> y = Dice(82).vector(2, 32), input = Dice(83).vector(1, 32);
  for (const auto& number : numbers_of<Model>())
    for (const double value : {7., std::nan(""), HUGE_VAL}) {
      Filter filter(c.d), unhurt(c.d);
      filter.start(problem.initial, problem.x0);
      unhurt.start(problem.initial, problem.x0);
      const Model& model = problem.models[0];
      Model other = model;
      number(other) = value;
      // A first step that fails for its numbers leaves nothing of them.
      if (!std::isfinite(value)) {
        EXPECT_EQ(go_on(filter, other, &y, &input).status, Status::non_finite_input);
        EXPECT_EQ(held_by(filter), problem.initial);
        EXPECT_EQ(filter.transformation(), (Matrix<double>::Identity(3, 3)));
      }
      ASSERT_TRUE(go_on(filter, model, &y, &input));
      ASSERT_TRUE(go_on(unhurt, model, &y, &input));
      const Status expected = std::isfinite(value) ? Status::time_varying_model : Status::non_finite_input;
      EXPECT_EQ(go_on(filter, other, &y, &input).status, expected);
      if constexpr (Model::parametrisation == Parametrisation::information) {
        EXPECT_EQ(filter.step(other, model, &y, &input).status, expected);
        EXPECT_EQ(filter.step(model, other, &y, &input).status, expected);
        EXPECT_EQ(filter.measurement_update(other, &y).status, expected);
      }
      EXPECT_EQ(held_by(filter), held_by(unhurt));
      EXPECT_EQ(filter.state(), unhurt.state());
      ASSERT_TRUE(go_on(filter, model, &y, &input));
      ASSERT_TRUE(go_on(unhurt, model, &y, &input));
      EXPECT_EQ(held_by(filter), held_by(unhurt));
      EXPECT_EQ(gain_of(filter), gain_of(unhurt));
      EXPECT_EQ(filter.state(), unhurt.state());

      // A new start may bring a new model.
      if (!std::isfinite(value)) continue;
      Filter fresh(c.d);
      filter.start(problem.initial, problem.x0);
      fresh.start(problem.initial, problem.x0);
      ASSERT_TRUE(go_on(filter, other, &y, &input));
      ASSERT_TRUE(go_on(fresh, other, &y, &input));
      EXPECT_EQ(held_by(filter), held_by(fresh));
      EXPECT_EQ(filter.state(), fresh.state());
    }
}

/// A second step, from a model whose D (and mean of w) changed: the recursion says what must come out.
template <class Filter>
void takes_other_inputs(const Metadata& form) {
  using Model = typename Filter::Model;
  const Case c{.d = {4, 2, 2}, .inputs = 1};
  AnyProblem<double> any = random_problem(Model::parametrisation, c, 84);
  auto& problem = std::get<Problem<Model>>(any);
  problem.models.resize(4, problem.models[0]);
  Dice dice(85);
  for (std::size_t k = 0; k < 4; ++k) {
    problem.models[k].D = dice.matrix(4, 1, 16);
    if constexpr (Model::parametrisation == Parametrisation::information)
      problem.models[k].w_mean = dice.vector(k % 2 == 0 ? 2 : 0, 16);
  }
  PlainRecursion recursion(any, form, u);
  Filter filter(c.d);
  filter.start(problem.initial, problem.x0);
  Vector<double> before;
  for (int k = 0; k < 4; ++k) {
    const Vector<double> y = dice.vector(2, 32), input = dice.vector(1, 32);
    recursion.step(k, &y, &input);
    StepReport<double> report;
    if constexpr (Model::parametrisation == Parametrisation::information)
      report = k == 0 ? filter.measurement_update(problem.model(0), &y)
                      : filter.step(problem.model(k - 1), problem.model(k), &y, &before);
    else
      report = filter.step(problem.model(k), &y, &input);
    ASSERT_TRUE(report);
    before = input;
    const Vector<double> state = filter.state();
    expect_followed<double>(recursion, held_by(filter), gain_of(filter), &state);
  }
}

}  // namespace

TEST(HessenbergSquareRootCovarianceFilter, FollowsThePlainRecursion) {
  for (const Case& c : all_cases())
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
      covariance_follows<double>(c, seed);
      covariance_follows<float>(c, seed);
      covariance_follows<long double>(c, seed);
    }
  for (std::uint64_t seed = 1; seed <= 4; ++seed)
    covariance_follows<double>({.d = {5, 3, 2}, .inputs = 1, .singular = true}, seed);
}

TEST(HessenbergSquareRootInformationFilter, FollowsThePlainRecursion) {
  for (const Case& c : all_cases())
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
      information_follows<double>(c, seed);
      information_follows<float>(c, seed);
      information_follows<long double>(c, seed);
    }
}

TEST(HessenbergFilters, RefuseAnotherModelAndGoOn) {
  refuses_another_model<Covariance>();
  refuses_another_model<InformationFilter>();
}

TEST(HessenbergFilters, TakeAnotherInputMatrixAndMeanOfTheNoise) {
  takes_other_inputs<Covariance>(covariance_form());
  takes_other_inputs<InformationFilter>(information_form());
}

// The form's own zeros: A_U = U A U', C_U = C U' are lower trapezoidal one over the other, U A^{-1} [B I] U' upper.
TEST(HessenbergFilters, TransformToTheFormTheyPromise) {
  const Case c{.d = {6, 2, 2}};
  const auto root = random_problem(Parametrisation::root, c, 86);
  const auto& S = std::get<Problem<Root>>(root);
  Covariance srcf(c.d);
  srcf.start(S.initial, S.x0);
  ASSERT_TRUE(srcf.step(S.models[0]));
  const auto information = random_problem(Parametrisation::information, c, 86);
  const auto& T = std::get<Problem<Information>>(information);
  InformationFilter srif(c.d);
  srif.start(T.initial, T.x0);
  ASSERT_TRUE(srif.step(T.models[0], T.models[0]));

  const auto transformed = [](const Matrix<double>& U, const Matrix<double>& A) {
    return Matrix<double>(Matrix<double>(U.lazyProduct(A)).lazyProduct(U.transpose()));
  };
  const Matrix<double>&U = srcf.transformation(), &V = srif.transformation();
  const Matrix<double> A = transformed(U, S.models[0].A), C = S.models[0].C.lazyProduct(U.transpose());
  const Matrix<double> F = transformed(V, T.models[0].A_inverse), H = V.lazyProduct(T.models[0].A_inverse_B);
  const double unit = threshold * u * 10;
  for (Index j = 0; j < 6; ++j)
    for (Index i = 0; i < 6; ++i) {
      if (j > i + 2) {
        EXPECT_LE(std::abs(A(i, j)), unit * norm_of(A)) << i << "," << j;
      }
      if (j > i && i < 2) {
        EXPECT_LE(std::abs(C(i, j)), unit * norm_of(C)) << i << "," << j;
      }
      if (i > j + 2) {
        EXPECT_LE(std::abs(F(i, j)), unit * norm_of(F)) << i << "," << j;
      }
      if (i > j && j < 2) {
        EXPECT_LE(std::abs(H(i, j)), unit * norm_of(H)) << i << "," << j;
      }
    }
}

// Re is the same in all coordinates; its root stands in the array.
TEST(HessenbergSquareRootCovarianceFilter, ShowsARootOfTheInnovationCovariance) {
  const Case c{.d = {4, 2, 3}};
  const auto any = random_problem(Parametrisation::root, c, 87);
  const auto& problem = std::get<Problem<Root>>(any);
  Covariance filter(c.d);
  filter.start(problem.initial, problem.x0);
  ASSERT_TRUE(filter.step(problem.models[0]));
  const Matrix<double> Re =
      square<double>(problem.models[0].R_root) + square<double>(problem.models[0].C.lazyProduct(problem.initial));
  EXPECT_LE(norm_of(square<double>(filter.innovation_root()) - Re), threshold * u * 9 * Re.trace());
}

TEST(HessenbergFilters, SayWhatIsSingularAndKeepWhatTheyHold) {
  const Case c{.d = {3, 2, 2}};
  auto root = random_problem(Parametrisation::root, c, 88);
  auto& S = std::get<Problem<Root>>(root);
  S.models[0].C.row(1) = S.models[0].C.row(0);
  S.models[0].R_root.setZero();
  Covariance srcf(c.d);
  srcf.start(S.initial, S.x0);
  const Vector<double> y = Dice(89).vector(2, 32);
  EXPECT_EQ(srcf.step(S.models[0], &y).status, Status::singular_innovation);
  EXPECT_EQ(srcf.factor(), S.initial);
  EXPECT_EQ(srcf.state(), S.x0);

  auto information = random_problem(Parametrisation::information, c, 88);
  auto& T = std::get<Problem<Information>>(information);
  T.models[0].A_inverse.col(1).setZero();
  T.models[0].C.col(1).setZero();
  InformationFilter srif(c.d);
  srif.start(T.initial, T.x0);
  EXPECT_EQ(srif.step(T.models[0], T.models[0], &y).status, Status::singular_information);
  EXPECT_EQ(srif.information_factor(), T.initial);
  EXPECT_EQ(srif.state(), T.x0);
}

// Finite data whose product is not: D u beyond the range.
TEST(HessenbergFilters, TellOverflowFromInputThatIsNotFinite) {
  const Case c{.d = {3, 2, 2}, .inputs = 1};
  const Vector<double> y = Dice(90).vector(2, 32), huge = Vector<double>::Constant(1, 0x1p+1000);
  auto root = random_problem(Parametrisation::root, c, 91);
  auto& S = std::get<Problem<Root>>(root);
  S.models[0].D.setConstant(0x1p+1000);
  Covariance srcf(c.d);
  srcf.start(S.initial, S.x0);
  EXPECT_EQ(srcf.step(S.models[0], &y, &huge).status, Status::overflow);
  EXPECT_EQ(srcf.factor(), S.initial);
  EXPECT_TRUE(srcf.step(S.models[0], &y));

  auto information = random_problem(Parametrisation::information, c, 91);
  auto& T = std::get<Problem<Information>>(information);
  T.models[0].D.setConstant(0x1p+1000);
  InformationFilter srif(c.d);
  srif.start(T.initial, T.x0);
  EXPECT_EQ(srif.step(T.models[0], T.models[0], &y, &huge).status, Status::overflow);
  EXPECT_EQ(srif.information_factor(), T.initial);
  EXPECT_TRUE(srif.step(T.models[0], T.models[0], &y));

  // Numbers whose transforms leave the range: nothing of the model is kept, and another one may come.
  auto large = S.models[0];
  large.A.setConstant(0x1.8p+1023);
  srcf.start(S.initial, S.x0);
  EXPECT_EQ(srcf.step(large, &y).status, Status::overflow);
  EXPECT_TRUE(srcf.step(S.models[0], &y));
}

TEST(HessenbergFilters, HaveATolerance) {
  const Case c{.d = {3, 1, 2}};
  const auto root = random_problem(Parametrisation::root, c, 92);
  const auto& S = std::get<Problem<Root>>(root);
  Covariance srcf(c.d, .999);
  srcf.start(S.initial, S.x0);
  EXPECT_EQ(srcf.step(S.models[0]).status, Status::singular_innovation);
  EXPECT_EQ(srcf.factor(), S.initial);
  const auto information = random_problem(Parametrisation::information, c, 92);
  const auto& T = std::get<Problem<Information>>(information);
  InformationFilter srif(c.d, .999);
  srif.start(T.initial, T.x0);
  EXPECT_EQ(srif.step(T.models[0], T.models[0]).status, Status::singular_information);
  EXPECT_EQ(srif.information_factor(), T.initial);
}

// Sizes known at compile time give the same numbers.
TEST(HessenbergFilters, OfFixedSizeDoAsDynamicOnes) {
  const Case c{.d = {3, 1, 2}, .inputs = 1};
  const Vector<double> y = Dice(93).vector(2, 32), input = Dice(94).vector(1, 32);
  const Vector<double, 2> y_fixed = y;
  const auto root = random_problem(Parametrisation::root, c, 95);
  const auto& S = std::get<Problem<Root>>(root);
  RootModel<double, 3, 1, 2> model;
  model.A = S.models[0].A;
  model.B = S.models[0].B;
  model.C = S.models[0].C;
  model.D = S.models[0].D;
  model.Q_root = S.models[0].Q_root;
  model.R_root = S.models[0].R_root;
  Covariance srcf(c.d);
  HessenbergSquareRootCovarianceFilter<double, 3, 1, 2> fixed_srcf;
  srcf.start(S.initial, S.x0);
  fixed_srcf.start(S.initial, S.x0);
  const auto information = random_problem(Parametrisation::information, c, 95);
  const auto& T = std::get<Problem<Information>>(information);
  InformationModel<double, 3, 1, 2> information_model;
  information_model.A_inverse = T.models[0].A_inverse;
  information_model.A_inverse_B = T.models[0].A_inverse_B;
  information_model.C = T.models[0].C;
  information_model.D = T.models[0].D;
  information_model.Q_inverse_root = T.models[0].Q_inverse_root;
  information_model.R_inverse_root = T.models[0].R_inverse_root;
  information_model.w_mean = T.models[0].w_mean;
  InformationFilter srif(c.d);
  HessenbergSquareRootInformationFilter<double, 3, 1, 2> fixed_srif;
  srif.start(T.initial, T.x0);
  fixed_srif.start(T.initial, T.x0);
  ASSERT_TRUE(srif.measurement_update(T.models[0], &y));
  ASSERT_TRUE(fixed_srif.measurement_update(information_model, &y_fixed));
  for (int k = 0; k < 3; ++k) {
    ASSERT_TRUE(srcf.step(S.models[0], &y, &input));
    ASSERT_TRUE(fixed_srcf.step(model, &y_fixed, &input));
    ASSERT_TRUE(srif.step(T.models[0], T.models[0], &y, &input));
    ASSERT_TRUE(fixed_srif.step(information_model, information_model, &y_fixed, &input));
  }
  // Eigen sums a product of fixed size in its own order: each step rounds within its bound, so both are compared with
  // the recursion.
  PlainRecursion covariance(root, covariance_form(), u), informed(information, information_form(), u);
  for (int k = 0; k < 3; ++k) covariance.step(k, &y, &input);
  for (int k = 0; k < 4; ++k) informed.step(k, &y, &input);
  const Matrix<double> factor = fixed_srcf.factor(), gain = fixed_srcf.predictor_gain();
  const Vector<double> state = fixed_srcf.state();
  expect_followed<double>(covariance, factor, gain, &state);
  const Matrix<double> information_factor = fixed_srif.information_factor(), filter_gain = fixed_srif.filter_gain();
  const Vector<double> information_state = fixed_srif.state();
  expect_followed<double>(informed, information_factor, filter_gain, &information_state);
}

}  // namespace kfstab::test::hessenberg
