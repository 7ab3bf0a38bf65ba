#include <kfstab/properties/law.hpp>

namespace kfstab::properties::laws::filter_gain {

namespace {

std::optional<Finding> look(const ObservedStep& s) {
  if (s.size.n == 0 || s.size.p == 0 || !s.gain || !s.update || !s.first_order()) return std::nullopt;
  const double R = s.R.norm(), scale = s.gain_amplification() * R;
  if (s.predictor_gain())
    return s.compare("K R", *s.gain * s.R, s.A * s.update->P * s.C.transposed(), scale, s.asymmetric() * s.C.norm());
  // By the P_{k|k} answered, where there is one.
  const Precise& P = s.answers_predicted() ? s.update->P : s.P;
  const double of_P = s.answers_predicted() ? 0 : s.amplification();
  return s.compare("Kf R", *s.gain * s.R, P * s.C.transposed(), scale + of_P * s.C.norm(), s.asymmetric() * s.C.norm());
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, look); }

}  // namespace

Law law() {
  return {.id = "filter-gain",
          .statement = "Kf R = P_{k|k} C', or K R = A P_{k|k} C': the gain by the covariance after the update",
          .assumptions =
              "a gain is answered; steps whose Re is positive definite and within the reach of first-order bounds",
          .source = "theory 2: Kf = P C' Re^{-1} = P_{k|k} C' R^{-1}",
          .tolerance =
              "30 u (n+m+p) ((|A| |Kf| r + (r a)^{1/2}) |Re^{-1}| |R| + d |C|), r = |R| + |C|^2 |P|, a = |A|^2 |P| + "
              "|B|^2 |Q|; d the tolerance of one-step where P_{k|k} is answered",
          .failure =
              "Gain and covariance do not belong to one another: the gain is of another step or of P before a "
              "correction, or R is another in the gain than in P.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::filter_gain
