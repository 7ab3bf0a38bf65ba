#include <kfstab/reference/trajectory.hpp>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include <kfstab/reference/detail/check.hpp>
#include <kfstab/reference/detail/lockstep.hpp>

namespace kfstab::reference {
namespace {

constexpr int most_digits = 750;  // what the highest lower rung can be asked for, with some left to lose

}  // namespace

namespace detail {

std::unique_ptr<Lockstep> make_lockstep(int pair, const AnyProblem<double>& problem, bool with_data) {
  return pair < 3 ? make_low_lockstep(pair, problem, with_data) : make_high_lockstep(pair, problem, with_data);
}

}  // namespace detail

struct Trajectory::Implementation {
  const AnyProblem<double>* problem;
  std::shared_ptr<const Data> data;
  int wanted;
  int pair = 0;
  std::int64_t k = -1;
  std::unique_ptr<detail::Lockstep> lockstep;
  std::unique_ptr<DataStream> stream;
  Truth truth;

  /// Both runs at their beginning, at the current pair of rungs.
  void restart() {
    lockstep = detail::make_lockstep(pair, *problem, data != nullptr);
    stream = data ? data->open() : nullptr;
  }

  bool step(std::int64_t at) {
    const StepData* step_data = nullptr;
    if (stream) {
      step_data = &stream->next();
      detail::check(*step_data, *problem, at);
    }
    return lockstep->advance(step_data, wanted);
  }

  /// From step 0 to step `last`, at the current pair.
  bool replay(std::int64_t last) {
    restart();
    for (std::int64_t at = 0; at <= last; ++at)
      if (!step(at)) return false;
    return true;
  }
};

Trajectory::Trajectory(const AnyProblem<double>& problem, std::shared_ptr<const Data> data, int digits,
                       int first_digits)
    : implementation_(std::make_unique<Implementation>()) {
  if (digits < 1 || digits > most_digits)
    throw ReferenceError("digits = " + std::to_string(digits) + ": expected 1 to " + std::to_string(most_digits));
  detail::check(problem, data != nullptr);
  Implementation& self = *implementation_;
  self.problem = &problem;
  self.data = std::move(data);
  self.wanted = digits;
  while (self.pair + 1 < detail::pairs && detail::rung_digits[self.pair] < first_digits) ++self.pair;
  self.restart();
}

Trajectory::~Trajectory() = default;
Trajectory::Trajectory(Trajectory&&) noexcept = default;
Trajectory& Trajectory::operator=(Trajectory&&) noexcept = default;

void Trajectory::advance() {
  Implementation& self = *implementation_;
  bool certified = self.step(self.k + 1);
  while (!certified) {
    if (self.pair + 1 == detail::pairs)
      throw ReferenceError("fewer than " + std::to_string(self.wanted) + " digits can be certified with " +
                           std::to_string(self.lockstep->higher_digits()) + " at work; " + self.lockstep->why());
    ++self.pair;
    certified = self.replay(self.k + 1);
  }
  self.lockstep->round_into(self.truth);
  ++self.k;
}

std::int64_t Trajectory::k() const { return implementation_->k; }
const Truth& Trajectory::truth() const { return implementation_->truth; }
int Trajectory::certified_digits() const { return implementation_->lockstep->certified_digits(); }
int Trajectory::working_digits() const { return implementation_->lockstep->higher_digits(); }

std::vector<Matrix<double>> Trajectory::expansion(Quantity quantity, int terms) const {
  return implementation_->lockstep->expansion(quantity, terms);
}

Errors Trajectory::measure(const Metadata& metadata, const Step<double>& step) const {
  return implementation_->lockstep->measure(metadata, step);
}

}  // namespace kfstab::reference
