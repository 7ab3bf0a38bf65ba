#include <kfstab/properties/input_error.hpp>

#include <algorithm>
#include <cctype>
#include <utility>

namespace kfstab::properties {

namespace {

std::string sentence(const Place& place, const std::string& found, const std::string& expected) {
  std::string text = place.origin;
  if (place.line > 0) {
    text += ':' + std::to_string(place.line);
    if (place.column > 0) text += ':' + std::to_string(place.column);
  }
  for (const std::string* part : {&place.pointer, &place.field})
    if (!part->empty()) text += (text.empty() ? "" : ": ") + *part;
  text += (text.empty() ? "found " : ": found ") + found;
  if (!expected.empty()) text += ", expected " + expected;
  return text;
}

/// Optimal string alignment: insertions, deletions, changes and swaps of neighbours.
std::size_t edits(std::string_view a, std::string_view b) {
  std::vector<std::vector<std::size_t>> d(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
  const auto lower = [](char c) { return std::tolower(static_cast<unsigned char>(c)); };
  for (std::size_t i = 0; i <= a.size(); ++i)
    for (std::size_t j = 0; j <= b.size(); ++j) {
      if (i == 0 || j == 0) {
        d[i][j] = i + j;
        continue;
      }
      const bool same = lower(a[i - 1]) == lower(b[j - 1]);
      d[i][j] = std::min({d[i - 1][j] + 1, d[i][j - 1] + 1, d[i - 1][j - 1] + (same ? 0U : 1U)});
      if (i > 1 && j > 1 && lower(a[i - 1]) == lower(b[j - 2]) && lower(a[i - 2]) == lower(b[j - 1]))
        d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
    }
  return d[a.size()][b.size()];
}

}  // namespace

InputError::InputError(Place place, std::string found, std::string expected)
    : std::runtime_error(sentence(place, found, expected)),
      place_(std::move(place)),
      found_(std::move(found)),
      expected_(std::move(expected)) {}

std::vector<std::string> near_misses(std::string_view name, std::span<const std::string> known) {
  if (name.size() > 100) return {};
  std::vector<std::pair<std::size_t, std::string>> near;
  for (const std::string& candidate : known) {
    const std::size_t distance = edits(name, candidate);
    if (distance <= std::max<std::size_t>(1, std::max(name.size(), candidate.size()) / 3)) near.emplace_back(distance, candidate);
  }
  std::stable_sort(near.begin(), near.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<std::string> names;
  for (std::size_t i = 0; i < std::min<std::size_t>(3, near.size()); ++i) names.push_back(near[i].second);
  return names;
}

std::string did_you_mean(std::string_view name, std::span<const std::string> known) {
  const std::vector<std::string> near = near_misses(name, known);
  std::string text;
  for (std::size_t i = 0; i < near.size(); ++i) {
    if (i == 0)
      text = "; did you mean '";
    else
      text += i + 1 == near.size() ? " or '" : ", '";
    text += near[i] + "'";
  }
  return text.empty() ? text : text + "?";
}

}  // namespace kfstab::properties
