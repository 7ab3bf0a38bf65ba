#include <kfstab/reference/trajectory.hpp>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include <kfstab/reference/detail/check.hpp>
#include <kfstab/reference/detail/lockstep.hpp>
#include <kfstab/reference/rounded.hpp>

namespace kfstab::reference {
namespace {

constexpr int most_wanted_digits = 750;  // what the highest lower rung can be asked for, with some left to lose

}  // namespace

namespace detail {

std::unique_ptr<Lockstep> make_lockstep(int pair, const Source& source, bool with_data) {
  return pair < 3 ? make_low_lockstep(pair, source, with_data) : make_high_lockstep(pair, source, with_data);
}

}  // namespace detail

struct Trajectory::Implementation {
  detail::Source source;
  std::shared_ptr<const Data> data;
  std::shared_ptr<const ExactData> exact_data;
  Request request;
  int pair = 0;
  std::int64_t k = -1;
  std::unique_ptr<detail::Lockstep> lockstep;
  std::unique_ptr<DataStream> stream;
  std::unique_ptr<DataStreamOf<Rational>> exact_stream;
  mutable Truth truth;
  mutable std::int64_t truth_of = -1;

  Implementation(detail::Source from, std::shared_ptr<const Data> d, std::shared_ptr<const ExactData> e, const Request& asked)
      : source(from), data(std::move(d)), exact_data(std::move(e)), request(asked) {
    const int wanted = request.digits;
    if (wanted < 1 || wanted > most_wanted_digits)
      throw ReferenceError("digits = " + std::to_string(wanted) + ": expected 1 to " +
                           std::to_string(most_wanted_digits));
    detail::check(source, with_data());
    const int first = request.first_digits > 0 ? request.first_digits : wanted + detail::spare_digits;
    while (pair + 1 < detail::pairs && detail::rung_digits[pair] < first) ++pair;
    restart();
  }

  bool with_data() const { return data || exact_data; }

  /// Both runs at their beginning, at the current pair of rungs.
  void restart() {
    lockstep = detail::make_lockstep(pair, source, with_data());
    stream = data ? data->open() : nullptr;
    exact_stream = exact_data ? exact_data->open() : nullptr;
  }

  bool step(std::int64_t at) {
    detail::SourceData now = static_cast<const StepData*>(nullptr);
    if (stream) now = &stream->next();
    if (exact_stream) now = &exact_stream->next();
    if (with_data()) detail::check(now, source, at);
    return lockstep->advance(now, request);
  }

  /// From step 0 to step `last`, at the current pair.
  bool replay(std::int64_t last) {
    restart();
    for (std::int64_t at = 0; at <= last; ++at)
      if (!step(at)) return false;
    return true;
  }

  /// To the rung that has room for what was lost here, or the next one.
  void climb() {
    if (pair + 1 == detail::pairs)
      throw ReferenceError("fewer than " + std::to_string(request.digits) + " digits can be certified with " +
                           std::to_string(lockstep->higher_digits()) + " at work; " + lockstep->why());
    const int certified = lockstep->certified_digits();
    const int needed = certified > 0 ? request.digits + lockstep->lower_digits() - certified : 0;
    do ++pair;
    while (pair + 1 < detail::pairs && detail::rung_digits[pair] < needed);
  }
};

Trajectory::Trajectory(const AnyProblem<double>& problem, std::shared_ptr<const Data> data, Request request)
    : implementation_(std::make_unique<Implementation>(&problem, std::move(data), nullptr, request)) {}

Trajectory::Trajectory(const ExactProblem& problem, std::shared_ptr<const ExactData> data, Request request)
    : implementation_(std::make_unique<Implementation>(&problem, nullptr, std::move(data), request)) {}

Trajectory::~Trajectory() = default;
Trajectory::Trajectory(Trajectory&&) noexcept = default;
Trajectory& Trajectory::operator=(Trajectory&&) noexcept = default;

void Trajectory::advance() {
  Implementation& self = *implementation_;
  bool certified = self.step(self.k + 1);
  while (!certified) {
    self.climb();
    certified = self.replay(self.k + 1);
  }
  ++self.k;
}

std::int64_t Trajectory::k() const { return implementation_->k; }

const Truth& Trajectory::truth() const {
  const Implementation& self = *implementation_;
  if (self.truth_of != self.k) {
    self.lockstep->round_into(self.truth);
    self.truth_of = self.k;
  }
  return self.truth;
}

int Trajectory::certified_digits() const { return implementation_->lockstep->certified_digits(); }
int Trajectory::certified_digits(Quantity quantity) const {
  return implementation_->lockstep->certified_digits(quantity);
}
int Trajectory::working_digits() const { return implementation_->lockstep->higher_digits(); }

std::vector<Matrix<double>> Trajectory::expansion(Quantity quantity, int terms) const {
  return implementation_->lockstep->expansion(quantity, terms);
}

std::vector<std::vector<std::string>> Trajectory::decimals(Quantity quantity, int most_digits) const {
  return implementation_->lockstep->decimals(quantity, most_digits);
}

template <class Scalar>
Errors Trajectory::measure(const Metadata& metadata, const Step<Scalar>& step) const {
  return implementation_->lockstep->measure(metadata, step);
}
template Errors Trajectory::measure(const Metadata& metadata, const Step<double>& step) const;
template Errors Trajectory::measure(const Metadata& metadata, const Step<Rounded>& step) const;

Matrix<double> Trajectory::entry_errors(const Metadata& metadata, const Step<double>& step) const {
  return implementation_->lockstep->entry_errors(metadata, step);
}

}  // namespace kfstab::reference
