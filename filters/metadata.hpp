#pragma once

#include <initializer_list>
#include <string_view>

#include <kfstab/filters/state_space.hpp>
#include <kfstab/filters/step_report.hpp>

namespace kfstab {

/// What a filter holds between steps.
enum class Held {
  covariance,          ///< P
  covariance_factor,   ///< S, lower, P = S S'
  covariance_root,     ///< F, square and full, P = F F'
  ud_factors,          ///< D on the diagonal, the unit upper triangular U above it: P = U D U'
  information_factor,  ///< T, upper, P^{-1} = T'T
  information,         ///< Y = P^{-1}
  gain,                ///< nothing of P: increments of what the gain is made of
};

/// P cannot be indefinite, and rounding loses the root of what it loses where P itself is held.
constexpr bool holds_root(Held held) {
  return held == Held::covariance_factor || held == Held::covariance_root || held == Held::ud_factors;
}

/// What is held, in the notation of docs/theory.md.
constexpr const char* notation(Held held) {
  switch (held) {
    case Held::covariance: return "P";
    case Held::covariance_factor: return "S, P = S S'";
    case Held::covariance_root: return "F, P = F F'";
    case Held::ud_factors: return "U and D, P = U D U'";
    case Held::information_factor: return "T, P^-1 = T'T";
    case Held::information: return "Y = P^-1";
    case Held::gain: return "K";
  }
  return "";
}

/// Of which instant: P_{k|k-1} or P_{k|k}.
enum class Instant { predicted, filtered };

/// Which gain a filter computes: A P C' Re^{-1} or P C' Re^{-1}.
enum class GainKind { predictor, filter };

/// How symmetry is kept, which decides how an asymmetric error grows (theory (3.i)-(3.v)).
enum class Asymmetry {
  none,      ///< one triangle is computed, or a factor is held
  textbook,  ///< (i)
  mixed,     ///< (ii)
  gain,      ///< (iii)
  cp,        ///< (iv)
  downdate,  ///< (v)
};

/// What must hold of a system before a filter applies to it.
struct Needs {
  bool invertible_A = false;
  bool positive_definite_Q = false;
  bool positive_definite_R = false;
  bool positive_definite_P0 = false;
  bool time_invariant = false;
};

/// A set of statuses.
class Statuses {
 public:
  /// What every filter may report, non_finite_input and overflow, and those given.
  constexpr Statuses(std::initializer_list<Status> own = {}) {
    for (const Status status : {Status::non_finite_input, Status::overflow}) bits_ |= bit(status);
    for (const Status status : own) bits_ |= bit(status);
  }
  constexpr bool has(Status status) const { return (bits_ & bit(status)) != 0; }

 private:
  static constexpr unsigned bit(Status status) { return 1u << static_cast<unsigned>(status); }
  unsigned bits_ = 0;
};

/// Everything that there is to say of a filter without running it. One line of registry.inc makes one.
struct Metadata {
  std::string_view id;     ///< as the command line knows it: "srcf"
  std::string_view title;  ///< "square-root covariance filter"
  std::string_view update; ///< its equation, in the notation of docs/theory.md
  Parametrisation takes = Parametrisation::covariance;
  Held holds = Held::covariance;
  Instant instant = Instant::predicted;
  GainKind gain = GainKind::predictor;
  Asymmetry asymmetry = Asymmetry::none;
  Needs needs = {};
  Statuses statuses;            ///< how a step may fail
  std::string_view operations;  ///< leading cost of a step, in multiply-adds
  std::string_view source;      ///< who said it first, and the routine that does the same
};

}  // namespace kfstab
