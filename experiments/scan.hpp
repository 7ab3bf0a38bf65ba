#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include <kfstab/properties/system.hpp>
#include <kfstab/properties/system_file.hpp>

/// Systems with something made to vary: what `--scan NAME=VALUES` says.
namespace kfstab::experiments {

/// One quantity and the values that it takes. NAME is one of
///
///     q         one of the file's [parameters]
///     R[0,0]    an entry, counted from 0, of A, B, C, D, Q, R, P0 as the file writes them (or Q_root, R_root, S0); of
///               a covariance the mirrored entry goes with it
///     scale:R   a factor before a matrix, 1 as it is written; of a covariance written by its root, the root of the
///               factor before that
///     bits      the mantissa of the filters; the system stays
///
/// and VALUES are a list, 24,53,64,113, or from:to:log:count or from:to:lin:count, ends included. Numbers may be
/// expressions: 2^-20.
struct Scan {
  enum class Of { parameter, entry, scale, bits };

  std::string name;
  Of of = Of::parameter;
  std::string matrix;  ///< of an entry or a scale
  Index row = 0, col = 0;
  std::vector<double> values;
  bool log = false;  ///< spread by factors, or drawn on a logarithmic axis because they span a hundred
};

/// Throws InputError, at --scan, for what is none of that; for fewer than 2 or more than 1000 values; for bits that are
/// no integers from Rounded::least_bits to Rounded::most_bits.
Scan parse_scan(const std::string& text);

/// The system that a word names (find_system), with one value for each scan in place. Simulated measurements are drawn
/// anew from it, with the same seed. Throws InputError for a name that it does not have and for what is then no system:
/// an indefinite Q, R or P0.
properties::System scanned_system(const std::string& word, properties::Overrides overrides, std::span<const Scan> scans,
                                  std::span<const double> values);

/// A filter's mantissa there: of the scan of bits, or 53.
int scanned_bits(std::span<const Scan> scans, std::span<const double> values);

}  // namespace kfstab::experiments
