#pragma once

#include <cstdint>
#include <functional>
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

/// What systems are drawn. The sizes drawn grow with RapidCheck's size: only at 100 are the whole ranges used, uniformly.
struct Options {
  Range n{1, 6};
  Range m{0, 4};
  Range p{0, 6};
  std::int64_t most_steps = 12;
  /// The ladder of condition numbers: the worst of a system, of A in its singular values and of Q, R and P0 in theirs, is 1e2 in
  /// half of all systems, 1e4 in a quarter, 1e8 and this in an eighth each, and never above this, which is >= 1. That is P0's, if
  /// n > 1; the others' are powers of 100 up to it, 1 among them. Above 1e14 a covariance may be definite no more when rounded.
  double worst_condition = 1e12;
  /// The largest spectral radius of a (single) A; above 1 in a quarter of all.
  double largest_radius = 1.25;
  /// Draw systems whose matrices change from step to step, a quarter of all: each matrix in half of these.
  bool time_varying = true;
  /// Draw a singular A, Q or P0, each in a sixth of all systems. R is always positive definite.
  bool singular = true;
  /// Draw data, in seven eighths of all systems; in a third of those D and u, one to three.
  bool data = true;
  /// Leave measurements out, in a quarter of the systems with data and outputs: in half of these (and where p = 1)
  /// whole steps, else single entries.
  bool missing = true;
  /// In an eighth of all systems states and measurements are in units of 2^-20 to 2^20: one for all measurements, and in half
  /// of these systems one for all states.
  bool units = true;
};

/// Systems. Q, R and P0 are full (two thirds) or diagonal or (not R) singular, each written as a covariance or as a root;
/// A, and the covariances, have singular values as LAPACK's DLATMS draws them, modes 1 to 5, in random orthogonal frames. A
/// is symmetric in a sixth of those with n > 1, orthogonal but for a factor where its condition number is 1, else not normal; in
/// a sixth of them some states are unobservable, for A is reducible then. x0 is 0 in a quarter. x0, y and u are of magnitudes of their own, 2^-10 to 2^10. Data
/// are any numbers, not those that the system would make.
///
/// A failing system shrinks to fewer steps, to matrices that do not change, to no data, to smaller p, m and n, nothing missing, and
/// to entries 0, 1 and powers of two; what is shrunk is valid too.
rc::Gen<System> systems(const Options& options = {});

/// The smallest system found that fails, starting from one that does, and how many times it was made smaller: no single
/// shrink of it fails any more. The boldest are tried first, so that few systems are. fails must not throw.
std::pair<System, std::size_t> smallest_of(const System& failing, const Options& options,
                                           const std::function<bool(const System&)>& fails);

/// What of the drawn system turned out not to matter, in words: "B and Q do not matter", "one step is enough", "no data
/// needed".
std::vector<std::string> irrelevant(const System& drawn, const System& smallest);

/// To which of the classes that a check wants to have seen the system belongs: "n = 1", "p > n", "correlated R" ... Of a
/// matrix that changes over time the first decides what is singular, unstable or ill-conditioned ("k >= 1e8").
std::vector<std::string> classes(const System& system);

/// System number k of the cases of a seed, sizes growing from the smallest to the whole of the ranges. The same seed and cases
/// are the same systems, whatever the environment says.
System drawn_system(const rc::Gen<System>& gen, std::uint64_t seed, int number, int cases);

}  // namespace kfstab::properties
