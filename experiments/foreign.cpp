#include <kfstab/experiments/foreign.hpp>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <utility>

#include <fmt/format.h>

#include <kfstab/filters/registry.hpp>

namespace kfstab::experiments {

using properties::Answer;
using properties::Ending;
using properties::StepInput;

namespace {

/// A name as an id: of figures, of columns, of a file.
std::string id_of(const std::string& name, const std::vector<std::string_view>& taken) {
  std::string id;
  for (const char c : name) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) || c == '.';
    if (plain)
      id += c;
    else if (!id.empty() && id.back() != '-')
      id += '-';
  }
  while (!id.empty() && id.back() == '-') id.pop_back();
  if (id.empty()) id = "foreign";
  std::string unique = id;
  for (int number = 2; std::ranges::find(taken, unique) != taken.end(); ++number)
    unique = fmt::format("{}-{}", id, number);
  return unique;
}

std::string what(const Ending& ending) {
  return ending.kind == Ending::Kind::refused ? fmt::format("says no: {}", ending.reason) : ending.reason;
}

}  // namespace

class Foreign::Driven final : public AnyFilter<double> {
 public:
  Driven(Foreign& owner, std::unique_ptr<properties::StepwiseFilter> filter)
      : owner_(owner), filter_(std::move(filter)) {}
  ~Driven() override {
    const std::lock_guard lock(owner_.mutex_);
    owner_.idle_.push_back(std::move(filter_));
  }

  const Metadata& metadata() const override { return owner_.metadata_; }

  void start(const AnyProblem<double>& problem) override {
    problem_ = std::get_if<Problem<CovarianceModel<double>>>(&problem);
    if (!problem_) throw std::invalid_argument(owner_.id_ + " takes covariances");
    if (const auto ended = filter_->start(problem_->dimensions(), problem_->x0, problem_->initial))
      throw ForeignStop(what(*ended));
  }

  Step<double> step(std::int64_t k, const Vector<double>* y, const Vector<double>* inputs) override {
    Step<double> result;
    const auto& now = problem_->model(k);
    // Without data every y is as good as any other.
    const Vector<double> no_data = Vector<double>::Zero(now.C.rows());
    const Vector<double>* measured = now.C.rows() == 0 ? nullptr : y ? y : &no_data;
    if (owner_.traits_.starts_predicted) {
      take(filter_->step({now.A, now.B, now.C, now.Q, now.R, inputs ? &now.D : nullptr, inputs, measured}));
    } else if (k == 0) {
      const Index n = now.A.rows();
      take(filter_->step({Matrix<double>::Identity(n, n), Matrix<double>::Zero(n, now.B.cols()), now.C, now.Q, now.R,
                          nullptr, nullptr, measured}));
    } else {
      const auto& before = problem_->model(k - 1);
      const bool input = u_before_.size() > 0;
      take(filter_->step({before.A, before.B, now.C, before.Q, now.R, input ? &before.D : nullptr,
                          input ? &u_before_ : nullptr, measured}));
    }
    u_before_ = inputs ? *inputs : Vector<double>();
    result.held = &answer_.held;
    if (answer_.gain) result.gain = &*answer_.gain;
    if (y && answer_.state) result.state = &*answer_.state;
    return result;
  }

 private:
  void take(std::variant<Answer, Ending> stepped) {
    if (const auto* ended = std::get_if<Ending>(&stepped)) throw ForeignStop(what(*ended));
    answer_ = std::get<Answer>(std::move(stepped));
    if (holds_root(answer_.holds) != holds_root(owner_.metadata_.holds))
      throw ForeignStop("answers with P here and with S there");
    if (!answer_.held.allFinite() || (answer_.gain && !answer_.gain->allFinite()) ||
        (answer_.state && !answer_.state->allFinite()))
      throw ForeignStop("its answer holds a NaN or an infinity");
  }

