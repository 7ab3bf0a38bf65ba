#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <kfstab/properties/system_file.hpp>

/// The systems that come with kfstab: experiments/systems/*.toml, built in, so they are found from any folder.
namespace kfstab::experiments {

struct CatalogueEntry {
  std::string_view name;
  std::string_view toml;
};

/// In alphabetical order.
std::span<const CatalogueEntry> catalogue();

/// A system as users name it: a file if the word holds a '/' or ends in .toml or .json, else a name of the catalogue.
/// Throws properties::InputError, with near misses for an unknown name.
properties::System find_system(const std::string& word, const properties::Overrides& overrides = {});

}  // namespace kfstab::experiments
