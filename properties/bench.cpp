#include <kfstab/properties/bench.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <kfstab/properties/data.hpp>
#include <kfstab/properties/precise.hpp>
#include <kfstab/reference/bounds.hpp>
#include <kfstab/reference/definiteness.hpp>
#include <kfstab/reference/trajectory.hpp>

namespace kfstab::properties {

namespace {

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

bool same(const Sequence& a, const Sequence& b) {
  return a.kind == b.kind && a.rows() == b.rows() && a.cols() == b.cols() && a.matrices == b.matrices;
}

bool same(const Covariance& a, const Covariance& b) { return a.written == b.written && same(a.value, b.value); }

/// NaNs, which stand for what is missing, are equal here.
bool same(const Vector<double>& a, const Vector<double>& b) {
  return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), [](double x, double y) {
           return x == y || (std::isnan(x) && std::isnan(y));
         });
}

bool same_data(const System& a, const System& b) {
  if (a.data == b.data) return true;
  if (!a.data || !b.data) return false;
  const auto first = a.data->open(), second = b.data->open();
  for (std::int64_t k = 0; k < a.steps; ++k) {
    const StepData &x = first->next(), &y = second->next();
    if (!same(x.y, y.y) || !same(x.u, y.u)) return false;
  }
  return true;
}

double norm(const Covariance& Q, std::int64_t k) {
  const Matrix<double>& X = Q.value.at(k);
  return Q.written == Covariance::Written::root ? X.lazyProduct(X.transpose()).norm() : X.norm();
}

/// k(R^{1/2}) where the subject whitens by it, else 1.
double condition_of_whitening(const Traits& traits, const System& complete, std::int64_t k) {
  if (!whitens(traits) || complete.R.value.rows() == 0) return 1;
  const Precise X(complete.R.value.at(k));
  return std::sqrt((complete.R.written == Covariance::Written::root ? X * X.transposed() : X).condition());
}

/// The bounds of the forms that hold P or a root of it: what each step commits by the tolerance of law one-step, carried on by
/// F, theory (4.4), and of the gain, (4.6).
class CovarianceBounds {
 public:
  CovarianceBounds(const Traits& traits, GainKind gain, const System& complete, double rounding)
      : traits_(traits), predictor_(gain == GainKind::predictor), system_(complete), rounding_(rounding),
        W_(Matrix<double>::Zero(complete.A.rows(), complete.A.rows())) {}

  void advance(std::int64_t k, const reference::Truth& truth) {
    const bool predicted = traits_.instant == Instant::predicted;
    const std::int64_t dynamics = predicted || k == 0 ? k : k - 1;
    const bool predicts = predicted || k > 0;
    const Matrix<double>&A = system_.A.at(dynamics), &C = system_.C.at(k);
    const double a = A.norm(), b = system_.B.at(dynamics).norm(), c = C.norm();
    const double P = predicted ? truth.P_predicted.norm() : before_ < 0 ? truth.P_predicted.norm() : before_;
    const double moved = a * a * P + b * b * norm(system_.Q, dynamics), formed = predicts ? moved : P;
    const double prior = predicted ? P : formed, r = norm(system_.R, k) + c * c * prior;
    const auto p = static_cast<double>(C.rows());
    const double Re_inverse =
        C.rows() == 0 ? 0 : std::sqrt(p) * truth.innovation_condition / reference::two_norm(truth.innovation);
    const double kappa = C.rows() == 0 ? 1 : r * Re_inverse, Kf = truth.filter_gain.norm();
    const double removed = (truth.P_predicted - truth.P_filtered).norm();
    // As ObservedStep has it.
    const double Pf = truth.P_filtered.norm(), whitening = condition_of_whitening(traits_, system_, k);
    const double whitened_P = whitening > 1 ? whitening * 2 * Kf * c * Pf * (predicted ? a * a : 1) : 0;
    const double whitened_K =
        whitening > 1 ? whitening * (Kf + c * (Pf * Re_inverse + Kf * Kf)) * (predictor_ ? a : 1) : 0;
    const double local = holds_root(traits_.holds) ? (1 + std::sqrt(kappa)) * formed + whitened_P
                                                   : kappa * (formed + removed * (predicted ? a * a : 1));

    const Index n = W_.rows();
    const Matrix<double> I = Matrix<double>::Identity(n, n);
    const Matrix<double> of_prior =
        predicted || !predicts ? W_ : Matrix<double>(congruence(A, W_) + rounding_ * moved * I);
    const Matrix<double> F = predictor_ ? truth.closed_loop : Matrix<double>(I - truth.filter_gain.lazyProduct(C));
    const double carried = Re_inverse * std::sqrt(std::max(0.0, congruence(F, of_prior).trace()) *
                                                  std::max(0.0, congruence(C, of_prior).trace()));
    const double own = predictor_ ? a * Kf * r + std::sqrt(r * moved) : Kf * r + std::sqrt(r * prior);
    gain_ = carried + rounding_ * (own * Re_inverse + whitened_K);
    G_ += rounding_ * own;
    Re_ += rounding_ * r;
    undamped_ = (G_ + a * Kf * Re_) * Re_inverse;
    W_ = congruence(predicted ? truth.closed_loop : truth.filtered_closed_loop, W_) + rounding_ * local * I;
    before_ = truth.P_filtered.norm();
  }

