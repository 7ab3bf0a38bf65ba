#include <kfstab/experiments/catalogue.hpp>

#include <algorithm>

#include <fmt/core.h>

#include <kfstab/properties/input_error.hpp>

namespace kfstab::experiments {

properties::System find_system(const std::string& word, const properties::Overrides& overrides) {
  if (word.find('/') != std::string::npos || word.ends_with(".toml") || word.ends_with(".json"))
    return properties::read_system(word, overrides);
  const auto entry = std::ranges::find(catalogue(), word, &CatalogueEntry::name);
  if (entry != catalogue().end())
    return properties::read_system_text(entry->toml, properties::Format::toml, fmt::format("catalogue: {}.toml", word),
                                        overrides);
  std::vector<std::string> names;
  for (const CatalogueEntry& e : catalogue()) names.emplace_back(e.name);
  throw properties::InputError(
      properties::Place{}, fmt::format("no system called '{}'", word),
      fmt::format("a name that `kfstab list systems` prints, or a file (with a '/' in it, or ending in .toml or .json){}",
                  properties::did_you_mean(word, names)));
}

}  // namespace kfstab::experiments
