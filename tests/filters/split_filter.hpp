#pragma once

#include <memory>
#include <span>
#include <string_view>

#include <kfstab/filters/problem.hpp>
#include <kfstab/filters/step_report.hpp>

namespace kfstab::test {

/// The filters whose step comes in two halves, behind one interface, so that their templates are compiled in one source
/// alone (updates_test.cpp). Model k of the problem that start() took is used.
class SplitFilter {
 public:
  virtual ~SplitFilter() = default;
  virtual void start(const AnyProblem<double>& problem) = 0;
  virtual StepReport<double> measurement_update(std::int64_t k, const Vector<double>* y) = 0;
  virtual StepReport<double> time_update(std::int64_t k, const Vector<double>* u) = 0;
  /// For an information filter from k|k to k+1|k+1, else from k|k-1 to k+1|k.
  virtual StepReport<double> step(std::int64_t k, const Vector<double>* y, const Vector<double>* u) = 0;

  virtual const Matrix<double>& held() const = 0;
  /// P C' Re^{-1} of the last measurement_update.
  virtual const Matrix<double>& filter_gain() const = 0;
  virtual const Vector<double>& state() const = 0;
};

std::span<const std::string_view> split_filters();
std::unique_ptr<SplitFilter> make_split_filter(std::string_view id);

}  // namespace kfstab::test