  double P() const { return W_.norm(); }
  double K() const { return gain_; }
  /// The same of a form that holds K Re^{1/2} and Re^{1/2} and adds to them: what was wrong with them once stays.
  double undamped_K() const { return undamped_; }

 private:
  const Traits& traits_;
  bool predictor_;
  const System& system_;
  double rounding_, gain_ = 0, G_ = 0, Re_ = 0, undamped_ = 0, before_ = -1;
  Matrix<double> W_;
};

double norm_of_inverse(const Covariance& R, std::int64_t k) {
  const Precise X(R.value.at(k));
  const auto inverse = (R.written == Covariance::Written::root ? X * X.transposed() : X).inverse();
  return inverse ? inverse->norm() : std::numeric_limits<double>::infinity();
}

}  // namespace

bool same_numbers(const System& a, const System& b) {
  return a.steps == b.steps && same(a.A, b.A) && same(a.B, b.B) && same(a.C, b.C) && same(a.D, b.D) && same(a.Q, b.Q) &&
         same(a.R, b.R) && same(a.P0, b.P0) && same(a.x0, b.x0) && same_data(a, b);
}

bool whitens(const Traits& subject) { return holds_root(subject.holds) && subject.needs.positive_definite_R; }

GainOfState gain_of_state(Instant instant, GainKind answered, const reference::Truth& truth, double A, double K_error) {
  if (instant == Instant::predicted && answered == GainKind::filter)
    return {A * truth.filter_gain.norm(), A * K_error};
  const double K = (answered == GainKind::predictor ? truth.predictor_gain : truth.filter_gain).norm();
  const double own = (instant == Instant::predicted ? truth.predictor_gain : truth.filter_gain).norm();
  return {own, K > 0 ? K_error / K * own : K_error};
}

System delayed(const System& system) {
  System later = system;
  const std::int64_t steps = system.steps;
  later.steps = steps + 1;
  const auto list = [](std::vector<Matrix<double>> all) { return Sequence(Sequence::Kind::list, std::move(all)); };
  // The time update of step k is that after step k now; the last is of no matter.
  for (Sequence* sequence : {&later.A, &later.B, &later.D, &later.Q.value}) {
    auto all = sequence->unrolled(steps).matrices;
    all.push_back(all.back());
    *sequence = list(std::move(all));
  }
  auto C = system.C.unrolled(steps).matrices, R = system.R.value.unrolled(steps).matrices;
  C.insert(C.begin(), Matrix<double>::Zero(system.C.rows(), system.C.cols()));
  R.insert(R.begin(), R.front());
  later.C = list(std::move(C));
  later.R.value = list(std::move(R));
  if (system.data) {
    Matrix<double> y = Matrix<double>::Zero(system.C.rows(), later.steps),
                   u = Matrix<double>::Zero(system.inputs(), later.steps);
    const auto stream = system.data->open();
    for (std::int64_t k = 0; k < steps; ++k) {
      const StepData& step = stream->next();
      y.col(k + 1) = step.y;
      if (step.u.size() > 0) u.col(k) = step.u;
    }
    later.data = std::make_shared<Recorded>(std::move(y), std::move(u));
  }
  return later;
}

