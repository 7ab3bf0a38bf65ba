#include <kfstab/properties/comparison.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include <kfstab/filters/kernels.hpp>
#include <kfstab/filters/symmetric_eigen.hpp>
#include <kfstab/properties/data.hpp>
#include <kfstab/properties/frame.hpp>

namespace kfstab::properties {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

Matrix<double> product(const Matrix<double>& X, const Matrix<double>& Y) { return X.lazyProduct(Y); }

/// X(i, j) 2^(rows[i] + cols[j] + all); an empty list is of zeros.
Matrix<double> scaled(const Matrix<double>& X, const std::vector<int>& rows, int row_sign, const std::vector<int>& cols,
                      int col_sign, int all = 0) {
  Matrix<double> Y = X;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) {
      int exponent = all;
      if (!rows.empty()) exponent += row_sign * rows[static_cast<std::size_t>(i)];
      if (!cols.empty()) exponent += col_sign * cols[static_cast<std::size_t>(j)];
      Y(i, j) = std::ldexp(X(i, j), exponent);
    }
  return Y;
}

double data_factor(const Units& units) { return units.data == 0 ? 1 : -std::ldexp(1.0, units.data); }

Covariance in_units(const Covariance& Q, int covariance, const std::vector<int>& of_entries) {
  const bool root = Q.written == Covariance::Written::root;
  return {Q.written, mapped(Q.value, [&](const Matrix<double>& X) {
            return root ? scaled(X, of_entries, 1, {}, 0, covariance)
                        : scaled(X, of_entries, 1, of_entries, 1, 2 * covariance);
          })};
}

bool is_permutation(const Matrix<double>& T) {
  return T.unaryExpr([](double t) { return t == 0 || t == 1 ? 0.0 : 1.0; }).sum() == 0;
}

/// T Q T' as a root of T L; as it was written where T is a permutation and Q was written as a covariance. roots: Q's, for each of its
/// matrices.
Covariance in_basis(const Covariance& Q, const std::vector<Matrix<double>>& roots,
                    const std::optional<Matrix<double>>& T) {
  if (!T || T->rows() == 0) return Q;
  if (Q.written == Covariance::Written::covariance && is_permutation(*T))
    return {Q.written, mapped(Q.value, [&](const Matrix<double>& X) { return congruence(*T, X); })};
  Covariance turned{Covariance::Written::root, Q.value};
  turned.value.exact.clear();
  for (std::size_t k = 0; k < roots.size(); ++k)
    turned.value.matrices[k] = lower_root_of_gram(Matrix<double>(product(*T, roots[k]).transpose()));
  return turned;
}

/// Lower roots of each of Q's matrices; nothing where one is no covariance.
std::optional<std::vector<Matrix<double>>> roots(const Covariance& Q) {
  if (Q.written == Covariance::Written::root) return Q.value.matrices;
  std::vector<Matrix<double>> all;
  for (const Matrix<double>& X : Q.value.matrices) {
    const Precise exact(X);
    auto root = exact.lower_root();
    // As problem() has it: positive semidefinite but for its own rounding.
    if (!root)
      root = exact.with_diagonal_raised(static_cast<double>(X.rows()) * std::numeric_limits<double>::epsilon())
                 .lower_root();
    if (!root) return std::nullopt;
    all.push_back(root->rounded());
  }
  return all;
}

double norm_of_asymmetry(const Matrix<double>& P) { return (P - P.transpose()).norm(); }

std::string difference(std::string_view name, const Matrix<double>& found, const Matrix<double>& expected,
                       std::string_view because) {
  return fmt::format("{}: {}", largest_difference(name, found, expected), because);
}

}  // namespace

// --- systems in disguise --------------------------------------------------------------------------------------------------

Columns columns(const System& system) {
  const auto steps = static_cast<Index>(system.steps);
  Columns data{Matrix<double>(system.C.rows(), steps), Matrix<double>::Zero(system.inputs(), steps)};
  const auto stream = system.data->open();
  for (Index k = 0; k < steps; ++k) {
    const StepData& step = stream->next();
    data.y.col(k) = step.y;
    if (step.u.size() > 0) data.u.col(k) = step.u;
  }
  return data;
}

