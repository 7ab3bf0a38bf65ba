#include <kfstab/experiments/series.hpp>

#include <cmath>

namespace kfstab::experiments {

void Series::widen(Stretch& stretch, Point point) {
  if (std::isnan(stretch.low.value) || point.value < stretch.low.value) stretch.low = point;
  if (std::isnan(stretch.high.value) || point.value > stretch.high.value) stretch.high = point;
}

Series::Series(const Points& points, std::int64_t count) {
  for (std::size_t i = 0; i < points.step.size(); ++i) {
    const Point point{static_cast<std::int64_t>(points.step[i]), points.value[i]};
    if (i == 0) first_ = point;
    last_ = point;
    stretches_.push_back({point, point});
    if (std::isnan(largest_) || point.value > largest_) largest_ = point.value;
    if (std::isnan(smallest_) || point.value < smallest_) smallest_ = point.value;
  }
  count_ = count;
}

void Series::add(std::int64_t step, double value) {
  const Point point{step, value};
  if (count_ == 0) first_ = point;
  last_ = point;
  if (std::isnan(largest_) || value > largest_) largest_ = value;
  if (std::isnan(smallest_) || value < smallest_) smallest_ = value;

  if (count_ % width_ == 0) {
    // One point a stretch as long as all are kept, then two: half of the capacity in stretches is the whole of it.
    while (stretches_.size() >= (width_ == 1 ? capacity : capacity / 2)) {
      for (std::size_t i = 0; i < stretches_.size() / 2; ++i) {
        Stretch merged = stretches_[2 * i];
        widen(merged, stretches_[2 * i + 1].low);
        widen(merged, stretches_[2 * i + 1].high);
        stretches_[i] = merged;
      }
      stretches_.resize(stretches_.size() / 2);
      width_ *= 2;
    }
    stretches_.push_back({point, point});
  } else {
    widen(stretches_.back(), point);
  }
  ++count_;
}

Series::Points Series::points() const {
  Points points;
  const auto add = [&](Point p) {
    if (!points.step.empty() && points.step.back() >= static_cast<double>(p.step)) return;
    points.step.push_back(static_cast<double>(p.step));
    points.value.push_back(p.value);
  };
  if (count_ == 0) return points;
  add(first_);
  for (const Stretch& s : stretches_) {
    const bool rising = s.low.step <= s.high.step;
    add(rising ? s.low : s.high);
    add(rising ? s.high : s.low);
  }
  add(last_);
  return points;
}

}  // namespace kfstab::experiments
