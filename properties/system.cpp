#include <kfstab/properties/system.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <kfstab/filters/linear_solve.hpp>
#include <kfstab/properties/data.hpp>
#include <kfstab/properties/precise.hpp>
#include <kfstab/reference/definiteness.hpp>

namespace kfstab::properties {

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();

/// Thrown inside this file only: problem() hands it back as a value.
struct Refused {
  std::string reason;
};

/// "A", or "A (step 3)" where it changes from step to step.
std::string named(std::string_view name, const Sequence& sequence, std::size_t k) {
  return sequence.matrices.size() == 1 ? std::string(name) : fmt::format("{} (step {})", name, k);
}

std::optional<Precise> root_of_covariance(const Matrix<double>& Q) {
  const Precise exact(Q);
  if (auto root = exact.lower_root()) return root;
  return exact.with_diagonal_raised(static_cast<double>(Q.rows()) * eps).lower_root();
}

/// Definite for certain, by a Cholesky factorisation in double that has more than its rounding to spare: saves the slow test.
bool plainly_definite(const Matrix<double>& scaled) {
  const double n = static_cast<double>(scaled.rows());
  Matrix<double> lowered = scaled;
  lowered.diagonal().array() -= 10 * n * n * eps;
  return cholesky_upper(lowered) == 0;
}

bool singular(const Covariance& Q, std::size_t k) {
  const Precise X(Q.value.matrices[k]);
  if (Q.written == Covariance::Written::root) return X.has_zero_on_diagonal();
  const auto root = X.lower_root();
  return !root || root->has_zero_on_diagonal();
}

/// "R (step 3)" if one of them is singular.
std::optional<std::string> first_singular(std::string_view name, const Covariance& Q) {
  for (std::size_t k = 0; k < Q.value.matrices.size(); ++k)
    if (singular(Q, k)) return named(name, Q.value, k);
  return std::nullopt;
}

std::optional<std::string> first_singular(std::string_view name, const Sequence& A) {
  for (std::size_t k = 0; k < A.matrices.size(); ++k)
    if (!Precise(A.matrices[k]).inverse()) return named(name, A, k);
  return std::nullopt;
}

Matrix<double> in_range(const Precise& X, std::string_view what) {
  Matrix<double> rounded = X.rounded();
  if (!rounded.allFinite()) throw Refused{fmt::format("{} is beyond the range of double", what)};
  return rounded;
}

// Each converts matrix k of what is written as the form asks for it.

Matrix<double> as_covariance(std::string_view name, const Covariance& Q, std::size_t k) {
  const Matrix<double>& X = Q.value.matrices[k];
  if (Q.written == Covariance::Written::covariance) return X;
  const Precise L(X);
  return in_range(L * L.transposed(), named(name, Q.value, k));
}

Matrix<double> as_root(std::string_view name, const Covariance& Q, std::size_t k) {
  const Matrix<double>& X = Q.value.matrices[k];
  if (Q.written == Covariance::Written::root) return X;
  const auto root = root_of_covariance(X);
  if (!root) throw Refused{named(name, Q.value, k) + " is not positive semidefinite"};
  return root->rounded();
}

/// Upper U with U'U = Q^{-1}: Q = U^{-1} U^{-T}, so U^{-1} is an upper root of Q, which is a lower one with rows and
/// columns counted from the end.
Matrix<double> as_information_root(std::string_view name, const Covariance& Q, std::size_t k) {
  const std::string what = named(name, Q.value, k);
  if (singular(Q, k)) throw Refused{fmt::format("the information form needs a positive definite {}: {} is singular", name, what)};
  Precise X(Q.value.matrices[k]);
  if (Q.written == Covariance::Written::root) X = X * X.transposed();
  const auto root = X.reversed().lower_root();
  const auto inverse = root ? root->reversed().inverse() : std::nullopt;
  if (!inverse) throw Refused{what + " is singular to 70 digits"};
  return in_range(*inverse, fmt::format("the inverse root of {}", what));
}

using Convert = Matrix<double> (*)(std::string_view, const Covariance&, std::size_t);

std::vector<Matrix<double>> each(Convert convert, std::string_view name, const Covariance& Q) {
  std::vector<Matrix<double>> converted;
  converted.reserve(Q.value.matrices.size());
  for (std::size_t k = 0; k < Q.value.matrices.size(); ++k) converted.push_back(convert(name, Q, k));
  return converted;
}

const Matrix<double>& cycle(const std::vector<Matrix<double>>& matrices, std::size_t k) {
  return matrices[k % matrices.size()];
}

template <class Model>
void fill_dynamics(Model& model, const System& system, std::size_t k) {
  const auto step = static_cast<std::int64_t>(k);
  model.A = system.A.at(step);
  model.B = system.B.at(step);
  model.C = system.C.at(step);
  model.D = system.D.at(step);
}

AnyProblem<double> covariance_problem(const System& system) {
  const auto Q = each(as_covariance, "Q", system.Q);
  const auto R = each(as_covariance, "R", system.R);
  Problem<CovarianceModel<double>> problem;
  problem.initial = as_covariance("P0", system.P0, 0);
  problem.x0 = system.x0;
  problem.models.resize(system.model_count());
  for (std::size_t k = 0; k < problem.models.size(); ++k) {
    fill_dynamics(problem.models[k], system, k);
    problem.models[k].Q = cycle(Q, k);
    problem.models[k].R = cycle(R, k);
  }
  return problem;
}

AnyProblem<double> root_problem(const System& system) {
  const auto Q_root = each(as_root, "Q", system.Q);
  const auto R_root = each(as_root, "R", system.R);
  Problem<RootModel<double>> problem;
  problem.initial = as_root("P0", system.P0, 0);
  problem.x0 = system.x0;
  problem.models.resize(system.model_count());
  for (std::size_t k = 0; k < problem.models.size(); ++k) {
    fill_dynamics(problem.models[k], system, k);
    problem.models[k].Q_root = cycle(Q_root, k);
    problem.models[k].R_root = cycle(R_root, k);
  }
  return problem;
}

AnyProblem<double> information_problem(const System& system) {
  const auto Q = each(as_information_root, "Q", system.Q);
  const auto R = each(as_information_root, "R", system.R);
  std::vector<Precise> A_inverse;
  A_inverse.reserve(system.A.matrices.size());
  for (std::size_t k = 0; k < system.A.matrices.size(); ++k) {
    auto inverse = Precise(system.A.matrices[k]).inverse();
    if (!inverse) throw Refused{"the information form needs an invertible A: " + named("A", system.A, k) + " is singular"};
    A_inverse.push_back(*std::move(inverse));
  }
  Problem<InformationModel<double>> problem;
  problem.initial = as_information_root("P0", system.P0, 0);
  problem.x0 = system.x0;
  problem.models.resize(system.model_count());
  for (std::size_t k = 0; k < problem.models.size(); ++k) {
    InformationModel<double>& model = problem.models[k];
    const auto step = static_cast<std::int64_t>(k);
    const Precise& inverse = A_inverse[k % A_inverse.size()];
    model.A_inverse = in_range(inverse, "the inverse of " + named("A", system.A, k % A_inverse.size()));
    model.A_inverse_B = in_range(inverse * Precise(system.B.at(step)), "A^{-1} B");
    model.C = system.C.at(step);
    model.D = system.D.at(step);
    model.Q_inverse_root = cycle(Q, k);
    model.R_inverse_root = cycle(R, k);
  }
  return problem;
}

}  // namespace

