#include <kfstab/properties/law.hpp>

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace kfstab::properties::laws::trajectory {

namespace {

struct Worst {
  double least;  // below it numbers underflow
  std::optional<Finding> finding;

  void see(std::int64_t k, const char* name, const Precise& found, const Matrix<double>& truth, double bound,
           double allowed) {
    if (std::isnan(bound) || found.rows() != truth.rows() || found.cols() != truth.cols() || truth.size() == 0) return;
    // Beyond a half of what is compared the bound, of first order, says nothing.
    const double size = truth.norm();
    if (!(largest_ratio * bound + allowed <= size / 2) || size < least) return;
    // The truth is rounded to double, entry by entry.
    allowed += unit_roundoff<double>() * size;
    const double error = (found - Precise(truth)).norm(), ratio = error <= allowed ? 0 : (error - allowed) / bound;
    if (finding && ratio <= finding->ratio) return;
    finding = Finding{ratio, k, {}};
    if (!(ratio <= largest_ratio))
      finding->what = fmt::format("step {}: {}", k, largest_difference(name, found, Precise(truth)));
  }
};

std::optional<Finding> examine(Bench& bench, const System& system) {
  const Run& run = bench.run(system);
  const Course& course = bench.course(system);
  const std::vector<double> allowed = asymmetric_errors(bench, system);
  Worst worst{underflow(bench.traits()), {}};
  for (std::size_t i = 0; i < allowed.size(); ++i) {
    const Answer& answer = run.answers[i];
    const auto k = static_cast<std::int64_t>(i);
    if (const auto P = covariance(answer)) worst.see(k, "P", *P, course.P(k), course.P_bound(k), allowed[i]);
    // What the gain and the state make of it, relative to their size.
    const double P = course.P(k).norm(), before = i == 0 ? 0 : std::max(allowed[i - 1], allowed[i]);
    const double relative = before == 0 ? 0 : before / P * (1 + course.truth(k).innovation_condition);
    if (!(relative <= 0x1p-20)) break;
    if (answer.gain && bench.traits().gain)
      worst.see(k, "K", Precise(*answer.gain), course.K(k), course.K_bound(k), relative * course.K(k).norm());
    if (system.data && answer.state)
      worst.see(k, "x", Precise(Matrix<double>(*answer.state)), course.x(k), course.x_bound(k),
                relative * course.x(k).norm());
  }
  return worst.finding;
}

}  // namespace

Law law() {
  return {.id = "trajectory",
          .statement = "P, K and x of every step are those of the certified reference, from the first step to the last",
          .assumptions =
              "as far as the first-order bound is below a half of what is compared; the asymmetry of a filter that "
              "does not symmetrise, and what it makes of P by (3.6), is allowed besides",
          .source = "theory (4.4), (4.6): what each step commits, carried on by F; reference/trajectory.hpp",
          .tolerance = "30 times the first-order bound of the filter's form, with u (n+m+p) for its constant",
          .failure =
              "The filter is not the Kalman filter of this system. If one-step holds, each step is right by itself: "
              "look at what is kept between steps and at the start (P0 taken as a root, x0 ignored).",
          .reference = true,
          .examine = examine};
}

}  // namespace kfstab::properties::laws::trajectory
