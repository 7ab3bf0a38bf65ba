#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <fmt/format.h>

namespace kfstab::properties::laws::nees {

namespace {

using M = Matrix<double>;

M product(const M& X, const M& Y) { return X.lazyProduct(Y); }

double determinant(const M& X) { return X.rows() == 1 ? X(0, 0) : X(0, 0) * X(1, 1) - X(0, 1) * X(1, 0); }
/// n <= 2, as the systems of the long run have it.
M inverse(const M& X) {
  M Y(X.rows(), X.cols());
  if (X.rows() == 1) {
    Y(0, 0) = 1 / X(0, 0);
  } else {
    Y << X(1, 1), -X(0, 1), -X(1, 0), X(0, 0);
    Y /= determinant(X);
  }
  return Y;
}

/// log det(I - W X), W positive semidefinite, X symmetric; infinite if some eigenvalue of W X, all of which are real, is not
/// below 1.
double log_det(const M& W, const M& X) {
  const M WX = product(W, X);
  const double half = WX.trace() / 2;
  const double largest = WX.rows() == 1 ? WX(0, 0) : half + std::sqrt(std::max(0.0, half * half - determinant(WX)));
  if (!(largest < 1)) return std::numeric_limits<double>::infinity();
  return std::log(determinant(M::Identity(W.rows(), W.cols()) - WX));
}

/// What the error e = x_k - x_{k|k-1} of the right filter is in one step: N(0, P), and goes on to F e + N(0, W).
struct Link {
  M P, F, W;
  M weight;  ///< P^{-1} if the step counts, else 0
};

/// log E exp(t sum e'P^{-1} e): from the last step back, E (exp(e'X e / 2) after this step) = exp(e'F'X(I - W X)^{-1}F e / 2)
/// det(I - W X)^{-1/2}. Infinite if there is none.
double log_moment(const std::vector<Link>& chain, double t) {
  double log = 0;
  M X = 2 * t * chain.back().weight;
  for (std::size_t k = chain.size() - 1; k-- > 0;) {
    const Link& link = chain[k];
    const double of_step = log_det(link.W, X);
    if (std::isinf(of_step)) return of_step;
    log -= of_step / 2;
    const M Y = product(X, inverse(M::Identity(X.rows(), X.cols()) - product(link.W, X)));
    X = 2 * t * link.weight + product(product(link.F.transpose(), (Y + Y.transpose()) / 2), link.F);
  }
  const double of_start = log_det(chain.front().P, X);
  return std::isinf(of_start) ? of_start : log - of_start / 2;
}

/// Chernoff's bound of the probability of so much, or so little: the least over t of log E exp(t (S - s)), as sigma.
double sigma(const std::vector<Link>& chain, double s, double expected) {
  double least = 0;
  // t up to 1/2, of a single chi-squared number; and down, where every moment is finite, to where 1 / (2 |t|) is a
  // hundredth of what the sum is of.
  for (int i = 0; i < 30; ++i) {
    const double t = s > expected ? std::pow(.75, i) / 2 : -50 * std::pow(.75, i);
    if (const double log = log_moment(chain, t); std::isfinite(log)) least = std::min(least, log - t * s);
  }
  return std::sqrt(-2 * least);
}

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (!long_run_innovations(bench, system)) return std::nullopt;
  const auto simulation = long_run(bench.traits(), system);
  const std::vector<ObservedStep>& steps = observed_steps(bench, simulation->system);
  double sum = 0;
  int count = 0;
  std::vector<Link> chain;
  Precise P = steps.front().prior;  // of the right filter, whose errors the sum is held against
  // What rounding may have made of P and of the error up to here: -W <= dP <= W by theory (4.4), and, X the same of squares,
  // |de|^2 <= (k + 1) tr X by Cauchy and Schwarz. P0 was rounded when it was written, and x when it was drawn.
  const double u = steps.front().rounding();
  const M I = M::Identity(P.rows(), P.rows());
  M W = u * P.norm() * I, X = std::pow(u * simulation->x.col(0).norm(), 2) * I;
  for (const ObservedStep& s : steps) {
    const auto Re_inverse = (s.R + s.C * P * s.C.transposed()).inverse();
    if (!Re_inverse) return std::nullopt;
    const Precise PC = P * s.C.transposed(), K = s.A * PC * *Re_inverse, BQB = s.B * s.Q * s.B.transposed();
    Link link{P.rounded(), (s.A - K * s.C).rounded(), (BQB + K * s.R * K.transposed()).rounded(), 0 * I};
    // A state that is known exactly has no error to be judged by; and of rounding no more than a hundredth may be in the sum.
    const auto answered = s.prior.inverse(), right = P.inverse();
    const double off_by = std::sqrt(static_cast<double>(s.k + 1) * X.trace()), seen = 0.01 / largest_ratio;
    if (answered && right && W.norm() * answered->norm() <= seen && off_by * std::sqrt(answered->norm()) <= seen) {
      link.weight = right->rounded();
      const Precise error = Precise(Matrix<double>(simulation->x.col(s.k))) - *s.x_prior;
      sum += (error.transposed() * *answered * error).rounded()(0, 0);
      ++count;
    }
    const double a = s.answers_predicted() ? 1 : s.A.norm();
    const auto carried = [&link](const M& Y) { return product(product(link.F, Y), link.F.transpose()); };
    W = carried(W) + a * a * (u * s.amplification() + s.asymmetric()) * I;
    X = carried(X) + std::pow(u * (a * s.state_amplification() + s.A.norm() * simulation->x.col(s.k).norm()), 2) * I;
    chain.push_back(std::move(link));
    P = s.A * (P - PC * *Re_inverse * PC.transposed()) * s.A.transposed() + BQB;
  }
  if (count == 0) return std::nullopt;
  const auto n = static_cast<double>(system.A.rows());
  return Finding{
      largest_ratio * sigma(chain, sum, count * n) / 6, -1,
      fmt::format("over {} steps (x^ - x)' P^-1 (x^ - x) has the mean {:.3g}, expected {}", count, sum / count, n)};
}

}  // namespace

Law law() {
  return {
      .id = "nees",
      .statement =
          "(x^ - x)' P^{-1} (x^ - x), x the state that the data were drawn with, is n on the average over a run, "
          "neither more nor less than is likely for errors that F = A - K C hands on from step to step",
      .assumptions = "as of nis; steps whose P is regular, and in which rounding is not seen",
      .source =
          "Bar-Shalom, Li, Kirubarajan 2001, 5.4; the sum's moments exp(t sum) by recursion, for its terms depend on "
          "one another; Chernoff's bound",
      .tolerance = "6 sigma: Chernoff's bound of the probability, exp(-s^2/2), at s = 6; the ratio is 5 s",
      .failure =
          "The filter is more sure of its state than it may be, or less: P goes down while x does not follow, noise is "
          "forgotten or counted twice, P is in another unit, or x is of another step than P.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::nees
