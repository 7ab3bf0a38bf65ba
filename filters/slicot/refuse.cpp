#include <cstdio>
#include <cstring>

#include <kfstab/filters/slicot/slicot.h>
#include <kfstab/filters/slicot/arguments.hpp>

// Weak and not defined: the program's own XERBLA is called, or LAPACK's if the program uses LAPACK, wherever it
// stands on the linker's command line. A weak definition would keep LAPACK's out wherever this library comes first.
extern "C" [[gnu::weak]] void xerbla_(const char* routine, const int* argument, size_t length);

namespace kfstab::slicot {

bool refuse(const char* routine, std::initializer_list<Check> checks, int* info) {
  *info = 0;
  for (const Check& check : checks) {
    if (check.legal) continue;
    *info = -check.argument;
    // Without one, what LAPACK's says; and, as OpenBLAS's does, back to the caller, who has INFO.
    if (xerbla_)
      xerbla_(routine, &check.argument, std::strlen(routine));
    else
      std::fprintf(stderr, " ** On entry to %s parameter number %2d had an illegal value\n", routine, check.argument);
    return true;
  }
  return false;
}

}  // namespace kfstab::slicot
