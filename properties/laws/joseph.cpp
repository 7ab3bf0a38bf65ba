#include <kfstab/properties/law.hpp>

namespace kfstab::properties::laws::joseph {

namespace {

std::optional<Finding> look(const ObservedStep& s) {
  if (s.size.n == 0 || !s.gain || !s.update || !s.first_order()) return std::nullopt;
  if (s.predictor_gain() && !s.answers_predicted()) return std::nullopt;
  // A gain that is off by dK gives dK Re dK' more, exactly: the square of what it may be off by.
  const double off = s.gain_amplification() * (s.predictor_gain() || !s.answers_predicted() ? 1 : s.A.norm());
  const double scale = s.amplification() + largest_ratio * s.rounding() * off * off * s.Re.norm();
  return s.compare("P", s.P, s.joseph(*s.gain), scale, s.asymmetric());
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, look); }

}  // namespace

Law law() {
  return {.id = "joseph",
          .statement =
              "P_{k|k} = (I - Kf C) P (I - Kf C)' + Kf R Kf' with the gain as answered; P+ = (A - K C) P (A - K C)' + "
              "K R K' + B Q B'",
          .assumptions =
              "a gain of the kind that belongs to P is answered; steps whose Re is positive definite and within the "
              "reach of first-order bounds",
          .source = "theory (2.2), (4.5): the covariance of the error that this gain makes",
          .tolerance = "that of one-step and |Re| times the square of the gain's, by which (4.5) is off",
          .failure =
              "P is not the covariance of the errors that the filter with this gain makes: it does not know how good "
              "it is. Look whether the gain of P and the gain answered (or used for x) are the same, and at K R K' in "
              "Joseph's form.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::joseph
