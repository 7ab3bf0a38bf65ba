#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <string>


#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/generators.hpp>

#include "systems.hpp"

namespace kfstab::properties::testing {
namespace {

TEST(Laws, EachSaysWhatItIs) {
  std::map<std::string_view, int> ids;
  for (const Law& law : all_laws()) {
    ++ids[law.id];
    for (const std::string_view text : {law.id, law.statement, law.assumptions, law.source, law.tolerance, law.failure})
      EXPECT_FALSE(text.empty()) << law.id;
    EXPECT_NE(law.ratio, nullptr);
  }
  EXPECT_EQ(ids, (std::map<std::string_view, int>{{"gain-innovation", 1}, {"noise-floor", 1}, {"symmetry", 1}}));
}

class EveryFilter : public ::testing::TestWithParam<Metadata> {
 protected:
  /// Draws systems, and shows the smallest on which a law does not hold.
  void expect_lawful(const Options& options, std::uint64_t seed, int cases) {
    const Metadata& metadata = GetParam();
    std::map<std::string_view, LawResult> worst;
    int applied = 0, broke_down = 0;
    const auto fails = [&](const System& system) {
      const LawReport report = check_laws(metadata.id, system);
      applied += report.steps > 0;
      broke_down += report.status != Status::ok;
      for (const LawResult& result : report.results) {
        LawResult& sum = worst[result.law.id];
        sum.steps += result.steps;
        sum.worst = std::max(sum.worst, result.worst);
      }
      return !report.all_hold();
    };
    const auto failure = smallest_failure(systems(options), fails, seed, cases);
    if (failure) {
      for (const LawResult& result : check_laws(metadata.id, failure->system).results)
        EXPECT_TRUE(result.holds()) << result.law.id << ", ratio " << result.worst << " at step " << result.worst_step;
      FAIL() << "system " << failure->number << ", after " << failure->shrinks << " shrinks:\n" << write_system(failure->system);
    }
    for (const auto& [id, result] : worst) {
      RecordProperty(std::string(id), std::to_string(result.worst));
      const bool none = metadata.holds == Held::gain || (id == "symmetry" && metadata.holds != Held::covariance);
      EXPECT_EQ(result.steps > cases, !none) << id << " applied to " << result.steps << " steps of " << cases << " systems";
    }
    // A sixth of all systems each has a singular A, Q or P0, a quarter changes with time; a fifth is left to chance.
    const Needs& needs = metadata.needs;
    double share = needs.time_invariant ? 3. / 4 : 1;
    for (const bool need : {needs.invertible_A, needs.positive_definite_Q, needs.positive_definite_P0})
      if (need) share *= 5. / 6;
    EXPECT_GT(applied, .8 * share * cases);
    EXPECT_LT(broke_down, cases / 10);
  }
};

TEST_P(EveryFilter, ObeysEveryLaw) { expect_lawful({}, 1986, 1000); }

// Breaking no law is no matter of luck: the condition numbers in the tolerances are what they should be.
TEST_P(EveryFilter, ObeysEveryLawOnIllConditionedSystems) {
  Options options;
  options.n.most = options.m.most = options.p.most = 4;
  options.most_steps = 25;
  // What is formed of P^{-1} has to be solved with: it breaks down where others have half of their digits left.
  options.worst_condition = GetParam().holds == Held::information ? 1e6 : 1e14;
  expect_lawful(options, 1989, 200);
}

INSTANTIATE_TEST_SUITE_P(Registry, EveryFilter, ::testing::ValuesIn(filters().begin(), filters().end()), [](const auto& parameter) {
  std::string name(parameter.param.id);
  std::ranges::replace(name, '-', '_');
  return name;
});

// --- filters with a mistake ------------------------------------------------------------------------------------------------

using Model = CovarianceModel<double>;

struct Outcome {
  Matrix<double> K;
  Matrix<double> P_plus;
};

/// The textbook's update, one triangle copied to the other.
Outcome update(const Model& model, const Matrix<double>& P, const Matrix<double>& R) {
  Matrix<double> Re = R + model.C * P * model.C.transpose();
  Outcome result;
  result.K = model.A * P * model.C.transpose();
  Vector<int> pivots(Re.rows());
  lu_transposed(Re, pivots);
  solve_lu_right(Re, pivots, result.K);
  const Matrix<double> P_plus =
      (model.A - result.K * model.C) * P * model.A.transpose() + model.B * model.Q * model.B.transpose();
  result.P_plus = P_plus.selfadjointView<Eigen::Lower>();
  return result;
}

/// A filter in plain expressions whose step can be spoilt.
class Mistaken final : public AnyFilter<double> {
 public:
  using Update = std::function<Outcome(const Model&, const Matrix<double>& P)>;

