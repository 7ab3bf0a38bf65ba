#include <kfstab/experiments/selection.hpp>

#include <regex>

#include <fmt/core.h>

#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/input_error.hpp>

namespace kfstab::experiments {

Selection::Selection(const std::string& expression, const std::string& what) {
  const bool excluded = expression.starts_with('-');
  const std::string pattern = excluded ? expression.substr(1) : expression;
  if (pattern.empty()) {
    matches_ = [](std::string_view) { return true; };
    return;
  }
  try {
    matches_ = [regex = std::regex(pattern), excluded](std::string_view name) {
      return std::regex_search(name.begin(), name.end(), regex) != excluded;
    };
  } catch (const std::regex_error& error) {
    properties::Place place;
    place.origin = what;
    throw properties::InputError(place, fmt::format("'{}'", expression),
                                 fmt::format("a regular expression ({})", error.what()));
  }
}

bool Selection::operator()(std::string_view name) const { return matches_(name); }

std::vector<const Metadata*> select_filters(const std::string& expression) {
  const Selection selects(expression, "--filters");
  std::vector<const Metadata*> selected;
  for (const Metadata& metadata : filters())
    if (selects(metadata.id)) selected.push_back(&metadata);
  if (selected.empty())
    throw NothingSelected(
        fmt::format("--filters: no filter matches '{}'; `kfstab list filters` prints their names", expression));
  return selected;
}

}  // namespace kfstab::experiments
