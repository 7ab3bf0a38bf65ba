#include <algorithm>

#include <kfstab/filters/slicot/slicot.h>
#include <kfstab/filters/condensed.hpp>
#include <kfstab/filters/slicot/arguments.hpp>

extern "C" void tb01md_(const char* jobu, const char* uplo, const int* n_, const int* m_, double* a, const int* lda,
                        double* b, const int* ldb, double* u, const int* ldu, double*, int* info) {
  using namespace kfstab::slicot;
  const kfstab::Index n = *n_, m = *m_, one = 1;
  const bool from_identity = is(jobu, 'I'), with_U = from_identity || is(jobu, 'U'), upper = is(uplo, 'U');
  if (refuse("TB01MD",
             {{1, with_U || is(jobu, 'N')},
              {2, upper || is(uplo, 'L')},
              {3, n >= 0},
              {4, m >= 0},
              {6, *lda >= std::max(one, n)},
              {8, *ldb >= std::max(one, n)},
              {10, *ldu >= (with_U ? std::max(one, n) : one)}},
             info))
    return;
  auto U = view(u, with_U ? n : 0, n, *ldu);
  if (from_identity) U.setIdentity();
  kfstab::controller_hessenberg(upper ? kfstab::Triangle::upper : kfstab::Triangle::lower, view(a, n, n, *lda),
                                view(b, n, m, *ldb), U);
}
