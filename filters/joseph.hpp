#pragma once

#include <kfstab/filters/conventional.hpp>

namespace kfstab {

/// The Kalman filter in Joseph's stabilised form, one triangle computed.
///
///     Re = R + C P C',  Kf = P C' Re^{-1},  P_{k|k} = (I - Kf C) P (I - Kf C)' + Kf R Kf',
///     P+ = A P_{k|k} A' + B Q B'                                                                    theory (2.2)
///
/// A sum of two positive semidefinite terms: an error dK of the gain enters P to second order alone, dK Re dK'. The gain
/// itself is no better than the conventional filter's: it comes from the same Re.
///
/// Source: Bucy and Joseph, Filtering for Stochastic Processes with Applications to Guidance (1968). Operations
/// 3 n^3 + n^2 (5p + m)/2.
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
using JosephFilter = SymmetricCovarianceFilter<MeasurementUpdate::joseph, S, N, M, P>;

}  // namespace kfstab