void set_columns(System& system, Columns data) {
  system.data = std::make_shared<Recorded>(std::move(data.y), std::move(data.u));
}

System with_data(const System& system) {
  if (system.data) return system;
  System with = system;
  const auto whole = [&](Index rows, Index first) {
    Matrix<double> X(rows, static_cast<Index>(system.steps));
    for (Index k = 0; k < X.cols(); ++k)
      for (Index i = 0; i < rows; ++i) X(i, k) = static_cast<double>((first + 3 * i + 5 * k) % 7 - 3);
    return X;
  };
  set_columns(with, {whole(system.C.rows(), 4), whole(system.inputs(), 1)});
  return with;
}

System measured(const System& system) {
  System with = with_data(system);
  Columns data = columns(with);
  if (!data.y.hasNaN()) return with;
  data.y = data.y.unaryExpr([](double y) { return std::isnan(y) ? 0.0 : y; });
  set_columns(with, std::move(data));
  return with;
}

System first_steps(const System& system, std::int64_t steps) {
  if (system.steps <= steps) return system;
  System first = system;
  first.steps = steps;
  for (Sequence* sequence : {&first.A, &first.B, &first.C, &first.D, &first.Q.value, &first.R.value, &first.P0.value})
    if (sequence->kind == Sequence::Kind::list) sequence->matrices.resize(static_cast<std::size_t>(steps));
  if (first.data) set_columns(first, columns(first));
  return first;
}

Sequence mapped(const Sequence& sequence, const std::function<Matrix<double>(const Matrix<double>&)>& map) {
  Sequence image = sequence;
  image.exact.clear();
  for (Matrix<double>& X : image.matrices) X = map(X);
  return image;
}

Covariance multiplied(const Covariance& Q, double factor) {
  const double f = Q.written == Covariance::Written::root ? std::sqrt(factor) : factor;
  return {Q.written, mapped(Q.value, [f](const Matrix<double>& X) { return Matrix<double>(f * X); })};
}

Covariance bordered(const Covariance& Q, Index more, double q) {
  const double diagonal = Q.written == Covariance::Written::root ? std::sqrt(q) : q;
  return {Q.written, mapped(Q.value, [&](const Matrix<double>& X) {
            const Index n = X.rows();
            Matrix<double> Y = Matrix<double>::Zero(n + more, n + more);
            Y.topLeftCorner(n, n) = X;
            for (Index i = n; i < n + more; ++i) Y(i, i) = diagonal;
            return Y;
          })};
}

System raised(const System& system) {
  System other = system;
  other.P0 = multiplied(system.P0, 4);
  other.Q = multiplied(system.Q, 16);
  other.R = multiplied(system.R, 64);
  return other;
}

System with_steps(const System& system, Steps steps, Columns data) {
  System other = system;
  other.steps = std::ssize(steps.A);
  const auto list = [](std::vector<Matrix<double>>& all) { return Sequence(Sequence::Kind::list, std::move(all)); };
  other.A = list(steps.A);
  other.B = list(steps.B);
  other.C = list(steps.C);
  other.D = list(steps.D);
  other.Q.value = list(steps.Q);
  other.R.value = list(steps.R);
  set_columns(other, std::move(data));
  return other;
}

System in_units(const System& system, const Units& units) {
  System other = system;
  const auto &d = units.state, &e = units.measurement;
  other.A = mapped(system.A, [&](const Matrix<double>& A) { return scaled(A, d, 1, d, -1); });
  other.B = mapped(system.B, [&](const Matrix<double>& B) { return scaled(B, d, 1, {}, 0); });
  other.C = mapped(system.C, [&](const Matrix<double>& C) { return scaled(C, e, 1, d, -1); });
  other.D = mapped(system.D, [&](const Matrix<double>& D) { return scaled(D, d, 1, {}, 0); });
  other.Q = in_units(system.Q, units.covariance, {});
  other.R = in_units(system.R, units.covariance, e);
  other.P0 = in_units(system.P0, units.covariance, d);
  const double f = data_factor(units);
  other.x0 = f * scaled(system.x0, d, 1, {}, 0);
  other.exact_x0.clear();
  if (system.data) {
    Columns data = columns(system);
    data.y = f * scaled(data.y, e, 1, {}, 0);
    data.u *= f;
    set_columns(other, std::move(data));
  }
  return other;
}

