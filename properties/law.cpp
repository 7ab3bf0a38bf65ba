#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include <kfstab/filters/symmetric_eigen.hpp>
#include <kfstab/properties/data.hpp>

namespace kfstab::properties {

namespace {

Precise lower(const Matrix<double>& L) { return Matrix<double>(L.triangularView<Eigen::Lower>()); }
Precise upper(const Matrix<double>& U) { return Matrix<double>(U.triangularView<Eigen::Upper>()); }
Precise square(const Precise& L) { return L * L.transposed(); }
Precise column(const Vector<double>& v) { return Precise(Matrix<double>(v)); }

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

std::vector<ObservedStep> observe(const Run& run, const Traits& traits, const ExactSystem& exact,
                                  const System& complete) {
  std::vector<ObservedStep> steps;
  std::optional<Precise> before = exact.P0;
  auto x_before = complete.data ? std::optional(exact.x0) : std::nullopt;
  const auto data = complete.data ? complete.data->open() : nullptr;
  const auto as_written = run.system.data ? run.system.data->open() : nullptr;
  std::optional<Vector<double>> u_before;
  const bool answers_predicted = traits.instant == Instant::predicted;
  for (std::size_t k = 0; k < run.answers.size() && before; ++k) {
    const Answer& answer = run.answers[k];
    const auto step = static_cast<std::int64_t>(k);
    const auto P = covariance(answer);
    const ExactModel& now = exact.at(step);
    // A filter that starts predicted and answers P_{k|k} comes by the dynamics of the step before.
    const bool late = !answers_predicted && traits.starts_predicted;
    const ExactModel& dynamics = late && k > 0 ? exact.at(step - 1) : now;
    if (!P) break;
    const bool predicts = !(late && k == 0);
    const StepData* given = data ? &data->next() : nullptr;
    const StepData* written = as_written ? &as_written->next() : nullptr;
    const std::optional<Vector<double>> u_now = given && given->u.size() > 0 ? std::optional(given->u) : std::nullopt;
    const auto& u = late ? u_before : u_now;

    double missing_log_variance = 0;
    if (written && written->y.hasNaN()) {
      const Matrix<double> R = now.R.rounded();
      for (Index i = 0; i < R.rows(); ++i)
        if (std::isnan(written->y(i))) missing_log_variance += std::log(R(i, i));
    }

    const Precise BQB = dynamics.B * dynamics.Q * dynamics.B.transposed();
    const bool prior_is_before = answers_predicted || !predicts;
    const Precise prior = prior_is_before ? *before : dynamics.A * *before * dynamics.A.transposed() + BQB;
    ObservedStep seen{.subject = traits,
                      .size = run.system.dimensions(),
                      .k = step,
                      .A = dynamics.A,
                      .B = dynamics.B,
                      .C = now.C,
                      .Q = dynamics.Q,
                      .R = now.R,
                      .predicts = predicts,
                      .measured = now.C.rows() - (written ? written->y.array().isNaN().count() : 0),
                      .missing_log_variance = missing_log_variance,
                      .before = *before,
                      .prior = prior,
                      .P = *P,
                      .Re = now.R + now.C * prior * now.C.transposed(),
                      .information = information_of(answer),
                      .gain = std::nullopt,
                      .x_before = std::nullopt,
                      .x_prior = std::nullopt,
                      .x = std::nullopt,
                      .y = std::nullopt,
                      .Du = std::nullopt,
                      .log_likelihood = answer.log_likelihood,
                      .update = std::nullopt,
                      .amplified = {}};
    if (answer.gain && traits.gain && answer.gain->cols() == now.C.rows()) seen.gain = *answer.gain;
    if (given && x_before && answer.state) {
      seen.x_before = x_before;
      seen.Du = u ? dynamics.D * column(*u) : Precise(Matrix<double>(Matrix<double>::Zero(now.A.rows(), 1)));
      seen.Du_terms = u ? dynamics.D.norm() * u->norm() : 0;
      seen.x_prior = prior_is_before ? *x_before : dynamics.A * *x_before + *seen.Du;
      seen.x = column(*answer.state);
      seen.y = column(given->y);
    }
    u_before = u_now;
    before = P;
    x_before = answer.state ? std::optional(column(*answer.state)) : std::nullopt;
    seen.complete();
    steps.push_back(std::move(seen));
  }
  return steps;
}

}  // namespace

std::optional<ExactSystem> exact_system(const System& complete, Parametrisation takes) {
  const auto converted = problem(complete, takes);
  const auto* numbers = std::get_if<AnyProblem<double>>(&converted);
  if (!numbers) return std::nullopt;
  return std::visit(
      [](const auto& any) -> std::optional<ExactSystem> {
        const auto P0 = initial(any);
        if (!P0) return std::nullopt;
        ExactSystem system{{}, *P0, column(any.x0)};
        for (const auto& model : any.models) {
          auto numbers_of = exact(model);
          if (!numbers_of) return std::nullopt;
          system.models.push_back(*std::move(numbers_of));
        }
        return system;
      },
      *numbers);
}

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

Precise ObservedStep::state_after(const Precise& z) const { return answers_predicted() ? A * z + *Du : z; }

Precise ObservedStep::exact_gain() const { return predictor_gain() ? A * update->Kf : update->Kf; }

Precise ObservedStep::joseph(const Precise& K) const {
  const bool whole = predictor_gain() && answers_predicted();
  const Precise F = (whole ? A : Precise::identity(size.n)) - K * C;
  const Precise sum = F * prior * F.transposed() + K * R * K.transposed();
  return whole ? sum + B * Q * B.transposed() : after(sum);
}

double underflow(const Traits& subject) {
  const bool single = subject.roundoff > unit_roundoff<double>();
  return (single ? std::numeric_limits<float>::min() : std::numeric_limits<double>::min()) / subject.roundoff;
}

std::optional<double> ObservedStep::ratio(double error, double kappa, double scale) const {
  if (scale < underflow(subject)) return std::nullopt;
  return error == 0 ? 0 : error / scale / (rounding() * kappa);
}

std::optional<Finding> ObservedStep::compare(std::string_view name, const Precise& found, const Precise& expected,
                                             double scale, double allowed) const {
  const double error = (found - expected).norm();
  const auto r = ratio(error <= allowed ? 0 : error - allowed, 1, scale);
  if (!r) return std::nullopt;
  return Finding{*r, k, *r <= largest_ratio ? std::string() : largest_difference(name, found, expected)};
}

std::optional<Finding> ObservedStep::semidefinite(std::string_view name, const Precise& X, double scale,
                                                  double allowed) const {
  const double below = below_zero(X);
  const auto r = ratio(below <= allowed ? 0 : below - allowed, 1, std::max(scale, X.norm()));
  if (!r) return std::nullopt;
  return Finding{*r, k,
                 *r <= largest_ratio ? std::string() : fmt::format("{} has the eigenvalue {:.6g}", name, -below)};
}

namespace {

/// What a step of a form that holds T or Y = T'T loses, theory (4.3), in units of u (n + m + p).
struct InformationLoss {
  double P = 0, Y = 0, R_inverse = 0;  ///< norms: of P_{k|k}, of its inverse, of R^{-1}
  double local = 0;                    ///< of Y
  double reported = 0;                 ///< of the P before, where it is not what the filter holds but was made of that
  double state = 0;
};

InformationLoss information_loss(const ObservedStep& s) {
  constexpr double infinite = std::numeric_limits<double>::infinity();
  const auto norm = [](const std::optional<Precise>& X) { return X ? X->norm() : infinite; };
  const auto Y = s.information ? s.information : s.P.inverse(), Y_before = s.before.inverse(),
             R_inverse = s.R.inverse();
  InformationLoss lost;
  lost.P = s.P.norm();
  lost.Y = norm(Y);
  lost.R_inverse = norm(R_inverse);
  if (!Y_before || !R_inverse) {
    lost.local = lost.state = infinite;
    return lost;
  }
  // { k(A) + k(R^{1/2}) + k(Qe^{1/2}) (k(Q^{1/2}) + k(A)) } |[T A^{-1}; R^{-1/2} C]|
  double bracket = 1 + (s.measured > 0 ? std::sqrt(s.R.condition()) : 0), moved = Y_before->norm(), A_inverse_norm = 1;
  if (s.predicts) {
    const auto A_inverse = s.A.inverse(), Q_inverse = s.Q.inverse();
    if (!A_inverse || !Q_inverse) {
      lost.local = lost.state = infinite;
      return lost;
    }
    const Precise TA = A_inverse->transposed() * *Y_before * *A_inverse;
    const double k_A = s.A.condition();
    const double k_Qe = s.size.m == 0 ? 0 : std::sqrt((*Q_inverse + s.B.transposed() * TA * s.B).condition());
    bracket += k_A + k_Qe * (std::sqrt(s.Q.condition()) + k_A);
    moved = TA.norm();
    A_inverse_norm = A_inverse->norm();
  }
  const double formed = moved + (s.C.transposed() * *R_inverse * s.C).norm();
  const double before = Y_before->norm();
  // One that holds Y, or that is foreign and inverts what it is given, has the square of all of this.
  const bool squared = s.subject.holds == Held::information || !s.information;
  lost.local = squared ? bracket * bracket * formed : 2 * bracket * std::sqrt(lost.Y * formed);
  const double k_before = before * s.before.norm();
  if (!s.information) lost.reported = k_before * s.before.norm();
  if (s.x) {
    // T+ x+ = xi, and what xi is made of
    const double x = s.x_before->norm() + (s.predicts ? A_inverse_norm * s.Du_terms : 0);
    const double xi = std::sqrt(formed) * s.x->norm() + std::sqrt(before) * x + std::sqrt(lost.R_inverse) * s.y->norm();
    const double reported = std::sqrt(k_before) * s.x_before->norm() * (s.predicts ? s.A.norm() : 1);
    lost.state = squared ? bracket * bracket * lost.P * std::sqrt(formed) * xi + std::sqrt(k_before) * reported
                         : bracket * std::sqrt(lost.P) * xi + reported;
  }
  return lost;
}

}  // namespace

void ObservedStep::complete() {
  const double a = A.norm(), b = B.norm(), c = C.norm();
  const double moved = a * a * before.norm() + b * b * Q.norm();  // what A P A' + B Q B' is made of
  const double formed = predicts ? moved : before.norm();
  const double P_prior = answers_predicted() ? before.norm() : formed;
  const double r = R.norm() + c * c * P_prior;

  double Re_inverse_norm = 0, removed = 0, Kf = 0, KfC = 0;
  if (Re.rows() == 0) {
    update = Update{Re, prior * C.transposed(), prior};
  } else if (auto inverse = Re.inverse()) {
    Re_inverse_norm = inverse->norm();
    const Precise gain_f = prior * C.transposed() * *inverse;
    const Precise less = gain_f * (C * prior);
    Kf = gain_f.norm();
    KfC = (gain_f * C).norm();
    removed = less.norm();
    if (Re.lower_root()) update = Update{*std::move(inverse), gain_f, prior - less};
  } else {
    Re_inverse_norm = std::numeric_limits<double>::infinity();
  }
  amplified.innovation = Re.rows() == 0 ? 1 : r * Re_inverse_norm;
  const double kappa = amplified.innovation;

  double condition = kappa;  // with which the step's errors are enlarged, relative to what it forms
  InformationLoss lost;
  if (holds_information()) {
    lost = information_loss(*this);
    const double Y = lost.Y, CR = c * lost.R_inverse;
    amplified.P = lost.P * lost.P * lost.local + std::pow((predicts ? a : 1) * (1 + KfC), 2) * lost.reported;
    condition = amplified.P / lost.P;
    const double of_filter = lost.P * (std::sqrt(static_cast<double>(size.n)) * Y * Kf + CR) + amplified.P * CR;
    amplified.gain = predictor_gain() ? a * of_filter : of_filter;
    amplified.state_gain = answers_predicted() ? a * of_filter : of_filter;
  } else {
    const double Pf = update ? update->P.norm() : 0;
    if (holds_root(subject.holds)) {
      condition = std::sqrt(kappa);
      amplified.P = (1 + condition) * formed;
      if (whitens(subject) && measured > 0) {
        // R^{1/2} Phi = C + E Phi, |E| <= u |R^{1/2}|: to the filter C is off by k(R^{1/2}) u |C|, and dP_{k|k} = -Kf dC P_{k|k}
        // - P_{k|k} dC' Kf'.
        amplified.whitening = std::sqrt(R.condition());
        condition += amplified.whitening;
        amplified.P += amplified.whitening * 2 * Kf * c * Pf * (answers_predicted() ? a * a : 1);
      }
    } else {
      amplified.P = kappa * (formed + removed * (answers_predicted() ? a * a : 1));
    }
    const double of_predictor = (a * Kf * r + std::sqrt(r * moved)) * Re_inverse_norm;
    const double of_filter = (Kf * r + std::sqrt(r * P_prior)) * Re_inverse_norm;
    // dKf = P_{k|k} dC' Re^{-1} - Kf dC Kf, and Kf = K~ R^{-1/2} in the end.
    const double whitened =
        amplified.whitening > 1 ? amplified.whitening * (Kf + c * (Pf * Re_inverse_norm + Kf * Kf)) : 0;
    amplified.gain = predictor_gain() ? of_predictor + a * whitened : of_filter + whitened;
    amplified.state_gain = (answers_predicted() ? std::max(of_predictor, a * of_filter) : of_filter) +
                           (answers_predicted() ? a : 1) * whitened;
  }

  const double D = (before - before.transposed()).norm(), carried = (predicts ? a : 1) * (1 + KfC);
  amplified.asymmetric = 4 * carried * carried * D;
  amplified.first_order = largest_ratio * rounding() * condition <= 0.5 && D * kappa <= std::ldexp(before.norm(), -30);

  if (!x) return;
  const double z = x_prior->norm(), e = (*y - C * *x_prior).norm(), moved_x = a * x_before->norm() + Du_terms;
  const double seen = predicts && !answers_predicted() ? moved_x : z;  // what x_{k|k-1} is made of
  // Forms that hold a root may whiten the measurements, by R^{-1/2}.
  const double whitening = holds_root(subject.holds) && measured > 0 ? std::sqrt(R.condition()) : 1;
  const double innovated = Kf * whitening * (y->norm() + c * seen);
  const double terms = answers_predicted() ? moved_x + a * innovated : seen + innovated;
  amplified.state = terms + amplified.state_gain * e;
  if (holds_information()) amplified.state += lost.state;
}

// --- words ----------------------------------------------------------------------------------------------------------------

std::string largest_difference(std::string_view name, const Precise& found, const Precise& expected) {
  if (found.rows() != expected.rows() || found.cols() != expected.cols())
    return fmt::format("{} is {} x {}, expected {} x {}", name, found.rows(), found.cols(), expected.rows(),
                       expected.cols());
  const Matrix<double> X = found.rounded(), Y = expected.rounded(), off = (found - expected).rounded();
  Index row = 0, column = 0;
  for (Index i = 0; i < off.rows(); ++i)
    for (Index j = 0; j < off.cols(); ++j)
      if (!(std::abs(off(i, j)) <= std::abs(off(row, column)))) row = i, column = j;
  if (off.size() == 0) return {};
  const std::string entry = off.size() == 1   ? std::string(name)
                            : off.cols() == 1 ? fmt::format("{}[{}]", name, row)
                                              : fmt::format("{}[{},{}]", name, row, column);
  const double x = X(row, column), y = Y(row, column);
  std::string text = fmt::format("{} = {:.6g}, expected {:.6g}", entry, x, y);
  if (std::abs(off(row, column)) < 1e-3 * std::abs(y)) text += fmt::format(" (off by {:.2g})", off(row, column));
  return text;
}

double below_zero(const Precise& X) {
  // Twice the symmetric part, so that no half is needed.
  Matrix<double> twice = (X + X.transposed()).rounded(), vectors(X.rows(), X.rows());
  if (twice.rows() == 0) return 0;
  if (!symmetric_eigen(twice, vectors)) return std::numeric_limits<double>::infinity();
  return std::max(0.0, -twice.diagonal().minCoeff() / 2);
}

// --- steps ----------------------------------------------------------------------------------------------------------------

const std::vector<ObservedStep>& observed_steps(Bench& bench, const System& system) {
  const Run& run = bench.run(system);
  auto& known = bench.observed_[&run];
  if (!known) {
    const System complete = with_every_measurement(system);
    const auto exact = exact_system(complete, bench.traits().takes);
    auto steps = exact ? observe(run, bench.traits(), *exact, complete) : std::vector<ObservedStep>();
    known = std::make_shared<const std::vector<ObservedStep>>(std::move(steps));
  }
  return *known;
}

std::optional<Finding> worst_step(Bench& bench, const System& system,
                                  const std::function<std::optional<Finding>(const ObservedStep&)>& examine) {
  std::optional<Finding> worst;
  for (const ObservedStep& step : observed_steps(bench, system)) {
    auto found = examine(step);
    if (!found) continue;
    if (std::isnan(found->ratio)) found->ratio = std::numeric_limits<double>::infinity();
    if (worst && found->ratio <= worst->ratio) continue;
    found->step = step.k;
    if (!found->what.empty()) found->what = fmt::format("step {}: {}", step.k, found->what);
    worst = std::move(found);
  }
  return worst;
}

std::vector<double> asymmetric_errors(Bench& bench, const System& system) {
  const Run& run = bench.run(system);
  const Traits& subject = bench.traits();
  const Course& course = bench.course(system);
  const System complete = with_every_measurement(subject.starts_predicted ? system : delayed(system));
  std::vector<double> errors;
  double leaked = 0, D = 0;
  const auto steps = std::min(course.steps(), static_cast<std::int64_t>(run.answers.size()));
  for (std::int64_t k = 0; k < steps; ++k) {
    const Answer& answer = run.answers[static_cast<std::size_t>(k)];
    if (answer.holds == Held::covariance && subject.asymmetry != Asymmetry::none) {
      const std::int64_t step = subject.starts_predicted ? k : k + 1;
      const bool predicted = subject.instant == Instant::predicted;
      const reference::Truth& truth = course.truth(k);
      const double f = (predicted ? truth.closed_loop : truth.filtered_closed_loop).norm();
      const double a = complete.A.at(predicted || step == 0 ? step : step - 1).norm();
      const double carried = a * (1 + truth.filter_gain.lazyProduct(complete.C.at(step)).norm());
      leaked = f * f * leaked + 4 * carried * carried * D;
      D = (answer.held - answer.held.transpose()).norm();
    }
    errors.push_back(leaked + D);
  }
  return errors;
}

std::optional<Simulation> long_run(const Traits& subject, const System& system) {
  const Dimensions size = system.dimensions();
  if (!system.time_invariant() || size.n == 0 || size.p == 0 || std::max({size.n, size.m, size.p}) > 2)
    return std::nullopt;
  constexpr std::int64_t steps = 60;
  System longer = system;
  longer.steps = steps;
  longer.data = nullptr;
  longer.D = Sequence(Matrix<double>(size.n, 0));
  // The state is measured too, without noise: that tells what it is.
  System seen = longer;
  Matrix<double> C(size.p + size.n, size.n), R = Matrix<double>::Zero(size.p + size.n, size.p + size.n);
  C.topRows(size.p) = system.C.at(0);
  C.bottomRows(size.n).setIdentity();
  R.topLeftCorner(size.p, size.p) = system.R.value.at(0);
  seen.C = Sequence(C);
  seen.R.value = Sequence(R);
  const auto stream = Simulated(seen, 1986).open();
  // A filter that starts from k|k predicts before its first measurement.
  if (!subject.starts_predicted) stream->next();
  Matrix<double> y(size.p, steps), x(size.n, steps);
  for (std::int64_t k = 0; k < steps; ++k) {
    const StepData& step = stream->next();
    y.col(k) = step.y.head(size.p);
    x.col(k) = step.y.tail(size.n);
  }
  longer.data = std::make_shared<Recorded>(std::move(y), Matrix<double>(0, steps));
  return Simulation{std::move(longer), std::move(x)};
}

std::optional<std::vector<Vector<double>>> long_run_innovations(Bench& bench, const System& system) {
  const auto simulation = long_run(bench.traits(), system);
  if (!simulation || refusal(bench.traits(), simulation->system)) return std::nullopt;
  std::vector<Vector<double>> innovations;
  for (const ObservedStep& s : observed_steps(bench, simulation->system)) {
    const auto root = s.Re.lower_root();
    if (!s.x_prior || !s.update || !s.first_order() || !root) return std::nullopt;
    const double rounded = largest_ratio * s.rounding() * (s.C.norm() * s.state_amplification() + s.y->norm());
    if (!(rounded * std::sqrt(s.update->Re_inverse.norm()) <= 0.1)) return std::nullopt;
    const auto inverse = root->inverse();
    if (!inverse) return std::nullopt;
    innovations.emplace_back((*inverse * (*s.y - s.C * *s.x_prior)).rounded().col(0));
  }
  if (static_cast<std::int64_t>(innovations.size()) < simulation->system.steps) return std::nullopt;
  return innovations;
}

}  // namespace kfstab::properties
