#include <kfstab/filters/registry.hpp>

#include <algorithm>
#include <array>

namespace kfstab {
namespace {

constexpr auto all = std::to_array<Metadata>({
#define KFSTAB_FILTER(header, Filter, ...) Metadata{__VA_ARGS__},
#include <kfstab/filters/registry.inc>
#undef KFSTAB_FILTER
});

}  // namespace

std::span<const Metadata> filters() { return all; }

const Metadata* find_filter(std::string_view id) {
  const auto it = std::ranges::find(all, id, &Metadata::id);
  return it == all.end() ? nullptr : &*it;
}

}  // namespace kfstab
