#include <kfstab/reference/exact_filter.hpp>

#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "support.hpp"

namespace kfstab::reference::testing {
namespace {

Matrix<Rational> fractions(Index rows, Index cols, std::initializer_list<const char*> by_rows) {
  Matrix<Rational> X(rows, cols);
  auto entry = by_rows.begin();
  for (Index i = 0; i < rows; ++i)
    for (Index j = 0; j < cols; ++j) X(i, j) = Rational(*entry++);
  return X;
}

TEST(ExactFilter, TwoStepsByHand) {
  // x+ = x/3 + w, y = x + v, q = 1/2, r = 1/5, P0 = 1, x0 = 1, y = 2, 0
  ExactProblem problem;
  CovarianceModel<Rational> model;
  model.A = fractions(1, 1, {"1/3"});
  model.B = model.C = fractions(1, 1, {"1"});
  model.D = Matrix<Rational>(1, 0);
  model.Q = fractions(1, 1, {"1/2"});
  model.R = fractions(1, 1, {"1/5"});
  problem.models = {model};
  problem.initial = fractions(1, 1, {"1"});
  problem.x0 = fractions(1, 1, {"1"});
  ExactFilter filter(problem, std::make_shared<ExactListedData>(std::vector<StepDataOf<Rational>>{
                                  {fractions(1, 1, {"2"}), {}}, {fractions(1, 1, {"0"}), {}}}));
  filter.advance();
  const ExactStep& step = filter.step();
  EXPECT_EQ(filter.k(), 0);
  EXPECT_EQ(step.innovation(0, 0), Rational("6/5"));
  EXPECT_EQ(step.innovation_determinant, Rational("6/5"));
  EXPECT_EQ(step.weighted_innovation, Rational("5/6"));  // e = 1
  EXPECT_EQ(step.filter_gain(0, 0), Rational("5/6"));
  EXPECT_EQ(step.predictor_gain(0, 0), Rational("5/18"));
  EXPECT_EQ(step.P_filtered(0, 0), Rational("1/6"));
  EXPECT_EQ(step.P_next(0, 0), Rational("14/27"));  // 1/54 + 1/2
  EXPECT_EQ(step.x_predicted(0), 1);
  EXPECT_EQ(step.x_filtered(0), Rational("11/6"));
  EXPECT_EQ(step.x_next(0), Rational("11/18"));
  filter.advance();
  EXPECT_EQ(filter.step().P_predicted(0, 0), Rational("14/27"));
  EXPECT_EQ(filter.step().innovation(0, 0), Rational("97/135"));
  EXPECT_EQ(filter.step().P_filtered(0, 0), Rational("14/97"));  // P r / (P + r)
  EXPECT_EQ(filter.step().x_filtered(0), Rational("11/18") * (1 - Rational("70/97")));
}

TEST(ExactFilter, ReadsRootsAndInformationAsTheirCovariances) {
  const ExactInformation both = exact_information();
  std::mt19937_64 random(3);
  const auto data = random_data(random, 2, 1, 3);
  const AnyProblem<double> information = both.information, covariance = both.covariance;
  // The mean of w is one more known input there, of which the data know nothing.
  ExactFilter a(exact_problem(information), exact_data(information, data));
  std::vector<StepData> with_one;
  const auto stream = data->open();
  for (int k = 0; k < 3; ++k) {
    const StepData now = stream->next();
    with_one.push_back({now.y, Vector<double>(matrix(2, 1, {now.u(0), 1}))});
  }
  ExactFilter b(exact_problem(covariance), exact_data(covariance, std::make_shared<ListedData>(with_one)));
  for (int k = 0; k < 3; ++k) {
    a.advance();
    b.advance();
    EXPECT_EQ(a.step().P_next, b.step().P_next);
    EXPECT_EQ(a.step().predictor_gain, b.step().predictor_gain);
    EXPECT_EQ(a.step().x_next, b.step().x_next);
  }

  Problem<RootModel<double>> root;
  root.models = {random_root_model(random, {3, 2, 2})};
  root.initial = few_bits_root(random, 3);
  root.x0 = few_bits(random, 3, 1);
  const AnyProblem<double> as_covariances = as_covariance(root);
  const ExactProblem expected = exact_problem(as_covariances);
  root.initial(0, 2) = root.models[0].R_root(0, 1) = std::numeric_limits<double>::quiet_NaN();  // never read
  const ExactProblem read = exact_problem(root);
  EXPECT_EQ(read.initial, expected.initial);
  EXPECT_EQ(read.models[0].Q, expected.models[0].Q);
  EXPECT_EQ(read.models[0].R, expected.models[0].R);
  EXPECT_EQ(exact_data(root, nullptr), nullptr);
}

TEST(ExactFilter, RefusesWhatIsNotPositiveDefinite) {
  const auto words = [](const char* R, const char* P0) -> std::string {
    ExactProblem problem;
    CovarianceModel<Rational> model;
    model.A = model.B = model.Q = fractions(1, 1, {"1"});
    model.C = fractions(2, 1, {"1", "1"});
    model.R = fractions(2, 2, {R, "0", "0", R});
    problem.models = {model};
    problem.initial = fractions(1, 1, {P0});
    try {
      ExactFilter(problem).advance();
    } catch (const ReferenceError& error) {
      return error.what();
    }
    return "accepted";
  };
  EXPECT_EQ(words("1/1000000000000000000000000000000", "1"), "accepted");
  EXPECT_EQ(words("0", "1"), "step 0: Re is not positive definite");  // singular, and nothing rounds it away
  EXPECT_EQ(words("-1/1000000000000000000000000000000", "1"), "step 0: Re is not positive definite");
  EXPECT_THROW(exact_problem(Problem<CovarianceModel<double>>{}), ReferenceError);
}

}  // namespace
}  // namespace kfstab::reference::testing
