#include <kfstab/experiments/reference_steps.hpp>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <memory>
#include <vector>

#include <nlohmann/json.hpp>

#include <kfstab/experiments/context.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/step_cache.hpp>
#include <kfstab/properties/data.hpp>
#include <kfstab/properties/exact.hpp>
#include <kfstab/reference/trajectory.hpp>
#include <kfstab/reports/files.hpp>
#include <kfstab/reports/number.hpp>

namespace kfstab::experiments {
namespace {

using reference::ExactData;
using reference::ExactProblem;
using reference::Quantity;
using reference::Rational;
using reference::Trajectory;
using json = nlohmann::ordered_json;

/// A double as its shortest decimal, any other number as a fraction.
std::string text(const Rational& x) {
  const double rounded = reference::round_to_double(x);
  return Rational(rounded) == x ? reports::exact_number(rounded) : x.str();
}

json texts(const Vector<Rational>& x) {
  json list = json::array();
  for (Index i = 0; i < x.size(); ++i) list.push_back(text(x(i)));
  return list;
}

/// What one step comes to: an object of kfstab.reference/1.
class Line {
 public:
  Line(const Trajectory& truth, int digits) : truth_(truth), digits_(digits) { step_["k"] = truth.k(); }

  void matrix(const char* name, Quantity quantity) { step_[name] = rows(quantity); }
  void vector(const char* name, Quantity quantity) {
    json list = json::array();
    for (const auto& row : rows(quantity)) list.push_back(row.front());
    step_[name] = std::move(list);
  }
  void number(const char* name, Quantity quantity) { step_[name] = rows(quantity).front().front(); }
  /// written: y as it was, with a NaN for an entry that is missing.
  void data(const StepDataOf<Rational>& data, const Vector<double>& written) {
    step_["y"] = texts(data.y);
    for (Index i = 0; i < written.size(); ++i)
      if (std::isnan(written(i))) step_["y"][static_cast<std::size_t>(i)] = "missing";
    if (data.u.size() > 0) step_["u"] = texts(data.u);
  }
  std::string text() {
    step_["certified_digits"] = certified_;
    return step_.dump();
  }

 private:
  std::vector<std::vector<std::string>> rows(Quantity quantity) {
    certified_ = std::min(certified_, truth_.certified_digits(quantity));
    return truth_.decimals(quantity, digits_);
  }

  const Trajectory& truth_;
  int digits_;
  int certified_ = std::numeric_limits<int>::max();
  json step_ = json::object();
};

/// Computes step by step, and says what each came to.
class Computation {
 public:
  /// written: the data in which what is missing is still so.
  Computation(const ExactProblem& problem, std::shared_ptr<const ExactData> data, const Data* written, int digits)
      : digits_(digits), data_(data ? data->open() : nullptr), written_(written ? written->open() : nullptr),
        truth_(problem, data, {.digits = digits, .each_entry = true}) {}

  std::string next() {
    truth_.advance();
    Line line(truth_, digits_);
    line.matrix("P", Quantity::P_predicted);
    line.matrix("P_filtered", Quantity::P_filtered);
    line.matrix("K", Quantity::predictor_gain);
    line.matrix("Re", Quantity::innovation);
    if (data_) {
      line.vector("x", Quantity::x_predicted);
      const Vector<double>& written = written_->next().y;
      // That of the reference counts the zeros in the place of what is missing.
      if (!written.hasNaN()) line.number("log_likelihood", Quantity::log_likelihood);
      line.data(data_->next(), written);
    }
    return line.text();
  }

 private:
  int digits_;
  std::unique_ptr<DataStreamOf<Rational>> data_;
  std::unique_ptr<DataStream> written_;
  Trajectory truth_;
};

void add(Checksum& checksum, const Matrix<Rational>& X) {
  checksum.add(std::to_string(X.rows()) + " x " + std::to_string(X.cols()));
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) checksum.add(X(i, j).str());
}

/// The program's own bytes: two builds of one revision may differ, and so may what they compute.
void add_program(Checksum& checksum) {
  for (const auto& [name, value] : context())
    if (name != "date") checksum.add(value);
  std::ifstream program("/proc/self/exe", std::ios::binary);
  std::string piece(std::size_t{1} << 20, '\0');
  while (program.read(piece.data(), static_cast<std::streamsize>(piece.size())) || program.gcount() > 0)
    checksum.add(std::string_view(piece).substr(0, static_cast<std::size_t>(program.gcount())));
}

/// Of everything that the lines depend on.
std::string cache_key(const ExactProblem& problem, const ExactData* data, const Data* written, std::int64_t steps,
                      int digits) {
  Checksum checksum;
  add_program(checksum);
  checksum.add(std::to_string(digits));
  checksum.add(std::to_string(steps));
  checksum.add(std::to_string(problem.models.size()));
  for (const auto& model : problem.models)
    for (const auto* X : {&model.A, &model.B, &model.C, &model.D, &model.Q, &model.R}) add(checksum, *X);
  add(checksum, problem.initial);
  add(checksum, problem.x0);
  checksum.add(data ? "data" : "no data");
  if (data) {
    const auto stream = data->open();
    const auto with_gaps = written->open();
    for (std::int64_t k = 0; k < steps; ++k) {
      const auto& step = stream->next();
      add(checksum, step.y);
      add(checksum, step.u);
      for (const double y : with_gaps->next().y) checksum.add(std::isnan(y) ? "missing" : "there");
    }
  }
  return checksum.hex();
}

}  // namespace

ReferenceOutcome reference_steps(const properties::System& system, const ReferenceRequest& request,
                                 const std::function<void(std::string_view)>& take) {
  ReferenceOutcome outcome;
  const auto done = [&](std::string_view line) {
    take(line);
    ++outcome.steps;
    if (request.progress) request.progress(1);
  };

  std::optional<StepCache> cache;
  if (!request.cache.empty()) cache.emplace(request.cache);
  try {
    const properties::System complete = properties::with_every_measurement(system);
    const ExactProblem problem = properties::exact_problem(complete);
    const auto data = properties::exact_data(complete);
    std::optional<StepCache::Entry> entry;
    // A cache that cannot be written is a pity, not an error.
    const auto keep = [&](auto write) {
      try {
        write();
      } catch (const reports::FileError& error) {
        outcome.warning = error.what();
        entry.reset();
      }
    };
    if (cache) {
      const std::string key = cache_key(problem, data.get(), system.data.get(), system.steps, request.digits);
      const bool known = cache->replay(key, [&](std::string_view line) {
        outcome.interrupted = interrupted();
        if (!outcome.interrupted) done(line);
        return !outcome.interrupted;
      });
      if (known) return outcome;
      keep([&] { entry.emplace(*cache, key); });
    }

    Computation computation(problem, data, system.data.get(), request.digits);
    for (std::int64_t k = 0; k < system.steps; ++k) {
      outcome.interrupted = interrupted();
      if (outcome.interrupted) return outcome;
      const std::string line = computation.next();
      if (entry) keep([&] { entry->add(line); });
      done(line);
    }
    if (entry) keep([&] { entry->commit(); });
  } catch (const reference::ReferenceError& error) {
    outcome.error = error.what();
  }
  return outcome;
}

}  // namespace kfstab::experiments
