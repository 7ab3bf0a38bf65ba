#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace kfstab::properties {

namespace {

Precise lower(const Matrix<double>& L) { return Matrix<double>(L.triangularView<Eigen::Lower>()); }
Precise upper(const Matrix<double>& U) { return Matrix<double>(U.triangularView<Eigen::Upper>()); }
Precise square(const Precise& L) { return L * L.transposed(); }
Precise column(const Vector<double>& v) { return Precise(Matrix<double>(v)); }

/// A model's numbers as they stand, exactly.
struct ExactModel {
  Precise A, B, C, Q, R, D;
};

/// Nothing where an inverse is that of a singular matrix.
std::optional<ExactModel> exact(const CovarianceModel<double>& model) {
  return ExactModel{model.A, model.B, model.C, model.Q, model.R, Matrix<double>(model.D)};
}
std::optional<ExactModel> exact(const RootModel<double>& model) {
  return ExactModel{
      model.A, model.B, model.C, square(lower(model.Q_root)), square(lower(model.R_root)), Matrix<double>(model.D)};
}
std::optional<ExactModel> exact(const InformationModel<double>& model) {
  const auto covariance = [](const Matrix<double>& root) {
    const Precise U = upper(root);
    return (U.transposed() * U).inverse();
  };
  const auto A = Precise(model.A_inverse).inverse(), Q = covariance(model.Q_inverse_root),
             R = covariance(model.R_inverse_root);
  if (!A || !Q || !R) return std::nullopt;
  return ExactModel{*A, *A * Precise(model.A_inverse_B), model.C, *Q, *R, Matrix<double>(model.D)};
}

std::optional<Precise> initial(const Problem<CovarianceModel<double>>& problem) { return Precise(problem.initial); }
std::optional<Precise> initial(const Problem<RootModel<double>>& problem) { return square(lower(problem.initial)); }
std::optional<Precise> initial(const Problem<InformationModel<double>>& problem) {
  const Precise T = upper(problem.initial);
  return (T.transposed() * T).inverse();
}

std::optional<Precise> information_of(const Answer& answer) {
  if (answer.holds == Held::information) return Precise(answer.held);
  if (answer.holds != Held::information_factor) return std::nullopt;
  const Precise T = upper(answer.held);
  return T.transposed() * T;
}

template <class Model>
std::vector<ObservedStep> observe(const Run& run, const Traits& traits, const Problem<Model>& problem,
                                  const System& complete) {
  std::vector<ObservedStep> steps;
  auto before = initial(problem);
  auto x_before = complete.data ? std::optional(column(problem.x0)) : std::nullopt;
  const auto data = complete.data ? complete.data->open() : nullptr;
  std::optional<Vector<double>> u_before;
  const bool answers_predicted = traits.instant == Instant::predicted;
  for (std::size_t k = 0; k < run.answers.size() && before; ++k) {
    const Answer& answer = run.answers[k];
    const auto step = static_cast<std::int64_t>(k);
    const auto P = covariance(answer);
    const auto now = exact(problem.model(step));
    // A filter that starts predicted and answers P_{k|k} comes by the dynamics of the step before.
    const bool late = !answers_predicted && traits.starts_predicted;
    const auto dynamics = late && k > 0 ? exact(problem.model(step - 1)) : now;
    if (!P || !now || !dynamics) break;
    const bool predicts = !(late && k == 0);
    const StepData* given = data ? &data->next() : nullptr;
    const std::optional<Vector<double>> u_now = given && given->u.size() > 0 ? std::optional(given->u) : std::nullopt;
    const auto& u = late ? u_before : u_now;

    const Precise BQB = dynamics->B * dynamics->Q * dynamics->B.transposed();
    const bool prior_is_before = answers_predicted || !predicts;
    const Precise prior = prior_is_before ? *before : dynamics->A * *before * dynamics->A.transposed() + BQB;
    ObservedStep seen{.subject = traits,
                      .size = run.system.dimensions(),
                      .k = step,
                      .A = dynamics->A,
                      .B = dynamics->B,
                      .C = now->C,
                      .Q = dynamics->Q,
                      .R = now->R,
                      .predicts = predicts,
                      .before = *before,
                      .prior = prior,
                      .P = *P,
                      .Re = now->R + now->C * prior * now->C.transposed(),
                      .information = information_of(answer),
                      .gain = std::nullopt,
                      .x_before = std::nullopt,
                      .x_prior = std::nullopt,
                      .x = std::nullopt,
                      .y = std::nullopt,
                      .Du = std::nullopt};
    if (answer.gain && traits.gain && answer.gain->cols() == now->C.rows()) seen.gain = *answer.gain;
    if (given && x_before && answer.state) {
      seen.x_before = x_before;
      seen.Du = u ? dynamics->D * column(*u) : Precise(Matrix<double>(Matrix<double>::Zero(now->A.rows(), 1)));
      seen.x_prior = prior_is_before ? *x_before : dynamics->A * *x_before + *seen.Du;
      seen.x = column(*answer.state);
      seen.y = column(given->y);
    }
    u_before = u_now;
    before = P;
    x_before = answer.state ? std::optional(column(*answer.state)) : std::nullopt;
    steps.push_back(std::move(seen));
  }
  return steps;
}

}  // namespace