Answer in_units(const Answer& answer, const Units& units) {
  const auto &d = units.state, &e = units.measurement;
  const int c = units.covariance;
  Answer other = answer;
  switch (answer.holds) {
    case Held::covariance: other.held = scaled(answer.held, d, 1, d, 1, 2 * c); break;
    case Held::covariance_factor:
    case Held::covariance_root: other.held = scaled(answer.held, d, 1, {}, 0, c); break;
    case Held::ud_factors:
      other.held = scaled(answer.held, d, 1, d, -1);
      for (Index i = 0; i < answer.held.rows(); ++i)
        other.held(i, i) = std::ldexp(answer.held(i, i), 2 * c + (d.empty() ? 0 : 2 * d[static_cast<std::size_t>(i)]));
      break;
    case Held::information_factor: other.held = scaled(answer.held, {}, 0, d, -1, -c); break;
    case Held::information: other.held = scaled(answer.held, d, -1, d, -1, -2 * c); break;
    case Held::gain: break;
  }
  // Of an answer in which the gain's columns are not the measurements (some are missing) nothing can be said.
  if (answer.gain && (e.empty() || answer.gain->cols() == static_cast<Index>(e.size())))
    other.gain = scaled(*answer.gain, d, 1, e, -1);
  else
    other.gain.reset();
  if (answer.state) other.state = data_factor(units) * scaled(*answer.state, d, 1, {}, 0);
  return other;
}

std::optional<System> in_bases(const System& system, const Bases& bases) {
  const auto Q = roots(system.Q), R = roots(system.R), P0 = roots(system.P0);
  if (!Q || !R || !P0) return std::nullopt;
  System other = system;
  const auto from_left = [](const std::optional<Matrix<double>>& T, const Matrix<double>& X) {
    return T ? product(*T, X) : X;
  };
  const auto from_right = [](const Matrix<double>& X, const std::optional<Matrix<double>>& T) {
    return T ? product(X, T->transpose()) : X;
  };
  const auto &T = bases.T, &M = bases.M, &V = bases.V;
  other.A = mapped(system.A, [&](const Matrix<double>& A) { return from_right(from_left(T, A), T); });
  other.B = mapped(system.B, [&](const Matrix<double>& B) { return from_right(from_left(T, B), V); });
  other.C = mapped(system.C, [&](const Matrix<double>& C) { return from_right(from_left(M, C), T); });
  other.D = mapped(system.D, [&](const Matrix<double>& D) { return from_left(T, D); });
  other.Q = in_basis(system.Q, *Q, V);
  other.R = in_basis(system.R, *R, M);
  other.P0 = in_basis(system.P0, *P0, T);
  other.x0 = from_left(T, system.x0);
  other.exact_x0.clear();
  if (M && system.data) {
    Columns data = columns(system);
    data.y = product(*M, data.y);
    set_columns(other, std::move(data));
  }
  return other;
}

Matrix<double> reflection(Index n) {
  Vector<double> v(n);
  for (Index i = 0; i < n; ++i) v(i) = static_cast<double>(1 + i % 3);
  Matrix<double> H = Matrix<double>::Identity(n, n);
  if (n > 0) H -= Matrix<double>(2 / v.squaredNorm() * v.lazyProduct(v.transpose()));
  return H;
}

Matrix<double> cycle(Index n) {
  Matrix<double> T = Matrix<double>::Zero(n, n);
  for (Index i = 0; i < n; ++i) T((i + 1) % n, i) = 1;
  return T;
}

// --- answers that are compared --------------------------------------------------------------------------------------------

