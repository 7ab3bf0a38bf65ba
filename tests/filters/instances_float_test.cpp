#include <gtest/gtest.h>

#include <kfstab/filters/instances.hpp>

#include "filters/beside_reference.hpp"

template std::unique_ptr<kfstab::AnyFilter<float>> kfstab::make_filter<float>(std::string_view);

namespace kfstab::test {

TEST(InstancesFloat, EveryFilterFollowsThePlainRecursion) { every_filter_follows_the_plain_recursion<float>(3); }

}  // namespace kfstab::test
