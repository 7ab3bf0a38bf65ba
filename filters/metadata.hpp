#pragma once

#include <string_view>

#include <kfstab/filters/state_space.hpp>

namespace kfstab {

/// What a filter holds between steps.
enum class Held {
  covariance,          ///< P
  covariance_factor,   ///< S, lower, P = S S'
  information_factor,  ///< T, upper, P^{-1} = T'T
};

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
  std::string_view operations;  ///< leading cost of a step, in multiply-adds
  std::string_view source;      ///< who said it first, and the routine that does the same
};

}  // namespace kfstab