Sequence Sequence::unrolled(std::int64_t steps) const {
  Sequence all(Kind::list, {});
  for (std::size_t k = 0; k < static_cast<std::size_t>(steps); ++k) {
    all.matrices.push_back(matrices[k % matrices.size()]);
    for (const ExactEntry& entry : exact)
      if (entry.matrix == k % matrices.size()) all.exact.push_back({k, entry.row, entry.col, entry.text});
  }
  return all;
}

bool System::time_invariant() const {
  return std::ranges::all_of(std::initializer_list<const Sequence*>{&A, &B, &C, &D, &Q.value, &R.value},
                             [](const Sequence* sequence) { return sequence->matrices.size() == 1; });
}

std::size_t System::model_count() const {
  const auto length = static_cast<std::size_t>(std::max<std::int64_t>(steps, 1));
  std::size_t count = 1;
  for (const Sequence* sequence : {&A, &B, &C, &D, &Q.value, &R.value}) {
    const std::size_t period = sequence->matrices.size();
    if (period == 1) continue;
    if (sequence->kind == Sequence::Kind::list) return length;
    const std::size_t factor = period / std::gcd(count, period);
    if (count > length / factor) return length;
    count *= factor;
  }
  return std::min(count, length);
}

std::variant<AnyProblem<double>, Refusal> problem(const System& system, Parametrisation form) {
  try {
    switch (form) {
      case Parametrisation::covariance: return covariance_problem(system);
      case Parametrisation::root: return root_problem(system);
      case Parametrisation::information: return information_problem(system);
    }
  } catch (const Refused& refused) {
    return Refusal{refused.reason};
  }
  throw std::invalid_argument("no such parametrisation");
}

