#include <kfstab/properties/protocol.hpp>

#include <algorithm>
#include <cstdio>
#include <optional>
#include <utility>
#include <vector>

#include <unistd.h>

#include <fmt/format.h>

#include <kfstab/properties/input_error.hpp>
#include <kfstab/properties/json_line.hpp>

namespace kfstab::properties {

namespace {

/// What is quoted of a line.
std::string quote(std::string_view line) {
  constexpr std::size_t most = 120;
  return line.size() <= most ? fmt::format("\"{}\"", line) : fmt::format("\"{}...\"", line.substr(0, most));
}

void ask_about_flushing() { std::fputs("kfstab: no answer for 1 s: does your filter flush its output?\n", stderr); }

/// A word of the shell.
std::string shell_word(const std::string& text) {
  std::string word = "'";
  for (const char c : text) word += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return word + "'";
}

class ProtocolFilter final : public StepwiseFilter {
 public:
  /// name: as messages call it, and it itself if it has none.
  ProtocolFilter(std::string name, std::string command, const Limits& limits)
      : name_(std::move(name)), command_(std::move(command)), limits_(limits) {
    open();
  }
  ~ProtocolFilter() override { close(); }

  const Traits& traits() const override { return traits_; }

  std::optional<Ending> start(const Dimensions& size, const Vector<double>& x, const Matrix<double>& P) override {
    if (!child_) open();
    size_ = size;
    step_ = -1;
    line_.begin();
    line_.text("op", "start");
    line_.integer("n", size.n);
    line_.integer("m", size.m);
    line_.integer("p", size.p);
    line_.vector("x", x);
    line_.matrix("P", P);
    return answered([&]() -> std::optional<Ending> {
      if (child_->babbles()) return unasked();
      if (auto ended = ask(limits_.reply)) return ended;
      if (auto why = refusal()) return why;
      if (message_.truth("ok") != true) throw Malformed("lacks \"ok\":true");
      return std::nullopt;
    });
  }

  std::variant<Answer, Ending> step(const StepInput& input) override {
    // After an answer that was none it was not asked to end.
    if (!child_) return Ending{Ending::Kind::no_answer, -1, "it was stopped"};
    ++step_;
    line_.begin();
    line_.text("op", "step");
    line_.matrix("A", input.A, A_);
    line_.matrix("B", input.B, B_);
    line_.matrix("C", input.C, C_);
    line_.matrix("Q", input.Q, Q_);
    line_.matrix("R", input.R, R_);
    if (input.u) {
      line_.matrix("D", *input.D, D_);
      line_.vector("u", *input.u);
    }
    if (input.y) line_.vector("y", *input.y);
    Answer answer;
    auto ended = answered([&]() -> std::optional<Ending> {
      if (auto e = ask(limits_.reply)) return e;
      if (auto why = refusal()) return why;
      read(answer, input.A.rows(), input.y ? input.C.rows() : -1);
      return std::nullopt;
    });
    if (ended) return *std::move(ended);
    return answer;
  }

 private:
  void open() {
    child_.emplace(command_, limits_);
    line_.begin();
    line_.text("op", "hello");
    line_.integer("protocol", 1);
    step_ = -1;
    size_ = {};
    auto ended = answered([&]() -> std::optional<Ending> {
      if (auto e = ask(limits_.startup)) return e;
      if (auto why = refusal()) return why;
      read_traits();
      return std::nullopt;
    });
    if (ended) refuse("", ended->reason, "an answer to hello: {\"name\":...,\"cycle\":...,\"gain\":...}");
  }

  void close() noexcept {
    if (!child_) return;
    try {
      child_->tell("{\"op\":\"stop\"}\n");
    } catch (const std::exception&) {
      // It has ended before it was told to.
    }
    child_.reset();
  }

  /// Sends line_ and reads what is answered into message_.
  std::optional<Ending> ask(std::chrono::milliseconds limit) {
    const std::string_view answer = child_->ask(line_.end(), limit, silence_);
    try {
      message_.read(answer);
    } catch (const Malformed& why) {
      // What comes after is likely out of step.
      const Ending ended{Ending::Kind::no_answer, -1, fmt::format("its answer {}: {}", why.what(), quote(answer))};
      child_->babbles();
      child_.reset();
      return ended;
    }
    if (!child_->has_more()) return std::nullopt;
    child_->babbles();
    return unasked();
  }

  Ending unasked() {
    child_.reset();
    return {Ending::Kind::no_answer, -1, "it wrote more than one line for an answer"};
  }

  std::optional<Ending> refusal() const {
    for (const char* name : {"error", "unsupported"})
      if (const auto why = message_.text(name)) return Ending{Ending::Kind::refused, -1, *why};
    return std::nullopt;
  }

  /// Does something with the program, and tells of its faults what they came in the middle of.
  template <class Exchange>
  std::optional<Ending> answered(const Exchange& exchange) {
    try {
      return exchange();
    } catch (const Malformed& why) {
      return Ending{Ending::Kind::no_answer, -1, fmt::format("its answer {}", why.what())};
    } catch (const SubjectFault& fault) {
      std::string text = fmt::format("{} {} {}", name_, fault.what(), occasion());
      std::string words = child_ ? child_->last_words() : "";
      child_.reset();
      while (!words.empty() && words.back() == '\n') words.pop_back();
      if (!words.empty()) text += ". The end of what it wrote to stderr:\n" + last_lines(words);
      throw SubjectFault(fault.kind, text);
    }
  }

