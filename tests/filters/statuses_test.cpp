// A step that cannot be done says why, leaves every bit of what was held, and may be called again: what follows is as
// if it had never failed.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <initializer_list>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include <kfstab/filters/registry.hpp>

#include "filters/random_problem.hpp"

namespace kfstab::test::statuses {
namespace {

using Covariance = CovarianceModel<double>;
using Root = RootModel<double>;
using Information = InformationModel<double>;

const double infinity = std::numeric_limits<double>::infinity();

constexpr int broken_step = 2;

/// An edit of the models that makes step 2 fail: of models[2], or, for what an information filter takes from the step
/// before, models[1].
template <class Model>
using Edit = std::function<void(std::vector<Model>&)>;

struct Fault {
  std::string text;
  Edit<Covariance> covariance = {};
  Edit<Root> root = {};
  Edit<Information> information = {};
  double y = 0;  ///< added to the first entry of y
  double u = 0;
};

template <class Model>
const Edit<Model>& edit_of(const Fault& fault) {
  if constexpr (std::is_same_v<Model, Covariance>)
    return fault.covariance;
  else if constexpr (std::is_same_v<Model, Root>)
    return fault.root;
  else
    return fault.information;
}

/// Whether the fault is one of this parametrisation.
bool apply(const Fault& fault, AnyProblem<double>& problem) {
  return std::visit(
      [&]<class Model>(Problem<Model>& given) {
        const Edit<Model>& edit = edit_of<Model>(fault);
        if (edit) edit(given.models);
        return edit || fault.y != 0 || fault.u != 0;
      },
      problem);
}

struct Snapshot {
  Matrix<double> held, gain;
  Vector<double> state;

