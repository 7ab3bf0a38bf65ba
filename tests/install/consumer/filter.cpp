// A project of somebody else's: one fixed-size filter from its header, and the registry from the library.
#include <cmath>
#include <cstdio>

#include <kfstab/filters/registry.hpp>
#include <kfstab/filters/square_root_covariance.hpp>

int main() {
  // The golden ratio: A = C = Q = R = 1 has P = 1 + P / (P + 1).
  using Filter = kfstab::SquareRootCovarianceFilter<double, 1, 1, 1>;
  Filter::Model model;
  model.A << 1;
  model.B << 1;
  model.C << 1;
  model.D.resize(1, 0);
  model.Q_root << 1;
  model.R_root << 1;
  Filter filter;
  filter.start(model.A, model.A.col(0));
  for (int k = 0; k < 100; ++k) {
    if (!filter.step(model)) return 1;
  }
  const double S = filter.factor()(0, 0);
  const double P = (1 + std::sqrt(5.0)) / 2, F = 2 - P;
  std::printf("P = %.17g, expected %.17g\n", S * S, P);
  if (std::abs(S * S - P) > 20 * 0x1p-53 / (1 - F * F) * P) return 1; // the steady-state level of rounding errors

  std::printf("%zu filters\n", kfstab::filters().size());
  return kfstab::make_filter<double>("srcf") ? 0 : 1;
}
