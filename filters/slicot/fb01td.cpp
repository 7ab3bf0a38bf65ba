#include <kfstab/filters/slicot/fb01td.hpp>

#include <algorithm>

#include <kfstab/filters/slicot/slicot.h>

extern "C" void fb01td_(const char* jobx, const char* multrc, const int* n_, const int* m_, const int* p_, double* sinv,
                        const int* ldsinv, const double* ainv, const int* ldainv, const double* ainvb,
                        const int* ldainb, const double* rinv, const int* ldrinv, const double* c, const int* ldc,
                        double* qinv, const int* ldqinv, double* x, const double* rinvy, const double* z, double* e,
                        const double* tol, int*, double* dwork, const int* ldwork, int* info) {
  using namespace kfstab::slicot;
  const kfstab::Index n = *n_, m = *m_, p = *p_, one = 1;
  const bool with_state = is(jobx, 'X'), has_RC = is(multrc, 'P');
  const kfstab::Index arrays = std::max({one, n * (n + 2 * m) + 3 * m, (n + p) * (n + 1) + n + std::max(n - 1, m + 1)});
  const kfstab::Index needed = with_state ? std::max({2 * one, arrays, 3 * n}) : arrays;
  if (refuse("FB01TD",
             {{1, with_state || is(jobx, 'N')},
              {2, has_RC || is(multrc, 'N')},
              {3, n >= 0},
              {4, m >= 0},
              {5, p >= 0},
              {7, *ldsinv >= std::max(one, n)},
              {9, *ldainv >= std::max(one, n)},
              {11, *ldainb >= std::max(one, n)},
              {13, *ldrinv >= (has_RC ? one : std::max(one, p))},
              {15, *ldc >= std::max(one, p)},
              {17, *ldqinv >= std::max(one, m)},
              {25, *ldwork >= needed}},
             info))
    return;
  const Result<double> result = fb01td<double>(
      with_state, has_RC, view(sinv, n, n, *ldsinv), view(ainv, n, n, *ldainv), view(ainvb, n, m, *ldainb),
      view(rinv, p, p, *ldrinv), view(c, p, n, *ldc), view(qinv, m, m, *ldqinv), VectorView<double>(x, n),
      ConstVectorView<double>(rinvy, p), ConstVectorView<double>(z, m), VectorView<double>(e, p), *tol, dwork);
  *info = result.info;
  dwork[0] = static_cast<double>(needed);
  if (with_state && result.info == 0) dwork[1] = result.rcond;
}
