#include <kfstab/properties/law.hpp>

namespace kfstab::properties::laws::time_update {

namespace {

std::optional<Finding> look(const ObservedStep& s) {
  if (s.size.n == 0 || !s.first_order() || s.C.norm() != 0) return std::nullopt;
  return s.compare("P", s.P, s.after(s.prior), s.amplification(), s.asymmetric());
}

std::optional<Finding> examine(Bench& bench, const System& system) { return worst_step(bench, system, look); }

}  // namespace

Law law() {
  return {
      .id = "time-update",
      .statement =
          "P+ = A P A' + B Q B' in a step that measures nothing; of a filter that answers P_{k|k} before any dynamics, "
          "P_{k|k} = P",
      .assumptions = "steps without a measurement: p = 0, C = 0, or all of y missing",
      .source = "theory (1.2)",
      .tolerance = "30 u (n+m+p) (|A|^2 |P| + |B|^2 |Q|); of forms that hold P^{-1}, theory (4.3)",
      .failure =
          "The prediction is wrong, whatever the update does: A for A', B or Q forgotten, squared or taken as a root, "
          "or noise of another step. If it fails only where y is missing, a missing measurement is not skipped.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::time_update