  std::string occasion() const {
    if (size_ == Dimensions{} && step_ < 0) return "when it was asked for its name (hello)";
    const std::string sizes = fmt::format("n = {}, m = {}, p = {}", size_.n, size_.m, size_.p);
    return step_ < 0 ? fmt::format("at the start of a problem ({})", sizes)
                     : fmt::format("at step {} ({})", step_, sizes);
  }

  static std::string last_lines(const std::string& words) {
    constexpr int most = 8;
    std::size_t begin = words.size();
    for (int lines = 0; begin > 0; --begin)
      if (words[begin - 1] == '\n' && ++lines == most) break;
    std::string text;
    for (const char c : "  " + words.substr(begin)) text += c == '\n' ? std::string("\n  ") : std::string(1, c);
    return text;
  }

  [[noreturn]] void refuse(const std::string& field, const std::string& found, const std::string& expected) const {
    Place place;
    place.origin = name_;
    place.field = field;
    throw InputError(place, found, expected);
  }

  void read_traits() {
    traits_ = {};
    traits_.name = message_.text("name").value_or(command_);
    const auto one_of = [&](const char* field, std::optional<std::string> found,
                            const std::vector<std::string>& words) {
      const auto word = found ? std::ranges::find(words, *found) : words.end();
      if (word == words.end()) {
        std::string expected;
        for (const std::string& w : words) expected += (expected.empty() ? "" : " or ") + quote(w);
        refuse(std::string("hello, ") + field, found ? quote(*found) : "nothing", expected);
      }
      return word - words.begin();
    };
    traits_.starts_predicted = one_of("cycle", message_.text("cycle"), {"update-predict", "predict-update"}) == 0;
    traits_.instant = traits_.starts_predicted ? Instant::predicted : Instant::filtered;
    traits_.gain = std::nullopt;
    if (const auto gain = one_of("gain", message_.text("gain"), {"predictor", "filter", "none"}); gain < 2)
      traits_.gain = gain == 0 ? GainKind::predictor : GainKind::filter;
    if (one_of("precision", message_.text("precision").value_or("double"), {"double", "single"}) == 1)
      traits_.roundoff = unit_roundoff<float>();
    bool* const needs[] = {&traits_.needs.invertible_A,        &traits_.needs.positive_definite_Q,
                           &traits_.needs.positive_definite_R, &traits_.needs.positive_definite_P0,
                           &traits_.needs.time_invariant,      &traits_.measurement_every_step};
    for (const std::string& need : message_.texts("needs").value_or(std::vector<std::string>{}))
      *needs[one_of("needs", need,
                    {"invertible-A", "positive-definite-Q", "positive-definite-R", "positive-definite-P0",
                     "time-invariant", "measurement-every-step"})] = true;
    traits_.holds = traits_.needs.invertible_A ? Held::information : Held::covariance;
  }

  /// p < 0: nothing was measured, and a gain means nothing.
  void read(Answer& answer, Index n, Index p) {
    if (!message_.vector("x", n, state_)) throw Malformed("lacks x");
    answer.state = state_;
    // What it holds, not what it makes of it.
    if (message_.matrix("S", n, n, answer.held))
      traits_.holds = answer.holds = Held::covariance_root;
    else if (!message_.matrix("P", n, n, answer.held))
      throw Malformed("lacks P, and S");
    if (traits_.gain && p >= 0 && message_.matrix("K", n, p, gain_)) answer.gain = gain_;
    answer.log_likelihood = message_.number("loglik");
  }

  std::string name_, command_;
  Limits limits_;
  Traits traits_;
  std::optional<ChildProcess> child_;
  Dimensions size_;
  std::int64_t step_ = -1;
  JsonLine line_;
  JsonLine::Kept A_, B_, C_, Q_, R_, D_;
  JsonMessage message_;
  Vector<double> state_;
  Matrix<double> gain_;
  void (*silence_)() = ::isatty(STDERR_FILENO) ? ask_about_flushing : nullptr;
};

}  // namespace

std::unique_ptr<StepwiseFilter> exec_filter(const std::string& command, const Limits& limits) {
  return std::make_unique<ProtocolFilter>(command, command, limits);
}

std::unique_ptr<StepwiseFilter> plugin_filter(const std::filesystem::path& library, const Limits& limits,
                                              const std::filesystem::path& host) {
  const std::filesystem::path program = host.empty() ? std::filesystem::read_symlink("/proc/self/exe") : host;
  const std::string command =
      fmt::format("exec {} plugin-host {}", shell_word(program.string()), shell_word(library.string()));
  return std::make_unique<ProtocolFilter>(library.string(), command, limits);
}

std::unique_ptr<Subject> exec_subject(const std::string& command, const Limits& limits) {
  return subject(exec_filter(command, limits));
}

std::unique_ptr<Subject> plugin_subject(const std::filesystem::path& library, const Limits& limits,
                                        const std::filesystem::path& host) {
  return subject(plugin_filter(library, limits, host));
}

}  // namespace kfstab::properties
