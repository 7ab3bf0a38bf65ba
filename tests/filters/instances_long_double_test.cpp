#include <gtest/gtest.h>

#include <kfstab/filters/instances.hpp>

#include "filters/beside_reference.hpp"

template std::unique_ptr<kfstab::AnyFilter<long double>> kfstab::make_filter<long double>(std::string_view);

namespace kfstab::test {

TEST(InstancesLongDouble, EveryFilterFollowsThePlainRecursion) {
  every_filter_follows_the_plain_recursion<long double>(3);
}

}  // namespace kfstab::test