// --- truths -------------------------------------------------------------------------------------------------------------

std::shared_ptr<const std::vector<reference::Truth>> Truths::of(const System& system, Parametrisation takes) {
  for (const Entry& entry : entries_)
    if (entry.takes == takes && same_numbers(entry.system, system)) return entry.truths;
  auto truths = std::make_shared<std::vector<reference::Truth>>();
  const System complete = with_every_measurement(system);
  const auto converted = problem(complete, takes);
  if (const auto* numbers = std::get_if<AnyProblem<double>>(&converted)) {
    try {
      reference::Trajectory trajectory(*numbers, complete.data, {.digits = 20});
      for (std::int64_t k = 0; k < complete.steps; ++k) {
        trajectory.advance();
        truths->push_back(trajectory.truth());
      }
    } catch (const reference::ReferenceError&) {
      // Beyond here nothing is known.
    }
  }
  entries_.push_back({system, takes, truths});
  return truths;
}

const Matrix<double>& Course::P(std::int64_t k) const {
  return instant_ == Instant::predicted ? truth(k).P_next : truth(k).P_filtered;
}
const Matrix<double>& Course::K(std::int64_t k) const {
  return gain_ == GainKind::predictor ? truth(k).predictor_gain : truth(k).filter_gain;
}
const Vector<double>& Course::x(std::int64_t k) const {
  return instant_ == Instant::predicted ? truth(k).x_next : truth(k).x_filtered;
}