Values values(const Answer& answer) {
  Values all;
  if (answer.holds == Held::covariance) {
    all.P = answer.held;
  } else if (const auto P = covariance(answer)) {
    all.P = P->rounded();
  }
  if (answer.gain) all.K = *answer.gain;
  if (answer.state) all.x = *answer.state;
  return all;
}

std::vector<Tolerance> tolerances(Bench& bench, const System& system, const System& whole) {
  const Course& course = bench.course(whole);
  const Run& run = bench.run(system);
  const Traits& traits = bench.traits();
  const Dimensions size = system.dimensions();
  const double u = traits.roundoff * static_cast<double>(size.n + size.m + size.p);
  const bool predicted = traits.instant == Instant::predicted, predictor = traits.gain != GainKind::filter;
  const bool inverts = traits.holds == Held::information || traits.holds == Held::information_factor;
  // A filter that starts predicted and answers P_{k|k} comes by the dynamics of the step before, in its first step by none.
  const bool late = !predicted && traits.starts_predicted;
  const System complete = with_every_measurement(system);
  const auto converted = problem(complete, Parametrisation::covariance);
  if (!std::holds_alternative<AnyProblem<double>>(converted)) return {};
  const auto& numbers = std::get<Problem<CovarianceModel<double>>>(std::get<AnyProblem<double>>(converted));
  const Columns data = complete.data ? columns(complete) : Columns();

  std::vector<Tolerance> all;
  Matrix<double> W = u * numbers.initial.norm() * Matrix<double>::Identity(size.n, size.n);
  double x_error = u * system.x0.norm();
  bool over = false;
  const auto steps = std::min(course.steps(), static_cast<std::int64_t>(run.answers.size()));
  for (std::int64_t k = 0; k < steps; ++k) {
    const reference::Truth& truth = course.truth(k);
    const Answer& answer = run.answers[static_cast<std::size_t>(k)];
    const Answer* before = k > 0 ? &run.answers[static_cast<std::size_t>(k - 1)] : nullptr;
    const CovarianceModel<double>& now = numbers.model(k);
    const CovarianceModel<double>& dynamics = late && k > 0 ? numbers.model(k - 1) : now;
    const bool predicts = !(late && k == 0);
    const double A = predicts ? dynamics.A.norm() : 1, B = predicts ? dynamics.B.norm() : 0, C = now.C.norm();
    const double R = now.R.norm(), Q = dynamics.Q.norm(), Kf = truth.filter_gain.norm();
    const double P = course.P(k).norm(), K = course.K(k).norm(), Pf = truth.P_filtered.norm();
    const Matrix<double> I_KC = Matrix<double>::Identity(size.n, size.n) - product(truth.filter_gain, now.C);
    const Matrix<double>& F = predicted ? truth.closed_loop : truth.filtered_closed_loop;
    const double re = truth.innovation.norm(), re_inverse = re > 0 ? truth.innovation_condition / re : 0;

    const double of_measurement = Kf * (Kf * R + 2 * C * Pf);
    const double P_before = k > 0 ? course.P(k - 1).norm() : numbers.initial.norm();
    const double of_dynamics = 2 * A * A * (predicted ? Pf : P_before) + 2 * B * B * Q;
    const double local =
        predicted ? of_dynamics + A * A * of_measurement : I_KC.squaredNorm() * of_dynamics + of_measurement;
    const double prior_error = predicted ? W.norm() : A * A * W.norm() + u * of_dynamics;
    W = congruence(F, W) + u * local * Matrix<double>::Identity(size.n, size.n);
    const double P_bound = std::isnan(course.P_bound(k)) ? 0 : course.P_bound(k);
    Tolerance tolerance{P_bound + W.norm() + u * P, 0, 0};

    // K = (A) P C' Re^{-1}.
    const double a = predictor ? now.A.norm() : 1, through = predictor ? truth.closed_loop.norm() : I_KC.norm();
    tolerance.K = course.K_bound(k) + through * prior_error * C * re_inverse +
                  u * (2 * K + a * Kf + a * Pf * C * re_inverse + K * (C * Kf + R * re_inverse));
    const bool has_state = complete.data && answer.state && (!before || before->state);
    if (has_state) {
      const Vector<double>& x = before ? *before->state : system.x0;
      const Index column = late && k > 0 ? k - 1 : k;
      const Vector<double> Du =
          data.u.rows() > 0 && predicts ? product(dynamics.D, data.u.col(column)) : Vector<double>::Zero(size.n);
      const Vector<double> prior = predicted || !predicts ? x : Vector<double>(product(dynamics.A, x) + Du);
      const double e = (data.y.col(k) - product(now.C, prior)).norm();
      const auto [own, gain_error] = gain_of_state(
          predicted ? Instant::predicted : Instant::filtered, predictor ? GainKind::predictor : GainKind::filter, truth, A,
          tolerance.K);
      const double Du_terms = dynamics.D.norm() * (data.u.rows() > 0 ? data.u.col(column).norm() : 0);
      const double moved = A * (predicted ? x.norm() + Kf * e : x.norm()) + (predicts ? Du_terms : 0);
      const double innovation = data.y.col(k).norm() + C * prior.norm();
      const double whitening = whitens(traits) && now.R.rows() > 0 ? std::sqrt(Precise(now.R).condition()) : 1;
      double rounded = moved + own * whitening * innovation;
      if (inverts) {
        // x is solved for with what P^{-1} is made of, and R^{-1/2} y comes to it by T^{-1}, however small the gain is; by
        // P R^{-T/2}, as Course has it, where Y is held.
        const double enlarged = P > 0 ? std::max(1.0, P_bound / (u * P)) : 1;
        rounded *= enlarged;
        const auto R_inverse = Precise(now.R).inverse();
        const double whitened = R_inverse ? std::sqrt(Pf * R_inverse->norm()) * innovation : infinity;
        rounded += (predicted ? A : 1) * whitened * (traits.holds == Held::information ? std::sqrt(enlarged) : 1);
      }
      x_error = F.norm() * x_error + gain_error * e + 2 * u * rounded;
      tolerance.x = x_error + u * answer.state->norm();
    }
    const double thirty = largest_ratio * tolerance.P;
    if (answer.holds == Held::covariance && norm_of_asymmetry(answer.held) > tolerance.P) over = true;
    if ((thirty > P / 8 && P > 0) || thirty * C * C * re_inverse > 1.0 / 8) over = true;
    if (!(tolerance.P < infinity && tolerance.K < infinity && tolerance.x < infinity)) over = true;
    all.push_back(over ? Tolerance{infinity, infinity, infinity} : tolerance);
  }
  return all;
}

