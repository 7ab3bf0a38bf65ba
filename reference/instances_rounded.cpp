#include <kfstab/filters/instances.hpp>
#include <kfstab/reference/rounded.hpp>

template std::unique_ptr<kfstab::AnyFilter<kfstab::reference::Rounded>> kfstab::make_filter<kfstab::reference::Rounded>(
    std::string_view);
