#pragma once

#include <kfstab/reference/detail/fused_dot.hpp>

/// Products of matrices of mpfr numbers, fast: by exact products of matrices of doubles where that pays (Ozaki, Ogita,
/// Oishi & Rump, "Error-free transformations of matrix multiplication", Numer. Algorithms 59, 2012), else by fused_dot.
namespace kfstab::reference::detail {

/// A matrix of mpfr numbers of one precision, wherever they lie; strides in bytes.
struct Entries {
  const void* first;
  std::ptrdiff_t down, across;

  Entries transposed() const { return {first, across, down}; }
  /// Row i from its entry j on, and column j from its entry i on.
  Line row(Index i, Index j = 0) const { return {static_cast<const char*>(first) + i * down + j * across, across}; }
  Line column(Index j, Index i = 0) const { return {static_cast<const char*>(first) + i * down + j * across, down}; }
};

/// Where a product goes: as Entries, and written to.
struct Results {
  void* first;
  std::ptrdiff_t down, across;

  Results transposed() const { return {first, across, down}; }
  __mpfr_struct& operator()(Index i, Index j) const {
    return *reinterpret_cast<__mpfr_struct*>(static_cast<char*>(first) + i * down + j * across);
  }
};

struct Shape {
  Index rows, inner, cols;
};

enum class Structure { general, symmetric };

/// Z = X Y or Z += X Y (or -=); X is rows x inner, Y inner x cols. Of a symmetric result the lower triangle is
/// computed, and mirrored. Z shares no entry with X and Y. All numbers have one precision of p bits.
///
/// Each entry is right to 2^-p (|z| + 1/4 |z_before| + 3/2 (|X| |Y|)_ij), as a dot product of its own would be, however
/// the rows and columns are scaled; where all its terms are 0, a product is 0.
void multiply(Results Z, Into into, Entries X, Entries Y, Shape shape, Structure structure);

// ---- the two ways of multiply, for tests and measurements ----

void multiply_by_dots(Results Z, Into into, Entries X, Entries Y, Shape shape, Structure structure);

/// How many doubles a vector of the processor's has.
enum class Vectors { of_2, of_4, of_8 };
Vectors widest_vectors();

/// False, and Z is as it was, where that is not possible: nothing to multiply, entries that are not finite, or so far
/// apart that bringing them to common exponents takes half as many bits again.
bool multiply_by_splitting(Results Z, Into into, Entries X, Entries Y, Shape shape, Structure structure,
                           Vectors vectors);

}  // namespace kfstab::reference::detail