std::vector<Tolerance> tolerances(Bench& bench, const System& system) { return tolerances(bench, system, system); }

bool small(const System& system) {
  const Dimensions size = system.dimensions();
  return std::max({size.n, size.m, size.p}) <= 4;
}

System counted(const System& system) { return system.data && columns(system).y.hasNaN() ? measured(system) : system; }

bool bits_count(const Traits& traits) { return traits.asymmetry.has_value(); }

void Comparison::add(Finding finding) {
  if (std::isnan(finding.ratio)) finding.ratio = infinity;
  if (!worst_ || finding.ratio > worst_->ratio) worst_ = std::move(finding);
}

void Comparison::add(std::int64_t step, std::string_view name, const Matrix<double>& found,
                     const Matrix<double>& expected, double tolerance, std::string_view because) {
  if (found.size() == 0 || expected.size() == 0 || tolerance == infinity) return;
  if (found.rows() != expected.rows() || found.cols() != expected.cols()) return;
  const double error = (found - expected).norm();
  // Where underflow decides, nothing can be said.
  if (error == 0 || tolerance < std::numeric_limits<double>::min()) return add(Finding{0, step, {}});
  const double ratio = error / tolerance;
  add(Finding{ratio, step, ratio > largest_ratio ? difference(name, found, expected, because) : std::string()});
}

void Comparison::add(std::int64_t step, const Values& found, const Values& expected, const Tolerance& tolerance,
                     std::string_view because) {
  add(step, "P", found.P, expected.P, tolerance.P, because);
  add(step, "K", found.K, expected.K, tolerance.K, because);
  add(step, "x", found.x, expected.x, tolerance.x, because);
}

