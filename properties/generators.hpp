#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <rapidcheck/Gen.h>

#include <kfstab/properties/system.hpp>

/// Random systems, for laws to be tried on. Each is valid by construction, none is drawn and thrown away.
namespace kfstab::properties {

/// From least to most, both included.
struct Range {
  Index least = 0;
  Index most = 0;
};

/// What systems are drawn. The sizes drawn grow with RapidCheck's size: only at 100 are the whole ranges used.
struct Options {
  Range n{1, 6};
  Range m{0, 4};
  Range p{0, 6};
  std::int64_t most_steps = 12;
  /// Condition numbers, of A in its singular values and of Q, R and P0 in theirs, are powers of 100 up to this; >= 1. Above
  /// 1e14 a covariance may be definite no more when rounded.
  double worst_condition = 1e6;
  /// The largest spectral radius of a (single) A.
  double largest_radius = 1.25;
  /// Draw systems whose matrices change from step to step, a quarter of all.
  bool time_varying = true;
  /// Draw a singular A, Q or P0, each in a sixth of all systems. R is always positive definite.
  bool singular = true;
  /// Draw data in which entries of y are missing, in a quarter of all systems.
  bool missing = true;
};

/// Systems without data. Q, R and P0 are full, diagonal or (not R) singular, each written as a covariance or as a root;
/// A, and the covariances, have singular values as LAPACK's DLATMS draws them, modes 1 to 5, in random orthogonal frames.
///
/// A failing system shrinks to fewer steps, to matrices that do not change, to smaller p, m and n, and to entries 0, 1 and
/// powers of two; what is shrunk is valid too, and so few steps lead to the end that thousands of systems can be shrunk.
rc::Gen<System> systems(const Options& options = {});

/// The smallest system found that fails, and how it was found.
struct Counterexample {
  System system;
  System drawn;            ///< as it was before it was shrunk
  int number = 0;          ///< which of the cases failed, counted from 0
  std::size_t shrinks = 0; ///< how many times it could be made smaller
};

/// Tries the systems number 0 to cases - 1 of a seed, sizes growing from the smallest to the whole of the generator's range,
/// and shrinks the first that fails. The same seed and cases try the same systems, whatever the environment says.
/// fails must not throw.
std::optional<Counterexample> smallest_failure(const rc::Gen<System>& gen, const std::function<bool(const System&)>& fails,
                                               std::uint64_t seed, int cases);

/// The smallest system found that fails, starting from one that does, and how many times it was made smaller.
std::pair<System, std::size_t> smallest_of(const System& failing, const Options& options,
                                           const std::function<bool(const System&)>& fails);

/// To which of the classes that a check wants to have seen the system belongs: "n = 1", "p > n", "correlated R" ...
std::vector<std::string> classes(const System& system);

/// System number k of a seed, as smallest_failure tries it.
System drawn_system(const rc::Gen<System>& gen, std::uint64_t seed, int number, int cases);

}  // namespace kfstab::properties
