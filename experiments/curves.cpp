#include <kfstab/experiments/curves.hpp>

#include <kfstab/experiments/models.hpp>

namespace kfstab::experiments {

reports::Curve measured_points(std::string id, std::string label, const std::string& filter) {
  return {std::move(id), std::move(label), {}, {}, reports::CurveRole::measured_points, color_of(filter)};
}

reports::Curve theory_line(std::string id, std::string label) {
  return {std::move(id), std::move(label), {}, {}, reports::CurveRole::theory, -1};
}

void add_point(reports::Curve& curve, double x, double y) {
  curve.x.push_back(x);
  curve.y.push_back(y);
}

}  // namespace kfstab::experiments
