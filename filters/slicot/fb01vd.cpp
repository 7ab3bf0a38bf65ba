#include <kfstab/filters/slicot/fb01vd.hpp>

#include <algorithm>

#include <kfstab/filters/slicot/slicot.h>

extern "C" void fb01vd_(const int* n_, const int* m_, const int* l_, double* p, const int* ldp, const double* a,
                        const int* lda, const double* b, const int* ldb, const double* c, const int* ldc,
                        const double* q, const int* ldq, double* r, const int* ldr, double* k, const int* ldk,
                        const double* tol, int*, double* dwork, const int* ldwork, int* info) {
  using namespace kfstab::slicot;
  const kfstab::Index n = *n_, m = *m_, l = *l_, one = 1;
  if (refuse("FB01VD",
             {{1, n >= 0},
              {2, m >= 0},
              {3, l >= 0},
              {5, *ldp >= std::max(one, n)},
              {7, *lda >= std::max(one, n)},
              {9, *ldb >= std::max(one, n)},
              {11, *ldc >= std::max(one, l)},
              {13, *ldq >= std::max(one, m)},
              {15, *ldr >= std::max(one, l)},
              {17, *ldk >= std::max(one, n)},
              {21, *ldwork >= std::max({one, l * n + 3 * l, n * n, n * m})}},
             info))
    return;
  const Result<double> result =
      fb01vd<double>(view(p, n, n, *ldp), view(a, n, n, *lda), view(b, n, m, *ldb), view(c, l, n, *ldc),
                     view(q, m, m, *ldq), view(r, l, l, *ldr), view(k, n, l, *ldk), *tol, dwork);
  *info = result.info;
  if (result.info == 0 || result.info == l + 1) dwork[0] = result.rcond;
}
