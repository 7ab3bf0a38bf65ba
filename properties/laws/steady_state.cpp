#include <kfstab/properties/law.hpp>

#include <cmath>

#include <fmt/format.h>

#include <kfstab/reference/error.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::properties::laws::steady_state {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  const auto simulation = long_run(bench.traits(), system);
  if (!simulation || refusal(bench.traits(), simulation->system)) return std::nullopt;
  const std::vector<ObservedStep>& steps = observed_steps(bench, simulation->system);
  if (static_cast<std::int64_t>(steps.size()) < simulation->system.steps) return std::nullopt;

  reference::SteadyState steady;
  try {
    const auto numbers = problem(simulation->system, bench.traits().takes);
    steady = reference::steady_state(std::get<AnyProblem<double>>(numbers));
  } catch (const reference::ReferenceError&) {
    return std::nullopt;  // there is none that the filter goes to
  }
  // P_k - P = Phi (P_0 - P) (F^k)', Phi the product of the F_i, and what each step commits is carried by the F_i after it.
  const std::size_t last = steps.size() - 1;
  Precise carried = Precise::identity(system.A.rows()), settled = carried;
  const Precise F(steady.closed_loop);
  double rounded = unit_roundoff<double>() * steady.P.norm(), allowed = 0;
  for (std::size_t k = last; k-- > 0;) {
    const ObservedStep& s = steps[k];
    if (!s.update || !s.first_order()) return std::nullopt;
    // The next prior is A P_{k|k} A' + B Q B' of a filter that answers P_{k|k}.
    const double a = s.answers_predicted() ? 1 : std::pow(steps[k + 1].A.norm(), 2);
    const double through = std::pow(carried.norm(), 2);
    rounded += through * a * s.rounding() * s.amplification();
    allowed += through * a * s.asymmetric();
    const Precise& A = s.answers_predicted() ? s.A : steps[k + 1].A;
    carried = carried * (A - A * s.update->Kf * s.C);
    settled = settled * F;
  }
  const Precise P(steady.P), &found = steps[last].prior;
  allowed += carried.norm() * settled.norm() * (steps[0].prior - P).norm();
  // Only where that leaves something to be seen.
  if (!(allowed + largest_ratio * rounded <= P.norm() / 2)) return std::nullopt;
  const double error = (found - P).norm(), ratio = error <= allowed ? 0 : (error - allowed) / rounded;
  Finding finding{ratio, steps[last].k, {}};
  if (!(ratio <= largest_ratio))
    finding.what = fmt::format("after {} steps: {}", last, largest_difference("P_{k|k-1}", found, P));
  return finding;
}

}  // namespace

Law law() {
  return {.id = "steady-state",
          .statement =
              "P_{k|k-1} goes to the stabilising solution P of the algebraic Riccati equation, as P_k - P = F_{k-1} "
              "... F_0 (P_0 - P) (F^k)'",
          .assumptions =
              "time-invariant systems with n, m, p <= 2 and a stabilising solution, run for 60 steps; no step beyond "
              "the reach of first-order bounds",
          .source = "theory 3, the difference of two solutions; reference/steady_state.hpp",
          .tolerance =
              "30 times what the steps commit by the tolerance of one-step, carried on by F_{k-1} ... F_i; and "
              "|F_{k-1} ... F_0| |F^k| |P_0 - P| itself",
          .failure =
              "The filter settles at another covariance, or not at all: something that one step hides adds up, such as "
              "a jitter, a limit on P or K, or a gain that is frozen.",
          .reference = true,
          .examine = examine};
}

}  // namespace kfstab::properties::laws::steady_state
