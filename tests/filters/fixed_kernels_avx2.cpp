#include "filters/fixed_kernels_text.hpp"

const kfstab::test::FixedKernels kfstab::test::fixed_avx2 = avx2::fixed;
