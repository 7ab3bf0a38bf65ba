#include <kfstab/reference/rounded.hpp>

#include <string>
#include <utility>

#include <kfstab/filters/registry.hpp>
#include <kfstab/reference/error.hpp>

namespace kfstab::reference {
namespace {

constexpr int bits_of_double = std::numeric_limits<double>::digits;

/// At this thread's bits.
Rounded to_rounded(double x) { return Rounded(x); }
double to_fewer_bits(double x) { return static_cast<double>(Rounded(x)); }

class RoundedStream final : public DataStream {
 public:
  RoundedStream(std::unique_ptr<DataStream> stream, int bits) : stream_(std::move(stream)), bits_(bits) {}
  const StepData& next() override {
    const StepData& step = stream_->next();
    const RoundedBits at(bits_);
    rounded_ = {convert(step.y, to_fewer_bits), convert(step.u, to_fewer_bits)};
    return rounded_;
  }

 private:
  std::unique_ptr<DataStream> stream_;
  int bits_;
  StepData rounded_;
};

class RoundedData final : public Data {
 public:
  RoundedData(std::shared_ptr<const Data> data, int bits) : data_(std::move(data)), bits_(bits) {}
  std::unique_ptr<DataStream> open() const override { return std::make_unique<RoundedStream>(data_->open(), bits_); }

 private:
  std::shared_ptr<const Data> data_;
  int bits_;
};

}  // namespace

RoundedBits::RoundedBits(int bits) : before_(Rounded::bits_) {
  if (bits < Rounded::least_bits || bits > Rounded::most_bits)
    throw ReferenceError("bits = " + std::to_string(bits) + ": expected " + std::to_string(Rounded::least_bits) +
                         " to " + std::to_string(Rounded::most_bits));
  Rounded::bits_ = bits;
}

AnyProblem<double> rounded(const AnyProblem<double>& problem, int bits) {
  const RoundedBits at(bits);
  return bits < bits_of_double ? convert(problem, to_fewer_bits) : problem;
}

std::shared_ptr<const Data> rounded(std::shared_ptr<const Data> data, int bits) {
  const RoundedBits at(bits);
  if (!data || bits >= bits_of_double) return data;
  return std::make_shared<RoundedData>(std::move(data), bits);
}

RoundedFilter::RoundedFilter(const Metadata& metadata, int bits) : bits_(bits) {
  const RoundedBits at(bits_);
  filter_ = make_filter<Rounded>(metadata.id);
}

void RoundedFilter::start(const AnyProblem<double>& problem) {
  const RoundedBits at(bits_);
  problem_ = convert(problem, to_rounded);
  filter_->start(problem_);
}

Step<Rounded> RoundedFilter::step(std::int64_t k, const Vector<double>* y, const Vector<double>* u) {
  const RoundedBits at(bits_);
  Vector<Rounded> y_rounded, u_rounded;
  if (y) y_rounded = convert(*y, to_rounded);
  if (u) u_rounded = convert(*u, to_rounded);
  Step<Rounded> step = filter_->step(k, y ? &y_rounded : nullptr, u ? &u_rounded : nullptr);
  if (step.held) step.held = &*step.held;  // made here, with these bits, not where somebody looks
  return step;
}

}  // namespace kfstab::reference
