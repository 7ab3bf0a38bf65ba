#pragma once

#include <memory>
#include <span>
#include <string_view>

#include <kfstab/filters/any_filter.hpp>
#include <kfstab/filters/metadata.hpp>

namespace kfstab {

/// Every filter that there is, in the order of registry.inc.
std::span<const Metadata> filters();

/// The filter of that id, or null.
const Metadata* find_filter(std::string_view id);

/// A new filter, not yet started. Instantiated for double in the library (instances_double.cpp); a program that wants
/// another scalar instantiates instances.hpp for it. Throws std::invalid_argument for an unknown id, or if
/// KFSTAB_ISA names kernels that this machine cannot run.
template <class Scalar>
std::unique_ptr<AnyFilter<Scalar>> make_filter(std::string_view id);
extern template std::unique_ptr<AnyFilter<double>> make_filter<double>(std::string_view);

}  // namespace kfstab
