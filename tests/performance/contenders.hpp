#pragma once
// Who takes part. What is compiled for vectors of different lengths meets here alone, so nothing here comes from Eigen or
// from kfstab: each of those sources has them under a name of its own (CMakeLists.txt).

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace performance {

struct Shape {
  int n, m, p;
};

/// Every number that some contender takes, matrices column by column; names as in docs/conventions.md.
struct System {
  Shape shape{};
  std::vector<double> A, B, C, Q, R, P0;
  std::vector<double> Q_root, R_root, S0;
  std::vector<double> A_inverse, A_inverse_B, Q_inverse_root, R_inverse_root, T0;
  std::vector<double> T0_filtered;  ///< T of k = 0|0, where the peers of srif begin
  std::vector<double> x0, y;
};

/// Somebody's filter, started.
struct Contender {
  std::function<bool()> step{};  ///< whether it went well
  /// What it holds, multiplied out: P, S S' or T'T, in the coordinates of the model.
  std::function<std::vector<double>()> product{};
  int filters = 1;  ///< that one step advances: batches have several
};

// Empty where there is no such thing.
using Maybe = std::optional<Contender>;

// Without gain a covariance form makes its factor alone, an information form the state and rcond, as its peer does.

/// Ours, sizes known at run time: as the built library has it, with the kernels that it chooses when it runs.
Maybe ours_dynamic(const std::string& filter, const System& system, bool gain);
/// Ours, 64 filters of one shape at once, sizes known at run time.
Maybe ours_batch(const std::string& filter, const System& system, bool gain);
/// Ours, sizes known to the compiler: a header, compiled with -O3 -march=native.
Maybe ours_fixed(const std::string& filter, const System& system, bool gain);
/// The same, 64 filters at once, where sizes are so small that the compiler makes a kernel for them.
Maybe ours_batch_fixed(const std::string& filter, const System& system, bool gain);

/// SLICOT's routine for what the filter does. FB01SD and FB01TD have no gain.
Maybe slicot(const std::string& routine, const System& system, bool gain);

/// As one writes it down with Eigen, compiled as ours_fixed is: the QR factors of the whole pre-array.
Maybe eigen_qr(const System& system, bool gain);
Maybe eigen_qr_fixed(const System& system, bool gain);
/// K = A P C' (C P C' + R)^{-1} and P+ = A (I - Kf C) P A' + B Q B'.
Maybe eigen_textbook(const System& system);
Maybe eigen_textbook_fixed(const System& system);

/// X Y of order 256 by SLICOT's BLAS.
constexpr int dgemm_order = 256;
Maybe dgemm();
/// As many multiply-adds, of vectors that stay in registers and wait for nothing: what this processor can do at all.
Contender multiply_adds();

/// SLICOT's BLAS: its file, and the kernels that it chose; what is missing if there is none.
std::string blas();

}  // namespace performance
