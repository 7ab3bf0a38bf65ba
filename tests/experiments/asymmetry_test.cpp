#include <kfstab/experiments/asymmetry.hpp>

#include <cmath>

#include <gtest/gtest.h>

#include <kfstab/experiments/models.hpp>

using namespace kfstab;
using namespace kfstab::experiments;

namespace {

/// One output, A = 2 I: an asymmetry of (iii), (iv), (v) is multiplied by exactly 4.
AnyProblem<double> doubling(double asymmetry) {
  const Matrix<double> A = 2 * Matrix<double>::Identity(2, 2), C{{1., .25}}, one{{1.}};
  auto problem =
      problem_of(system_of("doubling", A, Matrix<double>::Zero(2, 1), C, one, Matrix<double>::Identity(2, 2), 1),
                 Parametrisation::covariance);
  std::get<Problem<CovarianceModel<double>>>(problem).initial << 1, asymmetry, -asymmetry, 1;
  return problem;
}

}  // namespace

TEST(Asymmetry, TheFiveCodingsInOrder) {
  std::string names;
  for (const Metadata* metadata : codings())
    names += coding_of(*metadata) + (follows_A(metadata->asymmetry) ? "A " : " ");
  EXPECT_EQ(names, "(i) (ii) (iii)A (iv)A (v)A ");
}

TEST(Asymmetry, IsFollowedStepByStepUpToTheLimit) {
  for (const Metadata* metadata : codings()) {
    if (!follows_A(metadata->asymmetry)) continue;
    const auto curve = asymmetries(*metadata, doubling(1e-6), 50, 1);
    ASSERT_GE(curve.size(), 3u);
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_NEAR(norms(curve)[k] / (std::sqrt(2.) * 1e-6 * std::pow(4, k + 1)), 1, 1e-9) << metadata->id;
    EXPECT_GT(curve.back().norm(), 1) << "the first beyond the limit is the last";
    EXPECT_LE(curve[curve.size() - 2].norm(), 1);
  }
}