  Foreign& owner_;
  std::unique_ptr<properties::StepwiseFilter> filter_;
  const Problem<CovarianceModel<double>>* problem_ = nullptr;
  Answer answer_;
  Vector<double> u_before_;
};

Foreign::Foreign(std::function<std::unique_ptr<properties::StepwiseFilter>()> open,
                 const std::vector<std::string_view>& taken)
    : open_(std::move(open)) {
  auto filter = open_();
  const Matrix<double> one = Matrix<double>::Ones(1, 1);
  const Vector<double> zero = Vector<double>::Zero(1);
  if (!filter->start({1, 1, 1}, zero, one)) filter->step({one, one, one, one, one, nullptr, nullptr, &zero});
  traits_ = filter->traits();
  idle_.push_back(std::move(filter));
  id_ = id_of(traits_.name, taken);
  title_ = traits_.name;
  roundoff_ = traits_.roundoff;
  metadata_.id = id_;
  metadata_.title = title_;
  // Of an information filter, too, it is P that is answered.
  metadata_.holds = holds_root(traits_.holds) ? Held::covariance_root : Held::covariance;
  metadata_.instant = traits_.instant;
  metadata_.gain = traits_.gain.value_or(GainKind::predictor);
  metadata_.needs = traits_.needs;
  metadata_.source = "another program";
}

Foreign::~Foreign() = default;

void Foreign::give_up(const properties::SubjectFault& fault) {
  const std::lock_guard lock(mutex_);
  if (!fault_) fault_ = fault.what();
}

std::optional<std::string> Foreign::fault() const {
  const std::lock_guard lock(mutex_);
  return fault_;
}

std::optional<properties::Refusal> Foreign::refusal(const properties::System& system) const {
  if (const auto why = fault()) return properties::Refusal{*why};
  if (auto why = properties::refusal(traits_, system)) return why;
  if (!traits_.starts_predicted && traits_.needs.time_invariant)
    return properties::Refusal{id_ +
                               " needs a time-invariant system and predicts first: it cannot start from P_{0|-1}"};
  return std::nullopt;
}

std::unique_ptr<properties::StepwiseFilter> Foreign::take() {
  {
    const std::lock_guard lock(mutex_);
    if (!idle_.empty()) {
      auto filter = std::move(idle_.back());
      idle_.pop_back();
      return filter;
    }
  }
  return open_();
}

std::unique_ptr<AnyFilter<double>> Foreign::make() { return std::make_unique<Driven>(*this, take()); }

properties::Limits ForeignArguments::limits() const {
  properties::Limits limits;
  limits.reply = std::chrono::milliseconds(static_cast<std::int64_t>(timeout * 1000));
  limits.startup = std::max(limits.startup, limits.reply);
  limits.memory = static_cast<std::uint64_t>(memory) << 20;
  return limits;
}

bool report_faults(const std::vector<std::unique_ptr<Foreign>>& foreign) {
  bool any = false;
  for (const auto& one : foreign)
    if (const auto fault = one->fault()) {
      fmt::print(stderr, "kfstab: {}\n", *fault);
      any = true;
    }
  return any;
}

std::vector<std::unique_ptr<Foreign>> open_foreign(const ForeignArguments& arguments) {
  std::vector<std::unique_ptr<Foreign>> all;
  std::vector<std::string_view> taken;
  for (const Metadata& metadata : filters()) taken.push_back(metadata.id);
  const auto add = [&](std::function<std::unique_ptr<properties::StepwiseFilter>()> open) {
    all.push_back(std::make_unique<Foreign>(std::move(open), taken));
    taken.push_back(all.back()->metadata().id);
  };
  const properties::Limits limits = arguments.limits();
  for (const std::string& command : arguments.commands) add([=] { return properties::exec_filter(command, limits); });
  for (const std::string& library : arguments.plugins) add([=] { return properties::plugin_filter(library, limits); });
  return all;
}

}  // namespace kfstab::experiments
