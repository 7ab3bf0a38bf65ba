// The instances of double are the library's own.
#include <gtest/gtest.h>

#include "filters/beside_reference.hpp"

namespace kfstab::test {

TEST(InstancesDouble, EveryFilterFollowsThePlainRecursion) { every_filter_follows_the_plain_recursion<double>(10); }

}  // namespace kfstab::test
