#include <kfstab/properties/law.hpp>

#include <memory>

#include <kfstab/properties/data.hpp>

namespace kfstab::properties::laws::zero_innovation {

namespace {

/// The same system with the measurements that a filter without rounding would expect.
System as_expected(const System& system) {
  System quiet = system;
  const auto given = system.data->open();
  Matrix<double> y(system.C.rows(), system.steps), u(system.inputs(), system.steps);
  Vector<double> x = system.x0;
  for (std::int64_t k = 0; k < system.steps; ++k) {
    const StepData& now = given->next();
    const Vector<double> Cx = system.C.at(k).lazyProduct(x);
    y.col(k) = Cx;
    x = system.A.at(k).lazyProduct(x).eval();
    if (now.u.size() == 0) continue;
    u.col(k) = now.u;
    x += system.D.at(k).lazyProduct(now.u);
  }
  quiet.data = std::make_shared<Recorded>(std::move(y), std::move(u));
  return quiet;
}

std::optional<Finding> look(const ObservedStep& s) {
  if (s.size.n == 0 || !s.x || !s.update || !s.first_order()) return std::nullopt;
  const Precise moved = s.state_after(*s.x_prior), left = s.update->Kf * (*s.y - s.C * *s.x_prior);
  const double a = s.answers_predicted() ? s.A.norm() : 1;
  return s.compare("x", *s.x, moved, s.state_amplification(), 2 * a * left.norm());
}

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (!system.data || !bench.traits().starts_predicted) return std::nullopt;
  return worst_step(bench, as_expected(system), look);
}

}  // namespace

Law law() {
  return {.id = "zero-innovation",
          .statement = "y = C x gives x+ = A x + D u, whatever the gain: what was expected teaches nothing",
          .assumptions =
              "runs with data of filters that start predicted; the measurements are those of the undisturbed system, "
              "rounded, and what is left of the innovation counts twice",
          .source = "theory (1.2)",
          .tolerance = "as of state-update, and 2 |A| |Kf (y - C x)|",
          .failure =
              "The innovation is not y - C x: a wrong sign, C of another step, or an input or a mean that enters "
              "twice. Or the prediction of the state is wrong: A, D or u.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::zero_innovation
