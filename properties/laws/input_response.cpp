#include <kfstab/properties/comparison.hpp>

namespace kfstab::properties::laws::input_response {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (system.inputs() == 0) return std::nullopt;
  const System base = first_steps(measured(system), 4);
  System other = base;
  Columns data = columns(base);
  Vector<double> s = Vector<double>::Zero(system.A.rows());
  const bool first = bench.traits().starts_predicted;
  std::vector<Vector<double>> moved;
  for (Index k = 0; k < base.steps; ++k) {
    const Vector<double> next = base.A.at(k).lazyProduct(s) + base.D.at(k).lazyProduct(data.u.col(k));
    if (!first) s = next;
    data.y.col(k) -= base.C.at(k).lazyProduct(s);
    const Vector<double> filtered = s;
    if (first) s = next;
    moved.push_back(-(bench.traits().instant == Instant::predicted ? s : filtered));
  }
  data.u.setZero();
  set_columns(other, std::move(data));
  return compare_moved(bench, base, counted(system), other, moved, "without u, its response taken off y");
}

}  // namespace

Law law() {
  return {
      .id = "input-response",
      .statement = "Without u, and with y less C s_k, s_{k+1} = A s_k + D u_k: x less s_k, P and K as they were",
      .assumptions = "filters that answer x, systems with an input; the first 4 steps; steps in which 30 b is small",
      .source = "theory 1: a known input moves the state by a known way",
      .tolerance =
          "30 (b + b'), b and b' the tolerances of comparison.hpp for both systems, and the rounding of y - C s",
      .failure =
          "The known input goes in at a wrong place: one step late, after the gain, twice, with B for D, or not at "
          "all.",
      .examine = examine};
}

}  // namespace kfstab::properties::laws::input_response
