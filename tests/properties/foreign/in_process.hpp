#pragma once

#include <optional>
#include <variant>

#include <kfstab/properties/subject.hpp>

#include "textbook.hpp"

namespace kfstab::properties::testing {

/// The filter of the test program, on this side.
class InProcess final : public StepwiseFilter {
 public:
  InProcess() {
    traits_.name = "in process";
    traits_.gain = GainKind::filter;
  }
  const Traits& traits() const override { return traits_; }
  std::optional<Ending> start(const Dimensions&, const Vector<double>& x, const Matrix<double>& P) override {
    filter_.x = x;
    filter_.P = P;
    return std::nullopt;
  }
  std::variant<Answer, Ending> step(const StepInput& input) override {
    if (input.y) filter_.update(input.C, input.R, *input.y);
    filter_.predict(input.A, input.B, input.Q);
    if (input.u) filter_.x += *input.D * *input.u;
    Answer answer;
    answer.held = filter_.P;
    answer.state = filter_.x;
    if (input.y) answer.gain = filter_.K;
    return answer;
  }

 private:
  Traits traits_;
  Textbook<double> filter_;
};

}  // namespace kfstab::properties::testing