void Comparison::add_bits(std::int64_t step, std::string_view name, const Matrix<double>& found,
                          const Matrix<double>& expected, std::string_view because) {
  if (found.rows() != expected.rows() || found.cols() != expected.cols()) return;
  if (found == expected) return add(Finding{0, step, {}});
  add(Finding{infinity, step, difference(name, found, expected, because)});
}

void Comparison::add_order(std::int64_t step, std::string_view name, const Matrix<double>& found,
                           const Matrix<double>& least, double tolerance, std::string_view because) {
  if (found.size() == 0 || least.size() == 0 || tolerance == infinity) return;
  Matrix<double> X = (found - least + (found - least).transpose()) / 2, vectors(X.rows(), X.rows());
  if (!symmetric_eigen(X, vectors)) return;
  Index at = 0;
  const double smallest = X.diagonal().minCoeff(&at);
  if (smallest >= 0 || tolerance < std::numeric_limits<double>::min()) return add(Finding{0, step, {}});
  const double ratio = -smallest / tolerance;
  add(Finding{ratio, step,
              ratio > largest_ratio ? fmt::format("{} has the eigenvalue {:.6g}: {}", name, smallest, because)
                                    : std::string()});
}

// --- runs that are compared -----------------------------------------------------------------------------------------------

namespace {

/// Whether some number is so small that its square underflows: then scaling rounds. Kernels give up before, and the plain text,
/// which takes over, sums in another order: there scaling changes bits too.
bool too_small(const Matrix<double>& X) {
  const double least = std::ldexp(1.0, kernels::in_use() ? -230 : -500);
  return (X.array() != 0 && X.array().abs() < least).any();
}

bool too_small(const Answer& answer) {
  return too_small(answer.held) || (answer.gain && too_small(*answer.gain)) ||
         (answer.state && too_small(*answer.state));
}

/// Nothing is compared any more once numbers are too small: false.
bool add_all_bits(Comparison& comparison, std::int64_t k, const Answer& found, const Answer& expected,
                  std::string_view because) {
  if (too_small(found) || too_small(expected)) return false;
  const char* held = holds_root(found.holds) ? "S" : found.holds == Held::covariance ? "P" : "Y or T";
  if (found.holds == expected.holds) comparison.add_bits(k, held, found.held, expected.held, because);
  if (found.gain && expected.gain) comparison.add_bits(k, "K", *found.gain, *expected.gain, because);
  if (found.state && expected.state) comparison.add_bits(k, "x", *found.state, *expected.state, because);
  return true;
}

}  // namespace

std::optional<Finding> compare_units(Bench& bench, const System& system, const System& whole, const Units& units,
                                     bool bits) {
  const Run& base = bench.run(system);
  const System other = in_units(system, units);
  const Run& run = bench.run(other);
  Comparison comparison;
  constexpr std::string_view because = "in other units, brought back";
  const std::size_t steps = std::min(run.answers.size(), base.answers.size());
  if (bits && bits_count(bench.traits())) {
    for (std::size_t k = 0; k < steps; ++k)
      if (!add_all_bits(comparison, static_cast<std::int64_t>(k), run.answers[k], in_units(base.answers[k], units),
                        because))
        return comparison.worst();
    // What is estimated of a condition number, and so where a filter gives up, depends on the units of its entries.
    const bool of_entries = !units.state.empty() || !units.measurement.empty();
    if (!of_entries && run.answers.size() != base.answers.size())
      comparison.add(Finding{
          infinity, static_cast<std::int64_t>(steps),
          fmt::format("{}, in the units of before {}", run.ending.reason.empty() ? "an answer" : run.ending.reason,
                      base.ending.reason.empty() ? "an answer" : base.ending.reason)});
    return comparison.worst();
  }
  const auto before = tolerances(bench, system, whole), now = tolerances(bench, other);
  int largest_state = 0, largest_inverse = 0;
  for (const int d : units.state) largest_state = std::max(largest_state, d);
  for (const int e : units.measurement) largest_inverse = std::max(largest_inverse, -e);
  const double d = std::ldexp(1.0, largest_state), e = std::ldexp(1.0, largest_inverse);
  for (std::size_t k = 0; k < std::min({steps, before.size(), now.size()}); ++k) {
    const Tolerance both{before[k].P * d * d * std::ldexp(1.0, 2 * units.covariance) + now[k].P,
                         before[k].K * d * e + now[k].K, before[k].x * d * std::abs(data_factor(units)) + now[k].x};
    comparison.add(static_cast<std::int64_t>(k), values(run.answers[k]), values(in_units(base.answers[k], units)), both,
                   because);
  }
  return comparison.worst();
}

