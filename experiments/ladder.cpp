#include <kfstab/experiments/ladder.hpp>

#include <algorithm>
#include <string>

#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/models.hpp>

namespace kfstab::experiments {

void Ladder::add(std::size_t rung, double difficulty, double value) {
  if (rung >= values_.size()) {
    values_.resize(rung + 1);
    difficulties_.resize(rung + 1);
  }
  difficulties_[rung].push_back(difficulty);
  values_[rung].push_back(value);
}

std::vector<double> Ladder::difficulties() const {
  std::vector<double> result;
  for (const auto& rung : difficulties_) result.push_back(median(rung));
  return result;
}

std::vector<double> Ladder::quantiles(double fraction) const {
  std::vector<double> result;
  for (const auto& rung : values_) result.push_back(quantile(rung, fraction));
  return result;
}

double Ladder::growth() const {
  const auto all = medians();
  return all.empty() ? NaN : *std::ranges::max_element(all) / all.front();
}

void add_curves(reports::Figure& figure, const Ladder& ladder, std::string_view filter) {
  const std::string id(filter);
  const auto x = ladder.difficulties();
  figure.curves.push_back({id, id, x, ladder.medians(), reports::CurveRole::measured_points, color_of(filter)});
  for (const auto& [name, fraction] : {std::pair{"lower", .25}, {"upper", .75}})
    figure.curves.push_back({id + "-" + name + "-quartile", "", x, ladder.quantiles(fraction),
                             reports::CurveRole::quartile, color_of(filter)});
}

}  // namespace kfstab::experiments
