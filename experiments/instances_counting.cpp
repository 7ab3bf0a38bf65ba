#include <kfstab/filters/counting.hpp>
#include <kfstab/filters/instances.hpp>

template std::unique_ptr<kfstab::AnyFilter<kfstab::Counting<double>>> kfstab::make_filter<kfstab::Counting<double>>(
    std::string_view);
