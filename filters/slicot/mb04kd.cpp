#include <kfstab/filters/slicot/slicot.h>
#include <kfstab/filters/slicot/arguments.hpp>
#include <kfstab/filters/structured_lq.hpp>

extern "C" void mb04kd_(const char* uplo, const int* n, const int* m, const int* p, double* r, const int* ldr,
                        double* a, const int* lda, double* b, const int* ldb, double* c, const int* ldc, double* tau,
                        double*) {
  using namespace kfstab::slicot;
  kfstab::structured_qr(is(uplo, 'U') ? kfstab::Shape::trapezoidal : kfstab::Shape::full, view(r, *n, *n, *ldr),
                        view(a, *p, *n, *lda), view(b, *p, *m, *ldb), view(c, *n, *m, *ldc),
                        VectorView<double>(tau, *n));
}
