#include <kfstab/properties/law.hpp>

namespace kfstab::properties::laws::state_update {

namespace {

std::optional<Finding> look(const ObservedStep& s) {
  if (s.size.n == 0 || !s.x || !s.update || !s.first_order()) return std::nullopt;
  const Precise e = *s.y - s.C * *s.x_prior;
  const bool own = s.gain && (!s.predictor_gain() || s.answers_predicted());
  const Precise expected = !own                 ? s.state_after(*s.x_prior + s.update->Kf * e)
                           : s.predictor_gain() ? s.A * *s.x_prior + *s.gain * e + *s.Du
                                                : s.state_after(*s.x_prior + *s.gain * e);
  const double D = s.prior.norm() > 0 ? s.asymmetric() / s.prior.norm() : 0;
  return s.compare("x", *s.x, expected, s.state_amplification(), D * (s.update->Kf * e).norm());
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, look); }

}  // namespace

Law law() {
  return {
      .id = "state-update",
      .statement =
          "x+ = A x + K (y - C x) + D u with the gain as answered (x_{k|k} = x + Kf (y - C x) of a filter that answers "
          "P_{k|k}); with the exact gain of its P where none is answered",
      .assumptions = "runs with data; steps whose Re is positive definite and within the reach of first-order bounds",
      .source = "theory (1.2)",
      .tolerance =
          "30 u (n+m+p) (|A x| + |A| |Kf| (|y| + |C| |x|) + |D u| + d |y - C x|), d the gain's tolerance over 30 u "
          "(n+m+p); the first terms times the condition of T or Y of forms that hold them, |Kf| times k(R)^{1/2} of "
          "those that hold a root, which may whiten y",
      .failure =
          "The state is updated by something else than the gain and the innovation: D u forgotten or of another step, "
          "y compared with C x after the update instead of before, another gain than the one answered.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::state_update