  explicit Mistaken(Update step) : step_(std::move(step)) { metadata_.id = "mistaken"; }

  const Metadata& metadata() const override { return metadata_; }
  void start(const AnyProblem<double>& problem) override {
    problem_ = &std::get<Problem<Model>>(problem);
    now_.P_plus = problem_->initial;
  }
  Step<double> step(std::int64_t k, const Vector<double>*, const Vector<double>*) override {
    now_ = step_(problem_->model(k), now_.P_plus);
    return {{}, &now_.P_plus, &now_.K, nullptr};
  }

 private:
  Update step_;
  Metadata metadata_;
  const Problem<Model>* problem_ = nullptr;
  Outcome now_;
};

/// The smallest system on which the filter breaks a law, and the laws that it breaks there.
struct Caught {
  System system;
  std::vector<std::string> laws;
};

std::optional<Caught> caught(const Mistaken::Update& step) {
  const auto report = [&](const System& system) {
    Mistaken filter(step);
    return check_laws(filter, std::get<AnyProblem<double>>(problem(system, Parametrisation::covariance)), system.steps);
  };
  const auto failure = smallest_failure(systems(), [&](const System& system) { return !report(system).all_hold(); }, 7, 300);
  if (!failure) return std::nullopt;
  Caught result{failure->system, {}};
  for (const LawResult& law : report(failure->system).results)
    if (!law.holds()) result.laws.emplace_back(law.law.id);
  return result;
}

TEST(Mistakes, NoneIsSeenWhereThereIsNone) {
  EXPECT_FALSE(caught([](const Model& model, const Matrix<double>& P) { return update(model, P, model.R); }));
}

TEST(Mistakes, RSquaredShrinksToAScalarAndOneStep) {
  const auto found = caught([](const Model& model, const Matrix<double>& P) { return update(model, P, model.R * model.R); });
  ASSERT_TRUE(found);
  EXPECT_EQ(found->laws, std::vector<std::string>{"gain-innovation"});
  EXPECT_EQ(found->system.dimensions(), (Dimensions{1, 0, 1})) << write_system(found->system);
  EXPECT_EQ(found->system.steps, 1);
  EXPECT_TRUE(found->system.time_invariant());
  EXPECT_EQ(found->system.A.at(0)(0, 0), 1);
  EXPECT_EQ(found->system.C.at(0)(0, 0), 1);
  EXPECT_EQ(found->system.P0.value.at(0)(0, 0), 1);
}

TEST(Mistakes, AGainThatIsLate) {
  const auto found = caught([](const Model& model, const Matrix<double>& P) {
    Outcome outcome = update(model, P, model.R);
    outcome.K = update(model, outcome.P_plus, model.R).K;
    return outcome;
  });
  ASSERT_TRUE(found);
  EXPECT_EQ(found->laws, std::vector<std::string>{"gain-innovation"});
  EXPECT_EQ(found->system.dimensions().n, 1);
}

TEST(Mistakes, AGainWithoutA) {
  const auto found = caught([](const Model& model, const Matrix<double>& P) {
    Outcome outcome = update(model, P, model.R);
    Model still = model;
    still.A.setIdentity();
    outcome.K = update(still, P, model.R).K;
    return outcome;
  });
  ASSERT_TRUE(found);
  EXPECT_EQ(found->laws, std::vector<std::string>{"gain-innovation"});
}

TEST(Mistakes, ATriangleThatIsNotCopied) {
  const auto found = caught([](const Model& model, const Matrix<double>& P) {
    Outcome outcome = update(model, P, model.R);
    if (P.rows() > 1) outcome.P_plus(0, P.rows() - 1) += 1e-10;
    return outcome;
  });
  ASSERT_TRUE(found);
  EXPECT_EQ(found->laws.back(), "symmetry");
  EXPECT_EQ(found->system.dimensions().n, 2);
}

TEST(Mistakes, NoiseThatIsSubtracted) {
  const auto found = caught([](const Model& model, const Matrix<double>& P) {
    Outcome outcome = update(model, P, model.R);
    outcome.P_plus -= 2 * (model.B * model.Q * model.B.transpose());
    return outcome;
  });
  ASSERT_TRUE(found);
  EXPECT_EQ(found->laws, std::vector<std::string>{"noise-floor"});
  EXPECT_EQ(found->system.dimensions(), (Dimensions{1, 1, 0}));
}

TEST(Mistakes, NoiseByItsRoot) {
  const auto found = caught([](const Model& model, const Matrix<double>& P) {
    Model half = model;
    half.Q *= 0.5;
    return update(half, P, model.R);
  });
  ASSERT_TRUE(found);
  EXPECT_EQ(found->laws, std::vector<std::string>{"noise-floor"});
}

TEST(Mistakes, AnUpdateThatSubtractsTooMuch) {
  const auto found = caught([](const Model& model, const Matrix<double>& P) {
    Outcome outcome = update(model, P, model.R);
    outcome.P_plus -= outcome.K * (model.R + model.C * P * model.C.transpose()) * outcome.K.transpose();
    outcome.P_plus = Matrix<double>(outcome.P_plus.selfadjointView<Eigen::Lower>());
    return outcome;
  });
  ASSERT_TRUE(found);
  EXPECT_EQ(found->laws, std::vector<std::string>{"noise-floor"});
}

TEST(Mistakes, NotANumber) {
  const auto found = caught([](const Model& model, const Matrix<double>& P) {
    Outcome outcome = update(model, P, model.R);
    if (outcome.K.size() > 0) outcome.K(0, 0) = std::numeric_limits<double>::quiet_NaN();
    return outcome;
  });
  ASSERT_TRUE(found);
  EXPECT_EQ(found->laws, std::vector<std::string>{"gain-innovation"});
}

/// Bearing the wrong name: one coding that claims to be another.
TEST(Mistakes, ACodingThatIsNotTheOneNamed) {
  class Renamed final : public AnyFilter<double> {
   public:
    Renamed() : filter_(make_filter<double>("ckf-mixed")), metadata_(filter_->metadata()) { metadata_.asymmetry = Asymmetry::textbook; }
    const Metadata& metadata() const override { return metadata_; }
    void start(const AnyProblem<double>& problem) override { filter_->start(problem); }
    Step<double> step(std::int64_t k, const Vector<double>* y, const Vector<double>* u) override { return filter_->step(k, y, u); }

   private:
    std::unique_ptr<AnyFilter<double>> filter_;
    Metadata metadata_;
  };
  System system = read_system(std::string(KFSTAB_SOURCE_DIR) + "/experiments/systems/asymmetry-divergence.toml");
  const auto converted = std::get<AnyProblem<double>>(problem(system, Parametrisation::covariance));
  Renamed renamed;
  EXPECT_FALSE(check_laws(renamed, converted, 60).all_hold());
  const LawReport right = check_laws(*make_filter<double>("ckf-mixed"), converted, 60);
  EXPECT_TRUE(right.all_hold());
  // D grows by 2.2 a step: in the end its square counts and the law applies no more.
  for (const LawResult& result : right.results)
    if (result.law.id == "symmetry") {
      EXPECT_GT(result.steps, 15);
      EXPECT_LT(result.steps, 45);
    }
}

TEST(Laws, AFilterThatDoesNotApplyIsNotRun) {
  System system = read_toml(with(valid_toml(), "P0", "P0 = { diagonal = [0, 1] }"));
  const LawReport report = check_laws("srif", system);
  EXPECT_EQ(report.steps, 0);
  EXPECT_TRUE(report.all_hold());
  EXPECT_EQ(report.results.size(), all_laws().size());
  EXPECT_THROW(check_laws("nonesuch", system), std::invalid_argument);
}

}  // namespace
}  // namespace kfstab::properties::testing
