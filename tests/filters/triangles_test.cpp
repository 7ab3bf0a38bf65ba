// What a filter promises not to read may hold anything: NaN there changes no bit of any result.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include <kfstab/filters/registry.hpp>

#include "filters/random_problem.hpp"

namespace kfstab::test::triangles {
namespace {

enum class Side { above, below };

void plant(Matrix<double>& X, Side side) {
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      if (side == Side::above ? i < j : i > j) X(i, j) = std::nan("");
}

void plant(Problem<CovarianceModel<double>>& problem) { plant(problem.initial, Side::below); }

void plant(Problem<RootModel<double>>& problem) {
  plant(problem.initial, Side::above);
  for (auto& model : problem.models) {
    plant(model.Q_root, Side::above);
    plant(model.R_root, Side::above);
  }
}

void plant(Problem<InformationModel<double>>& problem) {
  plant(problem.initial, Side::below);
  for (auto& model : problem.models) {
    plant(model.Q_inverse_root, Side::below);
    plant(model.R_inverse_root, Side::below);
  }
}

template <class X>
void expect_same_bits(const X& a, const X& b, const char* what) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(std::memcmp(a.data(), b.data(), sizeof(double) * static_cast<std::size_t>(a.size())), 0)
      << what << "\n"
      << a << "\nand with NaN planted\n"
      << b;
}

}  // namespace

TEST(Triangles, NaNInThePromisedOnesChangesNoBit) {
  for (const Metadata& metadata : filters()) {
    if (metadata.asymmetry != Asymmetry::none) continue;  // these take all of P0
    for (const Case& c :
         {Case{.d = {4, 3, 2}, .period = 3, .inputs = 1}, Case{.d = {2, 3, 4}, .period = 2, .inputs = 1}}) {
      if (!applies(metadata, c)) continue;
      SCOPED_TRACE(std::string(metadata.id) + ": " + c.text());
      const AnyProblem<double> clean = random_problem(metadata.takes, c, 21);
      AnyProblem<double> planted = clean;
      std::visit([](auto& problem) { plant(problem); }, planted);
      const auto one = make_filter<double>(metadata.id), other = make_filter<double>(metadata.id);
      one->start(clean);
      other->start(planted);
      Dice dice(22);
      for (int k = 0; k < 4; ++k) {
        const Vector<double> y = dice.vector(c.d.p, 32), input = dice.vector(1, 32);
        const auto a = one->step(k, &y, &input), b = other->step(k, &y, &input);
        ASSERT_EQ(a.report.status, Status::ok);
        ASSERT_EQ(b.report.status, Status::ok) << name(b.report.status);
        EXPECT_EQ(a.report.rcond, b.report.rcond);
        expect_same_bits(*a.held, *b.held, "held");
        expect_same_bits(*a.gain, *b.gain, "gain");
        expect_same_bits(*a.state, *b.state, "state");
      }
    }
  }
}

// What is held is a whole matrix all the same: symmetric, or zero outside its triangle.
TEST(Triangles, OfWhatIsHeldAreWhole) {
  for (const Metadata& metadata : filters()) {
    if (metadata.asymmetry != Asymmetry::none || metadata.holds == Held::gain) continue;
    const auto problem = random_problem(metadata.takes, {.d = {4, 2, 2}}, 23);
    const auto filter = make_filter<double>(metadata.id);
    filter->start(problem);
    for (int k = 0; k < 3; ++k) {
      const Matrix<double>& X = *filter->step(k, nullptr, nullptr).held;
      for (Index j = 0; j < 4; ++j)
        for (Index i = 0; i < j; ++i) switch (metadata.holds) {
            case Held::covariance:
            case Held::information: EXPECT_EQ(X(i, j), X(j, i)) << metadata.id; break;
            case Held::covariance_factor: EXPECT_EQ(X(i, j), 0) << metadata.id; break;
            case Held::ud_factors:
            case Held::information_factor: EXPECT_EQ(X(j, i), 0) << metadata.id; break;
            case Held::covariance_root:
            case Held::gain: break;
          }
    }
  }
}

}  // namespace kfstab::test::triangles
