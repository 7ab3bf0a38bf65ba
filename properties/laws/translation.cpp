#include <kfstab/properties/comparison.hpp>

namespace kfstab::properties::laws::translation {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  const System base = first_steps(measured(system), 4);
  System other = base;
  Columns data = columns(base);
  Vector<double> d(system.A.rows());
  for (Index i = 0; i < d.size(); ++i) d(i) = static_cast<double>(1 + i % 4) * (i % 2 == 0 ? 1 : -1);
  other.x0 += d;
  // Before measuring, a filter that starts from k|k predicts.
  const bool first = bench.traits().starts_predicted;
  std::vector<Vector<double>> moved;
  for (Index k = 0; k < base.steps; ++k) {
    if (!first) d = base.A.at(k).lazyProduct(d).eval();
    data.y.col(k) += base.C.at(k).lazyProduct(d);
    const Vector<double> filtered = d;
    if (first) d = base.A.at(k).lazyProduct(d).eval();
    moved.push_back(bench.traits().instant == Instant::predicted ? d : filtered);
  }
  set_columns(other, std::move(data));
  return compare_moved(bench, base, counted(system), other, moved, "all moved by d, which is taken off again");
}

}  // namespace

Law law() {
  return {.id = "translation",
          .statement = "x0 moved by d, and y_k by C d_k, d_{k+1} = A d_k: x moved by d_k, P and K as they were",
          .assumptions = "filters that answer x; the first 4 steps; steps in which 30 b is small",
          .source = "theory 1: a filter that is told where the origin is finds the same errors",
          .tolerance =
              "30 (b + b'), b and b' the tolerances of comparison.hpp for both systems, and the rounding of y + C d",
          .failure =
              "The state update is not x+ = A x + K (y - C x): C or A of another step, A x instead of x in the "
              "innovation, a gain that is applied twice, a wrong sign.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::translation
