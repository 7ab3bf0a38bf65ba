#include <kfstab/properties/law.hpp>

namespace kfstab::properties::laws::gain_optimality {

namespace {

std::optional<Finding> look(const ObservedStep& s) {
  if (s.size.n == 0 || s.size.p == 0 || !s.gain || !s.update || !s.first_order()) return std::nullopt;
  if (s.predictor_gain() && !s.answers_predicted()) return std::nullopt;
  const Precise half = 0.5 * *s.gain, gap = half * s.Re * half.transposed();
  const Precise A_gap = s.predictor_gain() || !s.answers_predicted() ? gap : s.A * gap * s.A.transposed();
  const double a = s.predictor_gain() || !s.answers_predicted() ? 1 : s.A.norm();
  const double off = s.gain_amplification(), Re = s.Re.norm();
  const double scale = s.amplification() + a * a * Re * off * (2 * half.norm() + largest_ratio * s.rounding() * off);
  return s.compare("P(1.5 K) - P", s.joseph(*s.gain + half) - s.P, A_gap, scale, s.asymmetric());
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, look); }

}  // namespace

Law law() {
  return {.id = "gain-optimality",
          .statement =
              "P(K + dK) - P(K) = dK Re dK', P(.) by Joseph's form: with the right gain there is no term of first "
              "order, and trace W P(K) has its minimum at K for every W. dK = K / 2",
          .assumptions =
              "a gain of the kind that belongs to P is answered; steps whose Re is positive definite and within the "
              "reach of first-order bounds",
          .source = "theory (4.5)",
          .tolerance = "that of one-step and, of the gain's tolerance d, |Re| d (2 |dK| + d)",
          .failure =
              "Another gain would do better than the one answered: it is frozen, of another step, limited, or of a "
              "wrong R or Q, even if P is what this gain makes of it.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::gain_optimality
