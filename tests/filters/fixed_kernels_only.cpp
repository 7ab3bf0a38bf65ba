// Where the library has but one set of kernels, that which all is compiled for.
#include "filters/fixed_kernels_text.hpp"

const kfstab::test::FixedKernels kfstab::test::fixed_only = KFSTAB_KERNELS::fixed;