std::optional<Refusal> refusal(const Metadata& filter, const System& system) {
  const auto because = [&](std::string_view needs, const std::string& found) {
    return Refusal{fmt::format("{} needs {}: {}", filter.id, needs, found)};
  };
  if (filter.needs.time_invariant && !system.time_invariant())
    return because("a time-invariant system", "its matrices change from step to step");
  if (filter.needs.time_invariant && measurements_missing(system))
    return because("a time-invariant system", "measurements are missing, and C is another where they are");
  if (filter.needs.invertible_A)
    if (const auto A = first_singular("A", system.A)) return because("an invertible A", *A + " is singular");
  if (filter.needs.positive_definite_Q)
    if (const auto Q = first_singular("Q", system.Q)) return because("a positive definite Q", *Q + " is singular");
  if (filter.needs.positive_definite_R)
    if (const auto R = first_singular("R", system.R)) return because("a positive definite R", *R + " is singular");
  if (filter.needs.positive_definite_P0)
    if (const auto P0 = first_singular("P0", system.P0)) return because("a positive definite P0", *P0 + " is singular");
  return std::nullopt;
}

std::optional<std::string> admissible_covariance(const Matrix<double>& Q) {
  const Index n = Q.rows();
  if (!Q.allFinite()) return "an entry that is not finite";
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < i; ++j)
      if (Q(i, j) != Q(j, i)) return fmt::format("entry [{},{}] = {} but [{},{}] = {}", i, j, Q(i, j), j, i, Q(j, i));
    if (Q(i, i) < 0) return fmt::format("a negative variance: entry [{},{}] = {}", i, i, Q(i, i));
  }
  // Scaled by powers of two, so that scaling rounds nothing.
  Matrix<double> scaled = Q;
  for (Index i = 0; i < n; ++i) {
    if (Q(i, i) == 0) continue;
    const int half = -std::ilogb(Q(i, i)) / 2;
    for (Index j = 0; j < n; ++j) {
      scaled(i, j) = std::ldexp(scaled(i, j), half);
      scaled(j, i) = std::ldexp(scaled(j, i), half);
    }
  }
  if (n == 0 || plainly_definite(scaled) || root_of_covariance(Q)) return std::nullopt;
  for (Index i = 0; i < n; ++i)
    if (Q(i, i) == 0)
      for (Index j = 0; j < n; ++j)
        if (Q(i, j) != 0) return fmt::format("entry [{},{}] = {} beside a variance [{},{}] of 0", i, j, Q(i, j), i, i);
  return fmt::format("a smallest eigenvalue of {:.3g} when scaled to a diagonal between 1 and 4, below -n eps = {:.3g}",
                     reference::smallest_eigenvalue(scaled), -static_cast<double>(n) * eps);
}

}  // namespace kfstab::properties
