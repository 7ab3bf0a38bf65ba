#include <kfstab/filters/slicot/fb01qd.hpp>

#include <algorithm>

#include <kfstab/filters/slicot/slicot.h>

extern "C" void fb01qd_(const char* jobk, const char* multbq, const int* n_, const int* m_, const int* p_, double* s,
                        const int* lds, const double* a, const int* lda, const double* b, const int* ldb,
                        const double* q, const int* ldq, const double* c, const int* ldc, double* r, const int* ldr,
                        double* k, const int* ldk, const double* tol, int*, double* dwork, const int* ldwork,
                        int* info) {
  using namespace kfstab::slicot;
  const kfstab::Index n = *n_, m = *m_, p = *p_, one = 1;
  const bool with_gain = is(jobk, 'K'), has_product = is(multbq, 'P');
  const kfstab::Index arrays = std::max({one, n * (p + n) + 2 * p, n * (n + m + 2)});
  const kfstab::Index needed = with_gain ? std::max({2 * one, arrays, 3 * p}) : arrays;
  if (refuse("FB01QD",
             {{1, with_gain || is(jobk, 'N')},
              {2, has_product || is(multbq, 'N')},
              {3, n >= 0},
              {4, m >= 0},
              {5, p >= 0},
              {7, *lds >= std::max(one, n)},
              {9, *lda >= std::max(one, n)},
              {11, *ldb >= std::max(one, n)},
              {13, *ldq >= (has_product ? one : std::max(one, m))},
              {15, *ldc >= std::max(one, p)},
              {17, *ldr >= std::max(one, p)},
              {19, *ldk >= std::max(one, n)},
              {23, *ldwork >= needed}},
             info))
    return;
  Result<double> result;
  if (n > 0)
    result =
        fb01qd<double>(with_gain, has_product, view(s, n, n, *lds), view(a, n, n, *lda), view(b, n, m, *ldb),
                       view(q, m, m, *ldq), view(c, p, n, *ldc), view(r, p, p, *ldr), view(k, n, p, *ldk), *tol, dwork);
  *info = result.info;
  dwork[0] = static_cast<double>(needed);
  if (with_gain && result.info == 0) dwork[1] = result.rcond;
}