std::optional<Precise> covariance(const Answer& answer) {
  switch (answer.holds) {
    case Held::gain: return std::nullopt;
    case Held::covariance: return Precise(answer.held);
    case Held::covariance_factor: return square(lower(answer.held));
    case Held::covariance_root: return square(Precise(answer.held));
    case Held::ud_factors: {
      const Index n = answer.held.rows();
      Matrix<double> U = Matrix<double>::Identity(n, n), D = Matrix<double>::Zero(n, n);
      for (Index j = 0; j < n; ++j) {
        D(j, j) = answer.held(j, j);
        for (Index i = 0; i < j; ++i) U(i, j) = answer.held(i, j);
      }
      return Precise(U) * Precise(D) * Precise(U).transposed();
    }
    case Held::information_factor:
    case Held::information: return information_of(answer)->inverse();
  }
  return std::nullopt;
}

Precise ObservedStep::after(const Precise& X) const {
  return answers_predicted() ? A * X * A.transposed() + B * Q * B.transposed() : X;
}

std::optional<double> ObservedStep::ratio(double error, double kappa, double scale) const {
  if (scale < std::numeric_limits<double>::min() / unit_roundoff<double>()) return std::nullopt;
  return error == 0 ? 0 : error / scale / (rounding() * kappa);
}

double ObservedStep::innovation_condition() const {
  if (Re.rows() == 0) return 1;
  const auto inverse = Re.inverse();
  if (!inverse) return std::numeric_limits<double>::infinity();
  const double c = C.norm();
  return (R.norm() + c * c * prior.norm()) * inverse->norm();
}

double ObservedStep::amplification() const {
  const double a = A.norm(), b = B.norm();
  const double formed = predicts ? a * a * before.norm() + b * b * Q.norm() : before.norm();
  const double kappa = innovation_condition();
  if (holds_root(subject.holds)) return (1 + std::sqrt(kappa)) * formed;
  if (subject.holds == Held::information || subject.holds == Held::information_factor) {
    // dY <= { k(A) + k(R^{1/2}) + k(Qe^{1/2}) (k(Q^{1/2}) + k(A)) } |Y| for a root, its square where Y is held; dP = P dY P.
    const double root =
        1 + A.condition() + std::sqrt(R.condition()) + std::sqrt(kappa) * (std::sqrt(Q.condition()) + A.condition());
    const auto Y = P.inverse();
    const double held = subject.holds == Held::information ? root * root : root;
    return Y ? held * Y->norm() * P.norm() * P.norm() : std::numeric_limits<double>::infinity();
  }
  const auto inverse = Re.inverse();
  const Precise PC = prior * C.transposed();
  const double removed = Re.rows() == 0 || !inverse ? 0 : (PC * *inverse * PC.transposed()).norm();
  return kappa * (formed + removed * (answers_predicted() ? a * a : 1));
}

std::vector<ObservedStep> observed_steps(Bench& bench, const System& system) {
  const Run& run = bench.run(system);
  const System complete = with_every_measurement(system);
  const auto converted = problem(complete, bench.traits().takes);
  const auto* numbers = std::get_if<AnyProblem<double>>(&converted);
  if (!numbers) return {};
  return std::visit([&](const auto& any) { return observe(run, bench.traits(), any, complete); }, *numbers);
}

std::optional<Finding> worst_step(Bench& bench, const System& system,
                                  const std::function<std::optional<double>(const ObservedStep&)>& ratio) {
  std::optional<Finding> worst;
  for (const ObservedStep& step : observed_steps(bench, system)) {
    auto found = ratio(step);
    if (!found) continue;
    if (std::isnan(*found)) found = std::numeric_limits<double>::infinity();
    if (!worst || *found > worst->ratio) worst = Finding{*found, step.k, {}};
  }
  return worst;
}

}  // namespace kfstab::properties