  Snapshot() = default;
  explicit Snapshot(const Step<double>& step) : gain(*step.gain), state(*step.state) {
    if (step.held) held = *step.held;
  }
};

template <class X>
bool same_bits(const X& a, const X& b) {
  if (a.size() != b.size()) return false;
  return a.size() == 0 || std::memcmp(a.data(), b.data(), sizeof(double) * static_cast<std::size_t>(a.size())) == 0;
}

void expect_same_bits(const Snapshot& a, const Snapshot& b, const char* when) {
  EXPECT_TRUE(same_bits(a.held, b.held)) << when << ", held:\n" << a.held << "\nagainst\n" << b.held;
  EXPECT_TRUE(same_bits(a.gain, b.gain)) << when << ", gain:\n" << a.gain << "\nagainst\n" << b.gain;
  EXPECT_TRUE(same_bits(a.state, b.state)) << when << ", state:\n" << a.state << "\nagainst\n" << b.state;
}

/// One of the statuses is the right one.
using Statuses = std::vector<Status>;

void expect_status(Status is, const Statuses& expected) {
  for (const Status status : expected)
    if (is == status) return;
  ADD_FAILURE() << "status is " << name(is) << ", expected " << name(expected.front());
}

/// Two filters run side by side. One meets the fault in step 2, which is then mended, and called again.
void fails_and_goes_on(const Metadata& metadata, const AnyProblem<double>& good, const Fault& fault,
                       const Statuses& expected) {
  AnyProblem<double> given = good;
  if (!apply(fault, given)) return;
  SCOPED_TRACE(std::string(metadata.id) + ": " + fault.text);
  given = good;

  const auto unhurt = make_filter<double>(metadata.id), filter = make_filter<double>(metadata.id);
  unhurt->start(good);
  filter->start(given);
  const auto [n, m, p] = std::visit([](const auto& problem) { return problem.dimensions(); }, good);
  Dice dice(31);
  Snapshot last;
  for (int k = 0; k < 5; ++k) {
    const Vector<double> y = dice.vector(p, 32), u = dice.vector(1, 32);
    if (k == broken_step) {
      Vector<double> y_given = y, u_given = u;
      if (p > 0) y_given(0) += fault.y;
      u_given(0) += fault.u;
      apply(fault, given);
      const auto step = filter->step(k, &y_given, &u_given);
      expect_status(step.report.status, expected);
      EXPECT_FALSE(step.report);
      expect_same_bits(Snapshot(step), last, "after the failed step");
      given = good;
    }
    const auto step = filter->step(k, &y, &u), control = unhurt->step(k, &y, &u);
    ASSERT_EQ(control.report.status, Status::ok) << "step " << k;
    ASSERT_EQ(step.report.status, Status::ok) << "step " << k << ": " << name(step.report.status);
    EXPECT_EQ(step.report.rcond, control.report.rcond);
    last = Snapshot(step);
    expect_same_bits(last, Snapshot(control), ("step " + std::to_string(k)).c_str());
  }
}

Fault everywhere(const std::string& text, const std::function<void(Covariance&)>& c,
                 const std::function<void(Root&)>& r, const std::function<void(Information&)>& i,
                 std::size_t information_model = broken_step) {
  Fault fault{.text = text};
  if (c) fault.covariance = [c](auto& models) { c(models[broken_step]); };
  if (r) fault.root = [r](auto& models) { r(models[broken_step]); };
  if (i) fault.information = [i, information_model](auto& models) { i(models[information_model]); };
  return fault;
}

/// Five models, all the same where the form knows time-invariant systems alone.
AnyProblem<double> ordinary(const Metadata& metadata, Dimensions d = {3, 2, 2}) {
  const bool invariant = metadata.needs.time_invariant;
  AnyProblem<double> problem =
      random_problem(metadata.takes, {.d = d, .period = invariant ? 1 : 5, .inputs = 1}, 33);
  if (invariant) std::visit([](auto& given) { given.models.resize(5, given.models.front()); }, problem);
  return problem;
}

/// Two directions that nothing measures and nothing disturbs, of size 2^600 (information: all of T), or of 2^300 where
/// the form squares a root.
AnyProblem<double> huge(const Metadata& metadata) {
  const bool squares = metadata.holds == Held::ud_factors || metadata.holds == Held::information;
  const double size = squares ? 0x1p+300 : 0x1p+600;
  AnyProblem<double> problem = random_problem(metadata.takes, {.d = {3, 1, 1}, .period = 5, .inputs = 1}, 34);
  std::visit(
      [size]<class Model>(Problem<Model>& given) {
        for (auto& model : given.models) {
          model.C.setZero();
          model.C(0, 0) = 1;
          if constexpr (std::is_same_v<Model, Information>) {
            model.A_inverse.setIdentity();
            model.A_inverse_B.setZero();
          } else {
            model.A.setIdentity();
            model.B.setZero();
            model.B(0, 0) = 1;
          }
        }
        given.initial.setIdentity();
        given.initial(1, 1) = given.initial(2, 2) = size;
        if (std::is_same_v<Model, Information>) given.initial(0, 0) = size;  // or T would be singular
      },
      problem);
  return problem;
}

}  // namespace

TEST(Statuses, NonFiniteInput) {
  for (const double bad : {std::nan(""), infinity, -infinity}) {
    const std::vector<Fault> faults = {
        everywhere(
            "A", [=](auto& m) { m.A(1, 2) = bad; }, [=](auto& m) { m.A(1, 2) = bad; },
            [=](auto& m) { m.A_inverse(1, 2) = bad; }, broken_step - 1),
        everywhere(
            "B", [=](auto& m) { m.B(2, 1) = bad; }, [=](auto& m) { m.B(2, 1) = bad; },
            [=](auto& m) { m.A_inverse_B(2, 1) = bad; }, broken_step - 1),
        everywhere(
            "C", [=](auto& m) { m.C(1, 0) = bad; }, [=](auto& m) { m.C(1, 0) = bad; },
            [=](auto& m) { m.C(1, 0) = bad; }),
        everywhere(
            "last of C", [=](auto& m) { m.C(1, 2) = bad; }, [=](auto& m) { m.C(1, 2) = bad; },
            [=](auto& m) { m.C(1, 2) = bad; }),
        everywhere(
            "D", [=](auto& m) { m.D(0, 0) = bad; }, [=](auto& m) { m.D(0, 0) = bad; },
            [=](auto& m) { m.D(0, 0) = bad; }, broken_step - 1),
        everywhere(
            "Q", [=](auto& m) { m.Q(0, 1) = m.Q(1, 0) = bad; }, [=](auto& m) { m.Q_root(1, 0) = bad; },
            [=](auto& m) { m.Q_inverse_root(0, 1) = bad; }, broken_step - 1),
        everywhere(
            "R", [=](auto& m) { m.R(0, 1) = m.R(1, 0) = bad; }, [=](auto& m) { m.R_root(1, 0) = bad; },
            [=](auto& m) { m.R_inverse_root(0, 1) = bad; }),
        everywhere(
            "last of R", [=](auto& m) { m.R(1, 1) = bad; }, [=](auto& m) { m.R_root(1, 1) = bad; },
            [=](auto& m) { m.R_inverse_root(1, 1) = bad; }),
        everywhere(
            "w_mean", {}, {}, [=](auto& m) { m.w_mean = Vector<double>::Constant(2, bad); }, broken_step - 1),
        Fault{.text = "y", .y = bad},
        Fault{.text = "u", .u = bad},
    };
    for (const Metadata& metadata : filters())
      for (const Fault& fault : faults)
        fails_and_goes_on(metadata, ordinary(metadata), fault, {Status::non_finite_input});
  }
}

// The same quantity measured twice without noise. A Cholesky factorisation of Re finds a minor that is not positive,
// or, when its last pivot is rounded to something tiny, an rcond to match.
TEST(Statuses, SingularInnovation) {
  const Fault twice = everywhere(
      "one noiseless measurement twice",
      [](auto& m) {
        m.C.row(1) = m.C.row(0);
        m.R.setZero();
      },
      [](auto& m) {
        m.C.row(1) = m.C.row(0);
        m.R_root.setZero();
      },
      {});
  for (const Metadata& metadata : filters()) {
    if (metadata.needs.time_invariant || metadata.needs.positive_definite_R) continue;
    const bool cholesky = metadata.holds == Held::covariance && metadata.asymmetry == Asymmetry::none;
    fails_and_goes_on(metadata, ordinary(metadata), twice,
                      cholesky ? Statuses{Status::singular_innovation, Status::not_positive_definite}
                               : Statuses{Status::singular_innovation});
  }
}

// Two measurements that differ by d, without noise, of P = I: rcond of Re = [1 1; 1 1+d^2] is d^2/4, of its root [1 0;
// 1 d] d/2, but for terms of order d. The limit is p^2 u = 4u: forms that invert Re must refuse d = 2^-26, a
// square-root filter d = 2^-52.
TEST(Statuses, SingularInnovationIsToldByRcond) {
  for (const Metadata& metadata : filters()) {
    if (metadata.takes == Parametrisation::information || metadata.needs.time_invariant) continue;
    if (metadata.needs.positive_definite_R) continue;
    for (const int exponent : {-10, -26, -52}) {
      const double d = std::ldexp(1., exponent);
      AnyProblem<double> problem = random_problem(metadata.takes, {.d = {2, 1, 2}}, 35);
      std::visit(
          [&]<class Model>(Problem<Model>& given) {
            given.initial.setIdentity();
            if constexpr (!std::is_same_v<Model, Information>) given.models[0].C << 1, 0, 1, d;
            if constexpr (std::is_same_v<Model, Covariance>) given.models[0].R.setZero();
            if constexpr (std::is_same_v<Model, Root>) given.models[0].R_root.setZero();
          },
          problem);
      const auto filter = make_filter<double>(metadata.id);
      filter->start(problem);
      const auto report = filter->step(0, nullptr, nullptr).report;
      SCOPED_TRACE(std::string(metadata.id) + ", d = 2^" + std::to_string(exponent));
      const bool root = metadata.takes == Parametrisation::root;
      const double rcond = root ? d / 2 : d * d / 4, limit = 4 * 0x1p-53;
      if (rcond < limit) {
        if (exponent == -26 || root) {
          EXPECT_EQ(report.status, Status::singular_innovation) << name(report.status);
        } else {
          EXPECT_FALSE(report);  // 1 + d^2 = 1: exactly singular
        }
      } else {
        EXPECT_EQ(report.status, Status::ok) << name(report.status);
      }
      if (exponent != -52 || root) {
        EXPECT_NEAR(report.rcond / rcond, 1, 4 * d + 1e-12);
      }
    }
  }
}

TEST(Statuses, NotPositiveDefinite) {
  const Fault negative = everywhere("R = -100 I", [](auto& m) { m.R.diagonal().setConstant(-100); }, {}, {});
  const Fault indefinite = everywhere("R = [1 50; 50 1]",
                                      [](auto& m) {
                                        m.R.setConstant(50);
                                        m.R.diagonal().setConstant(1);
                                      },
                                      {}, {});
  for (const Metadata& metadata : filters()) {
    // The unsymmetrised codings use LU, which an indefinite Re does not stop: they go on with it.
    if (metadata.asymmetry != Asymmetry::none || metadata.needs.time_invariant) continue;
    fails_and_goes_on(metadata, ordinary(metadata), negative, {Status::not_positive_definite});
    fails_and_goes_on(metadata, ordinary(metadata), indefinite, {Status::not_positive_definite});
  }
}

// One number of the model is another: a form for time-invariant systems says so, and goes on with the one it knows.
TEST(Statuses, TimeVaryingModel) {
  const std::vector<Fault> faults = {
      everywhere(
          "A", [](auto& m) { m.A(1, 2) += 1; }, [](auto& m) { m.A(1, 2) += 1; },
          [](auto& m) { m.A_inverse(1, 2) += 1; }, broken_step - 1),
      everywhere(
          "B", [](auto& m) { m.B(2, 1) += 1; }, [](auto& m) { m.B(2, 1) += 1; },
          [](auto& m) { m.A_inverse_B(2, 1) += 1; }, broken_step - 1),
      everywhere(
          "C", [](auto& m) { m.C(1, 2) += 1; }, [](auto& m) { m.C(1, 2) += 1; }, [](auto& m) { m.C(1, 2) += 1; }),
      everywhere(
          "Q", [](auto& m) { m.Q(0, 0) += 1; }, [](auto& m) { m.Q_root(1, 0) += 1; },
          [](auto& m) { m.Q_inverse_root(0, 1) += 1; }, broken_step - 1),
      everywhere(
          "R", [](auto& m) { m.R(0, 0) += 1; }, [](auto& m) { m.R_root(1, 0) += 1; },
          [](auto& m) { m.R_inverse_root(0, 1) += 1; }),
  };
  for (const Metadata& metadata : filters())
    for (const Fault& fault : faults)
      if (metadata.needs.time_invariant)
        fails_and_goes_on(metadata, ordinary(metadata), fault, {Status::time_varying_model});
}

TEST(Statuses, SingularInformation) {
  // Nothing is known of the second state: A^{-1} sends it nowhere, C does not see it.
  Fault unseen{.text = "a state that nothing measures"};
  unseen.information = [](auto& models) {
    models[broken_step - 1].A_inverse.col(1).setZero();
    models[broken_step].C.col(1).setZero();
  };
  for (const Metadata& metadata : filters()) {
    if (metadata.needs.time_invariant) continue;
    fails_and_goes_on(metadata, ordinary(metadata), unseen,
                      metadata.holds == Held::information  // its Cholesky factorisation meets the zero, or what is left
                          ? Statuses{Status::singular_information, Status::not_positive_definite}
                          : Statuses{Status::singular_information});
  }
}

// The forms that whiten a measurement divide by R^{1/2}: a zero on its diagonal, or rows that are nearly one.
TEST(Statuses, SingularMeasurementNoise) {
  const Fault faults[] = {
      everywhere("R = 0", {}, [](auto& m) { m.R_root.setZero(); }, {}),
      everywhere("a noiseless measurement", {}, [](auto& m) { m.R_root.row(1).setZero(); }, {}),
      everywhere("two noises that are one", {}, [](auto& m) { m.R_root << 1, 0, 1, 0x1p-53; }, {}),
  };
  int tried = 0;
  for (const Metadata& metadata : filters()) {
    if (metadata.takes != Parametrisation::root || !metadata.needs.positive_definite_R) continue;
    ++tried;
    for (const Fault& fault : faults)
      fails_and_goes_on(metadata, ordinary(metadata), fault, {Status::singular_measurement_noise});
  }
  EXPECT_GT(tried, 0);
}

TEST(Statuses, Overflow) {
  const double big = 0x1p+600;
  const std::vector<Fault> faults = {
      everywhere(
          "A", [=](auto& m) { m.A *= big; }, [=](auto& m) { m.A *= big; }, [=](auto& m) { m.A_inverse *= big; },
          broken_step - 1),
      everywhere(
          "C", [=](auto& m) { m.C.setConstant(big); }, [=](auto& m) { m.C.setConstant(big); },
          [=](auto& m) {
            m.C.setConstant(big);
            m.R_inverse_root.setConstant(big);
          }),
  };
  for (const Metadata& metadata : filters()) {
    if (metadata.needs.time_invariant) continue;
    for (const Fault& fault : faults) fails_and_goes_on(metadata, huge(metadata), fault, {Status::overflow});
  }
}

// S+ is finite, P C' Re^{-1} is not: 2^200 2^-1030 / 2^-1859.
TEST(Statuses, OverflowOfTheGainAlone) {
  Problem<Root> problem;
  auto& model = problem.models.emplace_back();
  model.A = Matrix<double>::Identity(1, 1);
  model.B = Matrix<double>::Zero(1, 1);
  model.C = Matrix<double>::Constant(1, 1, 0x1p-1030);
  model.D.resize(1, 0);
  model.Q_root = Matrix<double>::Identity(1, 1);
  model.R_root = Matrix<double>::Constant(1, 1, 0x1p-930);
  problem.initial = Matrix<double>::Constant(1, 1, 0x1p+100);
  problem.x0 = Vector<double>::Zero(1);
  const AnyProblem<double> any = problem;
  for (const Metadata& metadata : filters()) {
    if (metadata.takes != Parametrisation::root) continue;
    const auto filter = make_filter<double>(metadata.id);
    filter->start(any);
    const auto step = filter->step(0, nullptr, nullptr);
    EXPECT_EQ(step.report.status, Status::overflow) << metadata.id << ": " << name(step.report.status);
    EXPECT_TRUE(all_finite(*step.gain)) << metadata.id;
  }
}

}  // namespace kfstab::test::statuses