std::optional<Finding> compare_bases(Bench& bench, const System& system, const System& whole, const Bases& bases,
                                     std::string_view because) {
  const auto other = in_bases(system, bases);
  if (!other) return std::nullopt;
  const Run& base = bench.run(system);
  const Run& run = bench.run(*other);
  const auto tolerance = tolerances(bench, system, whole);
  const std::size_t steps = std::min({run.answers.size(), base.answers.size(), tolerance.size()});
  Comparison comparison;
  for (std::size_t k = 0; k < steps; ++k) {
    Values expected = values(base.answers[k]);
    if (bases.T && expected.P.size() > 0) expected.P = congruence(*bases.T, expected.P);
    if (bases.T && expected.K.size() > 0) expected.K = product(*bases.T, expected.K);
    if (bases.M && expected.K.size() > 0)
      expected.K = expected.K.cols() == bases.M->cols() ? product(expected.K, bases.M->transpose()) : Matrix<double>();
    if (bases.T && expected.x.size() > 0) expected.x = product(*bases.T, expected.x);
    const Tolerance& b = tolerance[k];
    comparison.add(static_cast<std::int64_t>(k), values(run.answers[k]), expected, {2 * b.P, 2 * b.K, 2 * b.x},
                   because);
  }
  return comparison.worst();
}

std::optional<Finding> compare_again(Bench& bench, const System& system, const System& whole, const Run& found,
                                     const Run& expected, std::string_view because) {
  const std::size_t steps = std::min(found.answers.size(), expected.answers.size());
  Comparison comparison;
  if (bits_count(bench.traits())) {
    for (std::size_t k = 0; k < steps; ++k)
      if (!add_all_bits(comparison, static_cast<std::int64_t>(k), found.answers[k], expected.answers[k], because))
        return comparison.worst();
  } else {
    const auto tolerance = tolerances(bench, system, whole);
    for (std::size_t k = 0; k < std::min(steps, tolerance.size()); ++k)
      comparison.add(static_cast<std::int64_t>(k), values(found.answers[k]), values(expected.answers[k]), tolerance[k],
                     because);
  }
  if (found.answers.size() != expected.answers.size())
    comparison.add(Finding{
        infinity, static_cast<std::int64_t>(steps),
        fmt::format("{} in one run, {} in the other", found.ending.reason.empty() ? "an answer" : found.ending.reason,
                    expected.ending.reason.empty() ? "an answer" : expected.ending.reason)});
  return comparison.worst();
}

std::optional<Finding> compare_moved(Bench& bench, const System& system, const System& whole, const System& other,
                                     const std::vector<Vector<double>>& moved, std::string_view because) {
  const Run& expected = bench.run(system);
  const Run& found = bench.run(other);
  const auto before = tolerances(bench, system, whole), now = tolerances(bench, other, whole);
  const double u = bench.traits().roundoff;
  Comparison comparison;
  for (std::size_t k = 0; k < std::min({found.answers.size(), expected.answers.size(), before.size(), now.size()});
       ++k) {
    Values there = values(expected.answers[k]);
    if (there.x.size() > 0) there.x += moved[k];
    comparison.add(static_cast<std::int64_t>(k), values(found.answers[k]), there,
                   {before[k].P + now[k].P, before[k].K + now[k].K, before[k].x + now[k].x + u * moved[k].norm()},
                   because);
  }
  return comparison.worst();
}

}  // namespace kfstab::properties
