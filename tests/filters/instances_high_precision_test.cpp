#include <gtest/gtest.h>

#include "filters/high_precision.hpp"

#include <kfstab/filters/instances.hpp>

#include "filters/beside_reference.hpp"

template std::unique_ptr<kfstab::AnyFilter<kfstab::test::HighPrecision>>
    kfstab::make_filter<kfstab::test::HighPrecision>(std::string_view);

namespace kfstab::test {

TEST(InstancesHighPrecision, EveryFilterFollowsThePlainRecursion) {
  every_filter_follows_the_plain_recursion<HighPrecision>(2);
}

}  // namespace kfstab::test
