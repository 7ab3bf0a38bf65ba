#include <kfstab/properties/system.hpp>

#include <cmath>
#include <limits>

#include <kfstab/filters/registry.hpp>

#include "systems.hpp"

namespace kfstab::properties::testing {
namespace {

Matrix<double> square(std::initializer_list<double> entries) {
  const auto n = static_cast<Index>(std::lround(std::sqrt(static_cast<double>(entries.size()))));
  Matrix<double> X(n, n);
  auto entry = entries.begin();
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < n; ++j) X(i, j) = *entry++;
  return X;
}

template <class Model>
Problem<Model> get(const System& system) {
  auto converted = problem(system, Model::parametrisation);
  if (const auto* refused = std::get_if<Refusal>(&converted)) {
    ADD_FAILURE() << refused->reason;
    return {};
  }
  return std::get<Problem<Model>>(std::get<AnyProblem<double>>(converted));
}

std::string refused(const System& system, Parametrisation form) {
  auto converted = problem(system, form);
  const auto* refusal = std::get_if<Refusal>(&converted);
  return refusal ? refusal->reason : "";
}

/// n = m = p = 2, all identity.
System plain() {
  System system;
  system.name = "plain";
  for (Sequence* sequence : {&system.A, &system.B, &system.C, &system.Q.value, &system.R.value, &system.P0.value})
    *sequence = Sequence(Matrix<double>(Matrix<double>::Identity(2, 2)));
  system.D = Sequence(Matrix<double>(2, 0));
  system.x0 = Vector<double>::Zero(2);
  system.steps = 4;
  return system;
}

TEST(System, WhatIsWrittenPassesBitByBit) {
  System system = plain();
  system.Q.value = square({0.3, 0.1, 0.1, 0.2});
  system.P0 = {Covariance::Written::root, square({-0.1, 0, 0.7, 0.3})};
  const auto covariance = get<CovarianceModel<double>>(system);
  expect_same_bits(covariance.models[0].Q, system.Q.value.at(0), "Q");
  const auto root = get<RootModel<double>>(system);
  expect_same_bits(root.initial, system.P0.value.at(0), "S0");
  EXPECT_EQ(covariance.models.size(), 1U);
}

TEST(System, ConversionsRoundOnce) {
  System system = plain();
  system.Q.value = square({2, 1, 1, 2});
  const auto root = get<RootModel<double>>(system);
  EXPECT_EQ(root.models[0].Q_root(0, 0), std::sqrt(2.0));
  EXPECT_EQ(root.models[0].Q_root(1, 0), std::sqrt(0.5));
  EXPECT_EQ(root.models[0].Q_root(1, 1), std::sqrt(1.5));
  EXPECT_EQ(root.models[0].Q_root(0, 1), 0);
  EXPECT_EQ(root.models[0].R_root, Matrix<double>(Matrix<double>::Identity(2, 2)));

  // (1 + 2^-27)^2 - 1 = 2^-26 + 2^-54: rounding the square first would lose the second term.
  const double e = std::ldexp(1, -27);
  system.P0 = {Covariance::Written::root, square({1 + e, 0, -1, e})};
  const auto covariance = get<CovarianceModel<double>>(system);
  EXPECT_EQ(covariance.initial(0, 0), 1 + 2 * e);
  EXPECT_EQ(covariance.initial(0, 1), covariance.initial(1, 0));
  EXPECT_EQ(covariance.initial(1, 1), 1);  // 1 + 2^-54

  // A^{-1} = [1 -1; 0 3] / 3 from A = [1 1/3...]; entries of an exact inverse, each the nearest double.
  system.A = square({3, 1, 0, 1});
  system.B = Sequence(Matrix<double>(Matrix<double>::Constant(2, 2, 0.1)));
  const auto information = get<InformationModel<double>>(system);
  EXPECT_EQ(information.models[0].A_inverse, square({1.0 / 3, -1.0 / 3, 0, 1}));
  EXPECT_EQ(information.models[0].A_inverse_B(0, 0), 0);  // (0.1 - 0.1) / 3
  EXPECT_EQ(information.models[0].A_inverse_B(1, 0), 0.1);
}

TEST(System, InformationRootsAreUpperRootsOfTheInverse) {
  System system = plain();
  system.Q.value = square({2, 1, 1, 2});                                     // inverse [2 -1; -1 2] / 3
  system.R = {Covariance::Written::root, square({2, 0, 1, 0.5})};            // R = [4 2; 2 1.25]
  system.P0.value = square({4, 0, 0, 0.25});
  const auto information = get<InformationModel<double>>(system);
  const Matrix<double>& U = information.models[0].Q_inverse_root;
  EXPECT_EQ(U(0, 0), std::sqrt(2.0 / 3));
  EXPECT_EQ(U(1, 0), 0);
  EXPECT_NEAR(U(0, 1), -1 / std::sqrt(6.0), 1e-16);
  EXPECT_EQ(U(1, 1), std::sqrt(0.5));
  const Matrix<double>& V = information.models[0].R_inverse_root;
  const Matrix<double> R = V.transpose() * V * square({4, 2, 2, 1.25});
  EXPECT_TRUE(R.isApprox(Matrix<double>(Matrix<double>::Identity(2, 2)), 1e-14)) << R;
  EXPECT_EQ(information.initial, square({0.5, 0, 0, 2}));
}

TEST(System, SemidefiniteCovariances) {
  System system = plain();
  system.P0.value = square({0, 0, 0, 4});
  EXPECT_EQ(get<RootModel<double>>(system).initial, square({0, 0, 0, 2}));
  system.P0.value = square({4, 2, 2, 1});  // exactly singular
  EXPECT_EQ(get<RootModel<double>>(system).initial, square({2, 0, 1, 0}));
  system.P0.value = Matrix<double>(Matrix<double>::Zero(2, 2));
  EXPECT_EQ(get<RootModel<double>>(system).initial, square({0, 0, 0, 0}));

  // Rank one but for the rounding of its entries, on either side of singular: dt^4/4, dt^3/2; dt^3/2, dt^2.
  int indefinite = 0;
  for (int i = 1; i <= 200; ++i) {
    const double dt = 0.01 * i;
    const Matrix<double> Q = square({dt * dt * dt * dt / 4, dt * dt * dt / 2, dt * dt * dt / 2, dt * dt});
    EXPECT_EQ(admissible_covariance(Q), std::nullopt) << Q;
    system.P0.value = Q;
    const Matrix<double> S = get<RootModel<double>>(system).initial;
    EXPECT_EQ(S(0, 1), 0);
    for (Index r = 0; r < 2; ++r)
      for (Index c = 0; c < 2; ++c)
        EXPECT_NEAR((S * S.transpose())(r, c), Q(r, c), 8 * std::numeric_limits<double>::epsilon() * std::sqrt(Q(r, r) * Q(c, c)));
    // Exact in long double's 64 bits only up to its own rounding, which is far below the one of Q.
    indefinite += static_cast<long double>(Q(0, 0)) * Q(1, 1) < static_cast<long double>(Q(0, 1)) * Q(1, 0);
  }
  EXPECT_GT(indefinite, 20);
}

TEST(System, AdmissibleCovariance) {
  EXPECT_EQ(admissible_covariance(Matrix<double>(0, 0)), std::nullopt);
  EXPECT_EQ(admissible_covariance(square({0})), std::nullopt);
  EXPECT_EQ(admissible_covariance(square({1e-300, 0, 0, 1e300})), std::nullopt);
  EXPECT_NE(admissible_covariance(square({-1e-300, 0, 0, 1e300})), std::nullopt);
  EXPECT_NE(admissible_covariance(square({1, 2, 2.5, 9})), std::nullopt);
  // Indefinite by 1e-10 of the small variance, which is nothing beside the large one: refused all the same.
  EXPECT_NE(admissible_covariance(square({1e10, 0, 0, 0, 1, 1 + 1e-10, 0, 1 + 1e-10, 1})), std::nullopt);
  EXPECT_EQ(admissible_covariance(square({1e10, 0, 0, 0, 1, 1 + 2e-16, 0, 1 + 2e-16, 1})), std::nullopt);
  EXPECT_NE(admissible_covariance(square({std::nan("")})), std::nullopt);
  EXPECT_NE(admissible_covariance(square({std::numeric_limits<double>::infinity()})), std::nullopt);
}

TEST(System, RefusesWhatInformationCannotTake) {
  System system = plain();
  system.A = {Sequence::Kind::list, {square({1, 0, 0, 1}), square({1, 0, 0, 1}), square({1, 0, 0, 1}), square({1, 2, 2, 4})}};
  EXPECT_EQ(refused(system, Parametrisation::information), "the information form needs an invertible A: A (step 3) is singular");
  EXPECT_EQ(refused(system, Parametrisation::root), "");
  system = plain();
  system.P0.value = square({1, 1, 1, 1});
  EXPECT_EQ(refused(system, Parametrisation::information), "the information form needs a positive definite P0: P0 is singular");
  system = plain();
  system.A = square({1e-320, 0, 0, 1});
  EXPECT_EQ(refused(system, Parametrisation::information), "the inverse of A is beyond the range of double");
  system = plain();
  system.Q = {Covariance::Written::root, square({1e200, 0, 0, 1})};
  EXPECT_EQ(refused(system, Parametrisation::covariance), "Q is beyond the range of double");
  system = plain();
  system.R.value = square({1, 2, 2, 1});
  EXPECT_EQ(refused(system, Parametrisation::root), "R is not positive semidefinite");
}

TEST(System, RefusesWhatAFilterNeeds) {
  Metadata filter;
  filter.id = "srif";
  EXPECT_FALSE(refusal(filter, plain()));
  filter.needs = {true, true, true, true, true};
  EXPECT_FALSE(refusal(filter, plain()));

  System system = plain();
  system.A = {Sequence::Kind::periodic, {square({1, 0, 0, 1}), square({0, 1, 0, 1})}};
  EXPECT_EQ(refusal(filter, system)->reason, "srif needs a time-invariant system: its matrices change from step to step");
  filter.needs.time_invariant = false;
  EXPECT_EQ(refusal(filter, system)->reason, "srif needs an invertible A: A (step 1) is singular");
  system = plain();
  system.A = square({1e-30, 1e-30, 0, 1e30});  // invertible, and that is all that is asked
  EXPECT_FALSE(refusal(filter, system));
  system.Q.value = square({1, 1, 1, 1});
  EXPECT_EQ(refusal(filter, system)->reason, "srif needs a positive definite Q: Q is singular");
  system = plain();
  system.R = {Covariance::Written::root, square({1, 0, 5, 0})};
  EXPECT_EQ(refusal(filter, system)->reason, "srif needs a positive definite R: R is singular");
  system = plain();
  system.P0.value = square({0, 0, 0, 1});
  EXPECT_EQ(refusal(filter, system)->reason, "srif needs a positive definite P0: P0 is singular");
  for (const Metadata& known : filters()) {
    const auto why = refusal(known, system);
    EXPECT_EQ(why.has_value(), known.needs.positive_definite_P0) << known.id;
    EXPECT_EQ(std::holds_alternative<Refusal>(problem(system, known.takes)), known.needs.positive_definite_P0) << known.id;
  }
}

TEST(System, CommonPeriod) {
  const auto scaled = [](int count) {
    std::vector<Matrix<double>> matrices;
    for (int i = 0; i < count; ++i) matrices.push_back((i + 1.0) * Matrix<double>::Identity(2, 2));
    return Sequence(Sequence::Kind::periodic, matrices);
  };
  System system = plain();
  system.steps = 100;
  system.A = scaled(4);
  system.C = scaled(6);
  system.R.value = scaled(2);
  const auto periodic = get<CovarianceModel<double>>(system);
  EXPECT_EQ(periodic.models.size(), 12U);
  for (int k = 0; k < 30; ++k) {
    EXPECT_EQ(periodic.model(k).A(0, 0), k % 4 + 1);
    EXPECT_EQ(periodic.model(k).C(0, 0), k % 6 + 1);
    EXPECT_EQ(periodic.model(k).R(0, 0), k % 2 + 1);
  }
  EXPECT_EQ(get<InformationModel<double>>(system).model(15).A_inverse(0, 0), 0.25);
  system.steps = 7;
  EXPECT_EQ(get<RootModel<double>>(system).models.size(), 7U);
  system.steps = 5;
  system.B = scaled(5);
  system.B.kind = Sequence::Kind::list;
  EXPECT_EQ(get<RootModel<double>>(system).models.size(), 5U);
  EXPECT_EQ(get<RootModel<double>>(plain()).models.size(), 1U);
}

TEST(System, SizesOfZero) {
  System system = plain();
  system.B = Sequence(Matrix<double>(2, 0));
  system.Q.value = Sequence(Matrix<double>(0, 0));
  system.C = Sequence(Matrix<double>(0, 2));
  system.R.value = Sequence(Matrix<double>(0, 0));
  EXPECT_EQ(get<CovarianceModel<double>>(system).dimensions(), (Dimensions{2, 0, 0}));
  EXPECT_EQ(get<RootModel<double>>(system).dimensions(), (Dimensions{2, 0, 0}));
  EXPECT_EQ(get<InformationModel<double>>(system).dimensions(), (Dimensions{2, 0, 0}));
  EXPECT_EQ(get<InformationModel<double>>(System()).dimensions(), (Dimensions{0, 0, 0}));
}

}  // namespace
}  // namespace kfstab::properties::testing
