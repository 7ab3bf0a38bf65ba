// Compiled for the machine at hand, as who wants batches would: kernels of the user's own source beside those of the library.
#include <cstdio>

#include <kfstab/filters/batch.hpp>

namespace {

/// Whether a batch of such filters does what one of them does alone, to some roundings.
template <int n, int m, int p>
bool agrees() {
  using namespace kfstab;
  using Filter = SquareRootInformationFilter<double, n, m, p>;
  typename Filter::Model model;
  model.A_inverse.setIdentity();
  model.A_inverse_B.setConstant(.125);
  model.C.setConstant(.25);
  model.Q_inverse_root.setIdentity();
  model.R_inverse_root.setIdentity();
  const Matrix<double, n, n> T0 = Matrix<double, n, n>::Identity();
  const Vector<double, n> x0 = Vector<double, n>::Zero();
  Filter alone;
  alone.start(T0, x0);
  constexpr Index count = 19;
  Batch<Filter> batch(count);
  for (Index i = 0; i < count; ++i) {
    batch.start(i, T0, x0);
    batch.set_model(i, model);
  }
  for (int k = 0; k < 3; ++k) {
    if (!alone.step(model, model, nullptr, nullptr)) return false;
    batch.step();
  }
  const double u = 0x1p-53;
  for (Index i = 0; i < count; ++i)
    if (!batch.report(i) ||
        !((batch.held(i) - alone.information_factor()).norm() <= 30 * u * 3 * (n + m + p) * alone.information_factor().norm()))
      return false;
  std::printf("n = %d, m = %d, p = %d agree\n", n, m, p);
  return true;
}

}  // namespace

int main() {
  // Small enough for a kernel of its own. And small enough with n, m, p for it, but not with n, p, m, as the information form's
  // array has it: that once wrote to where no workspace was.
  return agrees<2, 1, 1>() && agrees<2, 12, 1>() ? 0 : 1;
}
