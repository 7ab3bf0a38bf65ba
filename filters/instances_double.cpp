#include <kfstab/filters/instances.hpp>

template std::unique_ptr<kfstab::AnyFilter<double>> kfstab::make_filter<double>(std::string_view);
