#pragma once

#include <cstdint>
#include <vector>

#include <kfstab/experiments/constants.hpp>

namespace kfstab::experiments {

/// A quantity over the steps of a run, in bounded memory: beyond `capacity` points it keeps the first, the last and the
/// extremes of equal stretches of steps, so nothing that a plot could show is lost.
class Series {
 public:
  static constexpr std::size_t capacity = 10000;

  Series() = default;
  /// What points() and count() of another said: how a stored series comes back.
  struct Points;
  Series(const Points& points, std::int64_t count);

  void add(std::int64_t step, double value);

  struct Points {
    std::vector<double> step;
    std::vector<double> value;
  };
  /// In the order of steps.
  Points points() const;

  std::int64_t count() const { return count_; }
  /// The last value, the largest and the smallest; NaN counts in none of the two but for a series of nothing else. NaN
  /// for an empty series.
  double last() const { return last_.value; }
  double largest() const { return largest_; }
  double smallest() const { return smallest_; }

 private:
  struct Point {
    std::int64_t step;
    double value;
  };
  struct Stretch {
    Point low, high;
  };
  static void widen(Stretch& stretch, Point point);

  std::vector<Stretch> stretches_;
  std::int64_t width_ = 1;  ///< steps in a stretch
  std::int64_t count_ = 0;
  Point first_{0, NaN}, last_{0, NaN};
  double largest_ = NaN, smallest_ = NaN;
};

}  // namespace kfstab::experiments