const Course& Bench::course(const System& system) {
  for (const auto& [known, course] : courses_)
    if (same_numbers(known, system)) return *course;
  const Traits& t = traits();
  auto course = std::make_unique<Course>();
  course->instant_ = t.instant;
  course->gain_ = t.gain.value_or(GainKind::predictor);
  course->offset_ = t.starts_predicted ? 0 : 1;
  const System run = t.starts_predicted ? system : delayed(system);
  const auto truths = truths_.of(run, t.takes);
  course->truths_ = *truths;

  // A foreign filter that inverts its model commits the errors of one that is given the inverses.
  const bool inverts = t.holds == Held::information || t.holds == Held::information_factor;
  const auto of_form = inverts ? truths_.of(run, Parametrisation::information) : truths;
  const System complete = with_every_measurement(run);
  const Dimensions size = system.dimensions();
  const double rounding = t.roundoff * static_cast<double>(size.n + size.m + size.p);
  Metadata form;
  form.holds = t.holds == Held::gain ? Held::covariance : t.holds;
  form.instant = t.instant;
  form.gain = course->gain_;
  reference::FirstOrderBound bound(form, size, t.roundoff);
  CovarianceBounds of_covariance(t, course->gain_, complete, rounding);
  const auto stream = complete.data ? complete.data->open() : nullptr;
  // moved: how large the terms are that x_{k|k-1} is made of.
  double x = 0, remembered = 0, moved = system.x0.norm();
  for (std::size_t k = 0; k < truths->size(); ++k) {
    const auto step = static_cast<std::int64_t>(k);
    const reference::Truth& truth = (*truths)[k];
    Course::Bounds now{not_a_number, not_a_number, not_a_number};
    if (k >= of_form->size()) {
      course->bounds_.push_back(now);
      continue;
    }
    const reference::Truth& formed = (*of_form)[k];
    const bool predicted = t.instant == Instant::predicted;
    const Matrix<double>& P = predicted ? truth.P_next : truth.P_filtered;
    const Matrix<double>&A = complete.A.at(step), &C = complete.C.at(step);
    if (inverts) {
      now.P = bound.advance(formed) * P.norm();
      // Kf = P_{k|k} C' R^{-1}
      now.K = (now.P + rounding * truth.P_filtered.norm()) * C.norm() * norm_of_inverse(complete.R, step) *
              (course->gain_ == GainKind::predictor ? A.norm() : 1);
    } else {
      of_covariance.advance(step, truth);
      now.P = of_covariance.P();
      now.K = of_covariance.K();
    }
    if (t.holds == Held::gain) {
      // What it was started with comes off again piece by piece: no error is forgotten, theory 3.
      remembered += rounding * truth.innovation_condition *
                    (A.norm() * A.norm() * truth.P_predicted.norm() + truth.P_next.norm()) / std::pow(truth.cosine, 2);
      now.K = std::max(now.K, remembered * A.norm() * C.norm() * truth.innovation_condition /
                                  std::max(truth.innovation.norm(), 1e-300)) +
              of_covariance.undamped_K();
      now.P = not_a_number;
    }
    if (stream) {
      const StepData& data = stream->next();
      const double e = (data.y - C.lazyProduct(truth.x_predicted)).norm();
      const double Du = data.u.size() > 0 ? complete.D.at(step).norm() * data.u.norm() : 0;
      const double innovation = data.y.norm() + C.norm() * truth.x_predicted.norm();
      const auto [own_K, gain_error] = gain_of_state(t.instant, course->gain_, truth, A.norm(), now.K);
      const Matrix<double>& F = predicted ? truth.closed_loop : truth.filtered_closed_loop;
      const double terms = predicted ? A.norm() * truth.x_predicted.norm() + Du : truth.x_predicted.norm();
      double local = terms + condition_of_whitening(t, complete, step) * own_K * innovation;
      if (inverts) {
        // x = T^{-1} z of an array that rounds T and z alike, by `amplified` relative to T; and R^{-1/2} y comes to z as it is,
        // however small the gain. What holds Y and d = Y x in their place, x = Y^{-1} d, has the square of both,
        // dx = P (dd - dY x): d loses with Y what Y - W W' cancels, theory (2.11), and is of the terms of x_{k|k-1}.
        const bool squared = t.holds == Held::information;
        const double P_filtered = truth.P_filtered.norm(), amplified = formed.information_loss.amplification();
        const double whitened = (predicted ? A.norm() : 1) * innovation *
                                std::sqrt(P_filtered * norm_of_inverse(complete.R, step));
        const double condition = formed.information.norm() * P.norm();
        local = squared ? 2 * amplified * amplified * condition * (std::max(terms, moved) + own_K * innovation) +
                              amplified * std::sqrt(condition) * whitened
                        : amplified * condition * local + whitened;
      }
      x = F.norm() * x + gain_error * e + rounding * local;
      now.x = x;
      moved = A.norm() * truth.x_filtered.norm() + Du;
      if (!predicted) x += rounding * moved;  // of the prediction that comes next
    }
    course->bounds_.push_back(now);
  }
  courses_.emplace_back(system, std::move(course));
  return *courses_.back().second;
}

// --- runs ---------------------------------------------------------------------------------------------------------------

Run Bench::rerun(const System& system, const std::vector<System>& beside) {
  std::vector<System> all{system};
  all.insert(all.end(), beside.begin(), beside.end());
  auto runs = subject_.run_all(all);
  for (const Run& run : runs) steps_ += static_cast<std::int64_t>(run.answers.size());
  return std::move(runs.front());
}

void Bench::run_ahead(const std::vector<System>& systems) {
  ahead_ = subject_.run_all(systems);
  for (const Run& run : ahead_) steps_ += static_cast<std::int64_t>(run.answers.size());
}

const Run& Bench::run(const System& system) {
  for (const auto& known : runs_)
    if (same_numbers(known->system, system)) return *known;
  const auto ahead = std::ranges::find_if(ahead_, [&](const Run& run) { return same_numbers(run.system, system); });
  if (ahead == ahead_.end()) return *runs_.emplace_back(std::make_unique<Run>(rerun(system)));
  runs_.push_back(std::make_unique<Run>(std::move(*ahead)));
  ahead_.erase(ahead);
  return *runs_.back();
}

void Bench::forget() {
  observed_.clear();
  runs_.clear();
  courses_.clear();
}

}  // namespace kfstab::properties
