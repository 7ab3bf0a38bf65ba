#include <kfstab/filters/instances.hpp>

template std::unique_ptr<kfstab::AnyFilter<float>> kfstab::make_filter<float>(std::string_view);
