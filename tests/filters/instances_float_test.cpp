// The instances are in instances_float.cpp: tests of the reference have need of them too.
#include <gtest/gtest.h>

#include "filters/beside_reference.hpp"

namespace kfstab::test {

TEST(InstancesFloat, EveryFilterFollowsThePlainRecursion) { every_filter_follows_the_plain_recursion<float>(3); }

}  // namespace kfstab::test
