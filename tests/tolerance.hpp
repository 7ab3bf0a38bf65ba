#pragma once

/// What the rooms' tolerances are made of.
namespace kfstab::test {

/// LAPACK's threshold for error / (u (n+m+p) kappa scale).
inline constexpr double threshold = 30;
/// The unit roundoff of double, and the distance of 1 from the next number.
inline constexpr double u = 0x1p-53;
inline constexpr double ulp = 0x1p-52;

}  // namespace kfstab::test
