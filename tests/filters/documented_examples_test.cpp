// The examples that other libraries print in their manuals. Four decimals are printed, so a result is right when it is
// within half a unit of the last of them, and within what rounding in the filter's own scalar may have added.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include <kfstab/filters/condensed.hpp>
#include <kfstab/filters/hessenberg_square_root_information.hpp>
#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/registry.hpp>

#include "filters/plain_recursion.hpp"
#include "filters/random_problem.hpp"
#include "tolerance.hpp"

namespace kfstab::test::documented_examples {
namespace {

using Json = nlohmann::json;

constexpr double half_unit = .5e-4;

Json read(const std::string& file) {
  std::ifstream stream(KFSTAB_SOURCE_DIR "/tests/oracle/" + file);
  EXPECT_TRUE(stream) << file;
  return Json::parse(stream);
}

Matrix<double> matrix(const Json& json) {
  if (!json.at(0).is_array()) {
    Matrix<double> x(static_cast<Index>(json.size()), 1);
    for (Index i = 0; i < x.rows(); ++i) x(i, 0) = json.at(static_cast<std::size_t>(i));
    return x;
  }
  Matrix<double> X(static_cast<Index>(json.size()), static_cast<Index>(json.at(0).size()));
  for (Index i = 0; i < X.rows(); ++i)
    for (Index j = 0; j < X.cols(); ++j) X(i, j) = json.at(static_cast<std::size_t>(i)).at(static_cast<std::size_t>(j));
  return X;
}

/// X X' and X Y; the sizes are too small to care.
Matrix<double> square(const Matrix<double>& X) { return X.lazyProduct(X.transpose()); }

template <class Model>
void read_dynamics(const Json& example, Model& model) {
  model.A = matrix(example["A"]);
  model.B = matrix(example["B"]);
  model.C = matrix(example["C"]);
  model.D.resize(model.A.rows(), 0);
}

AnyProblem<double> as_covariance(const Json& example) {
  Problem<CovarianceModel<double>> problem;
  auto& model = problem.models.emplace_back();
  read_dynamics(example, model);
  const bool roots = example["takes"] == "root";
  model.Q = roots ? square(matrix(example["Q_root"])) : matrix(example["Q"]);
  model.R = roots ? square(matrix(example["R_root"])) : matrix(example["R"]);
  problem.initial = roots ? square(matrix(example["S0"])) : matrix(example["P0"]);
  problem.x0 = Vector<double>::Zero(model.A.rows());
  return problem;
}

AnyProblem<double> as_root(const Json& example) {
  Problem<RootModel<double>> problem;
  auto& model = problem.models.emplace_back();
  read_dynamics(example, model);
  model.Q_root = matrix(example["Q_root"]);
  model.R_root = matrix(example["R_root"]);
  problem.initial = matrix(example["S0"]);
  problem.x0 = Vector<double>::Zero(model.A.rows());
  return problem;
}

/// FB01SD starts from a filtered state, AnyFilter from a predicted one: a first measurement that says nothing, C = 0,
/// is put before.
AnyProblem<double> as_information(const Json& example, double sign_of_w) {
  Problem<InformationModel<double>> problem;
  InformationModel<double> model;
  model.A_inverse = matrix(example["A_inverse"]);
  model.A_inverse_B = matrix(example["A_inverse_B"]);
  model.C = matrix(example["C"]);
  model.D.resize(model.A_inverse.rows(), 0);
  model.Q_inverse_root = matrix(example["Q_inverse_root"]);
  model.R_inverse_root = matrix(example["R_inverse_root"]);
  model.w_mean = sign_of_w * matrix(example["Z"]);
  for (int k = 0; k <= example["steps"].get<int>(); ++k) problem.models.push_back(model);
  problem.models.front().C.setZero();
  problem.initial = matrix(example["T0"]);
  problem.x0 = matrix(example["x0"]);
  return problem;
}

struct Result {
  Matrix<double> held, gain, state;
  Judgement bounds;  ///< of the error of P or T'T, gain and state
};

/// Any problem for any scalar; its numbers rounded to that scalar, which the bounds take for one error more.
template <class Scalar>
Result run_in(std::string_view id, const AnyProblem<double>& problem, int steps, const Vector<double>* y) {
  const auto filter = make_filter<Scalar>(id);
  const AnyProblem<Scalar> rounded = cast<Scalar>(problem);
  PlainRecursion recursion(problem, filter->metadata(), static_cast<double>(unit_roundoff<Scalar>()));
  filter->start(rounded);
  const Vector<Scalar> y_rounded = y ? cast<Scalar>(*y) : Vector<Scalar>();
  Result result;
  for (int k = 0; k < steps; ++k) {
    const auto step = filter->step(k, y ? &y_rounded : nullptr, nullptr);
    EXPECT_EQ(step.report.status, Status::ok) << name(step.report.status) << " in step " << k;
    recursion.step(k, y, nullptr);
    const Exact held = step.held ? exact(*step.held) : Exact{};
    if (step.held) result.held = held.front();
    result.gain = exact(*step.gain).front();
    if (step.state) result.state = exact(*step.state).front();
    result.bounds = recursion.judge(held, exact(*step.gain), step.state ? exact(*step.state) : Exact{});
  }
  return result;
}

enum class Precision { in_double, in_float };

Result run(Precision precision, std::string_view id, const AnyProblem<double>& problem, int steps,
           const Vector<double>* y = nullptr) {
  return precision == Precision::in_double ? run_in<double>(id, problem, steps, y)
                                           : run_in<float>(id, problem, steps, y);
}

void expect_printed(const Matrix<double>& computed, const Matrix<double>& printed, double tolerance, const char* what) {
  ASSERT_EQ(computed.rows(), printed.rows()) << what;
  ASSERT_EQ(computed.cols(), printed.cols()) << what;
  for (Index j = 0; j < printed.cols(); ++j)
    for (Index i = 0; i < printed.rows(); ++i)
      EXPECT_NEAR(computed(i, j), printed(i, j), tolerance) << what << "(" << i + 1 << "," << j + 1 << ")";
}

/// Columns with the sign of the printed ones.
Matrix<double> signs_fixed(Matrix<double> S, const Matrix<double>& printed) {
  for (Index j = 0; j < S.cols(); ++j)
    if (S(j, j) * printed(j, j) < 0) S.col(j) *= -1;
  return S;
}

/// P from what is held.
Matrix<double> covariance_of(Held holds, const Matrix<double>& held) {
  if (holds == Held::covariance) return held;
  if (holds != Held::ud_factors) return square(held);
  Matrix<double> U = held;
  U.diagonal().setOnes();
  return (U * held.diagonal().asDiagonal()).lazyProduct(U.transpose());
}

/// Every filter that takes P or S gives the printed P and gain; one that holds S gives the printed S.
void reproduces_covariances(Precision precision, const std::string& file) {
  const Json example = read(file), expected = example["expected"];
  const bool has_roots = example["takes"] == "root";
  int filters_run = 0;
  for (const Metadata& metadata : filters()) {
    const Needs& needs = metadata.needs;
    if (metadata.takes == Parametrisation::information || (metadata.takes == Parametrisation::root && !has_roots))
      continue;
    if (needs.invertible_A || needs.positive_definite_P0 || needs.positive_definite_Q) continue;
    SCOPED_TRACE(std::string(metadata.id));
    ++filters_run;
    const auto problem = metadata.takes == Parametrisation::root ? as_root(example) : as_covariance(example);
    const Result result = run(precision, metadata.id, problem, example["steps"]);
    const double rounding = threshold * result.bounds.held.bound;

    const bool factor = metadata.holds == Held::covariance_factor;
    if (metadata.holds == Held::gain) {
      // Its gain is judged below, by the bound of the others: where P0 = 0 its rotations are orthogonal.
      if (!matrix(example["S0"]).isZero(0)) continue;
    } else if (const Matrix<double> P = covariance_of(metadata.holds, result.held); expected.contains("P")) {
      expect_printed(P, matrix(expected["P"]), half_unit + rounding, "P");
    } else {
      const Matrix<double> S = matrix(expected["S"]);
      // An entry of S S' sums up to n products of two printed numbers.
      const double sum = 2 * half_unit * static_cast<double>(S.rows()) * S.cwiseAbs().maxCoeff();
      expect_printed(P, square(S), sum + rounding, "S S'");
      if (factor && precision == Precision::in_double)
        expect_printed(signs_fixed(result.held, S), S, 1.001 * half_unit, "S");
    }

    const Matrix<double> A = matrix(example["A"]);
    const bool predictor = metadata.gain == GainKind::predictor;
    const double gain_rounding = threshold * result.bounds.gain.bound;
    if (expected.contains("filter_gain")) {
      const Matrix<double> printed = matrix(expected["filter_gain"]);
      if (predictor)
        expect_printed(result.gain, A.lazyProduct(printed),
                       half_unit * A.cwiseAbs().rowwise().sum().maxCoeff() + gain_rounding, "K");
      else
        expect_printed(result.gain, printed, half_unit + gain_rounding, "Kf");
    } else {
      const Matrix<double> printed = matrix(expected["predictor_gain"]);
      const Matrix<double> K = predictor ? result.gain : Matrix<double>(A.lazyProduct(result.gain));
      expect_printed(K, printed, half_unit + gain_rounding * (predictor ? 1 : A.norm()), "K");
    }
  }
  EXPECT_GE(filters_run, 7);
}

/// The printed T and x, of a filter that holds T.
void expect_printed_information(const Json& expected, const Matrix<double>& held, const Matrix<double>& state,
                                Precision precision, const Judgement& bounds) {
  expect_printed(state, matrix(expected["x"]), half_unit + threshold * bounds.state.bound, "x");
  const Matrix<double> T = matrix(expected["T"]), transposed = held.transpose();
  const double sum = 2 * half_unit * static_cast<double>(T.rows()) * T.cwiseAbs().maxCoeff();
  expect_printed(square(transposed), square(T.transpose()), sum + threshold * bounds.held.bound, "T'T");
  if (precision == Precision::in_double)
    expect_printed(signs_fixed(transposed, T.transpose()), T.transpose(), 1.001 * half_unit, "T'");
}

void reproduces_information(Precision precision, const std::string& file) {
  const Json example = read(file);
  ASSERT_EQ(matrix(example["R_inverse_root"]), (Matrix<double>::Identity(2, 2)));  // so y is what is called weighted y
  const Vector<double> y = matrix(example["weighted_y"]);
  const int steps = example["steps"].get<int>() + 1;
  const Result result = run(precision, "srif", as_information(example, -1), steps, &y);
  expect_printed_information(example["expected"], result.held, result.state, precision, result.bounds);
}

/// (U'AU, U'B) and (U'AU, CU) are unique up to the signs of U's columns: some choice of them gives all that is printed,
/// to half a unit of the last decimal and what rounding may have added.
struct Transformed {
  Matrix<double> computed, printed;
  bool rows, columns;  ///< are those of the states, and take their signs
};

void expect_printed_up_to_signs(const std::vector<Transformed>& all, Index n, double scale) {
  const double tolerance = half_unit + threshold * 0x1p-53 * static_cast<double>(n) * scale;
  for (unsigned choice = 0; choice < 1u << n; ++choice) {
    const auto sign = [&](Index i, bool matters) { return matters && (choice >> i & 1u) ? -1. : 1.; };
    bool agrees = true;
    for (const Transformed& X : all)
      for (Index j = 0; j < X.printed.cols(); ++j)
        for (Index i = 0; i < X.printed.rows(); ++i) {
          const double value = sign(i, X.rows) * sign(j, X.columns) * X.computed(i, j);
          agrees = agrees && std::abs(value - X.printed(i, j)) <= tolerance;
        }
    if (agrees) return;
  }
  for (const Transformed& X : all)
    ADD_FAILURE() << "no choice of signs makes\n" << X.computed << "\nthe printed\n" << X.printed;
}

}  // namespace

TEST(DocumentedExamples, FB01QD) { reproduces_covariances(Precision::in_double, "fb01qd.json"); }
TEST(DocumentedExamples, FB01QDInFloat) { reproduces_covariances(Precision::in_float, "fb01qd.json"); }
TEST(DocumentedExamples, G13EBCExample1) { reproduces_covariances(Precision::in_double, "g13ebc_1.json"); }
TEST(DocumentedExamples, G13EBCExample1InFloat) { reproduces_covariances(Precision::in_float, "g13ebc_1.json"); }
TEST(DocumentedExamples, G13EBCExample2) { reproduces_covariances(Precision::in_double, "g13ebc_2.json"); }
TEST(DocumentedExamples, G13EBCExample2InFloat) { reproduces_covariances(Precision::in_float, "g13ebc_2.json"); }
TEST(DocumentedExamples, FB01VD) { reproduces_covariances(Precision::in_double, "fb01vd.json"); }
TEST(DocumentedExamples, FB01VDInFloat) { reproduces_covariances(Precision::in_float, "fb01vd.json"); }
TEST(DocumentedExamples, FB01RD) { reproduces_covariances(Precision::in_double, "fb01rd.json"); }
TEST(DocumentedExamples, FB01RDInFloat) { reproduces_covariances(Precision::in_float, "fb01rd.json"); }
TEST(DocumentedExamples, FB01SD) { reproduces_information(Precision::in_double, "fb01sd.json"); }
TEST(DocumentedExamples, FB01SDInFloat) { reproduces_information(Precision::in_float, "fb01sd.json"); }
TEST(DocumentedExamples, FB01TDByTheDenseForm) { reproduces_information(Precision::in_double, "fb01td.json"); }

// The Hessenberg form itself starts from a filtered state by its class alone: a measurement of nothing put before, as
// for the dense form, would be another model.
TEST(DocumentedExamples, FB01TD) {
  const Json example = read("fb01td.json");
  const AnyProblem<double> any = as_information(example, -1);
  const auto& problem = std::get<Problem<InformationModel<double>>>(any);
  const auto& model = problem.models.back();
  const Vector<double> y = matrix(example["weighted_y"]);
  PlainRecursion recursion(any, *find_filter("srif-hessenberg"), 0x1p-53);
  recursion.step(0, &y, nullptr);
  HessenbergSquareRootInformationFilter<double> filter(model.dimensions());
  filter.start(problem.initial, problem.x0);
  for (int k = 1; k <= example["steps"].get<int>(); ++k) {
    ASSERT_TRUE(filter.step(model, model, &y));
    recursion.step(k, &y, nullptr);
  }
  const Judgement bounds =
      recursion.judge(exact(filter.information_factor()), exact(filter.filter_gain()), exact(filter.state()));
  expect_printed_information(example["expected"], filter.information_factor(), filter.state(), Precision::in_double,
                             bounds);
  // The example has the form already: there was nothing to reduce, and the array's T is the printed one.
  EXPECT_EQ(filter.transformation(), (Matrix<double>::Identity(4, 4)));
  EXPECT_EQ(filter.condensed_factor(), filter.information_factor());
}

TEST(DocumentedExamples, TB01MD) {
  const Json example = read("tb01md.json");
  Matrix<double> A = matrix(example["A"]), B = matrix(example["B"]);
  const double scale = A.norm() + B.norm();
  controller_hessenberg(Triangle::upper, A, B);
  expect_printed_up_to_signs({{A, matrix(example["expected"]["A"]), true, true},
                              {B, matrix(example["expected"]["B"]), true, false}},
                             6, scale);
}

TEST(DocumentedExamples, TB01ND) {
  const Json example = read("tb01nd.json");
  Matrix<double> A = matrix(example["A"]), C = matrix(example["C"]);
  const double scale = A.norm() + C.norm();
  observer_hessenberg(Triangle::upper, A, C);
  expect_printed_up_to_signs({{A, matrix(example["expected"]["A"]), true, true},
                              {C, matrix(example["expected"]["C"]), false, true}},
                             5, scale);
}

// Only one sign of the process noise's mean gives the printed state: the routine's Z is the mean of -w.
TEST(DocumentedExamples, FB01SDWithTheOtherSignOfZIsAnotherState) {
  const Json example = read("fb01sd.json");
  const Vector<double> y = matrix(example["weighted_y"]);
  const Result result = run(Precision::in_double, "srif", as_information(example, 1), 4, &y);
  EXPECT_GT((result.state - matrix(example["expected"]["x"])).cwiseAbs().maxCoeff(), .1);
}

// The factor of Re that FB01VD returns, by the factorisation that the conventional filter uses.
TEST(DocumentedExamples, FB01VDInnovationFactor) {
  const Json example = read("fb01vd.json");
  const Matrix<double> C = matrix(example["C"]), P = matrix(example["P0"]);
  Matrix<double> Re = matrix(example["R"]);
  Re += Matrix<double>(C.lazyProduct(P)).lazyProduct(C.transpose());
  ASSERT_EQ(cholesky_upper(Re), 0);
  Re(1, 0) = 0;
  expect_printed(Re, matrix(example["expected"]["Re_root"]), 1.001 * half_unit, "V");
}

}  // namespace kfstab::test::documented_examples
