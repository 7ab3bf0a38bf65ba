#include <kfstab/properties/comparison.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <memory>
#include <string>
#include <utility>

#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/check.hpp>

#include "systems.hpp"

namespace kfstab::properties::testing {
namespace {

// --- a filter by other people -----------------------------------------------------------------------------------------------

/// What a step is given.
struct Given {
  Matrix<double> A, B, C, Q, R, D;
  std::optional<Vector<double>> y, u;
};

/// What a filter holds.
struct State {
  Vector<double> x;
  Matrix<double> P, K;
  int runs = 0;   ///< how often it was started
  int steps = 0;  ///< of this run
};

/// Mistakes: each may be empty.
struct Spoilt {
  std::function<void(State&, const Vector<double>& x, const Matrix<double>& P)> start = {};
  std::function<void(Given&, State&)> before = {};
  std::function<void(const Given&, State&)> after = {};
  bool silent = false;  ///< skips the update where Re is singular
};

enum class Form { textbook, joseph };

/// The filter as its users write it, in plain expressions, of which the laws know nothing.
template <class Scalar>
class PlainForeign final : public StepwiseFilter {
 public:
  using M = Matrix<Scalar>;

  PlainForeign(Form form, bool predicts_first, Spoilt spoilt = {}) : form_(form), spoilt_(std::move(spoilt)) {
    traits_.name = "foreign";
    traits_.roundoff = unit_roundoff<Scalar>();
    if (!predicts_first) return;
    traits_.starts_predicted = false;
    traits_.instant = Instant::filtered;
    traits_.gain = GainKind::filter;
  }

  const Traits& traits() const override { return traits_; }

  std::optional<Ending> start(const Dimensions&, const Vector<double>& x, const Matrix<double>& P) override {
    if (spoilt_.start) {
      spoilt_.start(now_, x, P);
    } else {
      now_.x = x;
      now_.P = P;
    }
    ++now_.runs;
    now_.steps = 0;
    return std::nullopt;
  }

  std::variant<Answer, Ending> step(const StepInput& input) override {
    Given given{input.A, input.B, input.C, input.Q, input.R, Matrix<double>(input.A.rows(), 0), {}, {}};
    if (input.y) given.y = *input.y;
    if (input.u) {
      given.D = *input.D;
      given.u = *input.u;
    }
    if (spoilt_.before) spoilt_.before(given, now_);
    M P = now_.P.cast<Scalar>(), K(P.rows(), given.C.rows());
    M x = now_.x.template cast<Scalar>();
    K.setZero();
    if (!traits_.starts_predicted) predict(given, x, P);
    if (given.y && !update(given, x, P, K)) return Ending{Ending::Kind::refused, -1, "Re is singular"};
    if (traits_.starts_predicted) {
      predict(given, x, P);
      K = given.A.cast<Scalar>() * K;
    }
    now_.x = x.template cast<double>();
    now_.P = P.template cast<double>();
    now_.K = K.template cast<double>();
    if (spoilt_.after) spoilt_.after(given, now_);
    ++now_.steps;
    Answer answer;
    answer.held = now_.P;
    answer.gain = now_.K;
    answer.state = now_.x;
    return answer;
  }

 private:
  void predict(const Given& given, M& x, M& P) {
    const M A = given.A.cast<Scalar>(), B = given.B.cast<Scalar>();
    x = (A * x).eval();
    if (given.u) x += given.D.cast<Scalar>() * given.u->cast<Scalar>();
    P = (A * P * A.transpose() + B * given.Q.cast<Scalar>() * B.transpose()).eval();
  }

  bool update(const Given& given, M& x, M& P, M& K) {
    const M C = given.C.cast<Scalar>(), R = given.R.cast<Scalar>(), y = given.y->template cast<Scalar>();
    M Re = R + C * P * C.transpose();
    // Gauss without pivots, on [Re (C P)]: Re is definite.
    M right = C * P.transpose();
    const Index p = Re.rows();
    for (Index k = 0; k < p; ++k) {
      if (Re(k, k) == Scalar(0)) return spoilt_.silent;
      for (Index i = 0; i < p; ++i) {
        if (i == k) continue;
        const Scalar factor = Re(i, k) / Re(k, k);
        Re.row(i) -= factor * Re.row(k).eval();
        right.row(i) -= factor * right.row(k).eval();
      }
    }
    for (Index k = 0; k < p; ++k) right.row(k) /= Re(k, k);
    K = right.transpose();
    x += K * (y - C * x);
    const M I_KC = M::Identity(P.rows(), P.rows()) - K * C;
    P = form_ == Form::textbook ? M(I_KC * P) : M(I_KC * P * I_KC.transpose() + K * R * K.transpose());
    return true;
  }

