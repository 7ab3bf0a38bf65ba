#include <kfstab/experiments/curves.hpp>

#include <kfstab/experiments/models.hpp>

namespace kfstab::experiments {

reports::Curve measured(std::string_view filter, std::vector<double> x, std::vector<double> y,
                        reports::CurveRole role) {
  return {std::string(filter), std::string(filter), std::move(x), std::move(y), role, color_of(filter)};
}

reports::Curve theory_line(std::string id, std::string label, const std::vector<double>& x,
                           const std::function<double(double)>& f, double most) {
  reports::Curve line{std::move(id), std::move(label), {}, {}, reports::CurveRole::theory, -1};
  for (const double at : x) {
    const double y = f(at);
    if (!(y > 0 && y <= most)) continue;
    line.x.push_back(at);
    line.y.push_back(y);
  }
  return line;
}

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
