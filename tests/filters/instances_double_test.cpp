// The instances of double are the library's own.
#include <gtest/gtest.h>

#include "filters/beside_reference.hpp"
#include "filters/with_kernels.hpp"

namespace kfstab::test {

TEST(InstancesDouble, EveryFilterFollowsThePlainRecursion) {
  for (const std::string& isa : all_kernels()) {
    SCOPED_TRACE(isa);
    const WithKernels with(isa);
    every_filter_follows_the_plain_recursion<double>(10);
  }
}

}  // namespace kfstab::test