  Form form_;
  Spoilt spoilt_;
  Traits traits_;
  State now_;
};

std::unique_ptr<Subject> foreign(Spoilt spoilt) {
  return subject(std::make_unique<PlainForeign<double>>(Form::joseph, false, std::move(spoilt)));
}

// --- what laws say of it ------------------------------------------------------------------------------------------------------

constexpr auto comparing = std::to_array<std::string_view>(
    {"accurate-measurement", "augmentation",          "concavity",           "data-independence",   "data-scaling",
     "decoupling",           "duplicate-measurement", "homogeneity",         "input-response",      "isolation",
     "measurement-basis",    "measurement-units",     "missing-measurement", "monotonicity",        "noise-basis",
     "noisy-measurement",    "not-a-number",          "permutation",         "precision",           "purity",
     "root-freedom",         "sequential-updates",    "similarity",          "singular-innovation", "split-prediction",
     "state-units",          "superposition",         "translation"});

std::vector<Law> laws(const std::function<bool(std::string_view id)>& wanted) {
  std::vector<Law> chosen;
  for (const Law& law : all_laws())
    if (wanted(law.id)) chosen.push_back(law);
  return chosen;
}

/// The law on 100 systems.
LawOutcome outcome(Subject& subject, std::string_view id) {
  CheckOptions options;
  options.cases = 100;
  options.shrinking = 0;
  options.laws = laws([id](std::string_view other) { return other == id; });
  return check(subject, options).laws.at(0);
}

void expect_broken(Subject& subject, std::string_view id) {
  const LawOutcome seen = outcome(subject, id);
  ASSERT_TRUE(seen.failure.has_value()) << id << ": ratio " << seen.max_ratio << " in " << seen.cases << " cases";
  EXPECT_GT(seen.max_ratio, 1000) << id;
  EXPECT_FALSE(seen.failure->finding.what.empty()) << id;
}

void expect_broken(Spoilt spoilt, std::string_view id) { expect_broken(*foreign(std::move(spoilt)), id); }

struct Correct {
  const char* name;
  std::function<std::unique_ptr<StepwiseFilter>()> make;
};

class CorrectForeign : public ::testing::TestWithParam<Correct> {};

// Nobody knows its code: it may sum in any order, and lets P lose its symmetry.
TEST_P(CorrectForeign, ComparesWell) {
  const auto filter = subject(GetParam().make());
  CheckOptions options;
  options.cases = 200;
  options.shrinking = 100;
  options.laws = laws([](std::string_view id) { return std::ranges::find(comparing, id) != comparing.end(); });
  EXPECT_GE(options.laws.size(), comparing.size());
  for (const LawOutcome& seen : check(*filter, options).laws) {
    EXPECT_TRUE(seen.holds()) << seen.law.id << ": ratio " << seen.max_ratio << ", " << seen.failure->finding.what
                              << '\n'
                              << write_system(seen.failure->system);
    if (seen.law.id == "root-freedom") continue;
    EXPECT_GT(seen.cases, 2) << seen.law.id;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Filters, CorrectForeign,
    ::testing::Values(
        Correct{"textbook", [] { return std::make_unique<PlainForeign<double>>(Form::textbook, false); }},
        Correct{"textbook_predicts_first", [] { return std::make_unique<PlainForeign<double>>(Form::textbook, true); }},
        Correct{"joseph_predicts_first", [] { return std::make_unique<PlainForeign<double>>(Form::joseph, true); }},
        Correct{"joseph_single", [] { return std::make_unique<PlainForeign<float>>(Form::joseph, false); }},
        Correct{"textbook_single", [] { return std::make_unique<PlainForeign<float>>(Form::textbook, true); }}),
    [](const auto& parameter) { return std::string(parameter.param.name); });

// --- each law has something that it sees ----------------------------------------------------------------------------------------

Matrix<double> absolute(const Matrix<double>& X) { return X.cwiseAbs(); }

TEST(Comparisons, AJitter) {
  // Of rounding's size on ordinary systems.
  expect_broken({.after = [](const Given&, State& now) { now.P.diagonal().array() += 1e-15; }}, "homogeneity");
}

TEST(Comparisons, AGate) {
  const Spoilt gate{.before = [](Given& given, State& now) {
    if (given.y && (*given.y - given.C * now.x).norm() > 100) given.y.reset();
  }};
  expect_broken(gate, "data-scaling");
  expect_broken(gate, "data-independence");
}

TEST(Comparisons, AnInnovationThatIsClipped) {
  const Spoilt clip{.before = [](Given& given, State& now) {
    if (given.y) *given.y = given.C * now.x + (*given.y - given.C * now.x).cwiseMin(1).cwiseMax(-1);
  }};
  expect_broken(clip, "superposition");
  expect_broken(clip, "data-scaling");
}

TEST(Comparisons, ALimitOnTheDiagonalOfP) {
  expect_broken({.after = [](const Given&, State& now) { now.P.diagonal() = now.P.diagonal().cwiseMin(1e4); }},
                "state-units");
}

TEST(Comparisons, ALimitOnR) {
  const Spoilt limit{.before = [](Given& given, State&) { given.R.diagonal() = given.R.diagonal().cwiseMax(1e-4); }};
  expect_broken(limit, "accurate-measurement");
  expect_broken({.before = [](Given& given, State&) { given.R.diagonal() = given.R.diagonal().cwiseMax(1e-2); }},
                "measurement-units");
  expect_broken({.before = [](Given& given, State&) { given.R = given.R.cwiseMin(1e6).cwiseMax(-1e6); }},
                "noisy-measurement");
}

TEST(Comparisons, OnlyTheDiagonal) {
  const auto diagonal = [](Matrix<double>& X) { X = Matrix<double>(X.diagonal().asDiagonal()); };
  expect_broken({.before = [=](Given& given, State&) { diagonal(given.R); }}, "measurement-basis");
  expect_broken({.before = [=](Given& given, State&) { diagonal(given.Q); }}, "noise-basis");
  expect_broken({.after = [=](const Given&, State& now) { diagonal(now.P); }}, "similarity");
}

TEST(Comparisons, AStateWithAPlaceOfItsOwn) {
  expect_broken({.after =
                     [](const Given&, State& now) {
                       if (now.x.size() > 1) now.x(0) += now.x(1) / 1024;
                     }},
                "permutation");
}

TEST(Comparisons, RootsWithoutSigns) {
  /// srcf, given |S0|.
  class Unsigned final : public AnyFilter<double> {
   public:
    const Metadata& metadata() const override { return filter_->metadata(); }
    void start(const AnyProblem<double>& problem) override {
      problem_ = problem;
      auto& roots = std::get<Problem<RootModel<double>>>(problem_);
      roots.initial.diagonal() = absolute(roots.initial.diagonal());
      filter_->start(problem_);
    }
    Step<double> step(std::int64_t k, const Vector<double>* y, const Vector<double>* u) override {
      return filter_->step(k, y, u);
    }

   private:
    std::unique_ptr<AnyFilter<double>> filter_ = make_filter<double>("srcf");
    AnyProblem<double> problem_;
  };
  expect_broken(*built_in(std::make_unique<Unsigned>()), "root-freedom");
}

TEST(Comparisons, BlocksThatLeak) {
  expect_broken({.after =
                     [](const Given&, State& now) {
                       const double mean = now.P.trace() / 1e6;
                       now.P.diagonal().array() += mean;
                     }},
                "decoupling");
}

TEST(Comparisons, AStateThatIsChangedByWhatFollowsIt) {
  expect_broken({.before = [](Given& given, State&) { given.A.transposeInPlace(); }}, "augmentation");
}

TEST(Comparisons, RowsOfTheWrongMeasurement) {
  // Where rows are missing, R is taken from the front of what it was when all were there.
  Matrix<double> whole;
  const auto front = [whole](Given& given, State& now) mutable {
    if (now.steps == 0 || given.R.rows() > whole.rows()) whole = given.R;
    given.R = whole.topLeftCorner(given.R.rows(), given.R.cols());
  };
  expect_broken({.before = front}, "sequential-updates");
}

TEST(Comparisons, AnInverseThatCutsOff) {
  // Whatever lies beyond as many measurements as there are states is not looked at.
  expect_broken({.before =
                     [](Given& given, State&) {
                       const Index kept = std::min(given.C.rows(), given.C.cols());
                       if (kept == given.C.rows() || !given.y) return;
                       given.R.bottomRightCorner(given.R.rows() - kept, given.R.rows() - kept).diagonal().array() *= 2;
                     }},
                "duplicate-measurement");
}

TEST(Comparisons, NothingIsDoneWithoutAMeasurement) {
  const Spoilt idle{.before = [](Given& given, State&) {
    if (given.y) return;
    given.A.setIdentity();
    given.B.setZero();
  }};
  expect_broken(idle, "split-prediction");
  expect_broken(idle, "missing-measurement");
}

TEST(Comparisons, RSquared) {
  const Spoilt squared{.before = [](Given& given, State&) { given.R = (given.R * given.R).eval(); }};
  expect_broken(squared, "monotonicity");
  expect_broken(squared, "concavity");
}

TEST(Comparisons, AnInnovationOfAnotherState) {
  expect_broken({.before =
                     [](Given& given, State& now) {
                       if (given.y) *given.y += given.C * now.x / 1024;
                     }},
                "translation");
}

TEST(Comparisons, MemoryOfTheRunBefore) {
  // Only the first start counts.
  expect_broken({.start =
                     [](State& now, const Vector<double>& x, const Matrix<double>& P) {
                       const bool warm = now.x.size() == x.size() && now.runs > 0;
                       now.x = warm ? Vector<double>(x + now.x / 1e6) : x;
                       now.P = P;
                     }},
                "isolation");
}

TEST(Comparisons, SomethingThatCounts) {
  expect_broken({.after = [](const Given&, State& now) { now.P *= 1 + 1e-9 * now.runs; }}, "purity");
}

TEST(Comparisons, AFailureThatIsSilent) { expect_broken({.silent = true}, "singular-innovation"); }

TEST(Comparisons, ANaNThatIsPassedOver) {
  expect_broken(
      {.before = [](Given& given, State&) { given.C = given.C.unaryExpr([](double c) { return c == c ? c : 0.0; }); }},
      "not-a-number");
}

TEST(Comparisons, SinglePrecisionInTheMiddle) {
  expect_broken({.after = [](const Given&, State& now) { now.P = now.P.cast<float>().cast<double>(); }}, "precision");
}

/// That the law applies to this system, and that these filters keep it.
void expect_to_hold(std::string_view id, std::initializer_list<const char*> filters, const System& system) {
  const auto law = laws([id](std::string_view one) { return one == id; }).at(0);
  for (const char* name : filters) {
    Truths truths;
    const auto filter = built_in(name);
    Bench bench(*filter, truths);
    const auto finding = law.examine(bench, system);
    ASSERT_TRUE(finding) << id << " of " << name;
    EXPECT_LE(finding->ratio, largest_ratio) << id << " of " << name;
  }
}

// The gain is 2e-8, but R^{-1/2} y goes through the array as it is: what it rounds is far more than u |K| |y|.
TEST(Comparisons, WhatAnInformationFilterWeighsItRounds) {
  const System system = read_toml(
      "name = 'weak'\nsteps = 1\nA = {identity = 2}\nB = [[], []]\nC = [[0, 0.00647948573539845]]\nQ = []\nR_root = 8\n"
      "S0 = {diagonal = [0.125, 0.015625]}\n");
  expect_to_hold("similarity", {"srif", "srif-hessenberg", "information"}, system);
}

// Kf is of size 1 here, and A Kf, which moves the state, of 1e-16: what Kf rounds comes to x by A, not relative to A Kf.
TEST(Trajectory, OfAFilterThatUpdatesBeforeItPredictsMayRoundItsGain) {
  const System system = read_toml(
      "name = 'cancels'\nsteps = 2\nA = [[0, 0], [0, 1]]\n"
      "B = [[-3.41699659217995, -1.1197269591076138, -1.7461569452010752, -0.14588265422687988],"
      " [-1.9890695648019152, 2.2489453785949607, 2.5174664013486683, -0.8051148170016975]]\n"
      "C = [[1, 0]]\nQ = {identity = 4}\nR = [[1]]\nP0 = [[0, 0], [0, 0]]\nx0 = [0, 0]\n"
      "measurements = [[0], [1]]\n");
  expect_to_hold("trajectory", {"ud", "potter", "carlson", "svd", "srcf", "ckf"}, system);
}

// The same in another basis: Kf is of size 2^-9, A Kf is 0, and in the turned basis A times what Kf rounds is not.
TEST(Comparisons, OfAFilterThatUpdatesBeforeItPredictsMayRoundItsGain) {
  const System system = read_toml(
      "name = 'cancels'\nsteps = 1\nA = {diagonal = [1, 0]}\nB = [[], []]\nC = [[0, 1]]\nQ = []\nR = [[1]]\n"
      "P0 = {diagonal = [16, 0.001953125]}\nx0 = [0, 0]\n");
  expect_to_hold("similarity", {"ud", "potter", "carlson", "svd", "srcf", "ckf"}, system);
}

// Y = 2^20 is told by Q = I that little is left of it: Y - W W' = 1 - 2^-20 has lost 20 digits of 2^20, and d = Y x with it,
// although no measurement moves x.
TEST(Trajectory, OfAFilterThatHoldsYItsStateLosesWithYWhatTheTimeUpdateTakesOff) {
  const System system = read_toml(
      "name = 'forgets'\nsteps = 2\nA = [[1]]\nB = [[1]]\nC = []\nQ = [[1]]\nR = []\nP0 = [[9.5367431640625e-07]]\n"
      "x0 = [-2072.4062849833654]\nmeasurements = [[], []]\n");
  for (const char* law : {"trajectory", "batch"})
    expect_to_hold(law, {"information", "srif", "srif-hessenberg", "srcf"}, system);
  // The bound is of the size of the error: u 2^20 |x|, and the squares of a few constants.
  Truths truths;
  const auto filter = built_in("information");
  Bench bench(*filter, truths);
  const double lost = std::ldexp(unit_roundoff<double>(), 20) * 2072, bound = bench.course(system).x_bound(1);
  EXPECT_GE(bound, lost);
  EXPECT_LE(bound, 1000 * lost);
}

// Phi = R^{-1/2} C is off by k(R^{1/2}) u, although Re is as well-conditioned as can be: ud, potter and carlson lose that.
class Whitened : public ::testing::TestWithParam<const char*> {};
TEST_P(Whitened, LosesTheConditionOfR) {
  for (const char* d : {"0.0001220703125", "1e-6", "1e-7"}) {
    const System system = read_toml(std::string("name = 'whitened'\nsteps = 2\nA = {identity = 2}\nB = [[], []]\n"
                                                "C = {identity = 2}\nQ = []\nR_root = [[") +
                                    d + ", 0], [1, 1]]\nP0 = {identity = 2}\nx0 = [1, 2]\nmeasurements = [[1, 2], [2, 1]]\n");
    for (const Law& law : all_laws()) {
      Truths truths;
      const auto filter = built_in(GetParam());
      Bench bench(*filter, truths);
      const auto finding = law.examine(bench, system);
      EXPECT_TRUE(!finding || finding->ratio <= largest_ratio) << law.id << ": " << finding->ratio << ", d = " << d;
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Filters, Whitened, ::testing::Values("ud", "potter", "carlson", "srcf", "svd", "ckf"));

TEST(Comparisons, AnInputThatIsLate) {
  Spoilt late{.before = [last = std::optional<Vector<double>>()](Given& given, State& now) mutable {
    if (!given.u) return;
    if (now.steps == 0 || !last) last = Vector<double>::Zero(given.u->size());
    std::swap(*given.u, *last);
  }};
  // The law on systems with an input, whatever is drawn.
  System system = read_toml(valid_toml());
  system.D = Sequence(Matrix<double>(Matrix<double>::Identity(2, 2)));
  set_columns(system, {Matrix<double>::Ones(1, 3), Matrix<double>::Ones(2, 3)});
  const auto law = laws([](std::string_view id) { return id == "input-response"; }).at(0);
  Truths truths;
  const auto wrong = foreign(std::move(late)), right = foreign({});
  Bench spoilt(*wrong, truths), good(*right, truths);
  EXPECT_GT(law.examine(spoilt, system)->ratio, 1000);
  EXPECT_LE(law.examine(good, system)->ratio, largest_ratio);
}

}  // namespace
}  // namespace kfstab::properties::testing
