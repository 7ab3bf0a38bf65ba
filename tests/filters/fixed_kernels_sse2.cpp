#include "filters/fixed_kernels_text.hpp"

const kfstab::test::FixedKernels kfstab::test::fixed_sse2 = sse2::fixed;
