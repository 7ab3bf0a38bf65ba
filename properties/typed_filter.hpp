#pragma once

#include <concepts>
#include <exception>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>

#include <kfstab/properties/subject.hpp>

/// The door for filters that are C++ types.
namespace kfstab::properties {

/// A filter of sizes known at run time, which holds P or a square root of it:
///
///     struct MyFilter {
///       void start(const Vector<double>& x, const Matrix<double>& P);  // x_{0|-1}, P_{0|-1}
///       void step(const StepInput& in);                                // takes *in.y, if there is one, then predicts
///       Vector<double> state() const;                                  // x_{k+1|k}
///       Matrix<double> covariance() const;                             // P_{k+1|k}; or covariance_root(): S, P = S S'
///       Matrix<double> filter_gain() const;                            // optional; or predictor_gain()
///       double log_likelihood() const;                                 // optional: of y_k
///       static Traits traits();                                        // optional: what it needs; whether it predicts first
///     };
///
/// A new one is made for every problem. start and step may return false, or throw, to say that they cannot: that is a
/// refusal, not a wrong answer. A filter whose traits() say that it does not start predicted gets x_{0|0}, P_{0|0}, and in each
/// step predicts with in.A, in.B, in.Q and D u before it takes y with in.C and in.R.
template <class Filter>
concept CheckableFilter = std::default_initializable<Filter> &&
    requires(Filter filter, const Filter& after, const Vector<double>& x, const Matrix<double>& P,
             const StepInput& input) {
  filter.start(x, P);
  filter.step(input);
  { after.state() } -> std::convertible_to<Vector<double>>;
} &&(
    requires(const Filter& after) {
      { after.covariance() } -> std::convertible_to<Matrix<double>>;
    } ||
    requires(const Filter& after) {
      { after.covariance_root() } -> std::convertible_to<Matrix<double>>;
    });

namespace detail {

template <class Filter>
class TypedFilter final : public StepwiseFilter {
 public:
  explicit TypedFilter(std::string name) {
    if constexpr (requires { Filter::traits(); }) traits_ = Filter::traits();
    if (traits_.name.empty()) traits_.name = std::move(name);
    // What it has functions for is what it answers.
    if constexpr (requires(const Filter& f) { f.predictor_gain(); })
      traits_.gain = GainKind::predictor;
    else if constexpr (requires(const Filter& f) { f.filter_gain(); })
      traits_.gain = GainKind::filter;
    else
      traits_.gain.reset();
    if constexpr (holds_a_root) traits_.holds = Held::covariance_root;
    traits_.takes = Parametrisation::covariance;
    traits_.instant = traits_.starts_predicted ? Instant::predicted : Instant::filtered;
  }

  const Traits& traits() const override { return traits_; }

  std::optional<Ending> start(const Dimensions&, const Vector<double>& x, const Matrix<double>& P) override {
    filter_.emplace();
    return tried([&] { return filter_->start(x, P); });
  }

  std::variant<Answer, Ending> step(const StepInput& input) override {
    if (auto ended = tried([&] { return filter_->step(input); })) return *std::move(ended);
    const Filter& after = *filter_;
    Answer answer;
    answer.state = after.state();
    answer.holds = holds_a_root ? Held::covariance_root : Held::covariance;
    if constexpr (holds_a_root)
      answer.held = after.covariance_root();
    else
      answer.held = after.covariance();
    if (input.y) {
      if constexpr (requires { after.predictor_gain(); })
        answer.gain = after.predictor_gain();
      else if constexpr (requires { after.filter_gain(); })
        answer.gain = after.filter_gain();
      if constexpr (requires { after.log_likelihood(); }) answer.log_likelihood = after.log_likelihood();
    }
    return answer;
  }

 private:
  static constexpr bool holds_a_root = requires(const Filter& f) { f.covariance_root(); };

  template <class Call>
  static std::optional<Ending> tried(const Call& call) {
    try {
      if constexpr (std::convertible_to<decltype(call()), bool>) {
        if (!static_cast<bool>(call())) return Ending{Ending::Kind::refused, -1, "it returned false"};
      } else {
        call();
      }
      return std::nullopt;
    } catch (const std::exception& why) {
      return Ending{Ending::Kind::refused, -1, why.what()};
    }
  }

  Traits traits_;
  std::optional<Filter> filter_;
};

}  // namespace detail

/// The type as a subject of the check engine; `name` is what reports call it, unless its traits() do.
template <CheckableFilter Filter>
std::unique_ptr<Subject> typed_subject(std::string name) {
  return subject(std::make_unique<detail::TypedFilter<Filter>>(std::move(name)));
}

}  // namespace kfstab::properties
