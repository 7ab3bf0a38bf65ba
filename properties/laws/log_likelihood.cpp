#include <kfstab/properties/law.hpp>

#include <cmath>
#include <numbers>

#include <fmt/format.h>

namespace kfstab::properties::laws::log_likelihood {

namespace {

/// log det of a positive definite matrix.
double log_determinant(const Precise& root) {
  const Matrix<double> L = root.rounded();
  double sum = 0;
  for (Index i = 0; i < L.rows(); ++i) sum += 2 * std::log(L(i, i));
  return sum;
}

std::optional<Finding> look(const ObservedStep& s) {
  if (!s.log_likelihood || !s.x || !s.update || !s.first_order()) return std::nullopt;
  const auto root = s.Re.lower_root();
  if (!root) return std::nullopt;
  const Precise e = *s.y - s.C * *s.x_prior, z = s.update->Re_inverse * e, quadratic = e.transposed() * z;
  const double squared = s.size.p > 0 ? quadratic.rounded()(0, 0) : 0, p = static_cast<double>(s.measured);
  const double expected = -(p * std::log(2 * std::numbers::pi) + log_determinant(*root) - s.missing_log_variance + squared) / 2;

  const double c = s.C.norm(), P = s.predicts && !s.answers_predicted() ? std::pow(s.A.norm(), 2) * s.before.norm() +
                                                                              std::pow(s.B.norm(), 2) * s.Q.norm()
                                                                        : s.before.norm();
  const double x =
      s.predicts && !s.answers_predicted() ? s.A.norm() * s.x_before->norm() + s.Du_terms : s.x_prior->norm();
  const double scale = p * s.innovation_condition() + std::pow(z.norm(), 2) * (s.R.norm() + c * c * P) +
                       z.norm() * (s.y->norm() + c * x) + std::abs(expected) + p;
  const double error = std::abs(*s.log_likelihood - expected);
  const auto ratio = s.ratio(error, 1, scale);
  if (!ratio) return std::nullopt;
  return Finding{*ratio, s.k, fmt::format("loglik = {:.9g}, expected {:.9g}", *s.log_likelihood, expected)};
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, look); }

}  // namespace

Law law() {
  return {
      .id = "log-likelihood",
      .statement =
          "loglik = -1/2 (p log 2 pi + log det Re + e' Re^{-1} e), e = y - C x_{k|k-1}, p the number of entries that "
          "were measured",
      .assumptions =
          "runs with data of filters that answer loglik and hold P or a root of it; steps whose Re is positive "
          "definite and within the reach of first-order bounds",
      .source = "theory 2; Schweppe 1965",
      .tolerance =
          "30 u (n+m+p) (p kappa + |z|^2 r + |z| (|y| + |C| |x|) + |loglik| + p), z = Re^{-1} e, r = |R| + |C|^2 |P|",
      .failure =
          "The likelihood is of something else: after the update instead of before, without p log 2 pi or the 1/2, a "
          "determinant for its logarithm, missing entries counted.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::log_likelihood
