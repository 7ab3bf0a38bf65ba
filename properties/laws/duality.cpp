#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <kfstab/reference/definiteness.hpp>

namespace kfstab::properties::laws::duality {

namespace {

Precise zero(Index rows, Index cols) { return Precise(Matrix<double>(Matrix<double>::Zero(rows, cols))); }

/// The dual system from the last step back to the first, for all weights at once (Z = I), under the control
/// V_k = share K_k' Z_{k+1}, what it costs, and what it gathers of the data.
struct Dual {
  Precise cost;         ///< J, n x n
  Precise more;         ///< what J is more than P by: sum (V - K'Z)' Re (V - K'Z)
  Precise state;        ///< Z_0' x_0 + sum V_k' y_k + Z_{k+1}' D u_k, n x 1
  double scale = 0;     ///< of the error of J - more, in u (n+m+p)
  double of_state = 0;  ///< of the error of state
  /// What asymmetry excuses, of J - more and of state.
  double allowed = 0, allowed_state = 0;
};

/// Of the first `count` steps. Nothing if they are not all within the reach of first-order bounds.
std::optional<Dual> dual(const std::vector<ObservedStep>& steps, std::size_t count, double share) {
  const ObservedStep& first = steps.front();
  const Index n = first.size.n;
  const bool with_state = std::all_of(steps.begin(), steps.begin() + static_cast<std::ptrdiff_t>(count),
                                      [](const ObservedStep& s) { return s.x.has_value(); });
  Dual d{zero(n, n), zero(n, n), zero(n, 1)};
  Precise Z = Precise::identity(n);
  for (std::size_t k = count; k-- > 0;) {
    const ObservedStep& s = steps[k];
    const double z = reference::two_norm(Z.rounded());
    const bool predicted = s.answers_predicted();
    const auto through = [](const Precise& X, const Precise& Q) { return X.transposed() * Q * X; };
    const Precise BQB = s.B * s.Q * s.B.transposed();
    // The filter's own control, K'z of the predictor's gain; Kf'A'z and Kf'z are the same of the filter's.
    const Precise moved = predicted ? s.A.transposed() * Z : Z;
    const Precise own = s.gain->transposed() * (s.predictor_gain() ? Z : moved);
    const Precise V = share * own, less = V - own, W = moved - s.C.transposed() * V;
    d.cost = d.cost + through(V, s.R);
    d.more = d.more + through(less, s.Re);
    if (s.predicts) d.cost = d.cost + through(predicted ? Z : W, BQB);
    if (with_state) {
      d.state = d.state + V.transposed() * *s.y;
      if (s.predicts) d.state = d.state + (predicted ? Z : W).transposed() * *s.Du;
      d.of_state += z * s.state_amplification();
      // As state-update has it.
      if (const double P = s.prior.norm(); P > 0)
        d.allowed_state += z * s.asymmetric() / P * (s.update->Kf * (*s.y - s.C * *s.x_prior)).norm();
    }
    // P of the step is off by what one-step allows; a gain that is off by dK moves that square by
    // 2 (v - K'z)' Re dK'z and z'dK Re dK'z.
    const double off = s.gain_amplification() * (s.predictor_gain() || !predicted ? 1 : s.A.norm()) * z;
    d.scale += z * z * s.amplification() + s.Re.norm() * off * (2 * less.norm() + largest_ratio * s.rounding() * off);
    d.allowed += z * z * s.asymmetric();
    Z = predicted || !s.predicts ? W : s.A.transposed() * W;
  }
  d.cost = d.cost + Z.transposed() * first.before * Z;
  if (with_state) d.state = d.state + Z.transposed() * *first.x_before;
  return d;
}

std::optional<Finding> examine(Bench& bench, const System& system) {
  constexpr std::size_t most = 4;
  const std::vector<ObservedStep>& steps = observed_steps(bench, system);
  std::size_t count = 0;
  for (; count < std::min(steps.size(), most); ++count) {
    const ObservedStep& s = steps[count];
    if (s.size.n == 0 || !s.gain || !s.update || !s.first_order()) break;
    if (s.predictor_gain() && !s.answers_predicted()) break;
  }
  if (count == 0) return std::nullopt;
  const ObservedStep& last = steps[count - 1];
  std::optional<Finding> worst;
  const auto see = [&](std::optional<Finding> finding, const std::string& control) {
    if (!finding) return;
    if (!finding->what.empty())
      finding->what = fmt::format("{} step{} of the dual system under {}: {}", count, count == 1 ? "" : "s", control,
                                  finding->what);
    if (!worst || !(finding->ratio <= worst->ratio)) worst = std::move(finding);
  };
  for (const double share : {1.0, .5, 0.0}) {
    const auto d = dual(steps, count, share);
    const std::string control = share == 1 ? "v = K'z" : share == .5 ? "v = K'z / 2" : "v = 0";
    see(last.compare("P", last.P, d->cost - d->more, d->scale, d->allowed), control);
    if (share != 1 || d->of_state == 0) continue;
    see(last.compare("x", *last.x, d->state, d->of_state, d->allowed_state), control);
  }
  return worst;
}

}  // namespace

Law law() {
  return {
      .id = "duality",
      .statement =
          "l'P_N l is the least cost of steering the dual system z_k = A'z_{k+1} - C'v_k back from z_N = l, sum "
          "z_{k+1}'B Q B'z_{k+1} + v_k'R v_k + z_0'P_0 z_0, and v = K'z has it: every other control costs sum (v - "
          "K'z)'Re (v - K'z) more, tried with K'z / 2 and 0; l'x_N = z_0'x_0 + sum v_k'y_k + z_{k+1}'D u_k",
      .assumptions =
          "a gain of the kind that belongs to P is answered; the first 4 steps, as far as Re is positive definite "
          "and within the reach of first-order bounds",
      .source = "Kalman 1960; the square of theory (4.5) completed in each step, and summed up",
      .tolerance =
          "sum |Z_{k+1}|^2 times that of one-step and, d the tolerance of the gain, |Re| |Z| d (2 |v - K'z| + |Z| "
          "d), Z_k the dual states of all unit vectors l; of x, sum |Z_{k+1}| times that of state-update",
      .failure =
          "Over several steps P, the gains and x are not of one filter: P is not the least that gains could make of "
          "P0, Q and R (one-step and gain-optimality name the step), or x is moved by another gain than the one "
          "answered.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::duality
