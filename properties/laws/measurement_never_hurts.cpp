#include <kfstab/properties/law.hpp>

namespace kfstab::properties::laws::measurement_never_hurts {

namespace {

std::optional<Finding> look(const ObservedStep& s) {
  if (s.size.n == 0 || !s.update || !s.first_order()) return std::nullopt;
  const char* name = s.answers_predicted() ? "A P A' + B Q B' - P+" : "P_{k|k-1} - P_{k|k}";
  return s.semidefinite(name, s.after(s.prior) - s.P, s.amplification(), s.asymmetric());
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, look); }

}  // namespace

Law law() {
  return {
      .id = "measurement-never-hurts",
      .statement =
          "P_{k|k} <= P_{k|k-1}, hence P_{k+1|k} <= A P_{k|k-1} A' + B Q B': no measurement makes the estimate worse",
      .assumptions = "steps whose Re is positive definite and within the reach of first-order bounds",
      .source = "theory 2: P_{k|k-1} - P_{k|k} = Kf Re Kf' >= 0",
      .tolerance = "as of one-step",
      .failure =
          "The update added what it should subtract, or the process noise is counted twice: look at the signs in the "
          "update of P, and whether noise is added at each of two places.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::measurement_never_hurts
