#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include <kfstab/filters/registry.hpp>

namespace kfstab::properties {

namespace {

Precise lower(const Matrix<double>& L) { return Matrix<double>(L.triangularView<Eigen::Lower>()); }
Precise upper(const Matrix<double>& U) { return Matrix<double>(U.triangularView<Eigen::Upper>()); }
Precise square(const Precise& L) { return L * L.transposed(); }

/// P from what is held.
Precise covariance(Held holds, const Matrix<double>& held) {
  switch (holds) {
    case Held::covariance_factor: return square(lower(held));
    case Held::covariance_root: return square(held);
    case Held::ud_factors: {
      const Index n = held.rows();
      Matrix<double> U = Matrix<double>::Identity(n, n), D = Matrix<double>::Zero(n, n);
      for (Index j = 0; j < n; ++j) {
        D(j, j) = held(j, j);
        for (Index i = 0; i < j; ++i) U(i, j) = held(i, j);
      }
      return Precise(U) * Precise(D) * Precise(U).transposed();
    }
    default: return held;
  }
}

Precise innovation(const Precise& R, const Precise& C, const Precise& P) { return R + C * P * C.transposed(); }

ObservedStep observe(const Metadata& filter, const Problem<CovarianceModel<double>>& problem, std::int64_t k,
                     const Matrix<double>& before, const Step<double>& step) {
  const auto& model = problem.model(k);
  const Precise P(before), R(model.R), C(model.C);
  CovarianceStep seen{model.A, model.B, C, model.Q, R, P, *step.held, *step.gain, innovation(R, C, P)};
  return {filter, model.dimensions(), k, std::move(seen), std::nullopt};
}

ObservedStep observe(const Metadata& filter, const Problem<RootModel<double>>& problem, std::int64_t k,
                     const Matrix<double>& before, const Step<double>& step) {
  const auto& model = problem.model(k);
  // The initial condition is a root, whatever the filter holds.
  const Precise P = k == 0 ? square(lower(before)) : covariance(filter.holds, before);
  const Precise P_plus = covariance(filter.holds, *step.held);
  const Precise R = square(lower(model.R_root)), C(model.C);
  CovarianceStep seen{model.A, model.B, C, square(lower(model.Q_root)), R, P, P_plus, *step.gain, innovation(R, C, P)};
  return {filter, model.dimensions(), k, std::move(seen), std::nullopt};
}

ObservedStep observe(const Metadata& filter, const Problem<InformationModel<double>>& problem, std::int64_t k,
                     const Matrix<double>& before, const Step<double>& step) {
  const auto& dynamics = problem.model(std::max<std::int64_t>(k - 1, 0));
  const auto& model = problem.model(k);
  const auto information = [&](const Matrix<double>& held, bool initial) {
    const bool factor = initial || filter.holds == Held::information_factor;
    return factor ? upper(held).transposed() * upper(held) : Precise(held);
  };
  InformationStep seen{dynamics.A_inverse,
                       dynamics.A_inverse_B,
                       model.C,
                       upper(dynamics.Q_inverse_root),
                       upper(model.R_inverse_root),
                       information(before, k == 0),
                       information(*step.held, false),
                       *step.gain};
  return {filter, model.dimensions(), k, std::nullopt, std::move(seen)};
}

void judge(LawReport& report, const ObservedStep& step) {
  for (LawResult& result : report.results) {
    const auto ratio = result.law.ratio(step);
    if (!ratio) continue;
    ++result.steps;
    const double value = std::isnan(*ratio) ? std::numeric_limits<double>::infinity() : *ratio;
    if (value > result.worst || result.worst_step < 0) {
      result.worst = value;
      result.worst_step = step.k;
    }
  }
}

}  // namespace

std::optional<double> ObservedStep::ratio(double error, double kappa, double scale) const {
  if (scale < std::numeric_limits<double>::min() / unit_roundoff<double>()) return std::nullopt;
  return error == 0 ? 0 : error / scale / (rounding() * kappa);
}

double CovarianceStep::innovation_condition() const {
  if (Re.rows() == 0) return 1;
  const auto inverse = Re.inverse();
  if (!inverse) return std::numeric_limits<double>::infinity();
  const double c = C.norm();
  return (R.norm() + c * c * P.norm()) * inverse->norm();
}

bool LawReport::all_hold() const {
  return std::ranges::all_of(results, [](const LawResult& result) { return result.holds(); });
}

LawReport check_laws(AnyFilter<double>& filter, const AnyProblem<double>& problem, std::int64_t steps) {
  LawReport report;
  for (const Law& law : all_laws()) report.results.push_back({law});
  filter.start(problem);
  Matrix<double> before = std::visit([](const auto& any) { return any.initial; }, problem);
  for (; report.steps < steps; ++report.steps) {
    const Step<double> step = filter.step(report.steps, nullptr, nullptr);
    report.status = step.report.status;
    if (!step.report) break;
    if (!step.held) continue;  // no P, and every law is about P
    judge(report, std::visit([&](const auto& any) { return observe(filter.metadata(), any, report.steps, before, step); }, problem));
    before = *step.held;
  }
  return report;
}

LawReport check_laws(std::string_view filter_id, const System& system) {
  const Metadata* metadata = find_filter(filter_id);
  if (!metadata) throw std::invalid_argument("no filter " + std::string(filter_id));
  LawReport none;
  for (const Law& law : all_laws()) none.results.push_back({law});
  if (refusal(*metadata, system)) return none;
  const auto converted = problem(system, metadata->takes);
  const auto* any = std::get_if<AnyProblem<double>>(&converted);
  return any ? check_laws(*make_filter<double>(filter_id), *any, system.steps) : none;
}

}  // namespace kfstab::properties
