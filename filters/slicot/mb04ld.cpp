#include <kfstab/filters/slicot/slicot.h>
#include <kfstab/filters/slicot/arguments.hpp>
#include <kfstab/filters/structured_lq.hpp>

extern "C" void mb04ld_(const char* uplo, const int* n, const int* m, const int* p, double* l, const int* ldl,
                        double* a, const int* lda, double* b, const int* ldb, double* c, const int* ldc, double* tau,
                        double*) {
  using namespace kfstab::slicot;
  kfstab::structured_lq(is(uplo, 'L') ? kfstab::Shape::trapezoidal : kfstab::Shape::full, view(l, *n, *n, *ldl),
                        view(a, *n, *m, *lda), view(b, *p, *m, *ldb), view(c, *p, *n, *ldc),
                        VectorView<double>(tau, *n));
}
